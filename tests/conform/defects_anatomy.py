"""Defects of anatomy: bones, proportions, sides, axes and joint limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense_conform.subject import Subject

from .conftest import SIDES, about, both, given_out, planted
from .kit import Kit, defect


@defect("anatomy.height")
def _(kit: Kit) -> Subject:
    position = 100 * kit.clean.position
    return replace(kit.clean, position=position)


@defect("anatomy.bone_constancy")
def _(kit: Kit) -> Subject:
    return kit.stretched("left_wrist", 1 + 0.1 * np.sin(0.3 * np.arange(len(kit.clean))))


@defect("anatomy.bone_symmetry")
def _(kit: Kit) -> Subject:
    return kit.stretched("left_wrist", 1.2)


@defect("anatomy.joint_order")
def _(kit: Kit) -> Subject:
    position, rotation = kit.clean.position.copy(), kit.clean.rotation.copy()
    pairs = kit.columns("left_elbow", "left_wrist", "right_elbow", "right_wrist")
    swapped = [pairs[1], pairs[0], pairs[3], pairs[2]]
    position[:, pairs], rotation[:, pairs] = position[:, swapped], rotation[:, swapped]
    return replace(kit.clean, position=position, rotation=rotation)


def scaled(kit: Kit, changes: dict[str, float]) -> Subject:
    """Bones of other lengths on both sides."""
    skeleton = kit.pose.skeleton
    offset = skeleton.rest_offset.copy()
    for name, factor in changes.items():
        offset[skeleton.index(name)] *= factor
    return given_out(planted(skeleton.with_offsets(offset), kit.pose.rotation), kit.steps)


def sides(part: str, factor: float) -> dict[str, float]:
    return {f"{side}_{part}": factor for side in SIDES}


@defect("anatomy.arm_proportion")
def _(kit: Kit) -> Subject:
    return scaled(kit, sides("elbow", 0.8) | sides("wrist", 1.35))


@defect("anatomy.leg_proportion")
def _(kit: Kit) -> Subject:
    return scaled(kit, sides("knee", 1.25) | sides("ankle", 0.75))


@defect("anatomy.arms_to_legs")
def _(kit: Kit) -> Subject:
    return scaled(kit, sides("elbow", 0.8) | sides("wrist", 0.8))


@defect("anatomy.trunk_share")
def _(kit: Kit) -> Subject:
    trunk = {"spine1": 2.0, "spine2": 2.0, "spine3": 2.0, "neck": 2.0}
    wide = sides("collar", 2.0) | sides("shoulder", 2.0) | sides("hip", 2.0)
    return scaled(
        kit, trunk | wide | sides("knee", 0.85) | sides("ankle", 0.85) | sides("elbow", 0.85) | sides("wrist", 0.85)
    )


@defect("anatomy.shoulder_width")
def _(kit: Kit) -> Subject:
    return scaled(kit, sides("collar", 1.7) | sides("shoulder", 1.7))


@defect("anatomy.hip_width")
def _(kit: Kit) -> Subject:
    skeleton = kit.pose.skeleton
    offset = skeleton.rest_offset.copy()
    offset[skeleton.indices(["left_hip", "right_hip"]), 0] *= 0.2
    return given_out(planted(skeleton.with_offsets(offset), kit.pose.rotation), kit.steps)


@defect("anatomy.up_axis")
def _(kit: Kit) -> Subject:
    turn = quaternion_exp(about(x=90))
    rotation = quaternion_multiply(turn, kit.clean.rotation)
    return replace(kit.clean, position=quaternion_rotate(turn, kit.clean.position), rotation=rotation)


@defect("anatomy.handedness")
def _(kit: Kit) -> Subject:
    return replace(
        kit.clean, position=kit.clean.position * [-1.0, 1, 1], rotation=kit.clean.rotation * [1.0, 1, -1, -1]
    )


@defect("anatomy.component_order")
def _(kit: Kit) -> Subject:
    return replace(kit.clean, rotation=np.roll(kit.clean.rotation, 1, axis=-1))


@defect("anatomy.inverse_rotations")
def _(kit: Kit) -> Subject:
    return replace(kit.clean, rotation=quaternion_conjugate(kit.clean.rotation))


@defect("anatomy.rotations_and_positions")
def _(kit: Kit) -> Subject:
    wandering = 0.5 * np.sin(0.05 * np.arange(len(kit.clean)))[:, None, None] * np.ones((1, len(kit.clean.points), 3))
    return replace(kit.clean, rotation=quaternion_multiply(kit.clean.rotation, quaternion_exp(wandering)))


@defect("anatomy.left_right")
def _(kit: Kit) -> Subject:
    turn = quaternion_exp(about(y=180))
    columns = kit.columns("pelvis", "spine3")
    rotation = kit.clean.rotation.copy()
    rotation[:, columns] = quaternion_multiply(rotation[:, columns], turn)
    return replace(kit.clean, rotation=rotation)


@defect("anatomy.rest_axes")
def _(kit: Kit) -> Subject:
    rotation = kit.clean.rotation.copy()
    for side, sign in (("left", 1), ("right", -1)):
        columns = kit.columns(f"{side}_shoulder", f"{side}_elbow")
        rotation[:, columns] = quaternion_multiply(rotation[:, columns], quaternion_exp(about(z=45.0 * sign)))
    return replace(kit.clean, rotation=rotation)


@defect("anatomy.knees_forward", "poses.squat_knees")
def _(kit: Kit) -> Subject:
    skeleton = kit.pose.skeleton
    rotation = kit.pose.rotation.copy()
    for name in ("left_knee", "right_knee"):
        k = skeleton.index(name)
        rotation[:, k] = quaternion_conjugate(rotation[:, k])
    return given_out(planted(skeleton, rotation), kit.steps)


def limit_defect(part: str, joint: str, angles: np.ndarray, *companions: str) -> None:
    """A joint that is turned further than it can."""
    defect(f"anatomy.limits_{part}", *companions)(lambda kit: kit.turned({joint: angles}))


limit_defect("knees", "left_knee", about(y=120))
limit_defect("hips", "left_hip", about(y=175), "anatomy.handedness", "poses.sit_feet", "poses.squat_feet")
limit_defect("ankles", "left_ankle", about(y=175), "anatomy.handedness")
limit_defect("spine", "spine2", about(y=120))
limit_defect("neck", "neck", about(y=150))
limit_defect("shoulders", "left_shoulder", about(x=-143, y=-86), "poses.stand_arms", "poses.t_pose_held")
limit_defect("elbows", "left_elbow", about(x=165))
limit_defect("wrists", "left_wrist", about(z=170))


def unscripted(subject: Subject) -> Subject:
    """Without its script: what is wrong with a limb is wrong with every pose."""
    return replace(subject, steps=())


@defect("anatomy.legs_apart")
def _(kit: Kit) -> Subject:
    return unscripted(kit.turned({"left_hip": about(z=-25), "right_hip": about(z=25)}))


@defect("anatomy.arms_outside", "anatomy.limits_elbows")
def _(kit: Kit) -> Subject:
    return unscripted(kit.turned({"left_shoulder": about(z=-15), "left_elbow": about(z=-125)}))


@defect("anatomy.arms_apart")
def _(kit: Kit) -> Subject:
    pose = kit.pose
    for part, angles in (("shoulder", about(z=-30)), ("shoulder", about(x=80)), ("elbow", about(y=-90))):
        pose = Kit(kit.clean, pose, kit.steps).bent(both(**{part: angles}))
    return unscripted(given_out(pose, kit.steps))
