"""MCAP takes in the open schemas of NVIDIA's Isaac Capture: 24 joints of a body, 26 of each hand, as FlatBuffers.

Their world has +Y up and bodies that face −Z, right toward +X: ours turned by half about +Y. Body joints are SMPL's 24,
hands those of OpenXR. All joints are marked as tracked, completed ones too.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.hands.hand import point_beyond
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.errors import missing_package
from bodysense.files import written_beside
from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.writer import check_motion

BODY_SCHEMA, HAND_SCHEMA = "core.FullBodyPoseRecord", "core.HandPoseRecord"
BODY_JOINTS = (*BODY, "left_hand", "right_hand")  # the hands are the middle of the knuckles
_POSE = [("position", "<f4", (3,)), ("rotation", "<f4", (4,)), ("valid", "?"), ("pad", "V3")]  # rotation x y z w
BODY_LAYOUT = np.dtype(_POSE)
HAND_LAYOUT = np.dtype([*_POSE, ("radius", "<f4")])
TIMES = np.dtype([("available", "<i8"), ("sample", "<i8"), ("device", "<i8")])  # ns
_FINGERS = ("index", "middle", "ring", "pinky")
HAND_JOINTS: tuple[str | None, ...] = (
    *(None, "wrist", "thumb1", "thumb2", "thumb3", "thumb_tip"),
    *(name for finger in _FINGERS for name in (None, f"{finger}1", f"{finger}2", f"{finger}3", f"{finger}_tip")),
)
"""OpenXR's 26 joints of a hand as ours, without the side; palm and metacarpals, which we lack, are None."""
_RADIUS = 0.008  # m: of a finger, about
_HALF_TURN = np.array([0.0, 0.0, 1.0, 0.0])  # wxyz, about +Y: ours to theirs
_FLIP = np.array([-1.0, 1.0, -1.0])
_EPOCH = 1_000_000_000  # ns: the first sample, on the common clock
_DEVICE = 7_000_000_000  # ns: offset of the device's own clock, which has another origin


def load_writer() -> Any:
    """Return the module `mcap.writer`. Raises BodysenseError if it is not installed."""
    try:
        from mcap import writer
    except ImportError as error:
        raise missing_package(error) from None
    return writer


def write_mcap(path: str | Path, clip: Clip) -> None:
    """Write a clip's body, and its hands where it has fingers; the file appears whole or not at all.

    Raises BodysenseError for a clip that is not one finite motion, and for a folder that cannot be written.
    """
    mcap = load_writer()
    check_motion(path, clip)
    position, rotation = forward_kinematics(clip.pose)
    turned = np.full((*position.shape[:-1], 4), np.nan)
    turned[:, : rotation.shape[1]] = rotation
    times = _EPOCH + np.round(clip.time * 1e9).astype(np.int64)
    skeleton = clip.pose.skeleton
    topics = [("full_body/full_body", BODY_SCHEMA, _body(skeleton, position, turned))]
    if clip.has_fingers:
        for side in ("left", "right"):
            topics.append((f"hands/{side}_hand", HAND_SCHEMA, _hand(skeleton, side, position, turned)))
    with written_beside(path) as beside, beside.open("wb") as file:
        writer = mcap.Writer(file, compression=mcap.CompressionType.ZSTD)
        writer.start(profile="teleop", library="bodysense")
        schemas = {name: writer.register_schema(name, "flatbuffer", b"") for name in (BODY_SCHEMA, HAND_SCHEMA)}
        channels = [writer.register_channel(topic, "flatbuffer", schemas[schema]) for topic, schema, _ in topics]
        for frame, time in enumerate(times.tolist()):
            for channel, (_, _, joints) in zip(channels, topics, strict=True):
                data = record(joints[frame], (time, time, time + _DEVICE))
                writer.add_message(channel, log_time=time, publish_time=time, sequence=frame, data=data)
        writer.finish()


def record(joints: np.ndarray | None, times: tuple[int, int, int], all_tracked: bool | None = None) -> bytes:
    """Return one record: joints of BODY_LAYOUT (24,) or HAND_LAYOUT (26,), or None without tracking; times in ns."""
    import flatbuffers

    builder = flatbuffers.Builder(1200)
    payload = None
    if joints is not None:
        is_body = joints.dtype == BODY_LAYOUT
        builder.StartObject(2 if is_body else 1)
        if is_body:
            is_valid = bool(joints["valid"].all()) if all_tracked is None else all_tracked
            builder.PrependBoolSlot(1, is_valid, False)
        builder.PrependStructSlot(0, _struct(builder, joints.tobytes()), 0)
        payload = builder.EndObject()
    builder.StartObject(2)
    if payload is not None:
        builder.PrependUOffsetTRelativeSlot(0, payload, 0)
    builder.PrependStructSlot(1, _struct(builder, np.array([times], dtype=TIMES).tobytes(), 8), 0)
    builder.Finish(builder.EndObject())
    return bytes(builder.Output())


def _struct(builder: Any, data: bytes, alignment: int = 4) -> int:
    """Write a struct's bytes at a table's slot."""
    builder.Prep(alignment, len(data))
    builder.head -= len(data)
    builder.Bytes[builder.head : builder.head + len(data)] = data
    return builder.Offset()


def _body(skeleton: Skeleton, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return joints (T, 24) of BODY_LAYOUT."""
    places = skeleton.indices(BODY)
    knuckles = [[f"{side}_{finger}1" for finger in _FINGERS] for side in ("left", "right")]
    hands = np.stack([position[:, skeleton.indices(names)].mean(axis=1) for names in knuckles], axis=1)
    wrists = skeleton.indices(["left_wrist", "right_wrist"])
    where = np.concatenate([position[:, places], hands], axis=1)
    turn = np.concatenate([rotation[:, places], rotation[:, wrists]], axis=1)
    return _joints(where, turn * np.array([1.0, -1.0, 1.0, -1.0]), BODY_LAYOUT)


def _hand(skeleton: Skeleton, side: str, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return joints (T, 26) of HAND_LAYOUT; palm and metacarpals are invalid."""
    names = [None if name is None else f"{side}_{name}" for name in HAND_JOINTS]
    here = [k for k, name in enumerate(names) if name is not None]
    axes = hand_axes(skeleton, side)
    places = skeleton.indices([name for name in names if name is not None])
    carriers = np.where(places < len(skeleton.joints), places, np.array(skeleton.parents)[places])
    turn = quaternion_multiply(
        quaternion_multiply(_HALF_TURN, rotation[:, carriers]), np.stack([axes[skeleton.points[k]] for k in carriers])
    )
    joints = np.zeros((len(position), len(names)), dtype=HAND_LAYOUT)
    joints["rotation"][..., 3] = 1
    joints[:, here] = _joints(position[:, places], turn, HAND_LAYOUT)
    return joints


def hand_axes(skeleton: Skeleton, side: str) -> dict[str, np.ndarray]:
    """Return OpenXR's axes in the frame of each joint of a hand (wxyz): −Z along the bone, +Y out of its back."""
    axes = {}
    for name in (f"{side}_wrist", *(f"{side}_{f}{k}" for f in ("thumb", *_FINGERS) for k in (1, 2, 3))):
        toward = f"{side}_middle1" if name.endswith("wrist") else point_beyond(name)
        bone = skeleton.rest_offset[skeleton.index(toward)]
        axes[name] = _axes(tuple(np.round(bone / np.linalg.norm(bone), 9).tolist()))
    return axes


@lru_cache(maxsize=128)
def _axes(bone: tuple[float, float, float]) -> np.ndarray:
    """Return axes with −Z along a bone and +Y nearest to up, the back of a flat hand."""
    z = -np.array(bone)
    y = np.array([0.0, 1.0, 0.0]) - z[1] * z
    y /= np.linalg.norm(y)
    return matrix_to_quaternion(np.stack([np.cross(y, z), y, z], axis=-1))


def _joints(position: np.ndarray, rotation: np.ndarray, layout: np.dtype) -> np.ndarray:
    """Return our positions (T, J, 3) and their rotations (T, J, 4) wxyz as valid joints of a layout."""
    joints = np.zeros(position.shape[:-1], dtype=layout)
    joints["position"] = position * _FLIP
    joints["rotation"] = np.roll(rotation, -1, axis=-1)
    joints["valid"] = True
    if "radius" in (layout.names or ()):
        joints["radius"] = _RADIUS
    return joints


def ours_from(position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Convert their positions (..., 3) and body rotations x y z w (..., 4) to ours (wxyz)."""
    return position * _FLIP, np.roll(rotation, 1, axis=-1) * np.array([1.0, -1.0, 1.0, -1.0])


def hand_rotation(rotation: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Convert their rotations x y z w (..., 4) of hand joints to ours (wxyz) with the joints' axes (wxyz)."""
    theirs = np.roll(rotation, 1, axis=-1)
    back = quaternion_multiply(_HALF_TURN * [1, -1, -1, -1], theirs)
    return quaternion_multiply(back, axes * np.array([1.0, -1.0, -1.0, -1.0]))
