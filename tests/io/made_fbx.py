"""Made FBX files: a body in any axes, unit and bind pose, written by records alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip
from bodysense.io.formats.fbx.binary import Record, Short, contents

TICKS = 46_186_158_000  # of a second
AXES = {"x": (0, 1), "-x": (0, -1), "y": (1, 1), "-y": (1, -1), "z": (2, 1), "-z": (2, -1)}


def direction(axis: str) -> np.ndarray:
    """Return the unit vector of an axis."""
    which, sign = AXES[axis]
    return sign * np.eye(3)[which]


def properties(*rows: tuple) -> Record:
    return Record("Properties70", (), [Record("P", row) for row in rows])


def _matrices(turn: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(np.roll(turn, -1, axis=-1)).as_matrix()


@dataclass
class MadeFile:
    """A file that grows by objects; `bytes` of it are an FBX file."""

    up: str = "y"
    front: str = "z"
    right: str = "x"
    unit: float = 0.01  # m
    rate: float = 30.0
    time_mode: int = 14
    objects: list[Record] = field(default_factory=list)
    links: list[Record] = field(default_factory=list)

    def add(self, kind: str, name: str, subkind: str, of: str, *records: Record) -> int:
        identity = 1000 + len(self.objects)
        self.objects.append(Record(kind, (identity, f"{name}\x00\x01{of}", subkind), list(records)))
        return identity

    def link(self, child: int, parent: int, attribute: str = "") -> None:
        more = (attribute,) if attribute else ()
        self.links.append(Record("C", ("OP" if attribute else "OO", child, parent, *more)))

    def bone(self, name: str, parent: int, *, kind: str = "LimbNode", rows: tuple[tuple, ...] = ()) -> int:
        bone = self.add("Model", name, kind, "Model", Record("Version", (Short(232),)), properties(*rows))
        attribute = self.add("NodeAttribute", name, kind, "NodeAttribute")
        self.link(attribute, bone)
        self.link(bone, parent)
        return bone

    def stack(self, name: str, stop: float) -> int:
        """Add an animation that ends at `stop` seconds; return its layer."""
        rows = (("LocalStart", "KTime", "Time", "", 0), ("LocalStop", "KTime", "Time", "", int(stop * TICKS)))
        stack = self.add("AnimationStack", name, "", "AnimStack", properties(*rows))
        layer = self.add("AnimationLayer", "BaseLayer", "", "AnimLayer")
        self.link(layer, stack)
        return layer

    def curves(self, layer: int, bone: int, name: str, values: np.ndarray, times: np.ndarray | None = None) -> None:
        """Add curves of `Lcl Translation`, `Lcl Rotation` or `Lcl Scaling` (T, 3)."""
        first = (("d|X", "Number", "", "A", 0.0), ("d|Y", "Number", "", "A", 0.0), ("d|Z", "Number", "", "A", 0.0))
        node = self.add("AnimationCurveNode", name[4], "", "AnimCurveNode", properties(*first))
        self.link(node, layer)
        self.link(node, bone, name)
        ticks = np.round((np.arange(len(values)) / self.rate if times is None else times) * TICKS).astype("i8")
        for axis, track in zip("XYZ", np.asarray(values, dtype="f4").T, strict=True):
            curve = self.add(
                *("AnimationCurve", "", "", "AnimCurve"),
                Record("KeyVer", (Short(4008),)),
                Record("KeyTime", (ticks,)),
                Record("KeyValueFloat", (np.ascontiguousarray(track),)),
                Record("KeyAttrFlags", (np.array([4], "i4"),)),
                Record("KeyAttrDataFloat", (np.zeros(4, "f4"),)),
                Record("KeyAttrRefCount", (np.array([len(track)], "i4"),)),
            )
            self.link(curve, node, f"d|{axis}")

    def bind(self, matrices: dict[int, np.ndarray]) -> None:
        """Add the bind pose: world matrices (4, 4) by bone."""
        nodes = [
            Record("PoseNode", (), [Record("Node", (bone,)), Record("Matrix", (matrix.T.ravel().copy(),))])
            for bone, matrix in matrices.items()
        ]
        self.add("Pose", "bind", "BindPose", "Pose", Record("Type", ("BindPose",)), *nodes)

    @property
    def bytes(self) -> bytes:
        axes = [
            (name + ending, "int", "Integer", "", Short(value))
            for name, axis in (("UpAxis", self.up), ("FrontAxis", self.front), ("CoordAxis", self.right))
            for ending, value in zip(("", "Sign"), AXES[axis], strict=True)
        ]
        scale = ("UnitScaleFactor", "double", "Number", "", self.unit * 100)
        rate = ("CustomFrameRate", "double", "Number", "", self.rate)
        mode = ("TimeMode", "enum", "", "", Short(self.time_mode))
        head = Record("FBXHeaderExtension", (), [Record("FBXVersion", (Short(7400),))])
        settings = Record("GlobalSettings", (), [properties(*axes, scale, mode, rate)])
        return contents([head, settings, Record("Objects", (), self.objects), Record("Connections", (), self.links)])


def made_body(
    clip: Clip,
    *,
    up: str = "y",
    front: str = "z",
    left_handed: bool = False,
    unit: float = 0.01,
    seed: int | None = None,
    root_scale: float = 1.0,
    has_bind: bool = True,
    prefix: str = "",
) -> bytes:
    """Return a file of a clip's joints and end sites, whose world has other axes and another unit.

    With a seed, every joint's axes are turned at random in the bind pose. A root scaled by `root_scale` carries the
    body, as in files of Blender. Everything is computed in the world by matrices of scipy.
    """
    right = np.cross(direction(up), direction(front)) * (-1 if left_handed else 1)
    world = np.stack([right, direction(up), direction(front)], axis=1)  # the file's world ← ours: +X, +Y, +Z
    named = next(name for name in AXES if np.allclose(direction(name), right))
    file = MadeFile(up=up, front=front, right=named, unit=unit, rate=clip.frame_rate)
    skeleton = clip.pose.skeleton
    place, turn = (np.asarray(part) for part in forward_kinematics(clip.pose))
    count, frames = len(skeleton.points), len(place)
    rng = np.random.default_rng(seed)
    own = Rotation.from_quat(rng.normal(size=(count, 4))) if seed is not None else Rotation.identity(count)
    scale = unit * root_scale
    rest = skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0]
    top = file.bone(
        f"{prefix}Armature", 0, kind="Null", rows=(("Lcl Scaling", "Lcl Scaling", "", "A", *[root_scale] * 3),)
    )
    layer = file.stack("Take 001", (frames - 1) / clip.frame_rate)
    bones: list[int] = []
    mirrored = np.linalg.det(world) < 0

    def into(rotation: np.ndarray) -> Rotation:  # rotations of our world in the file's
        return Rotation.from_matrix(world @ rotation @ world.T)

    rests = [into(np.eye(3)) * own[k] for k in range(count)]
    for point, name in enumerate(skeleton.points):
        parent = skeleton.parents[point]
        joint = point if point < len(skeleton.joints) else parent
        turned = into(_matrices(turn[:, joint])) * rests[point]
        at = place[:, point] @ world.T / scale
        still = rest[point] @ world.T / scale
        above, still_above = Rotation.identity(frames), Rotation.identity()
        if parent >= 0:
            above, still_above = into(_matrices(turn[:, parent])) * rests[parent], rests[parent]
            at = above.inv().apply(at - place[:, parent] @ world.T / scale)
            still = still_above.inv().apply(still - rest[parent] @ world.T / scale)
        angles = (above.inv() * turned).as_euler("xyz", degrees=True)
        at_rest = (still_above.inv() * rests[point]).as_euler("xyz", degrees=True)
        rows = (
            ("Lcl Translation", "Lcl Translation", "", "A", *map(float, still)),
            ("Lcl Rotation", "Lcl Rotation", "", "A", *map(float, at_rest)),
        )
        bone = file.bone(prefix + name, bones[parent] if parent >= 0 else top, rows=rows)
        bones.append(bone)
        file.curves(layer, bone, "Lcl Rotation", np.rad2deg(np.unwrap(np.deg2rad(angles), axis=0)))
        if parent < 0:
            file.curves(layer, bone, "Lcl Translation", at)
    if has_bind:
        matrices = {}
        for point, bone in enumerate(bones):
            matrix = np.eye(4)
            matrix[:3, :3] = rests[point].as_matrix() * root_scale
            matrix[:3, 3] = rest[point] @ world.T / unit
            matrices[bone] = matrix
        file.bind(matrices)
    assert mirrored == left_handed
    return file.bytes
