"""Video pipeline: pictures in, observations of one person out, frame by frame."""

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
class WatchedFrames:
    """Frames that became ready together, after a picture or at the end."""

    frames: VideoFrames
    pictures: tuple[Picture, ...] = field(repr=False)  # one for each frame
    people: tuple[tuple[PersonTrack, ...], ...]  # all people seen in each frame
    landmark_seconds: float  # time of the landmarkers for the newest picture
    device_seconds: float  # time of the rest


@dataclass
class SightingCounts:
    """Counts of frames and people in a video."""

    frames: int = 0
    bodies: int = 0  # frames in which the person was seen
    people: int = 0

    def add(self, watched: WatchedFrames) -> None:
        """Add the counts of more frames."""
        self.frames += len(watched.frames.person)
        self.bodies += int(watched.frames.person.has_body.sum())
        self.people = max([self.people, *(one.number for seen in watched.people for one in seen)])

    def check(self, name: str, number: int | None) -> None:
        """Raise BodysenseError if no person was seen in video `name`, or no person with this `number`."""
        if self.bodies:
            return
        if number is not None and self.people:
            only, valid = ("1 was", "1") if self.people == 1 else (f"{self.people} were", f"1 to {self.people}")
            raise BodysenseError(
                f"--follow {number}: only {only} found in {name}; give {valid}, or a larger --people if more are in "
                "the picture together"
            )
        raise BodysenseError(f"{name}: no person was found in its {self.frames} pictures; is a whole person visible?")


def watch(
    pictures: Iterable[Picture],
    landmarker: Landmarker,
    device_for: Callable[[float], VideoDevice],
    settings: PersonSettings = PersonSettings(),
) -> Iterator[WatchedFrames]:
    """Observe one person in pictures, in memory that does not grow with them.

    `device_for` returns the device for pictures with a width / height. If the video breaks, the waiting frames are
    yielded before its `VideoBrokenError` is raised.
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
        watched = waiting[: len(frames)]
        del waiting[: len(frames)]
        yield _watched_frames(frames, watched, found - begun, clock.perf_counter() - found)
    if device is not None and state is not None and waiting:
        begun = clock.perf_counter()
        frames = device.finish(state)
        yield _watched_frames(frames, waiting, 0.0, clock.perf_counter() - begun)
    if broken is not None:
        raise broken


def _watched_frames(
    frames: VideoFrames, watched: list[tuple[Picture, tuple[PersonTrack, ...]]], landmarks: float, device: float
) -> WatchedFrames:
    return WatchedFrames(
        frames, tuple(picture for picture, _ in watched), tuple(people for _, people in watched), landmarks, device
    )
