"""Skeletons and their animation in binary FBX 7.4: one bone per joint, one linear key per frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.geometry.rotation import quaternion_multiply, quaternion_rotate, quaternion_to_matrix
from bodysense.io.clip import Clip
from bodysense.io.formats.fbx.binary import CREATED, FILE_ID, Property, Record, Short, contents
from bodysense.io.formats.gltf.writer import check_motion
from bodysense.io.rigs.joint_file import euler_near

Axes = tuple[int, int, int]  # directions of right, up and front: 0 x, 1 -x, 2 y, 3 -y, 4 z, 5 -z
Y_UP: Axes = (0, 2, 4)  # those of Maya, MotionBuilder and Mixamo, and ours
CENTIMETRE = 0.01  # m
_SECOND = 46_186_158_000  # FBX's ticks of time
# Numbers of the frame rates (Hz) that the format knows; others are written as custom ones.
_RATES = {120: 1, 100: 2, 60: 3, 50: 4, 48: 5, 30: 6, 25: 10, 24: 11, 1000: 12, 96: 15, 72: 16}
_CUSTOM = 14
_LINEAR = 4  # interpolation of a key
_KEY_VERSION = 4008
_LARGEST = 2**32 - 1  # bytes; offsets have 32 bits


@dataclass(frozen=True, eq=False)
class FbxSkeleton:
    """Joints in their rest pose, parents before children, in file units and axes."""

    names: tuple[str, ...]
    parents: tuple[int, ...]  # -1 for a root
    place: np.ndarray = field(repr=False)  # (J, 3) in the parent
    turn: np.ndarray = field(repr=False)  # (J, 4) parent ← joint
    metres: float = CENTIMETRE  # of one unit
    axes: Axes = Y_UP


def write_fbx(path: str | Path, clip: Clip, names: tuple[str, ...] | None = None) -> None:
    """Write a clip as FBX: a skeleton of its joints and end sites, under `names` if given, in centimetres, +Y up.

    The file appears whole or not at all. Raises BodysenseError for a clip that is not one finite motion.
    """
    check_motion(path, clip)
    pose = clip.pose
    rotation, root = np.asarray(pose.rotation, dtype=float), np.asarray(pose.root_position, dtype=float)
    still = np.zeros((len(pose.skeleton.points), 4))
    still[:, 0] = 1
    place = pose.skeleton.rest_offset / CENTIMETRE
    skeleton = FbxSkeleton(names or pose.skeleton.points, pose.skeleton.parents, place, still)
    turns = {joint: rotation[:, joint] for joint in range(rotation.shape[1])}
    write_skeleton(path, skeleton, {0: root / CENTIMETRE}, turns, clip.frame_rate, clip.name or "Take 001")


def write_skeleton(
    path: str | Path,
    skeleton: FbxSkeleton,
    places: Mapping[int, np.ndarray],
    turns: Mapping[int, np.ndarray],
    frame_rate: float,
    animation: str,
) -> None:
    """Write a skeleton and its animation; the file appears whole or not at all.

    Args:
        path: output file.
        skeleton: the joints at rest.
        places: (T, 3) positions in their parents, in file units, of joints that move.
        turns: (T, 4) rotations, parent ← joint, of joints that turn.
        frame_rate: Hz.
        animation: name of the animation.

    Raises BodysenseError for numbers that are not finite, and for a motion that is too long for the format.
    """
    tracks = [*places.values(), *turns.values()]
    if not tracks or not all(len(track) and np.isfinite(track).all() for track in tracks):
        raise BodysenseError(f"{path}: a file holds one motion of finite numbers in at least one frame")
    if not 0 < frame_rate < np.inf:
        raise BodysenseError(f"{path}: frame rate {frame_rate:g} Hz must be positive")
    scene = _Scene(skeleton, frame_rate, len(tracks[0]))
    scene.animate(places, turns, animation)
    data = contents(scene.records(animation))
    if len(data) > _LARGEST:
        raise BodysenseError(f"{path}: {len(data)} bytes are more than FBX 7.4 can hold (4 GiB); cut the motion")
    with written_beside(path) as part:
        part.write_bytes(data)


class _Scene:
    """The objects and connections of a file."""

    def __init__(self, skeleton: FbxSkeleton, frame_rate: float, frames: int) -> None:
        self.skeleton, self.frame_rate = skeleton, frame_rate
        self.objects = Record("Objects")
        self.connections = Record("Connections")
        self._ids = count(1_000_000)
        ticks = np.round(np.arange(frames) * (_SECOND / frame_rate))
        self.times = ticks.astype("i8")
        self.models = self._skeleton()

    def _object(self, kind: str, name: str, subkind: str, of: str) -> tuple[int, Record]:
        """Add an object; `of` is its class."""
        identity = next(self._ids)
        return identity, self.objects.add(kind, identity, f"{name}\x00\x01{of}", subkind)

    def _connect(self, child: int, parent: int, attribute: str = "") -> None:
        if attribute:
            self.connections.add("C", "OP", child, parent, attribute)
        else:
            self.connections.add("C", "OO", child, parent)

    def _skeleton(self) -> list[int]:
        """Add the bones and their rest pose; return their models."""
        skeleton, models = self.skeleton, []
        angles = np.rad2deg([euler_near(turn[None], "ZYX", np.zeros(3))[0, ::-1] for turn in skeleton.turn])
        for joint, name in enumerate(skeleton.names):
            attribute, record = self._object("NodeAttribute", name, "LimbNode", "NodeAttribute")
            record.records = [_properties(("Size", "double", "Number", "", 1.0)), Record("TypeFlags", ("Skeleton",))]
            model, record = self._object("Model", name, "LimbNode", "Model")
            place = (("Lcl Translation", "Lcl Translation", "", "A", *map(float, skeleton.place[joint])),)
            turn = (("Lcl Rotation", "Lcl Rotation", "", "A", *map(float, angles[joint])),)
            inherit = (("InheritType", "enum", "", "", Short(1)),)
            record.records = [Record("Version", (Short(232),)), _properties(*inherit, *place, *turn)]
            models.append(model)
            parent = skeleton.parents[joint]
            self._connect(model, models[parent] if parent >= 0 else 0)
            self._connect(attribute, model)
        _, pose = self._object("Pose", "BindPose", "BindPose", "Pose")
        pose.add("Type", "BindPose")
        pose.add("Version", Short(100))
        pose.add("NbPoseNodes", Short(len(models)))
        for model, matrix in zip(models, _rest_matrices(skeleton), strict=True):
            node = pose.add("PoseNode")
            node.add("Node", model)
            node.add("Matrix", matrix.T.ravel())  # columns one after another
        return models

    def animate(self, places: Mapping[int, np.ndarray], turns: Mapping[int, np.ndarray], name: str) -> None:
        """Add the animation of joints."""
        stack, record = self._object("AnimationStack", name, "", "AnimStack")
        span = (("Start", 0), ("Stop", int(self.times[-1])))
        times = [(f"{kind}{end}", "KTime", "Time", "", at) for kind in ("Local", "Reference") for end, at in span]
        record.records = [_properties(*times)]
        layer, _ = self._object("AnimationLayer", "BaseLayer", "", "AnimLayer")
        self._connect(layer, stack)
        for joint, track in places.items():
            self._curves(layer, joint, "T", "Lcl Translation", np.asarray(track))
        for joint, track in turns.items():
            angles = np.rad2deg(euler_near(np.asarray(track), "ZYX", np.zeros(3)))[:, ::-1]
            self._curves(layer, joint, "R", "Lcl Rotation", angles)

    def _curves(self, layer: int, joint: int, short: str, name: str, values: np.ndarray) -> None:
        """Add the curves of a joint's position or rotation (T, 3)."""
        node, record = self._object("AnimationCurveNode", short, "", "AnimCurveNode")
        first = [(f"d|{axis}", "Number", "", "A", float(value)) for axis, value in zip("XYZ", values[0], strict=True)]
        record.records = [_properties(*first)]
        self._connect(node, layer)
        self._connect(node, self.models[joint], name)
        for axis, track in zip("XYZ", values.T, strict=True):
            curve, record = self._object("AnimationCurve", "", "", "AnimCurve")
            record.add("Default", float(track[0]))
            record.add("KeyVer", Short(_KEY_VERSION))
            record.add("KeyTime", self.times)
            record.add("KeyValueFloat", track.astype("f4"))
            record.add("KeyAttrFlags", np.array([_LINEAR], "i4"))
            record.add("KeyAttrDataFloat", np.zeros(4, "f4"))
            record.add("KeyAttrRefCount", np.array([len(track)], "i4"))
            self._connect(curve, node, f"d|{axis}")

    def records(self, animation: str) -> list[Record]:
        """Return all records of the file."""
        header = Record("FBXHeaderExtension")
        header.add("FBXHeaderVersion", Short(1003))
        header.add("FBXVersion", Short(7400))
        header.add("EncryptionType", Short(0))
        header.add("Creator", "bodysense")
        documents = Record("Documents", (), [Record("Count", (Short(1),))])
        document = documents.add("Document", next(self._ids), "Scene", "Scene")
        document.add("RootNode", 0)
        takes = Record("Takes", (), [Record("Current", (animation,))])
        take = takes.add("Take", animation)
        take.add("FileName", "Take_001.tak")
        take.add("LocalTime", 0, int(self.times[-1]))
        take.add("ReferenceTime", 0, int(self.times[-1]))
        return [
            header,
            Record("FileId", (FILE_ID,)),
            Record("CreationTime", (CREATED,)),
            Record("Creator", ("bodysense",)),
            self._settings(),
            documents,
            Record("References"),
            self._definitions(),
            self.objects,
            self.connections,
            takes,
        ]

    def _settings(self) -> Record:
        right, up, front = self.skeleton.axes
        rate = round(self.frame_rate)
        known = _RATES.get(rate) if abs(rate - self.frame_rate) < 1e-6 else None
        axes = [
            (name + ending, "int", "Integer", "", Short(value))
            for name, axis in (("UpAxis", up), ("FrontAxis", front), ("CoordAxis", right))
            for ending, value in (("", axis // 2), ("Sign", 1 - 2 * (axis % 2)))
        ]
        scale = self.skeleton.metres / CENTIMETRE
        return Record(
            "GlobalSettings",
            (),
            [
                Record("Version", (Short(1000),)),
                _properties(
                    *axes,
                    ("UnitScaleFactor", "double", "Number", "", float(scale)),
                    ("OriginalUnitScaleFactor", "double", "Number", "", float(scale)),
                    ("TimeMode", "enum", "", "", Short(known or _CUSTOM)),
                    ("TimeSpanStart", "KTime", "Time", "", 0),
                    ("TimeSpanStop", "KTime", "Time", "", int(self.times[-1])),
                    ("CustomFrameRate", "double", "Number", "", -1.0 if known else float(self.frame_rate)),
                ),
            ],
        )

    def _definitions(self) -> Record:
        kinds: dict[str, int] = {"GlobalSettings": 1}
        for record in self.objects.records:
            kinds[record.name] = kinds.get(record.name, 0) + 1
        definitions = Record("Definitions", (), [Record("Version", (Short(100),))])
        definitions.add("Count", Short(sum(kinds.values())))
        for kind, number in kinds.items():
            definitions.add("ObjectType", kind).add("Count", Short(number))
        return definitions


def _properties(*rows: tuple[Property, ...]) -> Record:
    return Record("Properties70", (), [Record("P", row) for row in rows])


def _rest_matrices(skeleton: FbxSkeleton) -> np.ndarray:
    """Return world matrices (J, 4, 4) of the joints at rest."""
    place, turn = skeleton.place.astype(float), skeleton.turn.astype(float)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            place[joint] = place[parent] + quaternion_rotate(turn[parent], place[joint])
            turn[joint] = quaternion_multiply(turn[parent], turn[joint])
    matrix = np.tile(np.eye(4), (len(place), 1, 1))
    matrix[:, :3, :3], matrix[:, :3, 3] = quaternion_to_matrix(turn), place
    return matrix
