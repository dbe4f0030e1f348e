"""BVH: reading and writing the text format of Biovision, in the file's own hierarchy and names.

A joint's channels turn it in the order they are listed (intrinsic: Zrotation Xrotation Yrotation is R = Rz · Rx · Ry);
position channels replace its OFFSET, as MotionBuilder and Blender have it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.rotation import quaternion_canonical, quaternion_to_euler
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_bytes, written_beside
from bodysense.io.bvh_text import parse_bvh
from bodysense.io.clip import Clip
from bodysense.io.rigs.figure import Figure

_BLOCK = 256  # frames that are written at once


def read_bvh(path: str | Path, unit: float = 0.01) -> Clip:
    """Read a BVH file of one figure: its own joints, names, axes and rest pose; `unit` is metres of a file unit.

    An End Site is named after its joint, 'LeftToeBase_end', and dropped where it has no length. Frame times that round
    to a whole rate (0.0333333 s) give that rate. Joints other than the root may have position channels: of a joint
    that moves in its parent, the median place is its offset. `bodysense.read` recognises unit, axes and joints.

    Raises BodysenseError, naming the file, what is wrong and the fix, for anything that is not such a file.
    """
    path = Path(path)
    data = read_bytes(path)
    file = parse_bvh(data, path)
    if len(file.roots) > 1:
        names = ", ".join(file.nodes[root].name for root in file.roots)
        raise BodysenseError(f"{path}: {len(file.roots)} figures ({names}), not one; split the file")
    return clip_of(file.figure(0), unit)


def clip_of(figure: Figure, unit: float) -> Clip:
    """The motion of a figure on its own joints, as a rigid skeleton; positions in metres, the figure's axes."""
    if not (np.isfinite(unit) and unit > 0):
        raise BodysenseError(f"{figure.name}: unit {unit:g} cannot be; give the metres of one file unit, e.g. 0.01")
    try:
        skeleton = Skeleton(figure.joints, figure.end_sites, figure.parents, figure.bone * unit)
    except BodysenseError as error:
        raise BodysenseError(f"{figure.name}: {error}") from None
    root = figure.position.get(0, np.tile(figure.offset[0], (len(figure), 1))) * unit
    rotation = figure.rotation.copy()
    rotation[:, 0] = quaternion_canonical(rotation[:, 0])
    return Clip(Path(figure.name).stem, Pose(skeleton, root, rotation), figure.frame_rate)


def write_bvh(path: str | Path, clip: Clip, unit: float = 0.01, order: str = "ZXY") -> None:
    """Write a clip as a BVH file of its own joints: positions in units of `unit` metres, angles in degrees.

    Every joint has rotation channels in `order`, the root position channels before them; both are written to six
    decimals. The file appears whole or not at all: it is written beside `path` and then renamed. Raises BodysenseError
    for a clip that is not one finite motion, a wrong order, or a folder that cannot be written.
    """
    path, pose, frame_rate = Path(path), clip.pose, clip.frame_rate
    rotation, root = np.asarray(pose.rotation, dtype=float), np.asarray(pose.root_position, dtype=float)
    if rotation.ndim != 3 or not len(rotation) or not np.isfinite(rotation).all() or not np.isfinite(root).all():
        raise BodysenseError(
            f"{path}: a BVH file holds one motion of finite numbers, rotation (T, J, 4); got {rotation.shape}"
            f"{'' if rotation.ndim != 3 else ', not all finite'}"
        )
    if sorted(order) != ["X", "Y", "Z"]:
        raise BodysenseError(f"order {order!r} must name X, Y and Z once each, e.g. 'ZXY'")
    if not (np.isfinite([frame_rate, unit]).all() and frame_rate > 0 and unit > 0):
        raise BodysenseError(f"frame rate {frame_rate:g} Hz and unit {unit:g} m must be positive")
    hierarchy, written = hierarchy_text(pose.skeleton, unit, order)
    with written_beside(path) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{hierarchy}MOTION\nFrames: {len(rotation)}\nFrame Time: {1 / frame_rate:.10g}\n")
        for start in range(0, len(rotation), _BLOCK):
            block = slice(start, start + _BLOCK)
            file.write(motion_text(root[block], rotation[block][:, written], unit, order))


def motion_text(root: np.ndarray, rotation: np.ndarray, unit: float, order: str) -> str:
    """Lines of the MOTION section: root (T, 3) m, local rotations (T, J, 4) in the order of the HIERARCHY section."""
    angles = np.rad2deg(quaternion_to_euler(rotation, order))
    values = np.concatenate([root / unit, angles.reshape(len(angles), -1)], axis=1)
    row = " ".join(["%.6f"] * values.shape[1]) + "\n"
    return row * len(values) % tuple(values.ravel().tolist())  # one formatting call, for speed


def hierarchy_text(skeleton: Skeleton, unit: float, order: str) -> tuple[str, list[int]]:
    """The HIERARCHY section, and the joints in the order in which they stand there."""
    odd = [name for name in skeleton.joints if name != name.strip() or not name or any(c in name for c in "{}\r\n")]
    if odd:
        raise BodysenseError(f"the joint name {odd[0]!r} cannot stand in a BVH file; rename it")
    rotations = " ".join(f"{axis}rotation" for axis in order)
    count = len(skeleton.joints)
    children: list[list[int]] = [[] for _ in skeleton.points]
    for point, parent in enumerate(skeleton.parents[1:], start=1):
        children[parent].append(point)
    lines, written = ["HIERARCHY"], []
    todo: list[tuple[int, int]] = [(0, 0)]  # (point, depth); a point of -1 closes a brace
    while todo:
        point, depth = todo.pop()
        indent = "\t" * depth
        if point < 0:
            lines.append(f"{indent}}}")
            continue
        is_site = point >= count
        head = "End Site" if is_site else f"{'JOINT' if depth else 'ROOT'} {skeleton.points[point]}"
        offset = " ".join(f"{x:.6f}" for x in skeleton.rest_offset[point] / unit)
        lines += [f"{indent}{head}", f"{indent}{{", f"{indent}\tOFFSET {offset}"]
        if not is_site:
            written.append(point)
            position = "" if depth else "Xposition Yposition Zposition "
            lines.append(f"{indent}\tCHANNELS {3 if depth else 6} {position}{rotations}")
            if not children[point]:  # many readers want an End Site on the last joint
                lines += [f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET 0 0 0", f"{indent}\t}}"]
        todo.append((-1, depth))
        todo += [(child, depth + 1) for child in reversed(children[point])]
    return "\n".join(lines) + "\n", written
