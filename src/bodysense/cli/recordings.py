"""Opening of a user's files as motions or recordings, with printed remarks."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense.io.markers.options import NO_OPTIONS, MarkerOptions
from bodysense.io.reading_options import ReadingOptions

if TYPE_CHECKING:
    from bodysense.body.person import Person
    from bodysense.io.clip import Clip
    from bodysense.observing.observation import Observation
    from bodysense.sources.open import MotionSource, Opened

_SIDES = ("left", "right")


def load_clip(file: Path, reading: ReadingOptions, rate: float | None = None) -> Clip:
    """Read a user's motion in canonical form and print remarks; `rate` Hz is for files without a frame rate."""
    return open_motion(file, reading, rate).clip


def open_motion(
    file: Path,
    reading: ReadingOptions,
    rate: float | None = None,
    option: str = "--rate",
    *,
    watches_limbs: bool = False,
) -> MotionSource:
    """Open a user's motion, and print remarks.

    Args:
        file: motion.
        reading: facts that the file omits.
        rate: frames a second, for files without a frame rate.
        option: name of the option for the rate, in messages.
        watches_limbs: look for limbs with constant values in a BVH file.

    Raises BodysenseError for every other kind of file.
    """
    from bodysense.sources.kinds import MOTION_ENDINGS, kind_of
    from bodysense.sources.open import MotionSource, open_source

    kind = kind_of(file)
    try:
        opened = open_source(file, reading, MarkerOptions(rate=rate)) if kind == "motion" else kind
        if isinstance(opened, MotionSource):
            opened = replace(opened, watches_limbs=watches_limbs)
            for line in opened.remarks:
                print(line.replace("--rate", option))
            print_warnings(opened.warnings)
            return opened
    except BodysenseError as error:
        raise BodysenseError(str(error).replace("--rate", option)) from None
    whole = {"recording": "a recording", "markers": "markers", "video": "a video", "motion": "joint places"}[kind]
    raise BodysenseError(
        f"{file}: {whole}, not a motion; complete it first: bodysense track {file.name} -o motion.bvh, or give a "
        f"file of {', '.join(MOTION_ENDINGS)}"
    )


def print_warnings(warnings: Sequence[str]) -> None:
    """Print warnings about a user's file."""
    for line in warnings:
        print(f"WARNING: {line}", file=sys.stderr)


def person_of(file: Path | None, height: float | None) -> Person | None:
    """Return the wearer that options describe; None without options."""
    from bodysense.body.person import Person

    if file is not None and height is not None:
        raise BodysenseError(f"--height {height:g}: {file} holds the wearer's height; leave one of both out")
    return None if file is None else Person.load(file)


def open_recorded(file: Path, reading: ReadingOptions, markers: MarkerOptions = NO_OPTIONS) -> Opened:
    """Open a user's file, and print remarks on markers and gloves."""
    from bodysense.body.hands.hand import glove_hands
    from bodysense.io.markers.options import is_marker_file
    from bodysense.sources.open import MarkerSource, RecordingSource, open_source

    opened = open_source(file, reading, markers)
    if isinstance(opened, MarkerSource):
        for line in opened.remarks:
            print(line)
        print_warnings(opened.warnings)
    if isinstance(opened, RecordingSource) and is_marker_file(file):
        points = ", ".join(opened.recording.observation.points)
        mirrored = "left-handed (--left-handed)"
        axes = mirrored if reading.left_handed else "right-handed, as OpenXR's (else --left-handed)"
        print(f"note: a headset's log, read as a recording (as a .jsonl is) of {points}; its axes are {axes}")
    if isinstance(opened, RecordingSource) and glove_hands(opened.recording.observation.points):
        _check_gloves(opened.recording.observation, file)
    return opened


def _check_gloves(observation: Observation, place: Path) -> None:
    """Print remarks on doubtful gloves of a recording."""
    from bodysense.body.hands.hand import glove_hands
    from bodysense.io.markers.checks import check_gloves

    others = [hand for hand in glove_hands(observation.points) if hand not in _SIDES]
    if others:
        print(f"note: left out {', '.join(map(repr, others))}: a body has the hands 'left' and 'right'")
    for remark in check_gloves(observation, str(place)).remarks:
        print(f"note: {remark}")
