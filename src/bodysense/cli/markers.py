"""Markers on the command line: remarks on gloves, and recordings as marker files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bodysense.io.recording import Recording
    from bodysense.observation import Observation

SIDES = ("left", "right")


def check_gloves_of(observation: Observation, place: Path) -> None:
    """Look at the gloves of a recording; prints what is doubtful."""
    from bodysense.body.hand import glove_hands
    from bodysense.io.markers.checks import check_gloves

    others = [hand for hand in glove_hands(observation.points) if hand not in SIDES]
    if others:
        print(f"note: left out {', '.join(map(repr, others))}: a body has the hands 'left' and 'right'")
    for remark in check_gloves(observation, str(place)).remarks:
        print(f"note: {remark}")


def write_seen(out: Path, recording: Recording, frame_rate: float) -> None:
    """Write a recording, or, by the ending of its name, the markers of its gloves."""
    from bodysense.io.markers.files import write_markers
    from bodysense.io.markers.options import is_marker_file
    from bodysense.io.recording import write_recording

    if is_marker_file(out):
        write_markers(out, recording.observation, frame_rate)
    else:
        write_recording(out, recording)
