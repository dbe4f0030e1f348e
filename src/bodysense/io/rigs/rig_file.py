"""A motion on the rig of a BVH file: its hierarchy, names, offsets, channel order, unit and axes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.retarget import on_body
from bodysense.body.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.errors import BodysenseError
from bodysense.io.bvh_stream import BvhLines, open_bvh
from bodysense.io.clip import Clip
from bodysense.io.rigs.figure import placed
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.io.rigs.rigged import Rigged, read_rigged
from bodysense.io.rigs.source_joints import joints_of_file, mean_rotation


def write_on_rig_of(path: Path, clip: Clip, source: Path, options: ReadingOptions = AS_FOUND) -> None:
    """Write a clip as BVH on the rig of another BVH file.

    On a body of other proportions feet stay on the floor and hands keep their positions, in a world scaled with the
    legs (`on_body`). Joints of the rig that we lack keep their mean rotation and position. Raises BodysenseError if the
    rig's file is not a BVH file, or not a humanoid.
    """
    file = open_bvh(source)
    on_rig(file, read_rigged(file.mended.text(), source, options), clip).write(path)


def on_rig(file: BvhLines, rigged: Rigged, clip: Clip) -> BvhLines:
    """Return the clip as a file like `file`, from which `rigged` was read."""
    joints, body = joints_of_file(file, rigged), rigged.clip.pose.skeleton
    pose = clip.pose if np.allclose(clip.pose.skeleton.rest_offset, body.rest_offset) else on_body(clip.pose, body)
    anchor = next(name for name in ("pelvis", "left_hip") if name in joints.ours)
    wanted, place = joints.world(pose), np.asarray(forward_kinematics(pose)[0])[:, body.index(anchor)]
    frames, rest = len(clip), mean_rotation(file.rotation)
    local, world = np.zeros((2, frames, len(file.joints), 4))
    for joint, parent in enumerate(file.parents):
        above = world[:, parent] if parent >= 0 else np.broadcast_to([1.0, 0.0, 0.0, 0.0], (frames, 4))
        known = np.isfinite(wanted[:, joint]).all()
        local[:, joint] = quaternion_multiply(quaternion_conjugate(above), wanted[:, joint]) if known else rest[joint]
        world[:, joint] = quaternion_multiply(above, local[:, joint])
    blank = _frames(file, np.median(file.mended.values, axis=0), frames, 1 / clip.frame_rate)
    whole = np.ones(local.shape[:2], dtype=bool)
    turned = blank.with_rotation(np.asarray(quaternion_canonical(local)), whole)
    carrier, carried = _carried(file, turned, joints.above(joints.ours[anchor]), rigged.rig.to_file(place), world)
    values, changed = turned.values.copy(), np.zeros(turned.values.shape, dtype=bool)
    columns = file.columns_of(carrier, "position")
    values[:, columns], changed[:, columns] = carried[:, _axes(file, carrier)], True
    return turned.with_values(values, changed)


def _carrier(file: BvhLines, chain: list[int]) -> int:
    """Return the joint that moves the body through the world, among a joint and its ancestors."""
    moving = [joint for joint in chain if len(file.columns_of(joint, "position")) == 3]
    if not moving:
        raise BodysenseError(f"{file.path}: no position above {file.joints[chain[0]]!r}; take a rig that has one")
    return max(moving, key=lambda joint: float(np.ptp(_offset(file, joint), axis=0).max()))


def _carried(
    rig: BvhLines, file: BvhLines, chain: list[int], target: np.ndarray, world: np.ndarray
) -> tuple[int, np.ndarray]:
    """Return the joint that moves a rig's body, and its position channels (T, 3) that bring a joint to `target` (T, 3).

    `chain` is that joint and its ancestors; `file` has the motion except these, `world` (T, J, 4) its rotations.
    """
    carrier = _carrier(rig, chain)
    own = chain.index(carrier)
    place = target
    for joint in chain[:own]:  # back from the pelvis
        place = place - quaternion_rotate(world[:, file.parents[joint]], _offset(file, joint))
    for joint in reversed(chain[own + 1 :]):  # and from the root
        step = _offset(file, joint)
        place = place - (step if file.parents[joint] < 0 else quaternion_rotate(world[:, file.parents[joint]], step))
    if file.parents[carrier] >= 0:
        place = quaternion_rotate(quaternion_conjugate(world[:, file.parents[carrier]]), place)
    if carrier > 0 and not np.allclose(_offset(rig, carrier), _channels(rig, carrier)):  # they add to the offset
        place = place - rig.offset[carrier]
    return carrier, np.asarray(place)


def _offset(file: BvhLines, joint: int) -> np.ndarray:
    """Return the position (T, 3) of a joint in its parent, file units."""
    still = np.tile(file.offset[joint], (len(file.lines), 1))
    given = {joint: _channels(file, joint)} if file.columns_of(joint, "position") else {}
    return placed(given, file.offset).get(joint, still)


def _channels(file: BvhLines, joint: int) -> np.ndarray:
    """Return the position channels (T, 3) of a joint; its offset along axes without a channel."""
    given = np.tile(file.offset[joint], (len(file.lines), 1))
    given[:, _axes(file, joint)] = file.mended.values[:, file.columns_of(joint, "position")]
    return given


def _axes(file: BvhLines, joint: int) -> list[int]:
    """Return the axes of a joint's position channels, in their order."""
    return ["XYZ".index(channel[0]) for channel in file.channels[joint] if channel.endswith("position")]


def _frames(file: BvhLines, row: np.ndarray, count: int, interval: float) -> BvhLines:
    """Return the file with `count` frames of one row (C,) of values."""
    head = re.sub(rb"(Frames\s*:\s*)\d+", rb"\g<1>%d" % count, file.head, flags=re.IGNORECASE)
    head = re.sub(rb"(Frame\s+Time\s*:\s*)\S+", rb"\g<1>%.10g" % interval, head, flags=re.IGNORECASE)
    line = b" ".join(b"%.6f" % value for value in row) + b"\n"
    return replace(file, head=head, lines=(line,) * count, values=np.tile(row, (count, 1)), interval=interval)
