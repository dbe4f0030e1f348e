"""A user's files as motions and signals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bodysense.cli.markers import NO_OPTIONS, MarkerOptions, check_gloves_of, recording_of_markers
from bodysense.errors import BodysenseError
from bodysense.io.rigs.options import ReadingOptions

if TYPE_CHECKING:
    from bodysense.body.person import Person
    from bodysense.io.clip import Clip
    from bodysense.io.recording import Recording


def load_clip(file: Path, reading: ReadingOptions, rate: float | None = None) -> Clip:
    """A user's motion in canonical form, at `rate` Hz where the file does not say it; prints what was recognised."""
    from bodysense.reading import read_clip

    clip, said = read_clip(file, reading, rate)
    for line in said:
        print(line)
    return clip


def person_of(file: Path | None, height: float | None) -> Person | None:
    """What a user says of the wearer; None for nothing."""
    from bodysense.body.person import Person

    if file is not None and height is not None:
        raise BodysenseError(f"--height {height:g}: {file} holds the wearer's height; leave one of both out")
    return None if file is None else Person.load(file)


def source_of(
    file: Path, markers: MarkerOptions, reading: ReadingOptions, fingers: bool = False
) -> Path | Clip | Recording:
    """What `bodysense.track` takes: a recording's file, a motion, or markers that a user says more about.

    `fingers` are to be made up, which those of gloves are not.
    """
    from bodysense.devices.gloves.device import has_gloves
    from bodysense.io.markers.files import ENDINGS, is_marker_file
    from bodysense.io.recording import is_recording, read_recording

    if not file.is_file():
        raise BodysenseError(f"{file}: no such file")
    if is_marker_file(file):
        found = recording_of_markers(file, markers, reading)
        if has_gloves(found.observation):
            _check_fingers(file, fingers)
        return found
    kinds = ", ".join(ENDINGS)
    if not is_recording(file):
        if replace(markers, rate=None) != NO_OPTIONS:
            raise BodysenseError(f"{file}: a motion; --names, --unlabelled and their like are for markers, {kinds}")
        return load_clip(file, reading, markers.rate)
    if replace(markers, marker_set=None) != NO_OPTIONS:
        raise BodysenseError(f"{file}: --names, --unlabelled and their like are for marker files, {kinds}")
    if reading != ReadingOptions(floor=reading.floor, height=reading.height):
        raise BodysenseError(f"{file}: --unit, --up, --joints and --figure are for motions and marker files")
    recording = read_recording(file)
    if has_gloves(recording.observation):
        _check_fingers(file, fingers)
        check_gloves_of(recording.observation, file)
        return replace(recording, worn=markers.worn())
    return file


def _check_fingers(file: Path, fingers: bool) -> None:
    if fingers:
        raise BodysenseError(f"{file}: its gloves have fingers; leave --fingers synthesize out")
