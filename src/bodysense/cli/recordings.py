"""A user's files as motions and signals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bodysense.cli.markers import NO_OPTIONS, MarkerOptions, check_gloves_of, recording_of_markers
from bodysense.errors import BodysenseError

if TYPE_CHECKING:
    from bodysense.body.person import Person
    from bodysense.capture.recording import Recording
    from bodysense.data.clip import Clip


def load_clip(file: Path, height: float | None, rate: float | None = None) -> Clip:
    """A user's motion in canonical form, scaled where they say how tall it is; `rate` Hz where it does not say.

    Prints what was found of files that do not say all.
    """
    from bodysense.data.augment import at_height
    from bodysense.reading import read_clip

    clip, remarks = read_clip(file, rate)
    for remark in remarks:
        print(f"note: {remark}")
    return clip if height is None else at_height(clip, height)


def person_of(file: Path | None, height: float | None) -> Person | None:
    """What a user says of the wearer; None for nothing."""
    from bodysense.body.person import Person

    if file is not None and height is not None:
        raise BodysenseError(f"--height {height:g}: {file} holds the wearer's height; leave one of both out")
    return None if file is None else Person.load(file)


def source_of(
    file: Path, markers: MarkerOptions, height: float | None, floor: float | None = None, fingers: bool = False
) -> Path | Recording | Clip:
    """What `bodysense.track` takes: a file, a recording of markers, or a motion that a user may say more about.

    `fingers` are to be made up, which those of gloves are not.
    """
    from bodysense.capture.recording import is_recording, read_recording
    from bodysense.devices.gloves import has_gloves
    from bodysense.io.markers.files import ENDINGS, is_marker_file
    from bodysense.reading import says_little

    if not file.is_file():
        raise BodysenseError(f"{file}: no such file")
    if is_marker_file(file):
        recording = recording_of_markers(file, markers, height, floor)
        if has_gloves(recording.observation):
            _check_fingers(file, fingers)
        return recording
    if says_little(file):
        if replace(markers, rate=None) != NO_OPTIONS:
            raise BodysenseError(f"{file}: a motion; --names, --unit, --up and their like are for marker files")
        return load_clip(file, None, markers.rate)
    if markers != NO_OPTIONS:
        raise BodysenseError(f"{file}: --names, --unit, --up and their like are for marker files, {', '.join(ENDINGS)}")
    if is_recording(file):
        recording = read_recording(file)
        if has_gloves(recording.observation):
            _check_fingers(file, fingers)
            check_gloves_of(recording.observation, file)
    return file


def _check_fingers(file: Path, fingers: bool) -> None:
    if fingers:
        raise BodysenseError(f"{file}: its gloves have fingers; leave --fingers synthesize out")
