"""Defects of scripted poses, of devices and of performers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.rotation import quaternion_exp, quaternion_log
from bodysense_conform.subject import Subject

from .conftest import RATE, SIDES, about, given_out, planted
from .kit import Defect, Kit, defect


def bent_while(label: str, angles: dict[str, np.ndarray], ramp: float = 0.2) -> Defect:
    """Joints that are turned so while a step lasts."""
    return lambda kit: kit.set(angles, label, ramp=ramp)


def both(part: str, left: np.ndarray) -> dict[str, np.ndarray]:
    return {f"left_{part}": left, f"right_{part}": left * [1, -1, -1]}


def legs(hip: float, knee: float, sides: tuple[str, ...] = SIDES) -> dict[str, np.ndarray]:
    found = {}
    for side in sides:
        found |= {f"{side}_hip": about(-hip), f"{side}_knee": about(knee), f"{side}_ankle": about(hip - knee)}
    return found


defect("poses.stand_upright")(bent_while("stand", {"spine2": about(x=35)}))
defect("poses.stand_feet")(bent_while("stand", {"left_hip": about(z=40)}))
defect("poses.stand_knees")(bent_while("stand", legs(20, 40)))
defect("poses.stand_arms")(bent_while("stand", both("shoulder", about())))
defect("poses.t_pose_held")(bent_while("t_pose", both("shoulder", about(z=-60))))
defect("poses.t_pose_elbows")(bent_while("t_pose", both("elbow", about(y=-45))))
defect("poses.arms_up")(bent_while("arms_up", both("shoulder", about()) | both("collar", about())))
defect("poses.arms_up_elbows")(bent_while("arms_up", both("elbow", about(y=-60))))
defect("poses.sit_down")(bent_while("sit", legs(10, 10)))
defect("poses.sit_knees")(bent_while("sit", legs(88, 20)))
defect("poses.sit_feet")(bent_while("sit", {"left_hip": about(-120), "left_knee": about(90)}))
defect("poses.squat_deep")(bent_while("squat", legs(5, 5)))
defect("poses.left_arm_raise")(bent_while("left_arm_raise", {"left_shoulder": about(z=-30)}))
defect("poses.right_arm_raise")(bent_while("right_arm_raise", {"right_shoulder": about(z=30)}))
defect("poses.left_leg_raise")(bent_while("left_leg_raise", legs(3, 3)))
defect("poses.right_leg_raise")(bent_while("right_leg_raise", legs(3, 3)))
defect("poses.march_lifts")(bent_while("march", legs(3, 3), 0.03))


def spoiled_squat(left: float, right: float) -> Defect:
    """Knees that bend by other shares of what they did."""

    def spoil(kit: Kit) -> Subject:
        inside = kit.during("squat")
        rotation = kit.pose.rotation.copy()
        for side, share in (("left", left), ("right", right)):
            for part in ("hip", "knee", "ankle"):
                k = kit.pose.skeleton.index(f"{side}_{part}")
                vector = quaternion_log(rotation[inside, k])
                rotation[inside, k] = quaternion_exp(share * vector)
        return given_out(planted(kit.pose.skeleton, rotation), kit.steps)

    return spoil


@defect("poses.squat_symmetry")
def _(kit: Kit) -> Subject:
    return spoiled_squat(0.7, 1.0)(kit)


@defect("poses.squat_knees")
def _(kit: Kit) -> Subject:
    inside = kit.during("squat")
    straight = spoiled_squat(0.0, 0.0)(kit)
    down = kit.clean.at("pelvis")[:, 1] - straight.at("pelvis")[:, 1]
    lower = np.where(inside, np.nan_to_num(down), 0.0)
    away = np.stack([0 * lower, lower, 0 * lower], axis=-1)[:, None]
    return replace(straight, position=straight.position + away)


@defect("poses.squat_feet")
def _(kit: Kit) -> Subject:
    away = 0.25 * np.sin(np.cumsum(kit.during("squat")) / RATE) ** 2 * kit.during("squat")
    return kit.moved(kit.clean.points, np.stack([away, 0 * away, 0 * away], axis=-1)[:, None])


@defect("poses.squats_alike")
def _(kit: Kit) -> Subject:
    first = kit.during("squat") & (kit.clean.time < kit.clean.time[kit.during("squat")].mean())
    rotation = kit.pose.rotation.copy()
    for name in [f"{side}_{part}" for side in SIDES for part in ("hip", "knee", "ankle")]:
        k = kit.pose.skeleton.index(name)
        rotation[first, k] = quaternion_exp(0.65 * quaternion_log(rotation[first, k]))
    return given_out(planted(kit.pose.skeleton, rotation), kit.steps)


@defect("poses.march_antiphase")
def _(kit: Kit) -> Subject:
    rotation = kit.pose.rotation.copy()
    for part in ("hip", "knee", "ankle"):
        left, right = (kit.pose.skeleton.index(f"{side}_{part}") for side in SIDES)
        rotation[kit.during("march"), right] = rotation[kit.during("march"), left]
    return given_out(planted(kit.pose.skeleton, rotation), kit.steps)


@defect("poses.march_cadence")
def _(kit: Kit) -> Subject:
    inside = np.flatnonzero(kit.during("march"))
    share = np.linspace(0, 1, len(inside))
    source = inside[0] + (share**2 * (len(inside) - 1)).astype(int)
    rotation = kit.pose.rotation.copy()
    rotation[inside] = kit.pose.rotation[source]
    return given_out(planted(kit.pose.skeleton, rotation), kit.steps)


@defect("poses.march_in_place")
def _(kit: Kit) -> Subject:
    inside = kit.during("march")
    way = np.minimum(np.cumsum(inside) / RATE, 9.0) * 0.12
    return kit.moved(kit.clean.points, np.stack([0 * way, 0 * way, way], axis=-1)[:, None])
