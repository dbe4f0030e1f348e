"""Defects of motion: jumps, tremor, floors, and what happens at losses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.rotation import quaternion_exp, quaternion_log, quaternion_multiply, quaternion_rotate
from bodysense_conform.subject import Step, Subject

from .conftest import LOST, RATE, SIDES, about, given_out, planted
from .kit import Kit, defect


@defect("motion.teleport")
def _(kit: Kit) -> Subject:
    return kit.moved(kit.clean.points, [0.7, 0.0, 0.0], kit.clean.time > 5.0)


@defect("motion.body_speed")
def _(kit: Kit) -> Subject:
    way = np.interp(kit.clean.time, [3.0, 4.0, 5.0, 6.0], [0.0, 7.0, 21.0, 28.0])
    return kit.moved(kit.clean.points, np.stack([way, 0 * way, 0 * way], axis=-1)[:, None])


@defect("motion.pop")
def _(kit: Kit) -> Subject:
    return kit.moved(kit.below("left_wrist"), [0.0, 0.0, 1.5], slice(400, 401))


@defect("motion.joint_speed")
def _(kit: Kit) -> Subject:
    since = kit.clean.time - kit.clean.time[kit.during("march")][0]
    swing = 4.0 * (1 - np.cos(2 * np.pi * since)) * ((since > 0) & (since < 9))
    return kit.moved(("head_top",), np.stack([0 * swing, swing, 0 * swing], axis=-1)[:, None])


@defect("motion.body_flip")
def _(kit: Kit) -> Subject:
    turn = quaternion_exp(about(y=180))
    middle = kit.clean.position[100, kit.columns("pelvis")] * [1.0, 0.0, 1.0]
    position, rotation = kit.clean.position.copy(), kit.clean.rotation.copy()
    position[100:] = middle + quaternion_rotate(turn, position[100:] - middle)
    rotation[100:] = quaternion_multiply(turn, rotation[100:])
    return replace(kit.clean, position=position, rotation=rotation)


@defect("motion.rotation_flip")
def _(kit: Kit) -> Subject:
    rotation = kit.clean.rotation.copy()
    columns = kit.columns("head")
    rotation[400:403, columns] = quaternion_multiply(rotation[400:403, columns], quaternion_exp(about(y=175)))
    return replace(kit.clean, rotation=rotation)


@defect("motion.shake", "motion.step_at_return")
def _(kit: Kit) -> Subject:
    noise = np.random.default_rng(1).normal(0, 0.024, (len(kit.clean), 1, 3))
    return kit.moved(kit.clean.points, noise)


@defect("motion.rotation_shake")
def _(kit: Kit) -> Subject:
    rotation = kit.clean.rotation.copy()
    columns = kit.columns("head")
    noise = quaternion_exp(np.random.default_rng(1).normal(0, 0.085, (len(rotation), 1, 3)))
    rotation[:, columns] = quaternion_multiply(rotation[:, columns], noise)
    return replace(kit.clean, rotation=rotation)


@defect("motion.dead")
def _(kit: Kit) -> Subject:
    """The first frame again and again, with as much noise as a tracker has."""
    still = kit.cut(kit.clean.time < 9.0)
    noise = np.random.default_rng(1).normal(0, 0.0002, (len(still), 1, 3))
    position, rotation = still.position[:1] + noise, np.repeat(still.rotation[:1], len(still), axis=0)
    return replace(still, position=position, rotation=rotation, steps=(Step("other", 0.0, 9.0),))


@defect("motion.skate")
def _(kit: Kit) -> Subject:
    walks = kit.clean.during(kit.clean.labelled("other")[-1])
    rotation = kit.pose.rotation.copy()
    for name in [f"{side}_{part}" for side in SIDES for part in ("hip", "knee", "ankle")]:
        k = kit.pose.skeleton.index(name)
        rotation[walks, k] = quaternion_exp(0.04 * quaternion_log(rotation[walks, k]))
    glide = np.cumsum(walks) / RATE
    subject = given_out(planted(kit.pose.skeleton, rotation), kit.steps)
    away = np.stack([0 * glide, 0 * glide, glide], axis=-1)[:, None]
    return replace(subject, position=subject.position + away)


@defect("motion.under_floor")
def _(kit: Kit) -> Subject:
    return kit.moved(kit.clean.points, [0.0, -0.15, 0.0])


@defect("motion.floor_level")
def _(kit: Kit) -> Subject:
    return kit.moved(kit.clean.points, [0.0, 0.2, 0.0])


@defect("motion.hover")
def _(kit: Kit) -> Subject:
    rise = 0.5 * np.clip(np.minimum(kit.clean.time - 2, 8 - kit.clean.time), 0, 1)
    return kit.moved(kit.clean.points, np.stack([0 * rise, rise, 0 * rise], axis=-1)[:, None])


@defect("motion.idle_steps")
def _(kit: Kit) -> Subject:
    step = 0.12 * (np.sin(2 * np.pi * 2.0 * kit.clean.time) > 0.6) * kit.during("stand")
    smooth = np.convolve(step, [0.25, 0.5, 0.25], "same")
    return kit.moved(("left_ankle", "left_foot", "left_toe"), np.stack([0 * smooth, 0 * smooth, smooth], -1)[:, None])


@defect("motion.step_at_loss")
def _(kit: Kit) -> Subject:
    away = np.zeros((len(kit.clean), 1, 3))
    away[LOST, 0, 2] = np.linspace(0.2, 0.0, LOST.stop - LOST.start)
    return kit.moved(kit.below("left_wrist"), away)


@defect("motion.step_at_return")
def _(kit: Kit) -> Subject:
    away = np.zeros((len(kit.clean), 1, 3))
    away[LOST, 0, 2] = np.linspace(0.0, 0.2, LOST.stop - LOST.start)
    return kit.moved(kit.below("left_wrist"), away)


@defect("motion.completed_speed")
def _(kit: Kit) -> Subject:
    away = np.zeros((len(kit.clean), 1, 3))
    share = np.linspace(0, np.pi, LOST.stop - LOST.start)
    away[LOST, 0, 2] = 3.0 * np.sin(share) ** 2
    return kit.moved(kit.below("left_wrist"), away)


@defect("motion.return_after_remount")
def _(kit: Kit) -> Subject:
    off = next(step for step in kit.steps if step.label == "remount")
    late = (kit.clean.time >= off.end - 0.2) & (kit.clean.time < off.end + 1.5)
    return kit.invalid(kit.clean.points, late)


@defect("motion.recovery")
def _(kit: Kit) -> Subject:
    off = next(step for step in kit.steps if step.label == "remount")
    after = kit.clean.time - off.end
    return kit.moved(kit.below("left_wrist"), [0.0, 0.0, 0.35], (after > -0.2) & (after < 1.0))


@defect("motion.same_body")
def _(kit: Kit) -> Subject:
    off = next(step for step in kit.steps if step.label == "remount")
    return kit.stretched("left_wrist", np.where(kit.clean.time > off.start, 1.08, 1.0))
