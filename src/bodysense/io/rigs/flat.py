"""Flat trees: joints that all hang on one root, or on none, are hung on one another as a body's, by their names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.io.rigs.figure import Figure
from bodysense.io.rigs.joint_map import ARMS, LEGS, table_of
from bodysense.io.rigs.names import joints_of
from bodysense.io.rigs.options import ReadingOptions

BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))


def hung(figures: list[Figure], options: ReadingOptions) -> list[Figure]:
    """The figures of a file; of a flat tree a body, whose joints are where and turned as they were in the world."""
    told = table_of(options.joints) if options.joints is not None else None
    names = [name for figure in figures for name in figure.joints]
    ours = {of: given for given, of in (told or joints_of(names)).items() if given in names}
    if not {"pelvis", *ARMS, *LEGS} <= ours.keys() or any(_hangs(figure, ours) for figure in figures):
        return figures
    place, turn, node = {}, {}, {}
    for figure in figures:
        own = [figure.joints.index(given) for given in ours.values() if given in figure.joints]
        if not own:
            continue
        for k, where, turned in zip(own, *(np.moveaxis(part, 1, 0) for part in figure.world(own)), strict=True):
            place[figure.joints[k]], turn[figure.joints[k]], node[figure.joints[k]] = where, turned, figure.nodes[k]
    body = default_skeleton()
    order = [name for name in body.points if name in ours]
    parents = [-1]
    for name in order[1:]:
        above = body.parents[body.index(name)]
        while body.points[above] not in ours:
            above = body.parents[above]
        parents.append(order.index(body.points[above]))
    joints = tuple(ours[name] for name in order)
    rotation, position = turn[joints[0]][:, None], {0: place[joints[0]]}
    for k, (given, parent) in enumerate(zip(joints[1:], parents[1:], strict=True), start=1):
        back = quaternion_conjugate(turn[joints[parent]])
        position[k] = quaternion_rotate(back, place[given] - place[joints[parent]])
        rotation = np.concatenate([rotation, quaternion_multiply(back, turn[given])[:, None]], axis=1)
    return [
        Figure(
            name=figures[0].name,
            joints=joints,
            end_sites=(),
            parents=tuple(parents),
            offset=np.stack([np.median(position[k], axis=0) for k in range(len(joints))]),
            rotation=rotation,
            position=position,
            frame_rate=figures[0].frame_rate,
            nodes=tuple(node[given] for given in joints),
        )
    ]


def _hangs(figure: Figure, ours: Mapping[str, str]) -> bool:
    """Whether a bone of a limb joins two joints of the figure."""
    index = {given: k for k, given in enumerate(figure.joints)}
    ends = [(ours[f"{side}_{a}"], ours[f"{side}_{b}"]) for side in ("left", "right") for a, b in BONES]
    return any(a in index and b in index and index[a] in figure.above(index[b]) for a, b in ends)
