"""Inverse kinematics: the posed skeleton whose points are closest to target positions, at constant bone lengths."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise
from struct import pack, unpack

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.posture import posture
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import load_library
from bodysense.geometry.rotation import matrix_to_quaternion

_Pointer = ctypes.c_void_p
_FIRST_DAMPING = 1e-3  # after a step that raised the cost
_MOST_DAMPING = 1e6
_REACHED = "5Pdi0P"  # bs_reached: root, world, local, position, tension; cost; whether it has a tension


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
    """A posed body in the world."""

    root_position: np.ndarray  # (3,) m
    world_rotation: np.ndarray  # (J, 4) wxyz, world ← joint
    local_rotation: np.ndarray  # (J, 4) wxyz, w ≥ 0, parent ← joint
    position: np.ndarray  # (P, 3) m


@dataclass(frozen=True, eq=False, slots=True)
class IkState:
    """A solved frame: the start of the next frame, and the result."""

    body: PosedBody
    cost: float  # m²: weighted sum of squared distances to the targets, and of turns from orientation targets
    tension: np.ndarray  # (P,) outward pull of the targets on every bone, in points of weight 1 at its end

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
    of bones and avoids products along chains. The compiled core solves for them (core/src/base/targets.c).
    """

    def __init__(self, skeleton: Skeleton, settings: IkSettings | None = None) -> None:
        self.skeleton = skeleton
        self.settings = settings = settings or IkSettings()
        parents, length = np.array(skeleton.parents, np.int32), skeleton.bone_length
        # The lever of a joint, the length of its longest bone, makes turns comparable with distances.
        lever = np.array([length[parents == joint].max(initial=0.01) for joint in range(len(skeleton.joints))])
        anatomy = posture(skeleton)
        stiffness = np.sqrt(settings.posture_weight * anatomy.stiffness) * lever[:, None]
        stiffness[0] = 0  # the root is free in the world
        offset, turn = np.ascontiguousarray(skeleton.rest_offset, np.float64), anatomy.relaxed
        # Twice the vector part of the quaternions of resting rotations.
        relaxed = turn * np.sinc(np.linalg.norm(turn, axis=1, keepdims=True) / (2 * np.pi))
        self._arrays = parents, offset, lever, stiffness, relaxed

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
        most = self.settings.max_iterations
        if state is None:
            found = self._descend(problem, *_aligned(self.skeleton, problem), most)
        else:
            body = state.body
            found = self._descend(problem, body.root_position, body.world_rotation, most, state.tension)
            # A target that jumped can leave the body in a wrong minimum: check whether a fresh start is better.
            if found.cost > 4 * state.cost + 1e-4 * float(problem.weight.sum()):
                fresh = self._descend(problem, *_aligned(self.skeleton, problem), most)
                found = fresh if fresh.cost < found.cost else found
        return Pose(self.skeleton, found.body.root_position, found.body.local_rotation), found

    def at(self, root_position: np.ndarray, world_rotation: np.ndarray) -> IkState:
        """Return the state of a body at root (3,) m with joints (J, 4) wxyz, as the start of a frame."""
        points = len(self.skeleton.points)
        body = self._descend(_Problem(np.zeros((points, 3)), np.zeros(points)), root_position, world_rotation, 0).body
        return IkState(body, np.inf, np.zeros(points))

    def _descend(
        self,
        problem: _Problem,
        root: np.ndarray,
        world: np.ndarray,
        iterations: int,
        tension: np.ndarray | None = None,
    ) -> IkState:
        """Run Gauss-Newton from root (3,) and world rotations (J, 4); a step that raises the cost is damped.

        The tension of the frame before predicts the pull after the step better than the new one's: most of the pull at
        its start is the motion since then.
        """
        settings, core = self.settings, _core()
        joints, points = len(self.skeleton.joints), len(self.skeleton.points)
        body = pack("2i5P", joints, points, *(part.ctypes.data for part in self._arrays))  # bs_posable
        descent = pack("4di0d", settings.tolerance, settings.damping, _FIRST_DAMPING, _MOST_DAMPING, iterations)
        pointers = [part.ctypes.data for part in (problem.target, problem.weight, *(problem.rotation or ()))]
        targets = pack("4P", *pointers, *[0] * (4 - len(pointers)))  # bs_targets
        starts = [0, *accumulate((3, 4 * joints, 4 * joints, 3 * points, points))]
        memory, scratch = np.empty(starts[-1]), np.empty(core.bs_reach_memory(body))
        placed, turned, local, position, pull = (memory[start:end] for start, end in pairwise(starts))
        placed[:], turned[:] = root, np.ravel(world)
        if tension is not None:
            pull[:] = tension
        first = memory.ctypes.data
        members = (*(first + 8 * start for start in starts[:-1]), np.inf, tension is not None)
        reached = bytearray(pack(_REACHED, *members))
        written = ctypes.byref(ctypes.c_char.from_buffer(reached))
        core.bs_reach_targets(body, descent, targets, written, scratch.ctypes.data)
        cost = unpack(_REACHED, reached)[5]
        solved = PosedBody(placed, turned.reshape(-1, 4), local.reshape(-1, 4), position.reshape(-1, 3))
        return IkState(solved, cost, pull)


@dataclass(frozen=True, eq=False, slots=True)
class _Problem:
    """The targets of one frame, with unknown ones replaced by zeros of weight 0."""

    target: np.ndarray  # (P, 3)
    weight: np.ndarray  # (P,)
    rotation: tuple[np.ndarray, np.ndarray] | None = None  # (J, 4) and its weights (J,)


def _problem(
    skeleton: Skeleton,
    target: np.ndarray,
    weight: np.ndarray | None,
    rotation_target: np.ndarray | None,
    rotation_weight: np.ndarray | None,
) -> _Problem:
    target, weight = _known("target", target, weight, full=1.0, of=skeleton.points, width=3)
    if rotation_target is None:
        return _Problem(target, weight)
    turn, turn_weight = _known(
        "rotation_target", rotation_target, rotation_weight, full=0.01, of=skeleton.joints, width=4
    )
    length = np.where(turn_weight > 0, np.sqrt(np.einsum("ij,ij->i", turn, turn)), 1.0)
    if (np.abs(length - 1) > 1e-3).any():
        worst = int(np.argmax(np.abs(length - 1)))
        raise BodysenseError(
            f"inverse kinematics: the rotation_target of {skeleton.joints[worst]!r} has length "
            f"{length[worst]:g}; give a unit quaternion (wxyz)"
        )
    return _Problem(target, weight, (turn, turn_weight))


def _known(
    name: str, target: np.ndarray, weight: np.ndarray | None, *, full: float, of: tuple[str, ...], width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a target (N, width) with zeros where its weight is 0, and its weights (N,)."""
    target = np.ascontiguousarray(target, dtype=np.float64)
    if target.shape != (len(of), width):
        raise BodysenseError(f"inverse kinematics: {name} has shape {target.shape}; it must be {(len(of), width)}")
    if weight is None:
        weight = np.full(len(of), full)
    else:
        weight = np.ascontiguousarray(weight, dtype=np.float64)
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


@lru_cache(maxsize=1)
def _core() -> ctypes.CDLL:
    """Return the compiled core, whose inverse kinematics is not part of `bodysense.h`."""
    loaded = load_library("_core")
    loaded.bs_reach_memory.restype, loaded.bs_reach_memory.argtypes = ctypes.c_size_t, [_Pointer]
    loaded.bs_reach_targets.restype, loaded.bs_reach_targets.argtypes = None, [_Pointer] * 5
    return loaded
