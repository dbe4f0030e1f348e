"""Watching: pictures in, observations of one person out, frame by frame."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from bodysense.devices.video.device import VideoDevice, VideoFrames
from bodysense.devices.video.landmarks import Landmarker
from bodysense.devices.video.person import PersonSettings, PersonState, PersonTrack, follow
from bodysense.devices.video.pictures import Picture, VideoBrokenError
from bodysense.errors import BodysenseError


@dataclass(frozen=True, eq=False)
class Watched:
    """Frames that became ready together, after a picture or at the end."""

    frames: VideoFrames
    pictures: tuple[Picture, ...] = field(repr=False)  # one a frame
    people: tuple[tuple[PersonTrack, ...], ...]  # all people seen in each of them
    landmark_seconds: float  # that the landmarkers took for the newest picture
    device_seconds: float  # for the rest


@dataclass
class Seen:
    """Counts of watched frames and people."""

    frames: int = 0
    bodies: int = 0  # frames in which the person was seen
    people: int = 0

    def add(self, done: Watched) -> None:
        """Add the counts of more frames."""
        self.frames += len(done.frames.person)
        self.bodies += int(done.frames.person.has_body.sum())
        self.people = max([self.people, *(one.number for seen in done.people for one in seen)])

    def check(self, name: str, number: int | None) -> None:
        """Raise BodysenseError if no person was seen in video `name`, or not the person of the requested `number`."""
        if self.bodies:
            return
        if number is not None and self.people:
            only, valid = ("1 was", "1") if self.people == 1 else (f"{self.people} were", f"1 to {self.people}")
            raise BodysenseError(
                f"--follow {number}: only {only} found in {name}; give {valid}, or a larger --people where more are in "
                "the picture together"
            )
        raise BodysenseError(f"{name}: no person was found in its {self.frames} pictures; is one to be seen whole?")


def watch(
    pictures: Iterable[Picture],
    landmarker: Landmarker,
    device_for: Callable[[float], VideoDevice],
    settings: PersonSettings = PersonSettings(),
) -> Iterator[Watched]:
    """Observe one person in pictures, in memory that does not grow with them.

    `device_for` returns the device for pictures of a width / height. If the video breaks, the waiting frames come
    first, then its `VideoBrokenError`.
    """
    source, broken = iter(pictures), None
    device, state, person_state = None, None, PersonState()
    waiting: list[tuple[Picture, tuple[PersonTrack, ...]]] = []
    while True:
        try:
            picture = next(source, None)
        except VideoBrokenError as error:
            picture, broken = None, error
        if picture is None:
            break
        begun = clock.perf_counter()
        bodies, hands = landmarker.find(picture)
        found = clock.perf_counter()
        if device is None or state is None:
            device = device_for(picture.pixels.shape[1] / picture.pixels.shape[0])
            state = device.start()
        person, person_state = follow(picture, bodies, hands, person_state, settings)
        frames, state = device.step(person, state)
        waiting.append((picture, person_state.seen_at(picture.time)))
        done = waiting[: len(frames)]
        del waiting[: len(frames)]
        yield _watched(frames, done, found - begun, clock.perf_counter() - found)
    if device is not None and state is not None and waiting:
        begun = clock.perf_counter()
        frames = device.finish(state)
        yield _watched(frames, waiting, 0.0, clock.perf_counter() - begun)
    if broken is not None:
        raise broken


def _watched(
    frames: VideoFrames, done: list[tuple[Picture, tuple[PersonTrack, ...]]], landmarks: float, device: float
) -> Watched:
    return Watched(
        frames, tuple(picture for picture, _ in done), tuple(people for _, people in done), landmarks, device
    )
