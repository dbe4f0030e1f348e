"""The whole path of a video: pictures in, bodies out, as they come."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from bodysense.capture.landmarks import Landmarker
from bodysense.capture.person import PersonSettings, PersonState, follow
from bodysense.capture.video import Picture, VideoBrokenError
from bodysense.estimators.video_body import VideoBody, VideoFrames


@dataclass(frozen=True, eq=False)
class Completed:
    """Frames that became complete together; a picture came in between, or the end."""

    frames: VideoFrames
    pictures: tuple[Picture, ...] = field(repr=False)  # one a frame
    landmark_seconds: float  # that the landmarkers took for the newest picture
    body_seconds: float  # that the rest took


def complete_video(
    pictures: Iterable[Picture],
    landmarker: Landmarker,
    body_for: Callable[[float], VideoBody],
    settings: PersonSettings = PersonSettings(),
) -> Iterator[Completed]:
    """Complete one person in pictures, in memory that does not grow with them.

    `body_for` gives what completes it, for pictures of a width / height. Where the video breaks, the frames that were
    still waited for come first, then its `VideoBrokenError`.
    """
    source, broken = iter(pictures), None
    body, state, person_state = None, None, PersonState()
    waiting: list[Picture] = []
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
        if body is None or state is None:
            body = body_for(picture.pixels.shape[1] / picture.pixels.shape[0])
            state = body.start()
        person, person_state = follow(picture, bodies, hands, person_state, settings)
        frames, state = body.step(person, state)
        waiting.append(picture)
        done = tuple(waiting[: len(frames)])
        del waiting[: len(frames)]
        yield Completed(frames, done, found - begun, clock.perf_counter() - found)
    if body is not None and state is not None and waiting:
        begun = clock.perf_counter()
        frames = body.finish(state)
        yield Completed(frames, tuple(waiting), 0.0, clock.perf_counter() - begun)
    if broken is not None:
        raise broken
