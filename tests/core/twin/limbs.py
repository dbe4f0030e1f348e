"""Arms and legs: two bones each that come to where their joints are measured or predicted."""

from dataclasses import dataclass

import numpy as np

from .points import PELVIS, SIDES, at
from .tracked import Tracked
from .vectors import across, cross, length, reach, turned_onto, unit

# Of a limb's length: share of the natural side in where a middle joint points that is not measured.
BENT = {"arm": 0.03, "leg": 0.1}
HINGE = 2.0  # weight of measured rotations of pelvis and foot for a knee, relative to the network


@dataclass(frozen=True)
class Limb:
    """The joints of a limb, from the one that carries it, and points that replace its end if that is not measured."""

    name: str
    kind: str
    carrier: int
    start: int
    middle: int
    end: int
    stand_in: tuple[int, ...]


def _limb(side: str, kind: str) -> Limb:
    if kind == "leg":
        carrier, joints, stand_in = PELVIS, ("hip", "knee", "ankle"), ("foot",)
    else:
        carrier, joints = at(f"{side}_collar"), ("shoulder", "elbow", "wrist")
        stand_in = ("index1", "middle1", "ring1", "pinky1", "thumb1")
    start, middle, end = (at(f"{side}_{name}") for name in joints)
    return Limb(f"{side}_{kind}", kind, carrier, start, middle, end, tuple(at(f"{side}_{name}") for name in stand_in))


LIMBS = {f"{side}_{kind}": _limb(side, kind) for kind in ("arm", "leg") for side in SIDES}


@dataclass
class Task:
    """A limb's task in a frame. Vectors are in the world, from the limb's start, m."""

    end: np.ndarray
    middle: np.ndarray
    end_seen: bool
    middle_seen: bool
    start_turned: bool  # the rotation of the upper bone is known
    middle_turned: bool  # that of the lower bone
    upper: np.ndarray  # bones as their rotations carry them
    lower: np.ndarray
    ahead: np.ndarray  # the shin's front, which a thigh is never behind; zero for arms

    @property
    def longest(self) -> float:
        """Length (m) of the stretched limb."""
        return length(self.upper) + length(self.lower)


def limb_goal(seen: Tracked, limb: Limb, rotation: np.ndarray, output: np.ndarray, start: np.ndarray) -> Task:
    """Return the goal of a limb before easing, from measured points, rotations (22, 3, 3) and the prediction.

    `output`: rotations (52, 3, 3), of which those of hands, feet and measured bones are final.
    """
    start_turned, middle_turned = seen.turned(limb.start), seen.turned(limb.middle)
    upper = (output if start_turned else rotation)[limb.start]  # measured ones are eased already
    lower = (output if middle_turned else rotation)[limb.middle]
    task = Task(
        end=np.zeros(3),
        middle=np.zeros(3),
        end_seen=bool(seen.has_position[limb.end]),
        middle_seen=bool(seen.has_position[limb.middle]),
        start_turned=start_turned,
        middle_turned=middle_turned,
        upper=upper @ seen.rest_offset[limb.middle],
        lower=lower @ seen.rest_offset[limb.end],
        ahead=lower[:, 2] if limb.kind == "leg" else np.zeros(3),
    )
    task.middle = seen.position[limb.middle] - start if task.middle_seen else task.upper
    task.end = task.middle + task.lower
    if task.end_seen:
        task.end = seen.position[limb.end] - start
    elif limb.name in seen.stands_in:
        standing_in = [p for p in limb.stand_in if seen.has_position[p]]
        there = start + task.end + seen.rest_offset[standing_in] @ output[limb.end].T
        task.end = task.end + (seen.position[standing_in] - there).mean(axis=0)
    if not task.middle_seen:
        if task.end_seen and task.middle_turned:
            task.middle = task.end - task.lower
        elif not task.start_turned:
            task.middle = natural_middle(seen, limb, task, rotation[limb.start])
    return task


def unnatural_side(limb: Limb, start: np.ndarray, upper: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The direction in which a limb's middle joint never goes, turned with it from its predicted upper bone."""
    return turned_onto(start, upper, unit(end))[:, 2] * (-1 if limb.kind == "leg" else 1)


def keep_forward(task: Task, seen: Tracked, limb: Limb, thigh: np.ndarray) -> None:
    """Keep a knee that is on its way to where it is measured from bending backward, seen from the thigh's rotation."""
    backward = unnatural_side(limb, thigh, thigh @ seen.rest_offset[limb.middle], task.end)
    task.middle = task.middle - max(task.middle @ backward, 0.0) * backward


def natural_middle(seen: Tracked, limb: Limb, task: Task, start: np.ndarray) -> np.ndarray:
    """Where the middle joint should be if it is not measured: as predicted, but on its natural side.

    A knee never goes backward, and bends about the axis that measured rotations of pelvis and foot have to the left.
    """
    leg, direction = limb.kind == "leg", unit(task.end)
    unnatural = unnatural_side(limb, start, task.upper, task.end)
    wrong = max(task.middle @ unnatural, 0.0) if leg else 0.0
    side = task.middle - (wrong + BENT[limb.kind] * task.longest) * unnatural
    if not leg or not seen.turned(limb.end) or not seen.has_position[limb.end]:
        return side
    hinge = seen.rotation[limb.end][:, 0] + (seen.rotation[PELVIS][:, 0] if seen.turned(PELVIS) else 0)
    return unit(across(side, direction)) + HINGE * cross(direction, hinge)


def solve_limb(task: Task) -> tuple[np.ndarray, np.ndarray]:
    """Middle and end from the start, as far as bones reach."""
    upper, lower = length(task.upper), length(task.lower)
    if task.middle_seen:
        middle = upper * unit(task.middle)
    elif task.start_turned:
        middle = task.upper
    elif task.middle_turned:
        thigh = task.end - task.lower
        middle = upper * unit(thigh + (not task.end_seen) * max(-thigh @ task.ahead, 0.0) * task.ahead)
    else:
        return reach(task.end, upper, lower, task.middle)
    if task.middle_turned and not task.end_seen:
        return middle, middle + task.lower
    return middle, middle + lower * unit(task.end - middle)


def turn_limb(rotation: np.ndarray, seen: Tracked, limb: Limb, middle: np.ndarray, end: np.ndarray) -> None:
    """Turn the bones of a limb as solved, in place of `rotation` (52, 3, 3)."""
    for joint, child, to in ((limb.start, limb.middle, middle), (limb.middle, limb.end, end - middle)):
        rotation[joint] = turned_onto(rotation[joint], rotation[joint] @ seen.rest_offset[child], to)
