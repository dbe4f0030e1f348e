"""Replays: a recording or a motion played in real time as a live signal, with the true poses if they are known."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import HAS_POSITION, HAS_ROTATION, SignalFrame, wire_accuracy
from bodysense.observing.observation import Observation
from bodysense_live.server.messages import Replay

SLOWEST, FASTEST = 0.1, 4.0
_PAUSE = 1.0  # s between the end and the beginning


@dataclass(frozen=True, eq=False)
class Playable:
    """A signal to play, its wearer and, for a motion, the true poses."""

    observation: Observation
    person: Person
    truth: Pose | None = None  # (T, …)

    def __post_init__(self) -> None:
        seen = self.observation
        if len(seen.points) > 128:
            raise BodysenseError(f"the recording has {len(seen.points)} points; at most 128 can be replayed")
        if self.person.skeleton.points != default_skeleton().points:
            raise BodysenseError("the recording's skeleton has other points than bodysense's; leave its skeleton out")
        if self.truth is not None and len(self.truth.root_position) != len(seen.time):
            raise BodysenseError("the replay's truth has other frames than its observation")

    @cached_property
    def time(self) -> np.ndarray:
        """Times of the frames from 0, (T,) s."""
        return self.observation.time - self.observation.time[0]

    @property
    def length(self) -> float:
        """Length in s."""
        return float(self.time[-1])

    def frame(self, index: int) -> SignalFrame:
        """Return the signal of a frame; its sequence is the frame's index."""
        seen = self.observation
        has = HAS_POSITION * seen.has_position[index] + HAS_ROTATION * seen.has_rotation[index]
        here = np.flatnonzero(has)
        return SignalFrame(
            index,
            float(self.time[index]),
            here.astype(np.uint8),
            has[here].astype(np.uint8),
            np.nan_to_num(seen.position[index, here]).astype(np.float32),
            np.nan_to_num(seen.rotation[index, here]).astype(np.float32),
            wire_accuracy(seen.accuracy[index, here]),
        )


class Player:
    """A player that repeats. It calls `play(frame, is_new_motion)` at each frame's time."""

    def __init__(self, playable: Playable, play: Callable[[SignalFrame, bool], None]) -> None:
        self.playable, self._play = playable, play
        self._playing, self._speed = True, 1.0
        self._position = 0.0  # s in the recording
        self._jumped = True
        self._changed = asyncio.Event()

    def apply(self, message: Replay) -> None:
        """Apply a watcher's request. Raises BodysenseError for a speed that is out of range."""
        if message.speed is not None:
            if not SLOWEST <= message.speed <= FASTEST:
                raise BodysenseError(f"replay: speed {message.speed:g}; give {SLOWEST:g} to {FASTEST:g}")
            self._speed = message.speed
        if message.time is not None:
            self._position = min(max(message.time, 0.0), self.playable.length)
            self._jumped = True
        if message.playing is not None:
            self._playing = message.playing
        self._changed.set()

    async def run(self) -> None:
        """Play until cancelled."""
        loop, time = asyncio.get_running_loop(), self.playable.time
        while True:
            self._changed.clear()
            index = int(np.searchsorted(time, self._position - 1e-9))
            begun, since = loop.time(), self._position
            self._play(self.playable.frame(min(index, len(time) - 1)), self._jumped)
            self._jumped = False
            while self._playing and not self._changed.is_set():
                index += 1
                ended = index >= len(time)
                due = self.playable.length + _PAUSE if ended else float(time[index])
                if not await self._sleep(begun + (due - since) / self._speed - loop.time()):
                    break
                self._position, self._jumped = (0.0, True) if ended else (due, False)
                if ended:
                    break
                self._play(self.playable.frame(index), False)
            else:
                await self._changed.wait()

    async def _sleep(self, seconds: float) -> bool:
        """Wait. Return False if a request arrived meanwhile."""
        if seconds <= 0:
            await asyncio.sleep(0)
        else:
            with suppress(TimeoutError):
                async with asyncio.timeout(seconds):  # `wait_for` of Python 3.11 may lose a cancellation
                    await self._changed.wait()
        return not self._changed.is_set()
