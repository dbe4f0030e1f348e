"""Replays: timing, repetition and control."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SignalFrame, read_signal, write_signal
from bodysense_live.server.messages import Replay
from bodysense_live.sessions.replay import Playable, Player


def playable(frames: int, rate: float, hands: bool = True) -> Playable:
    skeleton, standing = default_skeleton(), standing_pose(default_skeleton())
    pose = Pose(skeleton, np.tile(standing.root_position, (frames, 1)), np.tile(standing.rotation, (frames, 1, 1)))
    seen = observe(pose, 5 + np.arange(frames) / rate, THREE_POINT)
    if not hands:
        has = np.tile([True, False, False], (frames, 1))
        seen = replace(seen, has_position=has, has_rotation=has)
    return Playable(seen, Person(skeleton), pose)


def played(one: Playable, seconds: float, *changes: tuple[float, Replay]) -> list[tuple[float, SignalFrame, bool]]:
    """Play for some seconds. Return time, frame and whether a new motion starts, for each frame."""

    async def run() -> list[tuple[float, SignalFrame, bool]]:
        loop, found = asyncio.get_running_loop(), []
        begun = loop.time()
        player = Player(one, lambda frame, is_new_motion: found.append((loop.time() - begun, frame, is_new_motion)))
        task = asyncio.create_task(player.run())
        for at, change in changes:
            await asyncio.sleep(max(0.0, at - (loop.time() - begun)))
            player.apply(change)
        await asyncio.sleep(max(0.0, seconds - (loop.time() - begun)))
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return found

    return asyncio.run(run())


def test_frames_are_played_at_their_times() -> None:
    found = played(playable(1000, 50), 0.5)
    sequences = [frame.sequence for _, frame, _ in found]
    assert (
        sequences == list(range(len(found)))
        and found[0][2]
        and not any(is_new_motion for _, _, is_new_motion in found[1:])
    )
    for when, frame, _ in found:
        assert frame.time == pytest.approx(frame.sequence / 50)
        assert when >= frame.time - 0.01  # later only where this machine is busy
    assert len(found) >= 5


def test_a_replay_repeats() -> None:
    found = played(playable(3, 50), 1.4)
    assert [frame.sequence for _, frame, _ in found][:4] == [0, 1, 2, 0]
    assert found[3][2]


def test_a_replay_is_paused_sought_and_slowed() -> None:
    paused = played(playable(1000, 50), 0.6, (0.1, Replay(playing=False)))
    assert len(paused) <= 12
    sought = played(playable(1000, 50), 0.4, (0.1, Replay(time=10.0)))
    place = next(k for k, (_, frame, _) in enumerate(sought) if frame.sequence == 500)
    assert sought[place][2] and all(frame.sequence >= 500 for _, frame, _ in sought[place:])
    slow = played(playable(1000, 50), 0.5, (0.0, Replay(speed=0.2)))
    assert len(slow) <= 10
    with pytest.raises(BodysenseError, match="speed 9"):
        Player(playable(2, 50), lambda frame, is_new_motion: None).apply(Replay(speed=9))


def test_seeking_before_the_beginning_goes_to_the_beginning() -> None:
    found = played(playable(1000, 50), 1.5, (0.3, Replay(time=-3.0)))
    place = max(k for k, (_, _, is_new_motion) in enumerate(found) if is_new_motion)
    assert [frame.sequence for _, frame, _ in found[place : place + 2]] == [0, 1]  # not 3 s later


def test_frames_are_valid_signals() -> None:
    frame = playable(4, 50, hands=False).frame(2)
    assert frame.sequence == 2 and frame.time == pytest.approx(0.04)
    found = read_signal(write_signal(frame), 3)
    np.testing.assert_array_equal(found.point, [0])
    np.testing.assert_array_equal(found.has, [3])
