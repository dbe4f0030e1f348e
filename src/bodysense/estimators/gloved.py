"""Gloves on a body: hands that the markers show, and the rest of the body by whatever else completes it.

Wrists stand where the gloves have them and fingers are the gloves'. Arms are bent between them and the body's
shoulders; a hand that an arm cannot reach is shown where it is, and the tracker's inverse kinematics moves the body. A
hand whose markers have been hidden for long is the body's own; what is shown moves between the two from rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from bodysense.body.glove import side_of
from bodysense.body.hand import FINGERTIPS, HAND_JOINTS, hand_skeleton
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.products import CONJUGATE, exp, log, multiply
from bodysense.body.rotation import quaternion_canonical, quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import Skeleton
from bodysense.body.spring import spring_step
from bodysense.errors import BodysenseError
from bodysense.estimators.carried import Carried
from bodysense.estimators.estimate import Estimator, PointEstimate
from bodysense.estimators.gloves.hands import Hands
from bodysense.estimators.limbs import reach
from bodysense.observation import OPTICAL_ACCURACY, Observation, without_gloves

SIDES = ("left", "right")
_HINGE = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])  # straight elbows bend forward


@dataclass(frozen=True)
class GlovedSettings:
    """When a hand is the gloves', and how it passes to the body's."""

    lost: float = 0.05  # m of expected error from which on a hand is not known by its glove any more
    half_life: float = 0.06  # s in which half of the way to a lost or found hand's new place is made
    longest_gap: float = 1.0  # s without frames after which everything starts afresh

    def __post_init__(self) -> None:
        for name in ("lost", "half_life", "longest_gap"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"gloved body: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class GlovedState:
    """The states of hands and body, and where hands were shown."""

    hands: Any
    body: Any
    time: float | None = None
    known: np.ndarray | None = None  # (S,) bool: which hands were the gloves' in the last frame
    wrist: np.ndarray | None = None  # (S, 3) m
    turn: np.ndarray | None = None  # (S, 4) wxyz, world
    jump: np.ndarray | None = None  # (2, S, 3) what is left of the last one, m and rad
    closing: np.ndarray | None = None  # (2, S, 3) how fast that changes, per s


@dataclass(frozen=True)
class Gloved:
    """An estimator of a whole body with gloves on one hand or both; see the module's text.

    `hands` completes the hands 'left' and 'right', either or both; `body` the rest from all other points and, as
    tracked points of its own skeleton, the hands. The body's estimates have a pose: wrap a tracker
    (`ik_tracker.IkTracked`) around an estimator of positions. Raises BodysenseError for a skeleton without arms and
    fingers, and for hands that a body does not have.
    """

    hands: Hands
    body: Estimator
    settings: GlovedSettings = GlovedSettings()

    def __post_init__(self) -> None:
        strange = [name for name in self.hands.hands if name not in SIDES]
        if strange:
            raise BodysenseError(f"gloved body: the hand {strange[0]!r} is not of this body; it has 'left' and 'right'")
        for side in self.sides:
            hand_skeleton(self.skeleton, side_of(side))

    @property
    def skeleton(self) -> Skeleton:
        """The body that is completed."""
        return self.body.skeleton

    @cached_property
    def sides(self) -> tuple[str, ...]:
        """The hands with a glove."""
        return tuple(self.hands.hands)

    @cached_property
    def _arms(self) -> np.ndarray:
        """(4, S) collar (or whatever carries the shoulder), shoulder, elbow and wrist of every hand with a glove."""
        arms = np.stack(
            [
                self.skeleton.indices([f"{side}_{part}" for side in self.sides])
                for part in ("shoulder", "elbow", "wrist")
            ]
        )
        return np.concatenate([np.array(self.skeleton.parents)[arms[:1]], arms])

    @cached_property
    def _fingers(self) -> np.ndarray:
        """(S, 15) joints."""
        return np.stack([self.skeleton.indices([f"{side}_{name}" for name in HAND_JOINTS[1:]]) for side in self.sides])

    @cached_property
    def _points(self) -> np.ndarray:
        """(S, 21) points of every hand, the wrist first."""
        names = (*HAND_JOINTS, *FINGERTIPS)
        return np.stack([self.skeleton.indices([f"{side}_{name}" for name in names]) for side in self.sides])

    def start(self) -> GlovedState:
        """The state before the first frame."""
        return GlovedState(self.hands.start(), self.body.start())

    def step(self, observation: Observation, state: GlovedState) -> tuple[PointEstimate, GlovedState]:
        """Complete T frames. Raises BodysenseError when time does not increase, or when the body has no pose."""
        answers, hands = self.hands.step(observation, state.hands)
        shown = [answers[side] for side in self.sides]
        known = np.stack([answer.confidence[:, 0] <= self.settings.lost for answer in shown], axis=1)  # (T, S)
        estimate, body = self.body.step(self._with_hands(observation, shown, known), state.body)
        if estimate.pose is None:
            raise BodysenseError(
                "gloved body: its body is completed without rotations; wrap it in an IkTracked "
                "(bodysense.estimators.ik_tracker)"
            )
        place, world = forward_kinematics(estimate.pose)
        wrists, rows = self._arms[3], []
        for t, now in enumerate(np.asarray(observation.time, dtype=float).tolist()):
            target = np.stack([answer.position[t, 0] for answer in shown])
            turn = np.stack([_world_turn(answer)[t] for answer in shown])
            target = np.where(known[t][:, None], target, place[t, wrists])
            turn = np.where(known[t][:, None], turn, world[t, wrists])
            state = self._passed(target, turn, known[t], now, state)
            rows.append((state.wrist, state.turn))
        wrist, turn = (np.stack(values) for values in zip(*rows, strict=True))
        merged = self._merged(estimate, place, world, wrist, turn, shown)
        return merged, replace(state, hands=hands, body=body)

    def _with_hands(self, observation: Observation, shown: list[PointEstimate], known: np.ndarray) -> Observation:
        """What the body sees: all but the gloves' markers, and every point of the hands that the gloves know."""
        rest = without_gloves(observation)
        names = [self.skeleton.points[point] for point in self._points.ravel()]
        points = (*rest.points, *(name for name in names if name not in rest.points))
        where = {name: k for k, name in enumerate(points)}
        frames, more = len(rest.time), len(points) - len(rest.points)

        def widened(values: np.ndarray, filler: float | bool) -> np.ndarray:
            return np.concatenate([values, np.full((frames, more, *values.shape[2:]), filler, values.dtype)], axis=1)

        seen = Observation(
            points=points,
            position=widened(np.asarray(rest.position, dtype=float), np.nan),
            rotation=widened(np.asarray(rest.rotation, dtype=float), np.nan),
            has_position=widened(rest.has_position, False),
            has_rotation=widened(rest.has_rotation, False),
            accuracy=widened(np.asarray(rest.accuracy, dtype=float), OPTICAL_ACCURACY),
            time=rest.time,
        )
        for k, answer in enumerate(shown):
            here = np.array([where[self.skeleton.points[point]] for point in self._points[k]])
            frame = np.flatnonzero(known[:, k])
            seen.position[np.ix_(frame, here)] = answer.position[frame]
            seen.has_position[np.ix_(frame, here)] = True
            seen.accuracy[np.ix_(frame, here)] = np.maximum(answer.confidence[frame], OPTICAL_ACCURACY)
            seen.rotation[frame, here[0]] = _world_turn(answer)[frame]
            seen.has_rotation[frame, here[0]] = True
        return seen

    def _passed(
        self, target: np.ndarray, turn: np.ndarray, known: np.ndarray, now: float, state: GlovedState
    ) -> GlovedState:
        """The state in which wrists (S, 3), (S, 4) are shown, without a jump where a hand was lost or found."""
        jump = closing = np.zeros((2, len(target), 3))
        if state.time is not None and now - state.time <= self.settings.longest_gap:
            assert state.jump is not None and state.closing is not None and state.known is not None
            assert state.wrist is not None and state.turn is not None
            jump, closing = state.jump, state.closing
            changed = (known != state.known)[:, None]
            if changed.any():
                apart = np.stack([state.wrist - target, log(multiply(state.turn, turn * CONJUGATE))])
                jump, closing = np.where(changed, apart, jump), np.where(changed, 0.0, closing)
            if jump.any():
                jump, closing = spring_step(jump, closing, self.settings.half_life, now - state.time)
                target, turn = target + jump[0], multiply(exp(jump[1]), turn)
        return GlovedState(state.hands, state.body, now, known, target, turn, jump, closing)

    def _merged(
        self,
        estimate: PointEstimate,
        place: np.ndarray,
        world: np.ndarray,
        wrist: np.ndarray,
        turn: np.ndarray,
        shown: list[PointEstimate],
    ) -> PointEstimate:
        """The body with its wrists (T, S, 3), (T, S, 4) and the gloves' fingers."""
        assert estimate.pose is not None
        carrier, shoulder, elbow, hand = self._arms
        away = wrist - place[:, shoulder]
        # Where the body has a wrist already, its arm stays as it is.
        moved = (np.abs(wrist - place[:, hand]).max(axis=-1) > 1e-6).ravel()
        first, second = place[:, elbow] - place[:, shoulder], place[:, hand] - place[:, elbow]
        joints = np.stack([world[:, shoulder], world[:, elbow]])  # (2, T, S, 4)
        sides = [SIDES.index(side) for side in self.sides]
        hinge = quaternion_rotate(joints[0], np.broadcast_to(_HINGE[sides], first.shape))
        flat = joints.reshape(2, -1, 4)
        if moved.any():
            upper, lower, target = (values.reshape(-1, 3)[moved] for values in (first, second, away))
            flat[:, moved] = reach(upper, lower, target, flat[:, moved], hinge.reshape(-1, 3)[moved])
        turns = flat.reshape(joints.shape)
        rotation = np.array(estimate.pose.rotation, dtype=float)
        chain = (world[:, carrier], *turns, turn)
        for above, below, joint in zip(chain, chain[1:], (shoulder, elbow, hand), strict=False):
            local = quaternion_multiply(quaternion_conjugate(above), below)
            rotation[:, joint] = quaternion_canonical(local)
        for fingers, answer in zip(self._fingers, shown, strict=True):
            assert answer.pose is not None
            rotation[:, fingers] = answer.pose.rotation[:, 1:]
        pose = Pose(self.skeleton, estimate.pose.root_position, rotation)
        position = np.array(forward_kinematics(pose)[0])
        occluded, confidence = estimate.occluded.copy(), estimate.confidence.copy()
        for k, (points, answer) in enumerate(zip(self._points, shown, strict=True)):
            # Hands are where they should be, also where an arm is too short: the tracker then moves the body.
            position[:, points] += (wrist[:, k] - position[:, points[0]])[:, None]
            occluded[:, points], confidence[:, points] = answer.occluded, answer.confidence
        return PointEstimate(self.skeleton, position, occluded, confidence, pose)


def _world_turn(answer: PointEstimate) -> np.ndarray:
    """(T, 4) world ← wrist."""
    assert answer.pose is not None
    return np.asarray(answer.pose.rotation[:, 0])


def carried_by_gloves(hands: Hands, skeleton: Skeleton) -> Gloved:
    """A body of which nothing but the gloves is tracked."""
    return Gloved(hands, Carried(skeleton))
