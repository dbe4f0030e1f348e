"""BVH files of the add-on: a position of the root, a rotation of every bone. Pure Python.

Blender's own reader is not used: it makes a new armature, and in some packages it does not run.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from .fault import Fault

Vector = tuple[float, float, float]
CHANNELS = ("Zrotation", "Xrotation", "Yrotation")  # degrees; the rotation is their product in this order
_PLACE = ("Xposition", "Yposition", "Zposition")


@dataclass(frozen=True)
class Joint:
    """A bone at rest."""

    name: str
    parent: int  # -1 of the root, which comes first; parents come before children
    offset: Vector  # from the parent's head, of the root from the origin
    tip: Vector  # from its own head


def safe_names(names: Sequence[str]) -> list[str]:
    """Return names that a BVH file and a list of holes can carry."""
    safe = [re.sub(r"[\s,+{}]", "_", name) for name in names]
    twice = sorted({name for name in safe if safe.count(name) > 1})
    if twice:
        raise Fault(f"two bones would be named {twice[0]} in BVH; rename one without spaces, commas and +")
    return safe


def write_bvh(joints: Sequence[Joint], rows: Sequence[Sequence[float]], seconds: float) -> str:
    """Return a BVH file.

    Args:
        joints: in depth-first order, each parent directly before its first child's tree.
        rows: of each frame, the root's place, then three angles (degrees) of each joint in the order of `CHANNELS`.
        seconds: from frame to frame.
    """
    children: list[list[int]] = [[] for _ in joints]
    for index, joint in enumerate(joints):
        if joint.parent >= 0:
            children[joint.parent].append(index)
    lines = ["HIERARCHY", *_joint_lines(joints, children, 0, "")]
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {seconds:.9f}"]
    lines += [" ".join(f"{number:.9f}" for number in row) for row in rows]
    return "\n".join(lines) + "\n"


def _joint_lines(joints: Sequence[Joint], children: list[list[int]], index: int, indent: str) -> list[str]:
    joint, inner = joints[index], indent + "\t"
    channels = CHANNELS if joint.parent >= 0 else (*_PLACE, *CHANNELS)
    lines = [f"{indent}{'JOINT' if joint.parent >= 0 else 'ROOT'} {joint.name}", indent + "{"]
    lines += [f"{inner}OFFSET {_numbers(joint.offset)}", f"{inner}CHANNELS {len(channels)} {' '.join(channels)}"]
    for child in children[index]:
        lines += _joint_lines(joints, children, child, inner)
    if not children[index]:
        lines += [f"{inner}End Site", inner + "{", f"{inner}\tOFFSET {_numbers(joint.tip)}", inner + "}"]
    return [*lines, indent + "}"]


def _numbers(vector: Vector) -> str:
    return " ".join(f"{number:.9f}" for number in vector)


def read_rows(text: str, joints: Sequence[Joint]) -> list[list[float]]:
    """Return the rows of a file that was written on the same joints.

    Raises Fault if the joints or their channels differ.
    """
    head, _, motion = text.partition("MOTION")
    names = re.findall(r"^\s*(?:ROOT|JOINT)\s+(\S+)", head, re.MULTILINE)
    channels = [tuple(line.split()) for line in re.findall(r"CHANNELS\s+\d+\s+(.*)", head)]
    expected = [CHANNELS if joint.parent >= 0 else (*_PLACE, *CHANNELS) for joint in joints]
    if names != [joint.name for joint in joints] or channels != expected:
        raise Fault("bodysense wrote other bones than it read; install the extension again")
    return [[float(number) for number in line.split()] for line in motion.strip().splitlines()[2:]]
