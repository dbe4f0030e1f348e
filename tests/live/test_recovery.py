"""What happens to a tracker, and how soon and how smoothly the body is right again: loss, restart, re-centring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import default_skeleton
from bodysense.io.protocol import SignalFrame
from bodysense_live.messages import Recentre
from bodysense_live.session import Session

SKELETON = default_skeleton()
POINTS = ("head", "left_wrist", "right_wrist", "pelvis", "left_ankle", "right_ankle")
RATE = 30
SOON, JUMP = 0.5, 0.10  # s, m
AS_BEFORE = 0.03  # m from where the body of a tracker that was never lost is

UpdateSettings = Callable[[int, SignalFrame], SignalFrame | None]


@cache
def frame(k: int) -> SignalFrame:
    """Somebody who sways, waves and turns a little."""
    t = k / RATE
    pose = standing_pose(SKELETON)
    pose.root_position[:] += [0.1 * np.sin(t), -0.03 + 0.03 * np.cos(2 * t), 0.1 * np.cos(t)]
    pose.rotation[0] = quaternion_exp(np.array([0.0, 0.3 * np.sin(0.7 * t), 0.0]))
    elbow = SKELETON.index("left_elbow")
    pose.rotation[elbow] = quaternion_multiply(
        pose.rotation[elbow], quaternion_exp(np.array([0.0, -0.6 - 0.4 * np.sin(3 * t), 0.0]))
    )
    position, rotation = (np.asarray(values) for values in forward_kinematics(pose))
    floor = np.asarray(forward_kinematics(standing_pose(SKELETON))[0])[:, 1].min()
    places = SKELETON.indices(POINTS)
    every, has = np.arange(len(POINTS), dtype=np.uint8), np.full(len(POINTS), 3, dtype=np.uint8)
    return SignalFrame(k, t, every, has, (position[places] - [0, floor, 0]).astype(np.float32), rotation[places])


def without(signal: SignalFrame, name: str) -> SignalFrame:
    has = signal.has.copy()
    has[POINTS.index(name)] = 0
    return replace(signal, has=has)


def bodies(
    frames: int, change: UpdateSettings, at: dict[int, Callable[[Session], None]] | None = None
) -> dict[int, np.ndarray]:
    """Where all points are after each frame that was answered, (P, 3) m, in the signal's own world."""
    one, found = Session(POINTS, Person(SKELETON), eased=True), {}
    for k in range(frames):
        if at and k in at:
            at[k](one)
        signal = change(k, frame(k))
        if signal is None:
            continue
        one.receive(signal, 0.0)
        answer = one.step()
        assert answer is not None
        places, _ = answer.in_signal
        found[k] = np.array([places[name] for name in SKELETON.points])
    return found


LOST, BACK, END = 2 * RATE, 3 * RATE, 4 * RATE


@cache
def usual() -> dict[int, np.ndarray]:
    return bodies(END, lambda k, signal: signal)


def check(there: dict[int, np.ndarray], back: int, gap_may_jump: bool = False) -> None:
    """Half a second after `back` the body is as if nothing had happened; and at no time does it jump."""
    expected = usual()
    late = [k for k in there if k >= back + SOON * RATE]
    assert late
    for k in late:
        off = np.linalg.norm(there[k] - expected[k], axis=1)
        assert off.max() < AS_BEFORE, f"{SKELETON.points[int(off.argmax())]} is {100 * off.max():.1f} cm off"
    order = sorted(there)
    for before, after in pairwise(order):
        if after - before > 1 and gap_may_jump:  # nobody was shown what was between
            continue
        moved = np.linalg.norm(there[after] - there[before], axis=1)
        assert moved.max() < JUMP, f"{SKELETON.points[int(moved.argmax())]} jumps {100 * moved.max():.0f} cm at {after}"


@pytest.mark.parametrize("name", ["pelvis", "left_ankle", "left_wrist"])
def test_a_tracker_is_lost_and_found(name: str) -> None:
    check(bodies(END, lambda k, signal: without(signal, name) if LOST <= k < BACK else signal), BACK)


def test_everything_is_lost_and_found() -> None:
    """The whole tracking is restarted: a second without a frame."""
    there = bodies(END, lambda k, signal: None if LOST <= k < BACK else signal)
    check(there, BACK, gap_may_jump=True)


def test_a_sender_is_started_again_with_another_clock() -> None:
    """Its time begins at 0 again; half a second was not sent."""

    def change(k: int, signal: SignalFrame) -> SignalFrame | None:
        if LOST <= k < LOST + RATE // 2:
            return None
        return signal if k < LOST else replace(signal, time=(k - LOST) / RATE)

    check(bodies(END, change), LOST + RATE // 2, gap_may_jump=True)


def test_recentring_moves_the_world_and_not_the_body_in_it() -> None:
    check(bodies(END, lambda k, signal: signal, {LOST: lambda one: one.apply(Recentre())}), LOST)
