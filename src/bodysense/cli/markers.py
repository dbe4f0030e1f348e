"""Gloves on the command line: marker files to recordings, and recordings to marker files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.errors import BodysenseError

if TYPE_CHECKING:
    from bodysense.capture.raw_markers import MarkerFormat
    from bodysense.capture.recording import Recording
    from bodysense.observation import Observation

SIDES = ("left", "right")


@dataclass(frozen=True)
class MarkerOptions:
    """What a marker file (.csv, .c3d) does not say of itself, or says wrongly."""

    names: Path | None = None
    """Of a marker file: a table of its names and ours, .json or .csv (docs/gloves.md)."""
    unit: Literal["m", "cm", "mm"] | None = None
    """Of a marker file; by default what it says, metres for CSV."""
    up: Literal["y", "z"] | None = None
    """Of a marker file: its upward axis; by default what it says, y for CSV, z for C3D."""
    left_handed: bool = False
    """Of a marker file: its axes are left-handed, as in Unity and Unreal."""
    marker_rate: float | None = None
    """Of a CSV file without times: frames a second."""
    unlabelled: Literal["left", "right", "both"] | None = None
    """Of a marker file: its points are not told apart (passive markers); these gloves are found among them."""

    def form(self) -> MarkerFormat:
        """These options as the readers take them. Raises BodysenseError for a table of names that is none."""
        from bodysense.capture.raw_markers import MarkerFormat, read_names

        names = None if self.names is None else read_names(self.names)
        return MarkerFormat(names, self.unit, self.up, self.left_handed, self.marker_rate)


NO_OPTIONS = MarkerOptions()


def recording_of_markers(file: Path, options: MarkerOptions, height: float | None) -> Recording:
    """What the gloves of a marker file show, on the default body, `height` m tall, with hands of the gloves' size.

    Prints what is doubtful. Raises BodysenseError for a file that is no recording of gloves.
    """
    from bodysense.body.skeleton import default_skeleton
    from bodysense.capture.markers import read_markers, with_hands_of
    from bodysense.capture.recording import Recording

    body = default_skeleton() if height is None else default_skeleton().scaled(height)
    if options.unlabelled is not None:
        observation = _labelled(file, options)
        return Recording(observation, body)
    found = read_markers(file, options.form())
    for remark in found.remarks:
        print(f"note: {remark}")
    for hand, size in found.sizes.items():
        print(f"the {hand} hand is {size:.2f} times the size of the default body's")
    if height is not None:  # sizes are factors of the unscaled hand
        ratio = default_skeleton().height / body.height
        body = with_hands_of(body, {k: size * ratio for k, size in found.sizes.items()})
        return Recording(found.observation, body, hands_shown=True)
    return Recording(found.observation, with_hands_of(body, found.sizes), hands_shown=True)


def check_gloves_of(observation: Observation, place: Path) -> None:
    """Look at the gloves of a recording; prints what is doubtful."""
    from bodysense.body.glove import glove_hands
    from bodysense.capture.marker_checks import check_gloves

    others = [hand for hand in glove_hands(observation.points) if hand not in SIDES]
    if others:
        print(f"note: left out {', '.join(map(repr, others))}: a body has the hands 'left' and 'right'")
    for remark in check_gloves(observation, str(place)).remarks:
        print(f"note: {remark}")


def write_seen(out: Path, recording: Recording, frame_rate: float) -> None:
    """Write a recording, or, by the ending of its name, the markers of its gloves."""
    from bodysense.capture.markers import is_marker_file, write_markers
    from bodysense.capture.recording import write_recording

    if is_marker_file(out):
        write_markers(out, recording.observation, frame_rate)
    else:
        write_recording(out, recording)


def _labelled(file: Path, options: MarkerOptions) -> Observation:
    """The gloves among the points of a file that does not tell them apart."""
    from bodysense.body.hand import Side, hand_skeleton
    from bodysense.body.skeleton import default_skeleton
    from bodysense.capture.labelling import Labeller
    from bodysense.capture.markers import read_unlabelled

    if options.names is not None:
        raise BodysenseError(f"--names {options.names}: --unlabelled takes no names; leave one of both out")
    points, _ = read_unlabelled(file, options.form())
    sides: list[Side] = [side for side in SIDES if options.unlabelled in (side, "both")]
    labeller = Labeller({side: hand_skeleton(default_skeleton(), side) for side in sides})
    observation, _ = labeller.step(points, labeller.start())
    shown = observation.has_position.any(axis=0).reshape(len(sides), -1)
    for k, side in enumerate(sides):
        if not shown[k].any():
            raise BodysenseError(
                f"{file}: no {side} glove is found among its {len(points.points)} points; see docs/gloves.md, "
                "or name the markers"
            )
    return observation
