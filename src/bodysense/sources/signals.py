"""Signals: the observation and the person of a source (recording, motion seen by a simulated device, or video)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bodysense.body.hands.hand import glove_hands
from bodysense.body.person import SHORTEST, TALLEST, Person
from bodysense.body.shape import stature
from bodysense.devices.simulated.device import DEVICES, Device, simulate
from bodysense.errors import BodysenseError
from bodysense.io.formats.recording import Recording
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import RAW_POINTS, Observation
from bodysense.observing.points import concatenated_frames
from bodysense.observing.raw_poses import with_joints
from bodysense.quality.plausible import unit_fix
from bodysense.sources.open import MotionSource, Opened, VideoSource

if TYPE_CHECKING:
    from bodysense.body.hands.hand_family import GlovedHand


@dataclass(frozen=True, eq=False)
class Signal:
    """Observation of a person, and the known properties of that person."""

    name: str  # for messages
    observation: Observation
    person: Person
    infer: bool = True  # False: measured lengths are guesses, so proportions cannot be inferred


def signal_from(
    opened: Opened,
    *,
    device: str | Device | None = None,
    person: Person | None = None,
    height: float | None = None,
    noise: int | None = None,
    follow: int | None = None,
    roll: float | None = None,
) -> Signal:
    """Return the signal of an opened source; arguments as for `track`."""
    name = opened.name
    if person is not None and height is not None:
        raise BodysenseError(f"both a person and a height of {height:g} m were given; give one of them")
    if isinstance(opened, VideoSource):
        refuse(name, "a video, not a motion", device=device, noise=noise)
        wearer = Person(height=height) if person is None else person
        return Signal(name, _video_observation(name, wearer, follow, roll), wearer, infer=False)
    refuse(name, "not a video, which alone has people to choose from and a camera", follow=follow, roll=roll)
    if isinstance(opened, MotionSource):
        if device is None:
            raise BodysenseError(
                f"{name}: not a recording; if it is a motion, say what device watches it, such as --device "
                f"headset_camera; valid are {', '.join(DEVICES)}"
            )
        recording = Recording(simulate(opened.clip, device, noise), opened.clip.pose.skeleton)
        check_size(opened)
    else:
        refuse(name, "a recording, not a motion", device=device, noise=noise)
        recording = opened.recording
    try:
        return _recording_signal(name, recording, person, height)
    except BodysenseError as error:
        raise BodysenseError(f"{name}: {str(error).removeprefix('observation: ')}") from None


def check_size(opened: MotionSource) -> None:
    """Raise BodysenseError for a motion whose body is not as tall as a person."""
    height = stature(opened.clip.pose.skeleton.rest_offset)
    if not SHORTEST <= height <= TALLEST:
        raise BodysenseError(
            f"{opened.name}: the body is {height:.3g} m tall, and people are {SHORTEST:g} to {TALLEST:g} m; "
            f"{unit_fix(opened.options.unit)}, or give its --height"
        )


def _recording_signal(name: str, recording: Recording, person: Person | None, height: float | None) -> Signal:
    observation = recording.observation
    if person is None:
        hands = _calibrated_hands(recording) if glove_hands(observation.points) else None
        is_known = recording.known and height is None
        person = Person(recording.skeleton, hands=hands) if is_known else Person(height=height, hands=hands)
    _check(observation)
    if not RAW_POINTS.isdisjoint(observation.points):
        observation = with_joints(observation, person.skeleton)
    return Signal(name, observation, person)


def _calibrated_hands(recording: Recording) -> dict[str, GlovedHand] | None:
    """Return the hands in the gloves of a recording, by side; None for standard gloves on known hands."""
    from bodysense.devices.gloves.device import calibrated_hands, has_standard_gloves

    if not recording.measures_hands and has_standard_gloves(recording.observation):
        return None
    return calibrated_hands(recording.observation, recording.glove_set)


def refuse(name: str, kind: str, **options: object) -> None:
    """Raise BodysenseError for given options that this kind of source does not have."""
    for option, value in options.items():
        if value is not None:
            raise BodysenseError(f"{name}: {kind}; leave --{option} out")


def _video_observation(source: str, person: Person, follow: int | None, roll: float | None) -> Observation:
    """Return the observation of person number `follow` in a video, of a camera rolled by `roll` degrees."""
    from bodysense.devices.video.arms import Arms, load_arms
    from bodysense.devices.video.device import VideoDevice, VideoSettings
    from bodysense.devices.video.landmarker_files import find_landmarkers
    from bodysense.devices.video.landmarks import Landmarker, LandmarkerSettings
    from bodysense.devices.video.person import PersonSettings
    from bodysense.devices.video.pictures import open_video
    from bodysense.devices.video.watching import SightingCounts, watch

    settings, people = VideoSettings(roll=roll), PersonSettings(number=follow)
    arms, parts, seen = Arms(person.skeleton, load_arms()), [], SightingCounts()
    with open_video(source) as video, Landmarker(find_landmarkers(None), LandmarkerSettings()) as landmarker:
        if video.count is None and source.isdecimal():
            raise BodysenseError(f"{source}: a webcam never ends; use the command, bodysense track {source}")
        for done in watch(
            video.pictures,
            landmarker,
            lambda aspect: VideoDevice(person.skeleton, arms, aspect, settings),
            people,
        ):
            seen.add(done)
            if len(done.frames):
                parts.append(done.frames.observation)
    if not parts:
        raise BodysenseError(f"{source}: no picture in it can be read")
    seen.check(source, follow)
    return concatenated_frames(parts)


def _check(observation: Observation) -> None:
    """Raise BodysenseError for an observation that cannot be completed."""
    check_observation(observation)
    if observation.position.ndim != 3:
        raise BodysenseError(f"position has shape {observation.position.shape}; a take is of one person: (T, P, 3)")
    if not (observation.has_position.any() or observation.has_rotation.any()):
        raise BodysenseError(
            f"nothing is tracked in its {len(observation)} frames; record it with the trackers switched on and seen"
        )
