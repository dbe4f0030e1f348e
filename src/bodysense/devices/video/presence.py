"""Presence of a person before a camera: frames without one are left out of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

LONGEST_MISS = 1.0  # s without landmarks between two sightings, for which the person is still there


@dataclass
class Presence:
    """The frames of a film in which a person is there, from their sightings."""

    absent: list[tuple[float, float]] = field(default_factory=list)  # s, from and to, of times without a person
    seconds: float = 0.0  # s, sum of these times so far
    _waiting: list[int] = field(default_factory=list)  # numbers of frames after the last sighting
    _times: list[float] = field(default_factory=list)  # s, of these frames
    _last: float | None = None  # s, of the last sighting
    _frames: int = 0

    def add(self, times: Sequence[float], seen: Sequence[bool]) -> list[tuple[int, float]]:
        """Add frames, at `times` s. Return the numbers of frames with a person, and the time lost before each, s."""
        kept: list[tuple[int, float]] = []
        for time, is_seen in zip(times, seen, strict=True):
            if is_seen:
                if self._last is not None and time - self._last <= LONGEST_MISS:
                    kept += [(number, self.seconds) for number in self._waiting]
                elif self._waiting:
                    self._leave(time)
                self._waiting, self._times = [], []
                kept.append((self._frames, self.seconds))
                self._last = time
            else:
                self._waiting.append(self._frames)
                self._times.append(time)
            self._frames += 1
        return kept

    def finish(self, interval: float) -> None:
        """End the film; its frames are `interval` s apart. Nobody is there after the last sighting."""
        if self._waiting:
            self._leave(self._times[-1] + interval)
        self._waiting, self._times = [], []

    @property
    def oldest(self) -> int:
        """Number of the oldest frame that may still be kept."""
        return self._waiting[0] if self._waiting else self._frames

    def _leave(self, time: float) -> None:
        """Note the absence of the person from the first waiting frame to `time`."""
        self.absent.append((self._times[0], time))
        self.seconds += time - self._times[0]
