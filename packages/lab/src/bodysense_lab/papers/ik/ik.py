"""Inverse kinematics: the posed skeleton whose points are closest to target positions, at constant bone lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.posture import posture
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.products import ACROSS, CONJUGATE, LEFT, MATRIX, TANGENT
from bodysense.geometry.rotation import matrix_to_quaternion
from bodysense_lab.papers.ik.normal_equations import NormalEquations

_HALF_LEFT = LEFT[1:] / 2
_NO_JOINT, _NOTHING = np.zeros(0, dtype=np.intp), np.zeros((0, 4, 4))
_FIRST_DAMPING = 1e-3  # after a step that raised the cost
_MOST_DAMPING = 1e6


@dataclass(frozen=True)
class IkSettings:
    """Weights and stopping criteria of inverse kinematics. Weights are relative to a point's weight of 1."""

    max_iterations: int = 20  # steps a frame, at most
    tolerance: float = 3e-5  # m: stop if the error of a linear step is less (root mean square of all points)
    posture_weight: float = 1e-5  # pull toward the relaxed posture where positions leave freedom
    damping: float = 1e-7  # initial Levenberg-Marquardt damping of a frame

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise BodysenseError(f"IK settings: max_iterations is {self.max_iterations}; it must be at least 1")
        for name in ("tolerance", "posture_weight", "damping"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"IK settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False, slots=True)
class PosedBody:
    """A posed body in the world, with the quantities of inverse kinematics."""

    root_position: np.ndarray  # (3,) m
    world_rotation: np.ndarray  # (J, 4) wxyz, world ← joint
    world_matrix: np.ndarray  # (J, 3, 3) as matrices
    local_rotation: np.ndarray  # (J, 4) wxyz, w ≥ 0, parent ← joint
    bone: np.ndarray  # (P − 1, 3) m, from its parent to every point but the root
    position: np.ndarray  # (P, 3) m


@dataclass(frozen=True, eq=False, slots=True)
class IkState:
    """A solved frame: the start of the next frame, and the result."""

    body: PosedBody
    cost: float  # m²: weighted sum of squared distances to the targets, and of turns from orientation targets
    tension: np.ndarray  # (P − 1,) outward pull of the targets on every bone, in points of weight 1 at its end

    @property
    def position(self) -> np.ndarray:
        """(P, 3) m, world: the points of the solved body."""
        return self.body.position


def solve_sequence(ik: InverseKinematics, target: np.ndarray, weight: np.ndarray | None = None) -> Pose:
    """Solve T frames, each from the one before: targets (T, P, 3), weights (T, P) → Pose (T,).

    Shapes, units and errors of a frame are those of `InverseKinematics.solve`.
    """
    state = None
    bodies: list[PosedBody] = []
    for t in range(len(target)):
        _, state = ik.solve(target[t], None if weight is None else weight[t], state=state)
        bodies.append(state.body)
    joints = len(ik.skeleton.joints)
    root = np.array([body.root_position for body in bodies]).reshape(-1, 3)
    return Pose(ik.skeleton, root, np.array([body.local_rotation for body in bodies]).reshape(-1, joints, 4))


class InverseKinematics:
    """Gauss-Newton inverse kinematics of one skeleton; immutable, safe to share between threads.

    Minimises Σᵢ wᵢ |pᵢ − tᵢ|² over all points (world-space position errors, as UNOC does), plus optional orientation
    targets and a tiny pull toward a relaxed posture. That pull determines what positions do not, such as the twist
    of upper arm and thigh: the twist at which elbow or knee bends naturally is preferred.

    The unknowns are the root's position and one world rotation a joint, R ← exp(φ) R, which makes a point a plain sum
    of bones and avoids products along chains; `NormalEquations` solves for them.
    """

    def __init__(self, skeleton: Skeleton, settings: IkSettings | None = None) -> None:
        self.skeleton = skeleton
        self.settings = settings = settings or IkSettings()
        joints = len(skeleton.joints)
        parents = np.array(skeleton.parents)
        self._bone_parent = parents[1:]
        self._spring_parent = np.maximum(parents[:joints], 0)
        self._offset = skeleton.rest_offset[1:, :, None].copy()
        self._path = np.ascontiguousarray(skeleton.path[:, 1:])
        self._path_t = np.ascontiguousarray(self._path.T)
        self._incidence = (np.arange(joints)[:, None] == self._bone_parent).astype(np.float64)
        length = skeleton.bone_length
        self._half_inverse_square = 0.5 / np.maximum(length[1:], 1e-3) ** 2
        self._minus_inverse_square = -2 * self._half_inverse_square
        # The lever of a joint, the length of its longest bone, makes turns comparable with distances.
        lever = np.array([length[parents == joint].max(initial=0.01) for joint in range(joints)])
        self._system = NormalEquations(skeleton, lever)

        anatomy = posture(skeleton)
        stiffness = np.sqrt(settings.posture_weight * anatomy.stiffness) * lever[:, None]
        stiffness[0] = 0  # the root is free in the world
        self._stiffness = stiffness
        self._relaxed = 2 * _half_sine(anatomy.relaxed)

    def solve(
        self,
        target: np.ndarray,
        weight: np.ndarray | None = None,
        rotation_target: np.ndarray | None = None,
        rotation_weight: np.ndarray | None = None,
        state: IkState | None = None,
    ) -> tuple[Pose, IkState]:
        """Solve one frame.

        Args:
            target: (P, 3) m, world: wanted position of each point of the skeleton; NaN where its weight is 0.
            weight: (P,) ≥ 0; 0 ignores a point. None: 1 for every point.
            rotation_target: (J, 4) wxyz, world: wanted rotations of joints; NaN where the weight is 0.
            rotation_weight: (J,) m²/rad² ≥ 0; (0.1 m)² pulls like a point of weight 1 at 0.1 m. None: 0.01 for all.
            state: the frame before; None resets.

        Returns:
            The pose (local rotations, w ≥ 0) and the state for the next frame.

        Raises:
            BodysenseError: shapes do not fit, a weight is negative, a weighted target is not finite, or a weighted
                rotation is not a unit quaternion.
        """
        problem = _problem(self.skeleton, target, weight, rotation_target, rotation_weight)
        if state is None:
            found = self._descend(problem, self._posed(*_aligned(self.skeleton, problem)))
        else:
            found = self._descend(problem, state.body, state.tension)
            # A target that jumped can leave the body in a wrong minimum: check whether a fresh start is better.
            if found.cost > 4 * state.cost + 1e-4 * float(problem.weight.sum()):
                fresh = self._descend(problem, self._posed(*_aligned(self.skeleton, problem)))
                found = fresh if fresh.cost < found.cost else found
        return Pose(self.skeleton, found.body.root_position, found.body.local_rotation), found

    def at(self, root_position: np.ndarray, world_rotation: np.ndarray) -> IkState:
        """Return the state of a body at root (3,) m with joints (J, 4) wxyz, as the start of a frame."""
        body = self._posed(np.array(root_position, dtype=np.float64), np.array(world_rotation, dtype=np.float64))
        return IkState(body, np.inf, np.zeros(len(self._bone_parent)))

    def _descend(self, problem: _Problem, body: PosedBody, tension: np.ndarray | None = None) -> IkState:
        """Run Gauss-Newton from a start; a step that raises the cost is damped until it does not.

        The tension of the frame before predicts the pull after the step better than the new one's: most of the pull at
        its start is the motion since then.
        """
        settings = self.settings
        damping, converged, iteration = settings.damping, False, 0
        enough = settings.tolerance**2 * max(float(problem.weight.sum()), 1e-12)
        pull = self._pull(problem, body)
        tension = self._tension(body, problem.weight[:, None] * pull.error) if tension is None else tension
        while iteration < settings.max_iterations and not converged:
            iteration += 1
            # Derivatives (transposed) of the springs by the joint's own turn; by its parent's they are the opposite.
            slope = body.world_matrix @ ((body.local_rotation @ TANGENT).reshape(-1, 3, 3) * self._stiffness[:, None])
            block = self._curvature(body, tension)
            if problem.aimed.size:
                block[problem.aimed] += _aim(problem, body, pull.away)
            move, turn = self._system.solve(
                bone=body.bone,
                error=pull.error,
                weight=problem.weight,
                slope=slope,
                spring=pull.spring,
                block=block,
                damping=damping,
            )
            trial = self._posed(body.root_position + move, _turned(body.world_rotation, turn))
            trial_pull = self._pull(problem, trial)
            if not trial_pull.total <= pull.total * (1 + 1e-9) + 1e-12:
                damping = min(max(_FIRST_DAMPING, damping * 10), _MOST_DAMPING)
                continue
            swept = trial.bone - body.bone
            body, pull, damping = trial, trial_pull, max(settings.damping, damping * 0.1)
            # The linear step treated bones as straight lines: compute the resulting shortfall of the points.
            bulge = np.einsum("ij,ij->i", swept, swept) * self._half_inverse_square
            short = self._path @ (bulge[:, None] * body.bone)
            neglected = (short * problem.root_weight).ravel()
            tension = self._tension(body, problem.weight[:, None] * (pull.error + short))
            converged = bool(neglected.dot(neglected) <= enough)
        return IkState(body, pull.cost, tension)

    def _posed(self, root: np.ndarray, rotation: np.ndarray) -> PosedBody:
        """Forward kinematics from world rotations (J, 4)."""
        matrix = ((rotation[:, :, None] * rotation[:, None, :]).reshape(-1, 16) @ MATRIX).reshape(-1, 3, 3)
        bone = (matrix.take(self._bone_parent, axis=0) @ self._offset)[:, :, 0]
        position = self._path @ bone
        position += root
        parent = (rotation * CONJUGATE).take(self._spring_parent, axis=0)
        local = ((parent @ LEFT).reshape(-1, 4, 4) @ rotation[:, :, None])[:, :, 0]
        local[0] = rotation[0]
        local *= np.copysign(1.0, local[:, :1])
        return PosedBody(root, rotation, matrix, local, bone, position)

    def _pull(self, problem: _Problem, body: PosedBody) -> _Pull:
        """Compute the distance of a body from the targets and from the relaxed posture."""
        error = body.position - problem.target
        weighted = (error * problem.root_weight).ravel()
        cost = float(weighted.dot(weighted))
        away = problem.aim @ body.world_rotation[problem.aimed, :, None] if problem.aimed.size else _NOTHING
        if problem.aimed.size:
            turned = 2 * away[:, 1:].ravel()
            cost += float(turned.dot(turned))
        spring = self._stiffness * (2 * body.local_rotation[:, 1:] - self._relaxed)
        energy = float(spring.ravel().dot(spring.ravel()))
        return _Pull(error, spring, away, cost, cost + energy)

    def _tension(self, body: PosedBody, force: np.ndarray) -> np.ndarray:
        """Return (P − 1,) the outward pull of forces (P, 3) on every bone; 0 if they push."""
        along = np.einsum("ij,ij->i", self._path_t @ force, body.bone)
        return np.maximum(along * self._minus_inverse_square, 0.0)

    def _curvature(self, body: PosedBody, tension: np.ndarray) -> np.ndarray:
        """Return (J, 3, 4) contributions of tension to the joints' normal matrices and right sides.

        A bone that is pulled outward, its target beyond its length, resists turning more than in the linear model;
        without that second-order term Gauss-Newton overshoots on noisy targets. The opposite term, of pushed bones,
        would break positive definiteness and is omitted.
        """
        taut = body.bone * tension[:, None]
        outer = (taut[:, :, None] * body.bone[:, None, :]).reshape(-1, 9)
        return (self._incidence @ (outer @ ACROSS)).reshape(-1, 3, 4)


@dataclass(frozen=True, eq=False, slots=True)
class _Problem:
    """The targets of one frame, with unknown ones replaced by zeros of weight 0."""

    target: np.ndarray  # (P, 3)
    weight: np.ndarray  # (P,)
    root_weight: np.ndarray  # (P, 1) its square roots
    aimed: np.ndarray  # (A,) joints with an orientation target
    aim: np.ndarray  # (A, 4, 4) multiplies by the inverse of the target, and by the square root of its weight


@dataclass(frozen=True, eq=False, slots=True)
class _Pull:
    """Residuals of a body."""

    error: np.ndarray  # (P, 3) m, points minus targets
    spring: np.ndarray  # (J, 3) weighted distance of local rotations from their rest
    away: np.ndarray  # (A, 4, 1) weighted rotations of joints from their orientation targets
    cost: float  # m²: of points and orientation targets
    total: float  # m²: and of posture


def _problem(
    skeleton: Skeleton,
    target: np.ndarray,
    weight: np.ndarray | None,
    rotation_target: np.ndarray | None,
    rotation_weight: np.ndarray | None,
) -> _Problem:
    target, weight = _known("target", target, weight, full=1.0, of=skeleton.points, width=3)
    root_weight = np.sqrt(weight)[:, None]
    if rotation_target is None:
        return _Problem(target, weight, root_weight, _NO_JOINT, _NOTHING)
    turn, turn_weight = _known(
        "rotation_target", rotation_target, rotation_weight, full=0.01, of=skeleton.joints, width=4
    )
    aimed = np.flatnonzero(turn_weight)
    turn = turn[aimed]
    length = np.sqrt(np.einsum("ij,ij->i", turn, turn))
    if (np.abs(length - 1) > 1e-3).any():
        worst = int(np.argmax(np.abs(length - 1)))
        raise BodysenseError(
            f"inverse kinematics: the rotation_target of {skeleton.joints[aimed[worst]]!r} has length "
            f"{length[worst]:g}; give a unit quaternion (wxyz)"
        )
    inverse = turn * CONJUGATE * np.sqrt(turn_weight[aimed])[:, None]
    return _Problem(target, weight, root_weight, aimed, (inverse @ LEFT).reshape(-1, 4, 4))


def _known(
    name: str, target: np.ndarray, weight: np.ndarray | None, *, full: float, of: tuple[str, ...], width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a target (N, width) with zeros where its weight is 0, and its weights (N,)."""
    target = np.asarray(target, dtype=np.float64)
    if target.shape != (len(of), width):
        raise BodysenseError(f"inverse kinematics: {name} has shape {target.shape}; it must be {(len(of), width)}")
    if weight is None:
        weight = np.full(len(of), full)
    else:
        weight = np.asarray(weight, dtype=np.float64)
        if weight.shape != (len(of),):
            raise BodysenseError(
                f"inverse kinematics: the weights of {name} have shape {weight.shape}; they must be {(len(of),)}"
            )
        if not (weight.min() >= 0 and weight.max() < np.inf):
            bad = int(np.argmin((weight >= 0) & (weight < np.inf)))
            raise BodysenseError(
                f"inverse kinematics: the {name} of {of[bad]!r} has weight {weight[bad]:g}; "
                "weights are finite and not negative, 0 to ignore"
            )
        if not weight.all():
            target = np.where(weight[:, None] > 0, target, 0.0)
    if not np.isfinite(target).all():
        bad = int(np.argmin(np.isfinite(target).all(axis=1)))
        raise BodysenseError(
            f"inverse kinematics: the {name} of {of[bad]!r} is not finite; give it weight 0 to ignore it"
        )
    return target, weight


def _aim(problem: _Problem, body: PosedBody, away: np.ndarray) -> np.ndarray:
    """Return normal matrices and right sides (A, 3, 4) of the orientation targets.

    An error is twice the vector part of target⁻¹ · rotation, of either sign: the angle if it is small.
    """
    slope = body.world_matrix[problem.aimed] @ (away[:, :, 0] @ TANGENT).reshape(-1, 3, 3)
    return slope @ np.concatenate((slope.mT, 2 * away[:, 1:]), axis=2)


def _turned(rotation: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Turn rotations (J, 4) in the world by small rotation vectors (J, 3); Cayley's map, never half a turn."""
    half = (turn @ _HALF_LEFT).reshape(-1, 4, 4)
    turned = rotation + (half @ rotation[:, :, None])[:, :, 0]
    turned /= np.sqrt(np.einsum("ij,ij->i", turned, turned))[:, None]
    return turned


def _half_sine(rotation_vector: np.ndarray) -> np.ndarray:
    """Return the vector part of rotation vectors' quaternions: (J, 3) → (J, 3)."""
    return rotation_vector * np.sinc(np.linalg.norm(rotation_vector, axis=1, keepdims=True) / (2 * np.pi)) / 2


def _aligned(skeleton: Skeleton, problem: _Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return a closed-form start: from the root down, every joint is turned to point its bones at their targets."""
    known = problem.weight > 0
    offset, parents = skeleton.rest_offset, np.array(skeleton.parents)
    joints = len(skeleton.joints)
    rotation = np.broadcast_to(np.eye(3), (joints, 3, 3)).copy()
    position = np.zeros((joints, 3))
    position[0] = offset[0]
    if known.any():
        rest = skeleton.path @ offset
        share = problem.weight[known, None] / problem.weight[known].sum()
        middle, rest_middle = (share * problem.target[known]).sum(axis=0), (share * rest[known]).sum(axis=0)
        scatter = (share * (problem.target[known] - middle)).T @ (rest[known] - rest_middle)
        rotation[0] = _nearest_rotation(scatter + 1e-3 * (np.linalg.norm(scatter) + 1e-9) * np.eye(3))
        position[0] = problem.target[0] if known[0] else middle - rotation[0] @ rest_middle
    for joint in range(joints):
        if joint:
            parent = parents[joint]
            rotation[joint] = rotation[parent]
            position[joint] = position[parent] + rotation[parent] @ offset[joint]
        children = np.flatnonzero((parents == joint) & known)
        if children.size:
            # The parent's rotation, with a small weight, determines what too few bones do not: the shortest arc.
            here = problem.target[joint] if known[joint] else position[joint]
            scatter = (problem.target[children] - here).T @ offset[children]
            weak = 1e-3 * (offset[children] ** 2).sum() + 1e-9
            rotation[joint] = _nearest_rotation(scatter + weak * rotation[joint])
    return position[0], matrix_to_quaternion(rotation)


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """Return the rotation R that maximises tr(Rᵀ M): (3, 3) → (3, 3). Kabsch 1976."""
    u, _, v = np.linalg.svd(matrix)
    return (u * [1, 1, np.sign(np.linalg.det(u @ v))]) @ v
