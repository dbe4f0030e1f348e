"""Flat trees: joints that all hang on one root, or on none, are hung on one another as a body's, by their names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.io.rigs import words
from bodysense.io.rigs.figure import Figure
from bodysense.io.rigs.joint_map import ARMS, LEGS, table_of
from bodysense.io.rigs.names import joints_of
from bodysense.io.rigs.options import ReadingOptions

BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))


def hung(figures: list[Figure], options: ReadingOptions) -> list[Figure]:
    """The figures of a file; of a flat tree a body, whose joints are where and turned as they were in the world."""
    names = [name for figure in figures for name in figure.joints]
    given = table_of(options.joints) if options.joints is not None else joints_of(names)
    ours = {of: name for name, of in given.items() if name in names}
    if not {"pelvis", *ARMS, *LEGS} <= ours.keys() or any(_hangs(figure, ours) for figure in figures):
        return figures
    trunk = [name for name in names if _is_trunk(name) and name not in given]
    joints = _in_world(figures, [*ours.values(), *trunk])
    parents = _parents(ours, _upward(trunk, ours, joints))
    order = list(parents)
    rotation, position = [], {}
    for k, name in enumerate(order):
        place, turn, _ = joints[name]
        if (parent := parents[name]) is not None:
            above, turned, _ = joints[parent]
            back = quaternion_conjugate(turned)
            place, turn = quaternion_rotate(back, place - above), quaternion_multiply(back, turn)
        position[k] = place
        rotation.append(turn)
    body = Figure(
        name=figures[0].name,
        joints=tuple(order),
        end_sites=(),
        parents=tuple(-1 if parent is None else order.index(parent) for parent in parents.values()),
        offset=np.stack([np.median(position[k], axis=0) for k in range(len(order))]),
        rotation=np.stack(rotation, axis=1),
        position=position,
        frame_rate=figures[0].frame_rate,
        nodes=tuple(joints[name][2] for name in order),
    )
    return [body]


def _is_trunk(name: str) -> bool:
    """Whether a name is that of a joint between pelvis and head."""
    return bool(words.parts(name) & {"spine", "neck"}) and not words.side_of(name) and not words.is_end(name)


def _in_world(figures: list[Figure], names: list[str]) -> dict[str, tuple[np.ndarray, np.ndarray, int]]:
    """Of joints by name: places (T, 3) in the file's world, rotations (T, 4), and the node of the file."""
    found = {}
    for figure in figures:
        if own := [k for k, name in enumerate(figure.joints) if name in names]:
            place, turn = figure.world(own)
            found |= {figure.joints[k]: (place[:, n], turn[:, n], figure.nodes[k]) for n, k in enumerate(own)}
    return found


def _upward(trunk: list[str], ours: Mapping[str, str], joints: Mapping[str, tuple]) -> list[str]:
    """All joints between pelvis and head, those that we have among them, from below up."""
    low, high = joints[ours["pelvis"]][0], (joints[ours["left_shoulder"]][0] + joints[ours["right_shoulder"]][0]) / 2
    up = high - low
    own = [ours[name] for name in ("spine1", "spine2", "spine3", "neck") if name in ours]
    return sorted([*own, *trunk], key=lambda name: float(np.median(((joints[name][0] - low) * up).sum(-1))))


def _parents(ours: Mapping[str, str], trunk: list[str]) -> dict[str, str | None]:
    """On which joint each hangs, by name, in an order in which parents come first."""
    body = default_skeleton()
    parents: dict[str, str | None] = {ours["pelvis"]: None}
    below = ours["pelvis"]
    for name in trunk:
        parents[name], below = below, name
    chest = next((name for name in reversed(trunk) if "neck" not in words.parts(name)), ours["pelvis"])
    for name in (name for name in body.points if name in ours and ours[name] not in parents):
        above = body.parents[body.index(name)]
        while body.points[above] not in ours:
            above = body.parents[above]
        hangs_on = ours[body.points[above]]
        carried = name == "head" or "collar" in name or "shoulder" in name
        if carried and hangs_on in (*trunk, ours["pelvis"]):
            hangs_on = below if name == "head" else chest
        parents[ours[name]] = hangs_on
    return parents


def _hangs(figure: Figure, ours: Mapping[str, str]) -> bool:
    """Whether a bone of a limb joins two joints of the figure."""
    index = {given: k for k, given in enumerate(figure.joints)}
    ends = [(ours[f"{side}_{a}"], ours[f"{side}_{b}"]) for side in ("left", "right") for a, b in BONES]
    return any(a in index and b in index and index[a] in figure.above(index[b]) for a, b in ends)
