"""A whole body from a headset and two hands by a network: arms that reach the hands, feet that stand.

The network (`models/three_point_network.py`) gives every joint's rotation. Then each arm is bent so that its hand is
where it is measured, and each leg so that a foot in contact with the floor stays where it stands (`foot_lock`,
`limbs`). Fingers are relaxed.

What is not as it should be:

- Without a headset in a frame, its last pose is repeated; before its first, the body stands at the origin, facing +Z.
  Where it is found everything starts afresh if it was lost for more than `longest_gap`; otherwise feet come free.
- A hand that the arm cannot reach is shown where it is measured, while the pose only points at it: the tracker's
  inverse kinematics then moves the body.
- A hand that is not tracked is the network's guess. Where a hand is lost or found again, what is shown moves to its new
  place within a few frames, without a jump.
- A pose that cannot be one counts as not tracked: not finite, a quaternion that is not of unit length, farther than
  `FARTHEST` from the origin, a hand farther from the head than `REACH` of the wearer's height.
- After more than `longest_gap` without a frame everything starts afresh. A point that is named twice (two headsets)
  and time that does not increase are errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from bodysense.body.damping import settle
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.products import CONJUGATE, exp, log, multiply
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.foot_lock import FootLockSettings, FootLockState, lock_feet, released
from bodysense.estimators.three_point_answers import (
    FIRST_INTERVAL,
    UPRIGHT,
    Memory,
    ThreePointModel,
    ask,
    load_three_point,
    recalled,
    steadied,
    without_head,
)
from bodysense.estimators.whole_body import WholeBody
from bodysense.observation import FARTHEST, UNIT_TOLERANCE, Estimate, Observation
from bodysense.occlusion.three_point import POINTS

REACH = 0.75  # of the wearer's height, from the head: no hand is farther


@dataclass(frozen=True)
class ThreePointSettings:
    """What is done about the network's answer."""

    hand_half_life: float = 0.06  # s in which half of the way to a lost or found hand's new place is made
    longest_gap: float = 1.0  # s without frames after which everything starts afresh
    # None leaves feet where the network has them, also under the floor.
    feet: FootLockSettings | None = field(default_factory=FootLockSettings)

    def __post_init__(self) -> None:
        for name in ("hand_half_life", "longest_gap"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"three-point settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class ThreePointState:
    """What the network remembers, and what was shown."""

    memories: tuple[Memory, ...]  # of the network, oldest first; none before the first frame
    time: float | None  # s, of the last frame
    head: tuple[np.ndarray, np.ndarray]  # (3,) m, (4,) wxyz: the last known
    headset: float | None  # s, when its position was last known
    measured: np.ndarray  # (2, 2) bool: position and rotation of left and right hand in the last frame
    hand: np.ndarray  # (2, 3) m, from the head: where hands were shown
    hand_rotation: np.ndarray  # (2, 4) wxyz, world
    jump: np.ndarray  # (2, 2, 3): what is left of the last one, in m and in rad (rotation vectors in the world)
    closing: np.ndarray  # (2, 2, 3) how fast that changes, per s
    feet: FootLockState


@dataclass(frozen=True)
class ThreePoint:
    """A body from `head`, `left_wrist` and `right_wrist`, each where tracked; see the module's text.

    Raises BodysenseError for a skeleton that lacks
    one of the 22 joints.
    """

    skeleton: Skeleton
    model: ThreePointModel
    settings: ThreePointSettings = ThreePointSettings()

    def __post_init__(self) -> None:
        wanted = (*self.model.card["joints"], "left_toe", "right_toe")
        missing = [name for name in wanted if name not in self.skeleton.points]
        if missing or tuple(self.model.card["joints"]) != BODY:
            raise BodysenseError(
                f"{self.model.name} turns the joints {', '.join(BODY[:3])} …; the skeleton given has no "
                f"{missing[0] if missing else 'such order'}: bring the motion to the default skeleton with "
                "`bodysense.data.canonical`"
            )

    @cached_property
    def _body(self) -> WholeBody:
        return WholeBody(self.skeleton)

    @cached_property
    def _points(self) -> np.ndarray:
        return self.skeleton.indices(POINTS)

    @cached_property
    def _constants(self) -> dict[str, np.ndarray]:
        return {
            "rest_offset": self.skeleton.rest_offset[None, self._body.joints].astype(np.float32),
            "height": np.array([self.skeleton.height], dtype=np.float32),
        }

    def start(self) -> ThreePointState:
        """Nothing seen yet: a standing body that faces +Z."""
        position, rotation = forward_kinematics(standing_pose(self.skeleton))
        head, *hands = self.skeleton.indices(POINTS)
        return ThreePointState(
            memories=(),
            time=None,
            head=(position[head], rotation[head]),
            headset=None,
            measured=np.zeros((2, 2), dtype=bool),
            hand=position[hands] - position[head],
            hand_rotation=rotation[hands],
            jump=np.zeros((2, 2, 3)),
            closing=np.zeros((2, 2, 3)),
            feet=released(),
        )

    def step(self, observation: Observation, state: ThreePointState) -> tuple[Estimate, ThreePointState]:
        """Complete T frames, one after the other.

        Raises BodysenseError for a point that is named twice and for time that does not increase.
        """
        position, rotation, known = _usable(observation)
        frames, points = len(position), len(self.skeleton.points)
        roots, locals_ = np.empty((frames, 3)), np.empty((frames, len(self.skeleton.joints), 4))
        positions, errors, hidden = np.empty((frames, points, 3)), np.empty((frames, points)), np.ones((frames, points))
        for t, now in enumerate(np.asarray(observation.time, dtype=float).tolist()):
            state = self._continued(now, state)
            state = self._found(known[t, 0], now, state)
            roots[t], locals_[t], positions[t], errors[t], state = self._complete(
                position[t], rotation[t], known[t], now, state
            )
            hidden[t, self._points] = not known[t, 0, 0], *~state.measured[:, 0]
        return Estimate(self.skeleton, positions, hidden, errors, Pose(self.skeleton, roots, locals_)), state

    def _continued(self, now: float, state: ThreePointState) -> ThreePointState:
        """The state, or a fresh one after a gap."""
        if state.time is None and np.isfinite(now):
            return state
        if state.time is None or not state.time < now < np.inf:  # so that what is no number is refused as well
            raise BodysenseError(
                f"three points: a frame at {now:g} s"
                + (f" came after one at {state.time:g} s" if state.time is not None else "")
                + "; give frames in order of time, in seconds"
            )
        if now - state.time <= self.settings.longest_gap:
            return state
        return replace(self.start(), head=state.head)

    def _found(self, known: np.ndarray, now: float, state: ThreePointState) -> ThreePointState:
        """The state in which a headset that was lost, position and rotation `known` (2,) now, is found again."""
        if not known[0]:
            return state
        if state.headset is None or now - state.headset > self.settings.longest_gap:
            return replace(self.start(), headset=now)
        if state.headset != state.time:  # not one step, but a leap from where it was lost
            state = replace(state, memories=tuple(without_head(memory) for memory in state.memories), feet=released())
        return replace(state, headset=now)

    def _complete(
        self, position: np.ndarray, rotation: np.ndarray, known: np.ndarray, now: float, state: ThreePointState
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, ThreePointState]:
        """One frame (3, 3), (3, 4), (3, 2): root, local rotations, positions, expected errors of the whole body."""
        head = (
            position[0] if known[0, 0] else state.head[0],
            rotation[0] if known[0, 1] else state.head[1],
        )
        far = np.linalg.norm(position[1:] - head[0], axis=1) > REACH * self.skeleton.height
        measured = known[1:] & ~far[:, None]
        state = replace(state, head=head)
        body, before = self._body, recalled(self.model, state.memories, now)
        answer, after = ask(self.model, self._constants, head, position[1:], rotation[1:], measured, now, before)
        answer = steadied(answer, before[1:], head[0], body)

        interval = FIRST_INTERVAL if state.time is None else now - state.time
        known_position, known_rotation = measured[:, :1], measured[:, 1:]
        hand = np.where(known_position, position[1:], answer.position[body.wrists]) - head[0]
        turned = np.where(known_rotation, rotation[1:], answer.rotation[body.wrists])
        jump, closing = self._jumps(hand, turned, measured, interval, state)
        hand, turned = hand + jump[0], multiply(exp(jump[1]), turned) if jump[1].any() else turned
        foot, moved, feet = body.foot(answer.position, answer.rotation), np.zeros((2, 3)), state.feet
        if self.settings.feet is not None:
            moved, feet = lock_feet(foot, answer.contact, interval, self.settings.feet, feet)

        world = answer.rotation.copy()
        world[body.wrists] = turned
        body.reach(answer.position, world, np.concatenate([hand + head[0], foot[:, 0] + moved]))
        root = answer.position[0]
        whole, world = body.placed(root, world)
        # Hands are where they should be, also where an arm is too short: the tracker then moves the body.
        for side, points in enumerate(body.hands):
            whole[points] += hand[side] + head[0] - whole[points[0]]
        state = ThreePointState(
            *((*before, after), now, head, state.headset, measured, hand, turned, jump, closing, feet)
        )
        error = body.expected(answer.error, measured[:, 0], feet.held >= 0)
        return root, body.local(world), whole, error, state

    def _jumps(
        self, hand: np.ndarray, turned: np.ndarray, measured: np.ndarray, interval: float, state: ThreePointState
    ) -> tuple[np.ndarray, np.ndarray]:
        """How far (2, 2, 3), in m and rad, hands are still shown from where they are, and how fast that changes.

        The way is made as by the tracker's smoother, critically damped: from rest and without overshoot.
        """
        jump, closing, jumped = state.jump, state.closing, (measured != state.measured).T[..., None]
        if state.time is None or not (jumped.any() or jump.any()):
            return np.zeros((2, 2, 3)), np.zeros((2, 2, 3))
        if jumped.any():
            apart = np.stack([state.hand - hand, log(multiply(state.hand_rotation, turned * CONJUGATE))])
            jump, closing = np.where(jumped, apart, jump), np.where(jumped, 0.0, closing)
        return settle(jump, closing, self.settings.hand_half_life, interval)


def _usable(observation: Observation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position (T, 3, 3), rotation (T, 3, 4) of head and hands, zeros where unknown, and which (T, 3, 2) are known."""
    given, here = _places(observation.points)
    frames = len(observation.time)
    position, rotation = np.zeros((frames, 3, 3)), np.empty((frames, 3, 4))
    rotation[:] = UPRIGHT
    known = np.zeros((frames, 3, 2), dtype=bool)
    place, turn = observation.position[:, here], observation.rotation[:, here]
    # Comparisons with what is no number are false.
    with np.errstate(all="ignore"):
        near = np.abs(place).max(axis=-1) <= FARTHEST
        unit = np.abs(np.sqrt((turn * turn).sum(axis=-1)) - 1) < UNIT_TOLERANCE
    near &= observation.has_position[:, here]
    unit &= observation.has_rotation[:, here]
    known[:, given, 0], known[:, given, 1] = near, unit
    position[:, given] = np.where(near[..., None], place, 0.0)
    rotation[:, given] = np.where(unit[..., None], turn, UPRIGHT)
    return position, rotation, known


@lru_cache(maxsize=16)
def _places(points: tuple[str, ...]) -> tuple[list[int] | slice, list[int] | slice]:
    """Which of head and hands are among the points of an observation, and where; quicker to take where they are all."""
    twice = [name for name in POINTS if points.count(name) > 1]
    if twice:
        raise BodysenseError(
            f"three points: {twice[0]!r} is named twice; give one device for each of {', '.join(POINTS)}"
        )
    if points == POINTS:
        return slice(None), slice(None)
    given = [k for k, name in enumerate(POINTS) if name in points]
    return given, [points.index(POINTS[k]) for k in given]


def packaged_three_point(skeleton: Skeleton) -> ThreePoint:
    """The packaged network on a wearer's skeleton."""
    return ThreePoint(skeleton, load_three_point())
