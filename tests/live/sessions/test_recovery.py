"""Recovery of the body after a lost tracker, a restart and recentring: how soon, and how smoothly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.formats.protocol import SignalFrame
from bodysense_live.server.messages import Recentre
from bodysense_live.sessions.session import Session

SKELETON = default_skeleton()
POINTS = ("head", "left_wrist", "right_wrist", "pelvis", "left_ankle", "right_ankle")
RATE = 30
SOON, JUMP = 0.5, 0.10  # s, m
TOLERANCE = 0.03  # m, largest distance from the body of an undisturbed signal

ChangeSignal = Callable[[int, SignalFrame], SignalFrame | None]


@cache
def frame(k: int) -> SignalFrame:
    """Return a frame of a wearer who sways, waves and turns a little."""
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


def tracked_bodies(
    frames: int, change: ChangeSignal, at: dict[int, Callable[[Session], None]] | None = None
) -> dict[int, np.ndarray]:
    """Return positions of all points after each answered frame, (P, 3) m, in the signal's world."""
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
    return tracked_bodies(END, lambda k, signal: signal)


def check(positions: dict[int, np.ndarray], back: int, gap_may_jump: bool = False) -> None:
    """Check that the body equals the undisturbed one half a second after `back`, and never jumps."""
    expected = usual()
    late = [k for k in positions if k >= back + SOON * RATE]
    assert late
    for k in late:
        off = np.linalg.norm(positions[k] - expected[k], axis=1)
        assert off.max() < TOLERANCE, f"{SKELETON.points[int(off.argmax())]} is {100 * off.max():.1f} cm off"
    order = sorted(positions)
    for before, after in pairwise(order):
        if after - before > 1 and gap_may_jump:  # frames between were not displayed
            continue
        distance = np.linalg.norm(positions[after] - positions[before], axis=1)
        assert distance.max() < JUMP, (
            f"{SKELETON.points[int(distance.argmax())]} jumps {100 * distance.max():.0f} cm at {after}"
        )


@pytest.mark.parametrize("name", ["pelvis", "left_ankle", "left_wrist"])
def test_a_tracker_is_lost_and_found(name: str) -> None:
    check(tracked_bodies(END, lambda k, signal: without(signal, name) if LOST <= k < BACK else signal), BACK)


def test_everything_is_lost_and_found() -> None:
    """Tracking restarts: a second passes without a frame."""
    positions = tracked_bodies(END, lambda k, signal: None if LOST <= k < BACK else signal)
    check(positions, BACK, gap_may_jump=True)


def test_a_sender_restarts_with_another_clock() -> None:
    """The sender's time restarts at 0 after a gap of half a second."""

    def change(k: int, signal: SignalFrame) -> SignalFrame | None:
        if LOST <= k < LOST + RATE // 2:
            return None
        return signal if k < LOST else replace(signal, time=(k - LOST) / RATE)

    check(tracked_bodies(END, change), LOST + RATE // 2, gap_may_jump=True)


def test_recentring_moves_the_world_but_not_the_body_in_it() -> None:
    check(tracked_bodies(END, lambda k, signal: signal, {LOST: lambda one: one.apply(Recentre())}), LOST)
