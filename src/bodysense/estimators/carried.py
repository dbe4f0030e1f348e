"""A standing body that its hands carry: for gloves with nothing else of the body tracked.

It faces where the hands point, stands so that both are within reach, and goes, kneels and lifts as it must; its feet
glide. All of it but the hands is made up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.products import CONJUGATE, multiply
from bodysense.body.rotation import matrix_to_quaternion, quaternion_exp, quaternion_rotate
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.whole_body import WholeBody
from bodysense.observation import Observation, observed_points

_FINGERS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # which way they point at rest
_BESIDE = 0.9  # of the distance before the body, by which hands that hang are nearer
GUESSED_ERROR = 0.3  # m: what is expected of a body that is made up


@dataclass(frozen=True)
class CarriedSettings:
    """How a body follows its hands."""

    half_life: float = 0.7  # s in which half of the way to a new heading or place is made
    ahead: float = 0.2  # of the body's height: how far before it hands are held
    reach: float = 0.97  # of an arm's length: hands are not farther from their shoulder
    elbow_half_life: float = 0.1  # s in which half of the way to a new bend is made
    elbow_drop: float = 0.7  # how much elbows hang, beside pointing away from where the hand points
    across: float = 0.7  # how much the line between both hands says of the heading, beside where they point
    longest_gap: float = 1.0  # s without frames after which everything starts afresh

    def __post_init__(self) -> None:
        for name in ("half_life", "elbow_half_life", "reach", "longest_gap"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"carried body: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class CarriedState:
    """Where the body stands, and the hands that carry it."""

    time: float | None = None
    heading: np.ndarray | None = None  # (2,) unit, x and z of where it faces; None until a hand was seen
    root: np.ndarray | None = None  # (3,) m
    wrist: np.ndarray | None = None  # (2, 3) m, from the root
    turn: np.ndarray | None = None  # (2, 4) wxyz, world
    elbow: np.ndarray | None = None  # (2, 3) unit, which way elbows are bent out of the line from shoulder to wrist


@dataclass(frozen=True)
class Carried:
    """An estimator of a whole body from `left_wrist` and `right_wrist`, either or both, with rotations."""

    skeleton: Skeleton
    settings: CarriedSettings = CarriedSettings()

    @cached_property
    def _body(self) -> WholeBody:
        return WholeBody(self.skeleton)

    @cached_property
    def _wrists(self) -> np.ndarray:
        return self.skeleton.indices(["left_wrist", "right_wrist"])

    @cached_property
    def _standing(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (P, 3) from the root and world rotations (J, 4) of a body that stands and faces +Z."""
        pose = standing_pose(self.skeleton)
        position, rotation = forward_kinematics(pose)
        return position - pose.root_position, rotation

    @cached_property
    def _arm(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of both arms the shoulders (2,), lengths (2, 2) m and rest frames (2, 2, 3, 3) of upper and lower bones."""
        lower = self.skeleton.indices([f"{side}_{part}" for part in ("elbow", "wrist") for side in ("left", "right")])
        bones = self.skeleton.rest_offset[lower].reshape(2, 2, 3)
        frames = np.stack([_frames(bone, np.tile([0.0, 1.0, 0.0], (2, 1))) for bone in bones])
        shoulders = self.skeleton.indices(["left_shoulder", "right_shoulder"])
        return shoulders, np.linalg.norm(bones, axis=-1), frames

    def start(self) -> CarriedState:
        """Nothing seen yet."""
        return CarriedState()

    def step(self, observation: Observation, state: CarriedState) -> tuple[PointEstimate, CarriedState]:
        """Complete T frames, one after the other: before the first hand the body stands at the origin, facing +Z."""
        position, rotation, has_position, has_rotation = (
            values[:, self._wrists] for values in observed_points(observation, self.skeleton)
        )
        roots, locals_ = [], []
        for t, now in enumerate(np.asarray(observation.time, dtype=float).tolist()):
            state = self._follow(position[t], rotation[t], has_position[t], has_rotation[t], now, state)
            root, local = self._posed(state)
            roots.append(root)
            locals_.append(local)
        pose = Pose(self.skeleton, np.stack(roots), np.stack(locals_))
        hidden = np.ones((len(roots), len(self.skeleton.points)))
        hidden[:, self._wrists] = ~has_position
        error = np.full(hidden.shape, GUESSED_ERROR)
        return PointEstimate(self.skeleton, forward_kinematics(pose)[0], hidden, error, pose), state

    def _follow(
        self,
        position: np.ndarray,
        rotation: np.ndarray,
        known: np.ndarray,
        turned: np.ndarray,
        now: float,
        state: CarriedState,
    ) -> CarriedState:
        """The state after a frame of both wrists (2, 3), (2, 4), each where known (2,)."""
        if state.time is not None and not state.time < now < np.inf:
            raise BodysenseError(
                f"carried body: a frame at {now:g} s came after one at {state.time:g} s; give frames in order of time"
            )
        interval = np.inf if state.time is None else now - state.time
        if interval > self.settings.longest_gap:
            state = CarriedState()
        if state.heading is None and not known.any():
            return replace(state, time=now)
        share = 1.0 if state.heading is None else 1 - 0.5 ** (interval / self.settings.half_life)
        stood, facing = self._standing
        turn = facing[self._wrists] if state.turn is None else state.turn
        turn = np.where(turned[:, None], rotation, turn)
        heading = self._heading(position, known, turn, share, state.heading)
        points = quaternion_rotate(_yaw(heading), stood)
        hang = points[self._wrists] if state.wrist is None else state.wrist
        if known.any():
            middle = position[known].mean(axis=0)
            floor = -stood[:, 1].min()
            shoulders, length, _ = self._arm
            # Hands that hang are beside the body.
            hanging = (floor + points[shoulders, 1].mean() - middle[1]) / length.sum(axis=0).mean()
            ahead = self.settings.ahead * self.skeleton.height * (1 - _BESIDE * np.clip(hanging, 0.0, 1.0) ** 2)
            wanted = np.array([middle[0] - ahead * heading[0], floor, middle[2] - ahead * heading[1]])
            root = wanted if state.root is None else state.root + share * (wanted - state.root)
            root = self._within_reach(root, points, position, known)
        else:
            assert state.root is not None
            root = state.root
        wrist = np.where(known[:, None], position - root, hang)
        share = 1.0 if state.elbow is None else 1 - 0.5 ** (interval / self.settings.elbow_half_life)
        elbow = self._bend(points, wrist, turn, share, state.elbow)
        return CarriedState(now, heading, root, wrist, turn, elbow)

    def _bend(
        self, points: np.ndarray, wrist: np.ndarray, turn: np.ndarray, share: float, before: np.ndarray | None
    ) -> np.ndarray:
        """(2, 3) unit: elbows hang, and lie where the hand points away from; square to shoulder and wrist."""
        along = wrist - points[self._arm[0]]
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-6)[:, None]
        wanted = [0.0, -self.settings.elbow_drop, 0.0] - quaternion_rotate(turn, _FINGERS)
        wanted -= along * (wanted * along).sum(axis=1)[:, None]  # the less it says, the less it counts
        mixed = wanted if before is None else before + share * (wanted - before)
        mixed = mixed - along * (mixed * along).sum(axis=1)[:, None]
        return mixed / np.maximum(np.linalg.norm(mixed, axis=1), 1e-9)[:, None]

    def _heading(
        self, position: np.ndarray, known: np.ndarray, turn: np.ndarray, share: float, before: np.ndarray | None
    ) -> np.ndarray:
        """(2,) where the body faces: where its forearms point, and square to the line between both hands."""
        pointing = quaternion_rotate(turn, _FINGERS)[known][:, [0, 2]]
        wanted = pointing.sum(axis=0)
        if known.all():
            across = (position[0] - position[1])[[0, 2]]
            wanted = wanted + self.settings.across * np.array([-across[1], across[0]]) / max(np.hypot(*across), 0.1)
        length = np.hypot(*wanted)
        if length < 0.1:
            return np.array([0.0, 1.0]) if before is None else before
        now = wanted / length
        mixed = now if before is None else before + share * (now - before)
        length = np.hypot(*mixed)
        return mixed / length if length > 1e-3 else now

    def _within_reach(
        self, root: np.ndarray, points: np.ndarray, position: np.ndarray, known: np.ndarray
    ) -> np.ndarray:
        """The nearest place of the root from which both hands are within reach, or as nearly as can be."""
        shoulders, length, _ = self._arm
        longest = self.settings.reach * length.sum(axis=0)
        for _ in range(20):
            away = position - root - points[shoulders]
            distance = np.linalg.norm(away, axis=1)
            excess = np.where(known, np.maximum(distance - longest, 0.0), 0.0)
            if excess.max() < 1e-5:
                break
            root = root + (away * (excess / np.maximum(distance, 1e-9))[:, None])[excess.argmax()]
        return root

    def _posed(self, state: CarriedState) -> tuple[np.ndarray, np.ndarray]:
        """Root (3,) and local rotations (J, 4): standing, arms to the hands, knees bent where the body is low."""
        stood, facing = self._standing
        if state.root is None or state.heading is None:
            return self.skeleton.rest_offset[0] * [0, 1, 0], self._body.local(facing)
        assert state.wrist is not None and state.turn is not None
        body, yaw = self._body, _yaw(state.heading)
        world = multiply(np.tile(yaw, (len(facing), 1)), facing)[body.joints]
        points = quaternion_rotate(yaw, stood)
        ankles = points[body.feet[0]]
        ankles[:, 1] -= min(state.root[1] + stood[:, 1].min(), 0.0)  # feet stay on the floor where the body is low
        body.reach(points[body.joints], world, np.concatenate([points[self._wrists], ankles]))
        self._arms(points, world, state)
        return state.root, body.local(body.placed(state.root, world)[1])

    def _arms(self, points: np.ndarray, world: np.ndarray, state: CarriedState) -> None:
        """Turn both arms, in place among the world rotations (22, 4), so that they end in the hands."""
        assert state.wrist is not None and state.turn is not None and state.elbow is not None
        shoulders, (first, second), frames = self._arm
        away = state.wrist - points[shoulders]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
        along = away / distance[:, None]
        within = np.clip(distance, np.abs(first - second) + 1e-3, 0.9999 * (first + second))
        cosine = (first**2 + within**2 - second**2) / (2 * first * within)
        upper = first[:, None] * (cosine[:, None] * along + np.sqrt(1 - cosine**2)[:, None] * state.elbow)
        lower = within[:, None] * along - upper
        sign = np.array([[-1.0], [1.0]])  # elbows bend about −y on the left, +y on the right
        hinge = sign * np.cross(upper, lower)
        for bone, rest, joints in zip((upper, lower), frames, self._body.limbs[:2, :2], strict=True):
            world[joints] = matrix_to_quaternion(_frames(bone, hinge) @ rest.swapaxes(-1, -2))
        wrists = self._body.wrists
        elbows = self._body.limbs[1, :2]
        axis = self.skeleton.rest_offset[self._wrists] / second[:, None]
        bend = multiply(world[elbows] * CONJUGATE, state.turn)
        # Hand and forearm share the turn about the forearm.
        twist = 2 * np.arctan2((bend[:, 1:] * axis).sum(axis=1), bend[:, 0])
        twist = (twist + np.pi) % (2 * np.pi) - np.pi
        world[elbows] = multiply(world[elbows], quaternion_exp(0.5 * twist[:, None] * axis))
        world[wrists] = state.turn


def _yaw(heading: np.ndarray) -> np.ndarray:
    """(4,) the turn about +Y that takes +Z to a heading (2,)."""
    half = np.arctan2(heading[0], heading[1]) / 2
    return np.array([np.cos(half), 0.0, np.sin(half), 0.0])


def _frames(bone: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """(N, 3, 3) axes, columns: along N bones, their hinge made square to them, and across."""
    along = bone / np.maximum(np.linalg.norm(bone, axis=1), 1e-12)[:, None]
    up = hinge - along * (hinge * along).sum(axis=1)[:, None]
    up /= np.maximum(np.linalg.norm(up, axis=1), 1e-12)[:, None]
    return np.stack([along, up, np.cross(along, up)], axis=-1)
