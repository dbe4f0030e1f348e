"""Sources: `open_source` recognises motions, recordings, markers and videos, and opens them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from reprlib import repr as brief
from typing import TYPE_CHECKING

import numpy as np

from bodysense.arrays import array_shapes
from bodysense.body.hands.hand import Side, glove_hands, hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.checked import checked
from bodysense.io.clip import Clip
from bodysense.io.formats.archive import MotionFile
from bodysense.io.formats.headset_log import is_headset_log, read_headset_log
from bodysense.io.formats.recording import Recording, read_recording
from bodysense.io.markers.options import ENDINGS as MARKER_ENDINGS
from bodysense.io.markers.options import NO_OPTIONS, MarkerOptions
from bodysense.io.reading_options import AS_FOUND, ReadingOptions, given_options
from bodysense.io.rigged import Rigged, read_rigged
from bodysense.observing.observation import Observation
from bodysense.observing.world_axes import convert_world
from bodysense.quality.plausible import floor_doubt
from bodysense.sources.kinds import GLTF, MANY_KINDS, kind_of

if TYPE_CHECKING:
    from bodysense.io.formats.point_layouts import JointPlaces
    from bodysense.io.markers.raw_markers import MarkerRecording
    from bodysense.sources.partial_motion import PartialMotion

_JOINT_FILES = (".bvh", ".fbx")  # files whose joints can be written again
HeldStill = tuple[tuple[str, ...], np.ndarray]  # joints of a file, and (T, J) bool: limbs with constant values
_NOTHING_HELD: HeldStill = (), np.zeros((0, 0), dtype=bool)


@dataclass(frozen=True, eq=False)
class MotionSource:
    """A motion, in a file or in memory. A file is read when its clip or its holes are first used."""

    name: str  # for messages
    path: Path | None = None  # None: in memory
    given: Clip | None = None  # the motion in memory
    options: ReadingOptions = AS_FOUND
    rate: float | None = None  # Hz, for a file without a frame rate
    watches_limbs: bool = False  # look for limbs with constant values in a BVH or FBX file

    @property
    def joint_file(self) -> Path | None:
        """The file if it is a BVH or FBX file, whose rig can be kept; else None."""
        return self.path if self.path is not None and self.path.suffix.lower() in _JOINT_FILES else None

    def __post_init__(self) -> None:
        if self.path is None:
            return
        for option, endings, kinds in (
            ("smpl_model", MANY_KINDS, "AMASS and SMPL files (.npz, .npy)"),
            ("skin", (".fbx",), "FBX files"),
            ("animation", (".fbx", *GLTF), "FBX and glTF files"),
        ):
            if getattr(self.options, option) is not None and self.path.suffix.lower() not in endings:
                raise BodysenseError(f"{self.path}: --{option.replace('_', '-')} is for {kinds}; leave it out")

    @property
    def clip(self) -> Clip:
        """The motion in canonical form. Raises BodysenseError, naming the file and the fix, if it cannot be read."""
        return self._read[0]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Lines that describe the file as recognised."""
        return self._read[1]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubts about the motion, with the option that settles each."""
        return self.clip.warnings

    @property
    def held_still(self) -> HeldStill:
        """Limbs with constant values in a BVH or FBX file, if `watches_limbs`."""
        return self._read[2]

    @cached_property
    def _read(self) -> tuple[Clip, tuple[str, ...], HeldStill]:
        if self.given is not None:
            return self.given, (), _NOTHING_HELD
        assert self.path is not None
        if self.path.suffix.lower() in (*MANY_KINDS, *GLTF):
            return *_read_motion(self.path, self.options, self.rate), _NOTHING_HELD
        rigged = read_rigged(MotionFile(self.path).read(), self.path, self.options)
        held = _still_limbs(rigged) if self.joint_file is not None and self.watches_limbs else _NOTHING_HELD
        return rigged.clip, (f"read {self.path}: {rigged.rig.line()}",), held

    def with_holes(self, missing: str | Sequence[str]) -> PartialMotion:
        """Return the motion with its holes: `missing` joints, or without any, the holes found in the file."""
        from bodysense.io.holes import missing_items
        from bodysense.sources.partial_motion import open_partial

        items = missing_items(missing)
        try:
            return open_partial(self.joint_file or self.clip, items, self.options)
        except BodysenseError as error:
            raise error if self.name in str(error) else BodysenseError(f"{self.name}: {error}") from None


@dataclass(frozen=True, eq=False)
class RecordingSource:
    """A recording of tracked points, in a file or in memory."""

    name: str
    recording: Recording
    options: ReadingOptions = AS_FOUND


@dataclass(frozen=True, eq=False)
class MarkerSource:
    """A file of optical markers, and the recording of joints and gloves computed from them."""

    name: str
    path: Path
    recording: Recording
    remarks: tuple[str, ...]  # lines about recognised, doubtful and dropped markers
    warnings: tuple[str, ...] = ()  # dropped labels and guessed limbs
    found: MarkerRecording | None = None  # None: points without labels


@dataclass(frozen=True)
class VideoSource:
    """A video file, a folder of images, or a webcam by its index. It is opened when it is tracked."""

    name: str


Opened = MotionSource | RecordingSource | MarkerSource | VideoSource
InMemory = Clip | Observation | Recording
Source = str | Path | InMemory | Opened


def open_source(source: Source, reading: ReadingOptions = AS_FOUND, markers: MarkerOptions = NO_OPTIONS) -> Opened:
    """Recognise and open a source.

    Args:
        source: a file (motion, recording, markers, video), a folder of images, a webcam's index, or a Clip, Observation
            or Recording in memory. An opened source is returned unchanged.
        reading: facts that the file omits: unit, upward axis, floor, height, joints, which body.
        markers: facts that a marker file omits; `rate` is also for motions.

    Raises BodysenseError, naming the file and the fix, for unsupported files and for options that this kind of source
    does not have.
    """
    if isinstance(source, (MotionSource, RecordingSource, MarkerSource, VideoSource)):
        return source
    if isinstance(source, Clip):
        return MotionSource(source.name or "clip", given=source)
    if isinstance(source, Recording):
        return _recording_source("recording", source, reading)
    if isinstance(source, Observation):
        return _recording_source("observation", Recording(source, default_skeleton(), known=False), reading)
    if not isinstance(source, (str, PathLike)):
        raise BodysenseError(f"{brief(source)}: no source; give a file's path, or a Clip, Observation or Recording")
    path, kind = Path(source), kind_of(source)
    if kind == "motion" and path.suffix.lower() not in MANY_KINDS:
        return _motion_source(path, reading, markers)
    if kind == "video":
        if options := given_options(replace(reading, height=None)):
            raise BodysenseError(f"{source}: a video; {options}: for motions and recordings, leave it out")
        _refuse_options(str(source), "a video", markers)
        return VideoSource(str(source))
    if kind == "markers":
        return _open_markers(path, reading, markers)
    if kind == "recording":
        return _open_recording(path, reading, markers)
    from bodysense.io.formats.smpl import joint_places

    if (places := joint_places(path, markers.rate, markers.points, reading.figure)) is not None:
        return _open_joint_positions(path, places, replace(reading, figure=None), markers)
    return _motion_source(path, reading, markers)


def _motion_source(path: Path, reading: ReadingOptions, markers: MarkerOptions) -> MotionSource:
    _refuse_options(path, "a motion", replace(markers, rate=None))
    if markers.rate is not None and _has_rate(path):
        raise BodysenseError(
            f"{path}: the file says its frame rate; leave --rate {markers.rate:g} out (bodysense convert resamples)"
        )
    return MotionSource(str(path), path, options=reading, rate=markers.rate)


def _has_rate(path: Path) -> bool:
    """Whether a motion file has a frame rate. That of an SMPL file does not count, because an option may correct it."""
    if path.suffix.lower() not in MANY_KINDS:
        return True
    from bodysense.io.formats.smpl import RATE, is_smpl

    return not is_smpl(path) and not array_shapes(path).keys().isdisjoint(RATE)


def _read_motion(path: Path, options: ReadingOptions, rate: float | None) -> tuple[Clip, tuple[str, ...]]:
    """Read an AMASS, SMPL or glTF file; return its clip and lines that describe it. `rate` Hz if the file has none."""
    from bodysense.io.datasets.sources import Source as MotionEntry
    from bodysense.io.datasets.sources import apply_options, read_amass_source
    from bodysense.io.formats.smpl import is_smpl, read_smpl

    if path.suffix.lower() in MANY_KINDS and is_smpl(path):
        clip, remarks = read_smpl(path, rate, options)
        told = replace(options, unit=None, up=None, figure=None)
        clip = checked(apply_options(clip, told, "results of SMPL", "y"), options=options)
        return clip, tuple(f"note: {remark}" for remark in remarks)
    if path.suffix.lower() in GLTF:
        from bodysense.io.formats.gltf.motion import read_gltf

        clip, remarks = read_gltf(path, options.joints, options.animation)
        return apply_options(clip, replace(options, joints=None), "glTF files", "y"), tuple(
            f"note: {remark}" for remark in remarks
        )
    clip, placement = read_amass_source(MotionEntry(path, person="", split="test"), options)
    far = floor_doubt(0.0 if placement is None else placement.floor, options.unit)
    clip = checked(clip, [] if far is None else [far.text], options=options)
    return clip, () if placement is None else (f"note: {placement.remark}",)


def _still_limbs(rigged: Rigged) -> HeldStill:
    from bodysense.io.holes import flat_lined
    from bodysense.io.target_rigs.own_rig import joints_of_file

    try:
        return rigged.file.joints, flat_lined(rigged.file, joints_of_file(rigged.file, rigged))
    except BodysenseError:  # joints that do not hang on one another: no limb can be judged
        return _NOTHING_HELD


def _refuse_options(name: str | Path, kind: str, markers: MarkerOptions) -> None:
    if options := given_options(markers):
        raise BodysenseError(f"{name}: {kind}; {options}: for markers ({', '.join(MARKER_ENDINGS)}), leave it out")


def _open_recording(path: Path, reading: ReadingOptions, markers: MarkerOptions) -> RecordingSource:
    if is_headset_log(path):
        _refuse_options(path, "a headset's log", replace(markers, rate=None))
        log = read_headset_log(path, markers.rate, reading.left_handed)
        return _recording_source(str(path), log, replace(reading, left_handed=False))
    _refuse_options(path, "a recording", replace(markers, marker_set=None))
    recording = read_recording(path)
    if glove_hands(recording.observation.points):
        recording = replace(recording, glove_set=markers.glove_set())
    return _recording_source(str(path), recording, reading)


def _recording_source(name: str, recording: Recording, reading: ReadingOptions) -> RecordingSource:
    """Return the source of a recording, converted from the given unit and upward axis to metres and +Y up."""
    for option in (*reading.for_motions(), *(["--left-handed"] if reading.left_handed else [])):
        raise BodysenseError(f"{name}: {option} is for motions, not for recordings; leave it out")
    observation = convert_world(recording.observation, reading.unit, reading.up)
    return RecordingSource(name, replace(recording, observation=observation), reading)


def _open_markers(path: Path, reading: ReadingOptions, markers: MarkerOptions) -> MarkerSource:
    """Open a marker file of a body, of gloves, or of both.

    Gloves alone are put on the default body of the given height, with hands of the size of the gloves. Proportions of a
    body are inferred.
    """
    from bodysense.io.markers.recording import read_markers, with_hands_of

    height = reading.height
    body = default_skeleton() if height is None else default_skeleton().scaled(height)
    if markers.unlabelled is not None:
        return MarkerSource(str(path), path, Recording(_label_gloves(path, markers, reading), body), ())
    found = read_markers(path, markers.form(reading))
    sized = (
        f"the {hand} hand is {size:.2f} times the size of the default body's" for hand, size in found.sizes.items()
    )
    # Sizes are factors of the unscaled hand.
    hands = {hand: size * default_skeleton().height / body.height for hand, size in found.sizes.items()}
    recording = Recording(
        found.observation,
        with_hands_of(body, hands),
        known=not found.has_body,
        measures_hands=bool(glove_hands(found.observation.points)),
        glove_set=markers.glove_set(),
    )
    remarks = (*(f"note: {line}" for line in found.remarks), *sized)
    return MarkerSource(str(path), path, recording, remarks, found.warnings, found)


def _open_joint_positions(
    path: Path, found: JointPlaces, reading: ReadingOptions, markers: MarkerOptions
) -> MarkerSource:
    """Open an array of joint places as markers in the joints; the tracker finds the rotations."""
    from bodysense.io.markers.body import body_of
    from bodysense.io.markers.marker_sets import recognised
    from bodysense.io.markers.raw_markers import RawMarkers

    form = markers.form(reading)
    known = recognised(found.names)
    assert known is not None
    frames = np.arange(len(found.place)) / found.rate
    raw = RawMarkers(found.names, found.place, frames, found.rate, axes=found.axes)
    body = body_of(raw, form, known, str(path))
    line = f"an array of joint places {found.place.shape}, not of rotations: the body is completed from them"
    lines = tuple(f"note: {line}" for line in (line, *found.remarks, *body.remarks[1:]))
    recording = Recording(body.observation, default_skeleton(), known=False)
    return MarkerSource(str(path), path, recording, lines, body.warnings)


def _label_gloves(path: Path, options: MarkerOptions, reading: ReadingOptions) -> Observation:
    """Find the gloves among the unlabelled points of a file."""
    from bodysense.devices.gloves.labels.labelling import Labeller

    if options.names is not None:
        raise BodysenseError(f"--names {options.names}: --unlabelled takes no names; leave one of both out")
    from bodysense.io.markers.files import read_unlabelled

    points, _ = read_unlabelled(path, options.form(reading))
    hands: tuple[Side, ...] = ("left", "right")
    sides: list[Side] = [side for side in hands if options.unlabelled in (side, "both")]
    labeller = Labeller({side: hand_skeleton(default_skeleton(), side) for side in sides})
    observation, _ = labeller.step(points, labeller.start())
    seen = observation.has_position.any(axis=0).reshape(len(sides), -1)
    for k, side in enumerate(sides):
        if not seen[k].any():
            raise BodysenseError(
                f"{path}: no {side} glove is found among its {len(points.points)} points; see docs/gloves.md, "
                "or name the markers"
            )
    return observation
