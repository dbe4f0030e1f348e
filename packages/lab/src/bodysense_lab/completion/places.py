"""Where everything stands in the arrays of a completion step: places, matrices, conditions and means."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.constraints import ARMS, ENDS, LIMBS, MIDDLES, STARTS, replacing
from bodysense_lab.completion.fingers import HAND_JOINTS, HAND_POINTS, SIDES
from bodysense_lab.completion.frame import PAIRS
from bodysense_lab.completion.hands import WRISTS
from bodysense_lab.completion.masks import FIRST, SECOND, Condition
from bodysense_lab.completion.points import (
    HEAD,
    HEAD_HEIGHT,
    INPUT_POINTS,
    JOINTS,
    PLACED,
    SPIN_PLACES,
    body_places,
    path_from_head,
)
from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT

_SKELETON = default_skeleton()
_AT = _SKELETON.index
_FOUR_FINGERS = ("index", "middle", "ring", "pinky")
_FLATTEST = 1e-6  # m: no body is lower than that, also where all offsets are zero


# 1/m: a shoulder that is 4 cm off turns its collar, of some 15 cm, half as far as a sure one.
SHOULDER_DOUBT = 25.0


def _knuckles(side: str) -> list[int]:
    return [_AT(f"{side}_{finger}1") for finger in _FOUR_FINGERS]


def _input_points() -> list[list[int]]:
    """(27) the points that each point of the body's network is the mean of."""
    return [*([place] for place in body_places()), *(_knuckles(side) for side in SIDES)]


def _stand_ins() -> list[list[int]]:
    """(4) the points that say where the end of a limb is, where it is not tracked itself."""
    hands = [[*_knuckles(side), _AT(f"{side}_thumb1")] for side in SIDES]
    return [*hands, *([_AT(f"{side}_foot")] for side in SIDES)]


def conditions() -> dict[str, list[Condition]]:
    """What a step asks about what is tracked."""
    points = _input_points()
    hands: list[Condition] = []
    for wrist, ends, joints in zip(WRISTS, HAND_POINTS, HAND_JOINTS, strict=True):
        hands += [Condition(points=[wrist, int(point)]) for point in ends]
        hands += [Condition(joints=[int(joint)]) for _ in range(2) for joint in joints]
    return {
        "points": [Condition(points=group) for group in points],
        "moving": [
            *(Condition(points=group) for group in points),
            *(Condition(joints=[joint]) for _ in range(2) for joint in SPIN_PLACES),
        ],
        "axes": [Condition(joints=[joint]) for _ in range(2) for joint in range(JOINTS)],
        "lines": [Condition(points=[_AT(left), _AT(right)]) for left, right in PAIRS],
        # Limbs whose end is not tracked; whose middle joint goes to its natural side; whose lower bone leads there.
        "limbs": [
            *(Condition(without_points=[end, *others]) for end, others in zip(ENDS, _stand_ins(), strict=True)),
            # A limb whose upper bone is measured, by its rotation or by its ends, bends as that says, an arm also as
            # its lower bone does; a knee stays forward.
            *(
                Condition(without_points=[MIDDLES[k]], without_joints=[STARTS[k], MIDDLES[k]][: 2 if k < ARMS else 1])
                for k in range(len(LIMBS))
            ),
            *(
                Condition(points=[end], joints=[middle], without_points=[middle])
                for middle, end in zip(MIDDLES, ENDS, strict=True)
            ),
            # Arms that hang from a measured shoulder, whose collar's rotation is not measured; of these, those that go
            # with it. A measured hip moves the pelvis instead.
            *(_hung(k) for k in range(len(LIMBS))),
            *(_hung(k, [MIDDLES[k]]) for k in range(len(LIMBS))),
        ],
        "hands": hands,
    }


def _hung(limb: int, without: Sequence[int] = ()) -> Condition:
    start = STARTS[limb]
    collar = _SKELETON.parents[start]
    return Condition([start], without_points=without, without_joints=[collar], never=limb >= ARMS)


def means() -> dict[str, list[dict[int, float]]]:
    """What a step takes means of."""
    pelvis = _AT("pelvis")
    ends = [{**dict.fromkeys(others, 1.0), end: SECOND} for end, others in zip(ENDS, _stand_ins(), strict=True)]
    starts = [{STARTS[k]: 1.0} if k < ARMS else {} for k in range(len(LIMBS))]
    every = dict.fromkeys(range(POINT_COUNT), 1.0)
    return {
        "frame": [{**every, HEAD: FIRST}],
        "body": [{**every, pelvis: SECOND, HEAD: FIRST}],
        "pelvis": [{_AT("left_hip"): 1.0, _AT("right_hip"): 1.0, pelvis: SECOND}],
        "limbs": [*ends, *({middle: 1.0} for middle in MIDDLES), *starts],
    }


def reading_tables() -> dict[str, Tensor]:
    """How the points of the body's network are read from those of the skeleton."""
    groups = _input_points()
    table = torch.zeros(len(INPUT_POINTS), POINT_COUNT)
    for row, group in zip(table, groups, strict=True):
        row[group] = 1 / len(group)
    heights = torch.zeros(PLACED, POINT_COUNT)
    heights[:, body_places()[1:]] = torch.tensor(path_from_head(), dtype=torch.float32)
    spins = torch.tensor(SPIN_PLACES)
    joints = torch.arange(JOINTS)
    return {
        "input_points": table,
        "spin_rows": torch.cat([spins, spins + JOINT_COUNT]),
        "axis_rows": torch.cat([joints, joints + JOINT_COUNT]),
        "accuracy_places": torch.tensor([group[0] for group in groups]),
        "body_places": torch.tensor(body_places()),
        "heights": heights / -HEAD_HEIGHT,
        "flattest": torch.full((PLACED,), _FLATTEST),
    }


def skeleton_tables() -> dict[str, Tensor]:
    """The tree, and where its limbs are."""
    path = torch.tensor(_SKELETON.path - _SKELETON.path[HEAD], dtype=torch.float32)
    path[:, 0] = 0
    parents = torch.tensor([0, *_SKELETON.parents[1:]])
    wrists = torch.tensor(_SKELETON.wrist_of)
    legs = torch.zeros(len(LIMBS), 2)
    legs[2, 0] = legs[3, 1] = 1
    hinges = torch.zeros(len(LIMBS), JOINT_COUNT)
    for leg in (2, 3):
        hinges[leg, [_AT("pelvis"), ENDS[leg]]] = 1
    doubt = torch.zeros(len(LIMBS), POINT_COUNT)
    doubt[range(ARMS), STARTS[:ARMS]] = SHOULDER_DOUBT
    root = (torch.arange(JOINT_COUNT) == 0).float()[:, None].expand(3, -1, 3)
    collars = [_SKELETON.parents[start] for start in STARTS]
    turned = [*collars, *STARTS, *MIDDLES]
    # All rotations at last: the body's, those of limbs after bending, those of fingers. Hips stay where they are.
    world = replacing(JOINTS, turned)
    world[0] = 0
    fingers = [JOINTS + len(turned) + k for k in range(HAND_JOINTS.size)]
    return {
        "from_head": path,
        "parents": parents,
        "flat_parents": torch.where(wrists >= 0, wrists, parents),  # of a hand whose fingers are not known yet
        "joint_parents": parents[:JOINT_COUNT],
        "hanging": 1 - root,
        "standing": root * torch.eye(3).unsqueeze(1),
        "starts": torch.tensor(STARTS),
        "start_doubt": doubt,
        "middles": torch.tensor(MIDDLES),
        "ends": torch.tensor(ENDS),
        "feet": torch.tensor([_AT(f"{side}_{part}") for part in ("ankle", "foot", "toe") for side in SIDES]),
        "legs": legs,
        "hinges": hinges,
        "turned": torch.tensor(turned),
        "with_turned": torch.tensor([*world, *fingers]),
    }
