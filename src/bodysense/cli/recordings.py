"""Files as recordings: what was tracked, or what a device would track of a motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.cli.markers import NO_OPTIONS, MarkerOptions, recording_of_markers, simulated_gloves
from bodysense.errors import BodysenseError

if TYPE_CHECKING:
    import numpy as np

    from bodysense.capture.recording import Recording
    from bodysense.data.clip import Clip

Device = Literal["headset-camera", "three-point", "head-only", "gloves"]


def load_clip(file: Path, height: float | None) -> Clip:
    """A user's motion in canonical form, scaled where they say how tall it is."""
    from bodysense.data.augment import at_height
    from bodysense.data.sources import Source, read_source

    clip = read_source(Source(file, person="", split="test"))
    return clip if height is None else at_height(clip, height)


def simulated(clip: Clip, device: Device) -> Recording:
    """What a device tracks of a clip."""
    from bodysense.capture.recording import Recording
    from bodysense.occlusion import headset_camera, three_point

    if device == "gloves":
        return simulated_gloves(clip)
    if device == "headset-camera":
        observation = headset_camera.observe(clip.pose, clip.time)
    else:
        observation = three_point.observe(clip.pose, clip.time, three_point.ThreePoint(hands=device == "three-point"))
    return Recording(observation, clip.pose.skeleton)


def recording_of(
    file: Path, device: Device | None, height: float | Literal["headset"] | None, gloves: MarkerOptions
) -> Recording:
    """A recording, or what a device records of a motion; checked for what would come out of it."""
    from bodysense.capture.markers import is_marker_file
    from bodysense.capture.recording import is_recording, read_recording

    if device is not None:
        recording = simulated(load_clip(file, metres(height)), device)
    elif not file.is_file():
        raise BodysenseError(f"{file}: no such file")
    elif is_marker_file(file):
        recording = recording_of_markers(file, gloves, metres(height))
    elif gloves != NO_OPTIONS:
        raise BodysenseError(f"{file}: --names, --unit, --up and their like are for marker files, .csv and .c3d")
    elif is_recording(file):
        recording = read_recording(file)
        if height is not None:
            recording = _of_height(file, recording, height)
    elif height is not None:
        raise BodysenseError(f"{file}: --height scales a motion seen by a device; say which with --device")
    else:
        raise BodysenseError(
            f"{file}: not a recording; if it is a motion, say what watches it: --device headset-camera, or "
            "--fingers synthesize to give it fingers"
        )
    if is_three_point(recording):
        _check_headset(recording)
    return recording


def is_three_point(recording: Recording) -> bool:
    """Whether nothing but head and wrists is in it, gloves aside."""
    from bodysense.observation import without_gloves
    from bodysense.occlusion.three_point import POINTS

    body = without_gloves(recording.observation).points
    return bool(body) and set(body) <= set(POINTS)


def metres(height: float | Literal["headset"] | None) -> float | None:
    """What was said in metres."""
    return None if height == "headset" else height


def _head_height(recording: Recording) -> np.ndarray:
    """(T,) m over the floor; NaN where the headset was not tracked."""
    import numpy as np

    seen = recording.observation
    head = [name == "head" for name in seen.points]
    return np.where(seen.has_position[:, head], seen.position[:, head, 1], np.nan).ravel()


def _check_headset(recording: Recording) -> None:
    """Refuse a recording of head and wrists without a headset, or with one below the floor."""
    import numpy as np

    height = _head_height(recording)
    known = height[np.isfinite(height)]
    if not known.size:
        raise BodysenseError(
            "the recording has no headset: 'head' is tracked in none of its frames; record it with one"
        )
    highest = float(np.percentile(known, 95))
    if highest < 0:
        raise BodysenseError(
            f"the headset is {-highest:.2f} m below the floor, which is y = 0; give positions over the floor"
        )


def _of_height(file: Path, recording: Recording, height: float | Literal["headset"]) -> Recording:
    """A recording of head and wrists whose wearer is as tall as they say, or as their headset shows."""
    from bodysense.body.stature import height_from_headset

    if not is_three_point(recording):
        raise BodysenseError(
            f"{file}: --height scales a motion; a recording holds its wearer's skeleton, so leave it out"
        )
    if height == "headset":
        height = height_from_headset(_head_height(recording), recording.skeleton)
        print(f"the headset is carried by a body of {height:.2f} m")
    return replace(recording, skeleton=recording.skeleton.scaled(height))
