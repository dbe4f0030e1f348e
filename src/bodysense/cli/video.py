"""`bodysense track VIDEO`: a person in a video file, a folder of images or a webcam, to motion."""

from __future__ import annotations

import time as clock
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense.files import check_place

if TYPE_CHECKING:
    from collections.abc import Callable

    from bodysense.body.person import Person
    from bodysense.body.pose import Pose
    from bodysense.body.skeleton import Skeleton
    from bodysense.devices.video.device import VideoDevice, VideoFrames
    from bodysense.devices.video.person import PersonSettings
    from bodysense.devices.video.presence import Presence
    from bodysense.devices.video.watching import SightingCounts, WatchedFrames
    from bodysense.io.formats.bvh import BvhStream
    from bodysense.observing.observation import Observation
    from bodysense.takes.two_way import TwoWayTracker
    from bodysense.tracking.tracker import TrackerSettings


@dataclass(frozen=True)
class VideoOptions:
    """Options of videos."""

    overlay: Path | None = None
    """video: file (.mp4) for the video with the body over it and next to it."""
    look_ahead: float | None = None
    """video: seconds that a result waits for later frames; 0.25 by default, 0 for a webcam."""
    field_of_view: float = 60.0
    """video: field of view in degrees over the longer side of the picture."""
    tilt: float | None = None
    """video: degrees by which the camera looks down; estimated from the standing person if omitted."""
    roll: float | None = None
    """video: degrees by which upright things lean to the right in the picture; estimated if omitted."""
    follow: int | None = None
    """video: number of the person to follow, which --overlay displays at its beginning; the largest if omitted."""
    people: int = 2
    """video: maximum number of people; 1 is faster if no other person comes into the picture."""
    seconds: float | None = None
    """video: length in seconds; a webcam also stops with Ctrl-C."""
    image_rate: float = 30.0
    """folder of images: images a second."""
    landmarkers: Path | None = None
    """video: folder of MediaPipe's model files (docs/video.md)."""


NO_VIDEO = VideoOptions()
_SPANS = 5  # times without a person that are printed


def track_video(
    source: str,
    out: Path,
    options: VideoOptions,
    model: Path | None,
    wearer: Person | None,
    rig: str | None,
    settings: TrackerSettings,
    causal: bool = False,
) -> None:
    """Write the motion of the person in a video on a rig, and the video with the body over it.

    The motion of a file is completed with past and future, unless `causal`. The body over the video is always causal.
    """
    from rich.progress import Progress, SpinnerColumn

    from bodysense.body.person import Person
    from bodysense.devices.video.landmarker_files import find_landmarkers
    from bodysense.devices.video.landmarks import Landmarker, LandmarkerSettings
    from bodysense.devices.video.pictures import VideoBrokenError, open_video
    from bodysense.devices.video.presence import Presence
    from bodysense.devices.video.watching import SightingCounts, watch
    from bodysense.io.motion_files import motion_stream
    from bodysense.io.target_rigs.named import OWN
    from bodysense.pictures.overlay import Overlay
    from bodysense.takes.two_way import TwoWayTracker
    from bodysense.tracking.tracker import Tracker

    people = _person_settings(options)
    person = Person() if wearer is None else wearer
    look_ahead = _look_ahead(source, options)
    make_device = _device_factory(person.skeleton, options, model, look_ahead)
    # Lengths in a video are guesses, so proportions cannot be inferred.
    tracker = Tracker(person, settings=replace(settings, infer=False))
    state, tally, broken = tracker.start(), _Tally(SightingCounts()), None
    with ExitStack() as stack:
        video = stack.enter_context(open_video(source, options.image_rate))
        files = find_landmarkers(options.landmarkers)
        landmarker = stack.enter_context(Landmarker(files, LandmarkerSettings(people=options.people)))
        file = stack.enter_context(motion_stream(out, person.skeleton, video.rate, rig or OWN))
        two_way = None if causal or video.count is None else TwoWayTracker(person, None, tracker.settings)
        motion = _Motion(file, two_way, Presence())
        overlay = None if options.overlay is None else stack.enter_context(Overlay(options.overlay, video.rate))
        longest = options.seconds or float("inf")
        pictures = takewhile(lambda picture: picture.time < longest, video.pictures)
        progress = stack.enter_context(Progress(SpinnerColumn(), *Progress.get_default_columns()))
        count = min(video.count or float("inf"), longest * video.rate)  # infinite for a webcam
        bar = progress.add_task(
            f"tracking {video.name}, look-ahead {look_ahead:g} s", total=None if count == float("inf") else round(count)
        )
        try:
            for done in watch(pictures, landmarker, make_device, people):
                begun = clock.perf_counter()
                if len(done.frames):
                    estimate, state = tracker.step(done.frames.observation, state)
                    motion.add(done.frames, estimate.pose)
                    if overlay is not None:
                        overlay.add(done.pictures, estimate.pose, done.frames, done.people)
                tally.add(done, clock.perf_counter() - begun)
                progress.advance(bar, len(done.frames))
        except VideoBrokenError as error:
            broken = str(error)
        except KeyboardInterrupt:
            if video.count is not None:
                raise
        tally.seen.check(video.name, options.follow)
        motion.finish(1 / video.rate)
    _report(f"wrote {out}: {file.frames} frames\n{tally.line()}{_absence(motion.presence)}", broken, options.overlay)


def _absence(presence: Presence) -> str:
    """Return a line with the times without a person, or an empty text."""
    if not presence.absent:
        return ""
    spans = [f"{begin:.1f}-{end:.1f}" for begin, end in presence.absent[:_SPANS]]
    more = "" if len(presence.absent) <= _SPANS else f" and {len(presence.absent) - _SPANS} more"
    return (
        f"\nnobody is seen for {presence.seconds:.1f} s, which are left out of the motion: {', '.join(spans)} s{more}"
    )


def _report(text: str, warning: str | None, overlay: Path | None) -> None:
    """Print the result, with a warning if the video broke off."""
    from rich.console import Console

    console = Console(highlight=False)
    if warning is not None:
        console.print(f"warning: {warning}", style="yellow")
    console.print(text)
    if overlay is not None:
        console.print(f"wrote {overlay}")


def _person_settings(options: VideoOptions) -> PersonSettings:
    """Return the person to follow. Raises BodysenseError for invalid options, before any file is opened."""
    from bodysense.devices.video.person import PersonSettings

    if options.overlay is not None:
        check_place(options.overlay)
    if options.seconds is not None and not options.seconds > 0:
        raise BodysenseError(f"--seconds {options.seconds:g}: give more than 0")
    return PersonSettings(number=options.follow)


def _look_ahead(source: str, options: VideoOptions) -> float:
    """Return the look-ahead in seconds: the given one, else 0 for a webcam and the default for a file."""
    from bodysense.devices.video.device import VideoSettings

    if options.look_ahead is not None:
        return options.look_ahead
    return 0.0 if source.isdecimal() and not Path(source).exists() else VideoSettings().look_ahead


def _device_factory(
    skeleton: Skeleton, options: VideoOptions, model: Path | None, look_ahead: float
) -> Callable[[float], VideoDevice]:
    """Return a function from the aspect ratio (width / height) of pictures to the device."""
    from bodysense.devices.video.arms import Arms, ArmSettings, load_arms
    from bodysense.devices.video.device import VideoDevice, VideoSettings

    settings = VideoSettings(look_ahead, field_of_view=options.field_of_view, tilt=options.tilt, roll=options.roll)
    arms = Arms(skeleton, load_arms(model), ArmSettings(look_ahead=look_ahead))
    return lambda aspect: VideoDevice(skeleton, arms, aspect, settings)


@dataclass
class _Motion:
    """The motion of a video: written frame by frame, or completed with past and future at the end.

    Frames without a person are left out.
    """

    file: BvhStream
    two_way: TwoWayTracker | None  # None: each frame is written at once
    presence: Presence
    kept: list[Observation] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)  # s without a person before each kept frame
    waiting: list[tuple[Observation, Pose]] = field(default_factory=list)  # frames that may be kept later
    first: int = 0  # number of the first waiting frame

    def add(self, frames: VideoFrames, pose: Pose) -> None:
        """Add the next frames and their causal poses (T,)."""
        self.waiting += [(frames.observation[k : k + 1], pose[k : k + 1]) for k in range(len(frames))]
        for number, lost in self.presence.add(frames.time.tolist(), frames.person.has_body.tolist()):
            observation, body = self.waiting[number - self.first]
            if self.two_way is None:
                self.file.append(observation.time - lost, body)
            else:
                self.kept.append(observation)
                self.lost.append(lost)
        done = self.presence.oldest - self.first
        del self.waiting[:done]
        self.first += done

    def finish(self, seconds: float) -> None:
        """Complete the kept frames, `seconds` apart, and write them."""
        from bodysense.observing.points import concatenated_frames

        self.presence.finish(seconds)
        if self.two_way is not None and self.kept:
            whole = concatenated_frames(self.kept)
            self.file.append(whole.time - self.lost, self.two_way.complete(whole, seconds).pose)


@dataclass
class _Tally:
    """Counts of seen people and hands, and times."""

    seen: SightingCounts
    left_hands: int = 0
    right_hands: int = 0
    landmark_seconds: float = 0.0
    body_seconds: float = 0.0

    def add(self, done: WatchedFrames, seconds: float) -> None:
        self.seen.add(done)
        left, right = done.frames.person.has_hand.sum(axis=0).tolist()
        self.left_hands, self.right_hands = self.left_hands + left, self.right_hands + right
        self.landmark_seconds += done.landmark_seconds
        self.body_seconds += done.device_seconds + seconds

    def line(self) -> str:
        frames, counts = self.seen.frames, (self.seen.bodies, self.left_hands, self.right_hands)
        body, left, right = (f"{count / frames:.0%}" for count in counts)
        landmarks, rest = (f"{frames / s:.0f}" for s in (self.landmark_seconds, self.body_seconds))
        return (
            f"the person in {body} of the pictures, their left hand in {left}, right in {right}; "
            f"landmarks {landmarks} frames/s, the rest {rest} frames/s"
        )
