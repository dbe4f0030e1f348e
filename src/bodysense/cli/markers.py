"""Gloves on the command line: marker files to recordings, and what completes a recording with gloves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.errors import BodysenseError

if TYPE_CHECKING:
    from bodysense.capture.raw_markers import MarkerFormat
    from bodysense.capture.recording import Recording
    from bodysense.data.clip import Clip
    from bodysense.estimators.estimate import Estimator
    from bodysense.estimators.gloved import Gloved
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
        return Recording(found.observation, with_hands_of(body, {k: size * ratio for k, size in found.sizes.items()}))
    return Recording(found.observation, with_hands_of(body, found.sizes))


def check_gloves_of(recording: Recording, place: Path, fingers: bool, samples: int | None, model: Path | None) -> None:
    """Refuse what does not go with gloves, and look at those of a recording; prints what is doubtful.

    `fingers` are to be synthesized, `samples` to be drawn, `model` completes the rest of the body.
    """
    from bodysense.capture.marker_checks import check_gloves
    from bodysense.capture.markers import is_marker_file
    from bodysense.observation import without_gloves

    if fingers:
        raise BodysenseError(f"{place}: its gloves have fingers; leave --fingers synthesize out")
    if samples is not None:
        raise BodysenseError(f"--samples {samples} is for head and wrists alone, {place} has gloves; leave it out")
    if model is not None and not without_gloves(recording.observation).points:
        raise BodysenseError(f"--model {model} completes a body, {place} has gloves alone; leave it out")
    if is_marker_file(place):  # looked at already, as it was read
        return
    for remark in check_gloves(recording.observation, str(place)).remarks:
        print(f"note: {remark}")


def gloved(recording: Recording, body: Callable[[Recording], Estimator], half_life: float | None) -> Gloved:
    """What completes a recording with gloves; `body` gives what completes the recording of everything else.

    Where nothing else is tracked a standing body carries the hands.
    """
    from bodysense.body.glove import glove_hands
    from bodysense.body.hand import Side, hand_skeleton
    from bodysense.cli.options import tracker_settings
    from bodysense.estimators.carried import Carried
    from bodysense.estimators.gloved import Gloved
    from bodysense.estimators.gloves.hands import Hands, load_glove_models
    from bodysense.estimators.ik_tracker import IkTracked, IkTracker
    from bodysense.observation import without_gloves

    found = glove_hands(recording.observation.points)
    sides: list[Side] = [side for side in SIDES if side in found]
    others = [hand for hand in found if hand not in SIDES]
    if others:
        print(f"note: left out {', '.join(map(repr, others))}: a body has the hands 'left' and 'right'")
    if not sides:
        raise BodysenseError(
            f"the gloves are {', '.join(map(repr, found))}; name the hands of a body 'left' and 'right'"
        )
    hands = Hands({side: hand_skeleton(recording.skeleton, side) for side in sides}, load_glove_models())
    rest = without_gloves(recording.observation)
    if not rest.points:
        if half_life is not None:
            raise BodysenseError(
                f"--half-life {half_life:g}: gloves are completed without smoothing, so that hands are where they are "
                "measured; leave it out"
            )
        return Gloved(hands, Carried(recording.skeleton))
    whole = body(replace(recording, observation=rest))
    return Gloved(hands, IkTracked(IkTracker(whole, tracker_settings(half_life))))


def simulated_gloves(clip: Clip) -> Recording:
    """What a ring of cameras sees of the markers of both gloves of a clip."""
    from bodysense.capture.recording import Recording
    from bodysense.occlusion.camera_ring import CameraRing
    from bodysense.occlusion.glove import GloveCapture, observe

    return Recording(observe(clip.pose, clip.time, GloveCapture(CameraRing())), clip.pose.skeleton)


def write_seen(out: Path, recording: Recording, frame_rate: float) -> None:
    """Write a recording, or, by the ending of its name, the markers of its gloves."""
    from bodysense.capture.markers import is_marker_file, write_markers
    from bodysense.capture.recording import write_recording

    if is_marker_file(out):
        write_markers(out, recording.observation, frame_rate)
    else:
        write_recording(out, recording)


def has_gloves(observation: Observation) -> bool:
    """Whether any of the points is a marker of a glove."""
    from bodysense.body.glove import glove_hands

    return bool(glove_hands(observation.points))


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
