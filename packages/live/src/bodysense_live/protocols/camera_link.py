"""The link to a webcam of the server's machine: a thread finds a person with hands in its pictures (docs/video.md)."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.devices.video.device import POINTS, VideoDevice, VideoSettings
from bodysense.devices.video.landmarker_files import find_landmarkers
from bodysense.devices.video.pictures import VideoBrokenError, open_video
from bodysense.devices.video.watching import watch
from bodysense.errors import BodysenseError
from bodysense.observing.observation import Observation
from bodysense_live.protocols.links import signal_of
from bodysense_live.server.live import Live
from bodysense_live.sessions.answer import Answer

RETRY = 2.0  # s between attempts to open a camera that was lost
COUNTED = 2.0  # s between counts of people; the landmarker that follows one person alone is twice as fast
MOST = 4  # people that are counted
ABSENT = 1.0  # s without a person, after which the server says so
_DARK = 16.0  # of 255, largest brightness of 99 % of the pixels behind a covered lens; noise of sensors is below it


@dataclass(frozen=True)
class Look:
    """Landmarks of one picture of a webcam, and whether the lens is covered."""

    observation: Observation  # `POINTS` of one frame
    is_dark: bool = False  # the lens is covered, or the room is dark
    people: int = 1  # people in the picture, as counted last; one of them is followed


@dataclass(frozen=True)
class CameraSettings:
    """A webcam of the server's machine, and the folder with MediaPipe's models; None: the cache."""

    index: int
    landmarkers: Path | None = None

    def __post_init__(self) -> None:
        if self.index < 0:
            raise BodysenseError(f"--camera {self.index}: give the index of a webcam; the first is 0")


def camera_frames(settings: CameraSettings, skeleton: Skeleton) -> Generator[Look, None, None]:
    """Yield what each picture of a webcam shows, until it has no more pictures.

    Raises BodysenseError if the webcam or the models cannot be opened, and VideoBrokenError when the webcam is lost.
    """
    from bodysense.devices.video.arms import Arms, ArmSettings, load_arms
    from bodysense.devices.video.landmarks import Landmarker, LandmarkerSettings

    arms = Arms(skeleton, load_arms(None), ArmSettings(look_ahead=0.0))
    files = find_landmarkers(settings.landmarkers)
    with (
        open_video(str(settings.index)) as video,
        Landmarker(files, LandmarkerSettings(people=1)) as landmarker,
        Landmarker(files, LandmarkerSettings(people=MOST)) as counter,
    ):
        people, counted_at = 0, -inf
        for watched in watch(
            video.pictures,
            landmarker,
            lambda aspect: VideoDevice(skeleton, arms, aspect, VideoSettings(look_ahead=0.0)),
        ):
            for k, picture in enumerate(watched.pictures):
                if picture.time - counted_at >= COUNTED:
                    people, counted_at = len(counter.find(picture)[0].world), picture.time
                yield Look(watched.frames.observation[k : k + 1], is_dark(picture.pixels), people)


def is_dark(pixels: np.ndarray) -> bool:
    """Whether a picture (H, W, 3) uint8 is black but for noise."""
    return bool(np.percentile(pixels[::8, ::8], 99) < _DARK)


class CameraLink:
    """The link to a webcam (`links.Link`). A webcam that is taken away is opened again when it comes back.

    Raises BodysenseError if the webcam or the models cannot be opened at the start.
    """

    def __init__(self, settings: CameraSettings, skeleton: Skeleton) -> None:
        self._settings, self._skeleton = settings, skeleton
        self._frames: Generator[Look, None, None] | None = camera_frames(settings, skeleton)
        next(self._frames, None)  # opens all, so that errors come before the start
        self._stopped = threading.Event()
        self._sequence = 0
        self._seen_at: float | None = None  # s of the loop's clock, when a person was last seen; None: never
        self._state = ""  # as printed last

    async def open(self, live: Live) -> None:
        """Start to watch."""
        slot = live.add_input("camera", POINTS)
        self._receive_frame = partial(live.receive, slot)
        self._loop = asyncio.get_running_loop()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def send_body(self, answer: Answer) -> None:
        """Do nothing: a webcam takes no bodies."""

    def close(self) -> None:
        """Stop watching. The thread ends after the picture that it looks at."""
        self._stopped.set()

    def _run(self) -> None:
        """Watch, and again after each loss, until stopped."""
        while not self._stopped.is_set():
            frames = self._frames if self._frames is not None else camera_frames(self._settings, self._skeleton)
            self._frames = None
            reason = f"webcam {self._settings.index}: no more pictures"
            try:
                with closing(frames):
                    for look in frames:
                        if self._stopped.is_set():
                            return
                        self._loop.call_soon_threadsafe(self._receive, look)
            except VideoBrokenError:
                pass
            except BodysenseError as error:
                reason = str(error)
            except RuntimeError:  # the loop has ended
                return
            if not self._stopped.is_set():
                print(f"{reason}; it is opened again when it comes back", flush=True)
            self._stopped.wait(RETRY)

    def _receive(self, look: Look) -> None:
        """Pass a frame to the session, in the event loop. Frames without a person are left out."""
        now, observation = self._loop.time(), look.observation
        if not (observation.has_position.any() or observation.has_rotation.any()):
            if self._seen_at is None or now - self._seen_at > ABSENT:
                self._report("the picture is black: uncover the lens, or switch a light on" if look.is_dark else
                             "nobody is seen")  # fmt: skip
            return
        self._report(
            "a person is seen"
            if look.people < 2
            else f"{look.people} people are seen, one of them is followed; if it is the wrong one, let the others "
            "leave the picture for a moment"
        )
        self._seen_at = now
        self._sequence = (self._sequence + 1) % 2**32
        self._receive_frame(signal_of(observation, POINTS, self._sequence, now))

    def _report(self, state: str) -> None:
        """Print what the webcam sees, if it has changed."""
        if state != self._state:
            self._state = state
            print(f"webcam {self._settings.index}: {state}", flush=True)
