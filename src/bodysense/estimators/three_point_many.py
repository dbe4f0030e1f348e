"""Frames of three points of many wearers at once.

The network and everything after it take a batch of wearers, each with a skeleton and a state of their own; a single one
(`three_point.py`) is a batch of one. What comes out is what each would get alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.products import CONJUGATE, exp, log, multiply
from bodysense.body.spring import spring_step
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.foot_lock import FootLockState, lock_feet, released
from bodysense.estimators.three_point_answers import (
    FIRST_INTERVAL,
    UPRIGHT,
    ask,
    recalled,
    steadied,
    without_head,
)
from bodysense.estimators.three_point_state import ThreePointState
from bodysense.estimators.whole_body import together
from bodysense.observation import FARTHEST, HEADSET_ACCURACY, UNIT_TOLERANCE, Observation, accuracy_like
from bodysense.occlusion.three_point import POINTS

if TYPE_CHECKING:
    from bodysense.estimators.three_point import ThreePoint

REACH = 0.75  # of the wearer's height, from the head: no hand is farther


Job = tuple["ThreePoint", Observation, ThreePointState]


def step_together(jobs: Sequence[Job]) -> list[tuple[PointEstimate, ThreePointState]]:
    """Complete the frames of many wearers: of each what its own `step` gives, a batch at a time.

    Wearers share a batch who share network, settings and the tree of their skeleton. Raises BodysenseError for a
    point that is named twice and for time that does not increase.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, (one, _, _) in enumerate(jobs):
        key = (id(one.model), one.settings, one.skeleton.joints, one.skeleton.end_sites, one.skeleton.parents)
        groups.setdefault(key, []).append(k)
    done: dict[int, tuple[PointEstimate, ThreePointState]] = {}
    for rows in groups.values():
        done.update(zip(rows, _step([jobs[k] for k in rows]), strict=True))
    return [done[k] for k in range(len(jobs))]


class _Frame(NamedTuple):
    """One completed frame of B wearers."""

    root: np.ndarray  # (B, 3) m
    rotation: np.ndarray  # (B, J, 4) wxyz, parent ← joint
    position: np.ndarray  # (B, P, 3) m
    error: np.ndarray  # (B, P) m
    hidden: np.ndarray  # (B, P)
    states: list[ThreePointState]


def _step(jobs: Sequence[Job]) -> list[tuple[PointEstimate, ThreePointState]]:
    wearers, states = [one for one, _, _ in jobs], [state for _, _, state in jobs]
    times = [np.asarray(observation.time, dtype=float).tolist() for _, observation, _ in jobs]
    position, rotation, known = _usable([observation for _, observation, _ in jobs])
    first = list(accumulate((len(time) for time in times), initial=0))
    frames: list[tuple[list[int], _Frame]] = []
    for t in range(max(map(len, times))):
        rows = [k for k, time in enumerate(times) if t < len(time)]
        here, now = [first[k] + t for k in rows], [times[k][t] for k in rows]
        before = [
            _continued(wearers[k], known[place, 0], moment, states[k])
            for k, place, moment in zip(rows, here, now, strict=True)
        ]
        frame = _complete([wearers[k] for k in rows], position[here], rotation[here], known[here], now, before)
        for k, state in zip(rows, frame.states, strict=True):
            states[k] = state
        frames.append((rows, frame))
    return [
        (_estimate(one, [(frame, rows.index(k)) for rows, frame in frames if k in rows]), states[k])
        for k, one in enumerate(wearers)
    ]


def _estimate(one: ThreePoint, frames: Sequence[tuple[_Frame, int]]) -> PointEstimate:
    """The estimate of one wearer, of whom each frame of a batch has the row that is given beside it."""
    if len(frames) == 1:
        frame, row = frames[0]
        root, rotation, position, error, hidden = (values[row : row + 1] for values in frame[:5])
    else:
        root, rotation, position, error, hidden = (
            np.array([frame[part][row] for frame, row in frames]) for part in range(5)
        )
    return PointEstimate(one.skeleton, position, hidden, error, Pose(one.skeleton, root, rotation))


def _continued(one: ThreePoint, head: np.ndarray, now: float, state: ThreePointState) -> ThreePointState:
    """The state that a frame goes on from, the headset's position and rotation `head` (2,) known in it or not.

    After a gap everything is fresh, also after one in which only the headset was lost.
    """
    longest = one.settings.longest_gap
    if state.time is None or not state.time < now < np.inf:  # so that what is no number is refused as well
        if state.time is not None or not np.isfinite(now):
            raise BodysenseError(
                f"three points: a frame at {now:g} s"
                + (f" came after one at {state.time:g} s" if state.time is not None else "")
                + "; give frames in order of time, in seconds"
            )
    elif now - state.time > longest:
        state = replace(one.start(), head=state.head)
    if not head[0]:
        return state
    if state.headset is None or now - state.headset > longest:
        return one.start()
    if state.headset != state.time:  # not one step, but a leap from where it was lost
        state = replace(state, memories=tuple(without_head(memory) for memory in state.memories), feet=released())
    return state


def _complete(
    wearers: Sequence[ThreePoint],
    position: np.ndarray,
    rotation: np.ndarray,
    known: np.ndarray,
    now: Sequence[float],
    states: Sequence[ThreePointState],
) -> _Frame:
    """One frame (B, 3, 3), (B, 3, 4), (B, 3, 2) of B wearers."""
    first = wearers[0]
    body, settings, model = together([one.body for one in wearers]), first.settings, first.model
    height = np.array([one.skeleton.height for one in wearers])
    position[:, 0] = np.where(known[:, 0, :1], position[:, 0], [state.head[0] for state in states])
    rotation[:, 0] = np.where(known[:, 0, 1:], rotation[:, 0], [state.head[1] for state in states])
    head = position[:, 0]
    away = position[:, 1:] - head[:, None]
    far = np.einsum("bki,bki->bk", away, away) > (REACH * height[:, None]) ** 2
    measured = known[:, 1:] & ~far[..., None]

    before = [recalled(model, state.memories, moment) for state, moment in zip(states, now, strict=True)]
    constants = {
        "rest_offset": np.array([one.rest_offset for one in wearers]),
        "height": height.astype(np.float32),
    }
    answer, after = ask(model, constants, position, rotation, measured, now, before)
    answer = steadied(answer, [memories[1:] for memories in before], head, body)

    interval = np.array(
        [
            FIRST_INTERVAL if state.time is None else moment - state.time
            for state, moment in zip(states, now, strict=True)
        ]
    )
    hand = np.where(measured[..., :1], position[:, 1:], answer.position[:, body.wrists]) - head[:, None]
    turned = np.where(measured[..., 1:], rotation[:, 1:], answer.rotation[:, body.wrists])
    hand, turned, jump, closing = _jumped(hand, turned, measured, interval, settings.hand_half_life, states)
    foot, moved = body.foot(answer.position, answer.rotation), np.zeros((len(states), 2, 3))
    feet = FootLockState(*(np.array([getattr(s.feet, name) for s in states]) for name in ("held", "anchor", "shift")))
    if settings.feet is not None:
        moved, feet = lock_feet(foot, answer.contact, interval, settings.feet, feet)

    world, shown = answer.rotation.copy(), hand + head[:, None]
    world[:, body.wrists] = turned
    body.reach(answer.position, world, np.concatenate([shown, foot[:, :, 0] + moved], axis=1))
    root = answer.position[:, 0]
    whole, world = body.placed(root, world)
    # Hands are where they should be, also where an arm is too short: whoever shows the pose may then move the body.
    for side, points in enumerate(body.hands):
        whole[:, points] += (shown[:, side] - whole[:, points[0]])[:, None]
    hidden = np.ones(whole.shape[:2])
    hidden[:, first.points] = ~np.concatenate([known[:, :1, 0], measured[..., 0]], axis=1)
    return _Frame(
        root,
        body.local(world),
        whole,
        body.expected(answer.error, measured[..., 0], feet.held >= 0),
        hidden,
        [
            ThreePointState(
                (*before[k], after[k]),
                now[k],
                (head[k], rotation[k, 0]),
                now[k] if known[k, 0, 0] else state.headset,
                measured[k],
                hand[k],
                turned[k],
                jump[k],
                closing[k],
                FootLockState(feet.held[k], feet.anchor[k], feet.shift[k]),
            )
            for k, state in enumerate(states)
        ],
    )


def _jumped(
    hand: np.ndarray,
    turned: np.ndarray,
    measured: np.ndarray,
    interval: np.ndarray,
    half_life: float,
    states: Sequence[ThreePointState],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where hands (B, 2, 3), (B, 2, 4) are shown, how far (B, 2, 2, 3) that is from where they are, in m and rad, and
    how fast it changes.

    The way is made as by the tracker's smoother, critically damped: from rest and without overshoot.
    """
    jump, closing = np.zeros((2, len(states), 2, 2, 3))
    changed = measured != np.array([state.measured for state in states])
    rows = [k for k, state in enumerate(states) if state.time is not None and (changed[k].any() or state.jump.any())]
    if not rows:
        return hand, turned, jump, closing
    left = [np.array([getattr(states[k], name) for k in rows]) for name in ("jump", "closing", "hand", "hand_rotation")]
    leap = changed[rows].transpose(0, 2, 1)[..., None]  # (N, 2, 2, 1): in position and rotation, of each hand
    turn = multiply(left[3].reshape(-1, 4), (turned[rows] * CONJUGATE).reshape(-1, 4))
    apart = np.stack([left[2] - hand[rows], log(turn).reshape(-1, 2, 3)], axis=1)
    now = spring_step(
        np.where(leap, apart, left[0]), np.where(leap, 0.0, left[1]), half_life, interval[rows, None, None, None]
    )
    jump[rows], closing[rows] = now
    hand = hand + jump[:, 0]
    turned = turned.copy()
    turned[rows] = multiply(exp(now[0][:, 1].reshape(-1, 3)), turned[rows].reshape(-1, 4)).reshape(-1, 2, 4)
    return hand, turned, jump, closing


def _usable(observations: Sequence[Observation]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position (N, 3, 3), rotation (N, 3, 4) of head and hands, zeros where unknown, and which (N, 3, 2) are known.

    N are the frames of all observations, one after the other.
    """
    if any(observation.points != POINTS for observation in observations):
        observations = [_named(observation) for observation in observations]
    position = np.concatenate([observation.position for observation in observations]).astype(float)
    rotation = np.concatenate([observation.rotation for observation in observations]).astype(float)
    known = np.empty((len(position), 3, 2), dtype=bool)
    np.concatenate([observation.has_position for observation in observations], out=known[..., 0])
    np.concatenate([observation.has_rotation for observation in observations], out=known[..., 1])
    # Comparisons with what is no number are false.
    with np.errstate(all="ignore"):
        known[..., 0] &= np.abs(position).max(axis=-1) <= FARTHEST
        known[..., 1] &= np.abs(np.sqrt((rotation * rotation).sum(axis=-1)) - 1) < UNIT_TOLERANCE
    position[~known[..., 0]] = 0.0
    rotation[~known[..., 1]] = UPRIGHT
    return position, rotation, known


def _named(observation: Observation) -> Observation:
    """The same, of `POINTS`: those that it lacks are not known."""
    if observation.points == POINTS:
        return observation
    given, here = _places(observation.points)
    frames = len(observation.time)
    position, rotation = np.full((frames, 3, 3), np.nan), np.full((frames, 3, 4), np.nan)
    has = np.zeros((2, frames, 3), dtype=bool)
    position[:, given], rotation[:, given] = observation.position[:, here], observation.rotation[:, here]
    has[0][:, given], has[1][:, given] = observation.has_position[:, here], observation.has_rotation[:, here]
    accuracy = accuracy_like(has[0], HEADSET_ACCURACY)
    accuracy[:, given] = observation.accuracy[:, here]
    return Observation(POINTS, position, rotation, has[0], has[1], accuracy, observation.time)


@lru_cache(maxsize=64)
def _places(points: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Which of head and hands are among the points of an observation, and where."""
    twice = [name for name in POINTS if points.count(name) > 1]
    if twice:
        raise BodysenseError(
            f"three points: {twice[0]!r} is named twice; give one device for each of {', '.join(POINTS)}"
        )
    given = [k for k, name in enumerate(POINTS) if name in points]
    return given, [points.index(POINTS[k]) for k in given]
