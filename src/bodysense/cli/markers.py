"""Markers on the command line: marker files to recordings, and recordings to marker files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from bodysense.errors import BodysenseError
from bodysense.io.rigs.options import ReadingOptions

if TYPE_CHECKING:
    from bodysense.body.glove_set import GloveSet
    from bodysense.io.markers.raw_markers import MarkerFormat
    from bodysense.io.recording import Recording
    from bodysense.observation import Observation

SIDES = ("left", "right")


@dataclass(frozen=True)
class MarkerOptions:
    """What a marker file (.c3d, .csv, .trc, .tsv) does not say of itself, or says wrongly."""

    marker_set: str | None = None
    """Of gloves: which marker sits on which segment, a .toml or .json file or a packaged set's name (docs/gloves.md);
    by their labels if omitted."""
    names: Path | None = None
    """Of a marker file: a table of its names and ours, .json or .csv (docs/markers.md)."""
    left_handed: bool = False
    """Of a marker file: its axes are left-handed, as in Unity and Unreal."""
    rate: float | None = None
    """Of a file that does not say it: frames a second."""
    unlabelled: Literal["left", "right", "both"] | None = None
    """Of a marker file: its points are not told apart (passive markers); these gloves are found among them."""

    def form(self, reading: ReadingOptions) -> MarkerFormat:
        """These options as the readers take them. Raises BodysenseError for what marker files cannot be."""
        from bodysense.io.markers.raw_markers import METRES, MarkerFormat, Unit, Up, read_names

        if reading.unit not in (None, *METRES) or reading.up not in (None, "y", "z"):
            raise BodysenseError(f"--unit {reading.unit} --up {reading.up}: marker files are in m, cm or mm, y or z up")
        if more := reading.for_motions():
            raise BodysenseError(f"{', '.join(more)}: for motions, not for marker files; leave it out")
        names = None if self.names is None else read_names(self.names)
        unit, up = cast("Unit | None", reading.unit), cast("Up | None", reading.up)
        return MarkerFormat(names, unit, up, self.left_handed, self.rate, self.worn(), reading.floor)

    def worn(self) -> GloveSet | None:
        """The marker set that is told."""
        from bodysense.body.glove_set import read_set

        return None if self.marker_set is None else read_set(self.marker_set)


NO_OPTIONS = MarkerOptions()


def recording_of_markers(file: Path, options: MarkerOptions, reading: ReadingOptions) -> Recording:
    """What the markers of a file show: a body, gloves, or both.

    Gloves alone are put on the default body, as tall as told, with hands of the gloves' size; the proportions of a body
    are inferred. Prints what was recognised and what is doubtful. Raises BodysenseError for a file that shows neither.
    """
    from bodysense.body.skeleton import default_skeleton
    from bodysense.devices.gloves.device import has_gloves
    from bodysense.io.markers.recording import read_markers, with_hands_of
    from bodysense.io.recording import Recording

    height = reading.height
    body = default_skeleton() if height is None else default_skeleton().scaled(height)
    if options.unlabelled is not None:
        observation = _labelled(file, options, reading)
        return Recording(observation, body)
    found = read_markers(file, options.form(reading))
    for remark in found.remarks:
        print(f"note: {remark}")
    for hand, size in found.sizes.items():
        print(f"the {hand} hand is {size:.2f} times the size of the default body's")
    # Sizes are factors of the unscaled hand.
    ratio = default_skeleton().height / body.height
    hands = {hand: size * ratio for hand, size in found.sizes.items()}
    shown = has_gloves(found.observation)
    hands_of = with_hands_of(body, hands)
    return Recording(found.observation, hands_of, told=not found.has_body, hands_shown=shown, worn=options.worn())


def check_gloves_of(observation: Observation, place: Path) -> None:
    """Look at the gloves of a recording; prints what is doubtful."""
    from bodysense.body.glove import glove_hands
    from bodysense.io.markers.checks import check_gloves

    others = [hand for hand in glove_hands(observation.points) if hand not in SIDES]
    if others:
        print(f"note: left out {', '.join(map(repr, others))}: a body has the hands 'left' and 'right'")
    for remark in check_gloves(observation, str(place)).remarks:
        print(f"note: {remark}")


def write_seen(out: Path, recording: Recording, frame_rate: float) -> None:
    """Write a recording, or, by the ending of its name, the markers of its gloves."""
    from bodysense.io.markers.files import is_marker_file, write_markers
    from bodysense.io.recording import write_recording

    if is_marker_file(out):
        write_markers(out, recording.observation, frame_rate)
    else:
        write_recording(out, recording)


def _labelled(file: Path, options: MarkerOptions, reading: ReadingOptions) -> Observation:
    """The gloves among the points of a file that does not tell them apart."""
    from bodysense.body.hand import Side, hand_skeleton
    from bodysense.body.skeleton import default_skeleton
    from bodysense.devices.gloves.labelling import Labeller
    from bodysense.io.markers.files import read_unlabelled

    if options.names is not None:
        raise BodysenseError(f"--names {options.names}: --unlabelled takes no names; leave one of both out")
    points, _ = read_unlabelled(file, options.form(reading))
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
