"""One defect each: of a faultless performance, changed in one way, exactly the checks fail that are named for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from bodysense.body.pose import Pose
from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.conform.checks import TABLE
from bodysense.conform.subject import Step, Subject, is_finger
from bodysense.conform.verdict import judge

from .conftest import RATE, SIDES, about, given_out, planted

RANDOM = np.random.default_rng(7)
LEFT_LEG = ("left_hip", "left_knee", "left_ankle", "left_foot", "left_toe")
LEFT_HAND = ("thumb", "index", "middle", "ring", "pinky")


@dataclass(frozen=True)
class Kit:
    """The performance and ways to spoil it."""

    clean: Subject
    pose: Pose
    steps: list[Step]

    def during(self, label: str, share: float = 1.0) -> np.ndarray:
        return np.any([self.clean.during(step, share) for step in self.clean.labelled(label)], axis=0)

    def columns(self, *names: str) -> list[int]:
        return [self.clean.points.index(name) for name in names]

    def moved(self, names: tuple[str, ...], by: Any, frames: Any = slice(None)) -> Subject:
        """Points put elsewhere."""
        position = self.clean.position.copy()
        position[np.ix_(np.arange(len(position))[frames], self.columns(*names))] += by
        return replace(self.clean, position=position)

    def below(self, joint: str) -> tuple[str, ...]:
        """A joint and all that hangs on it."""
        skeleton = self.pose.skeleton
        found = {skeleton.index(joint)}
        for k, parent in enumerate(skeleton.parents):
            if parent in found:
                found.add(k)
        return tuple(name for name in self.clean.points if skeleton.index(name) in found)

    def stretched(self, joint: str, by: np.ndarray | float) -> Subject:
        """A bone `by` times its length, all that hangs on it carried along."""
        skeleton = self.pose.skeleton
        parent = skeleton.joints[skeleton.parents[skeleton.index(joint)]]
        bone = self.clean.at(joint) - self.clean.at(parent)
        move = np.nan_to_num(bone * (np.broadcast_to(by, len(bone))[:, None] - 1))
        return self.moved(self.below(joint), move[:, None])

    def turned(self, angles: dict[str, np.ndarray], frames: Any = slice(None), plant: bool = False) -> Subject:
        """Joints turned further, rad, in their own frames."""
        return given_out(self.bent(angles, frames, plant), self.steps)

    def bent(self, angles: dict[str, np.ndarray], frames: Any = slice(None), plant: bool = False) -> Pose:
        rotation = self.pose.rotation.copy()
        for name, vector in angles.items():
            k = self.pose.skeleton.index(name)
            rotation[frames, k] = quaternion_multiply(rotation[frames, k], quaternion_exp(vector))
        whole = replace(self.pose, rotation=rotation)
        return planted(self.pose.skeleton, rotation) if plant else whole

    def set(self, angles: dict[str, np.ndarray], label: str, plant: bool = True) -> Subject:
        """Joints turned so and no further while a step lasts, blended at its ends."""
        inside = self.during(label)
        rotation = self.pose.rotation.copy()
        count = int(inside.sum())
        ramp = np.clip(np.minimum(np.arange(count), np.arange(count)[::-1]) / (0.2 * count), 0, 1)
        for name, vector in angles.items():
            k = self.pose.skeleton.index(name)
            old = rotation[inside, k]
            new = np.broadcast_to(quaternion_exp(vector), old.shape)
            mixed = (1 - ramp)[:, None] * old + ramp[:, None] * new
            rotation[inside, k] = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
        pose = planted(self.pose.skeleton, rotation) if plant else replace(self.pose, rotation=rotation)
        return given_out(pose, self.steps)

    def transport(self, **changes: Any) -> Subject:
        return replace(self.clean, transport=replace(self.clean.transport, **changes))

    def timed(self, time: np.ndarray) -> Subject:
        """The same frames at other times; what else has times follows."""
        transport = replace(self.clean.transport, log_time=time + 0.02, available=time + 0.02, device_time=time + 7)
        return replace(self.clean, time=time, transport=transport)

    def cut(self, keep: np.ndarray) -> Subject:
        """Some frames only."""
        c, t = self.clean, self.clean.transport
        assert c.measured is not None and t.all_tracked is not None
        transport = replace(t, log_time=c.time[keep], available=c.time[keep], device_time=c.time[keep] + 7,
                            all_tracked=t.all_tracked[keep])  # fmt: skip
        return replace(c, time=c.time[keep], position=c.position[keep], rotation=c.rotation[keep], valid=c.valid[keep],
                       measured=c.measured[keep], transport=transport)  # fmt: skip

    def without(self, *names: str) -> Subject:
        """Some points never come."""
        keep = [k for k, name in enumerate(self.clean.points) if name not in names]
        assert self.clean.measured is not None
        return replace(
            self.clean, points=tuple(self.clean.points[k] for k in keep), position=self.clean.position[:, keep],
            rotation=self.clean.rotation[:, keep], rotated=self.clean.rotated[keep], valid=self.clean.valid[:, keep],
            measured=self.clean.measured[:, keep],
        )  # fmt: skip

    def invalid(self, names: tuple[str, ...], frames: Any) -> Subject:
        valid = self.clean.valid.copy()
        valid[np.ix_(np.arange(len(valid))[frames], self.columns(*names))] = False
        transport = replace(self.clean.transport, all_tracked=valid.all(axis=1))
        return replace(self.clean, valid=valid, transport=transport)

    def script(self, *steps: Step) -> Subject:
        return replace(self.clean, steps=steps)


Defect = Callable[[Kit], Subject]
DEFECTS: dict[str, tuple[Defect, set[str]]] = {}


def defect(check: str, *companions: str) -> Callable[[Defect], Defect]:
    def register(spoil: Defect) -> Defect:
        assert check not in DEFECTS, check
        DEFECTS[check] = (spoil, {check, *companions})
        return spoil

    return register


@pytest.fixture(scope="session")
def kit(clean: Subject, performed: tuple[Pose, list[Step]]) -> Kit:
    return Kit(clean, *performed)


LIMITED = [check for check in TABLE if check.most is not None or check.least is not None]


def test_every_check_with_a_limit_has_its_defect() -> None:
    assert {check.id for check in LIMITED} - {"data.long_enough"} == set(DEFECTS)


@pytest.mark.parametrize("check", sorted(DEFECTS))
def test_a_defect_fails_exactly_what_is_named_for_it(check: str, kit: Kit) -> None:
    spoil, expected = DEFECTS[check]
    verdict = judge(spoil(kit))
    failed = {one.check.id: one.value for one in verdict.of("fail", "retake")}
    assert set(failed) == expected, failed
    blamed = {one.check.id: one.outcome for one in verdict.of("fail", "retake")}[check]
    row = next(one for one in TABLE if one.id == check)
    assert blamed == ("retake" if row.blame == "performer" else "fail")


# Timing and data


@defect("data.time_finite")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[100] = np.nan
    return replace(kit.clean, time=time)


@defect("data.time_increases")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[[100, 101]] = time[[101, 100]]
    return replace(kit.clean, time=time)


@defect("data.time_repeats")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[101:400:9] = time[100:399:9]
    return replace(kit.clean, time=time)


@defect("data.time_in_seconds", "data.windows_covered", "data.clock_drift")
def _(kit: Kit) -> Subject:
    steps = [Step(step.label, 1000 * step.start, 1000 * step.end) for step in kit.steps]
    return replace(kit.timed(1000 * kit.clean.time), steps=tuple(steps))


@defect("data.rate")
def _(kit: Kit) -> Subject:
    steps = [Step(step.label, 3 * step.start, 3 * step.end) for step in kit.steps]
    return replace(kit.timed(3 * kit.clean.time), steps=tuple(steps))


@defect("data.interval_regular")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[1::2] += 0.3 / RATE
    return kit.timed(time)


@defect("data.gaps", "data.windows_covered")
def _(kit: Kit) -> Subject:
    t = kit.clean.time
    return kit.cut((t < 3.0) | (t > 3.5))


@defect("data.log_times_increase")
def _(kit: Kit) -> Subject:
    log = kit.clean.time.copy()
    log[[40, 41]] = log[[41, 40]]
    return kit.transport(log_time=log)


@defect("data.available_after_sample")
def _(kit: Kit) -> Subject:
    return kit.transport(available=kit.clean.time - 0.01)


@defect("data.clock_drift")
def _(kit: Kit) -> Subject:
    return kit.transport(device_time=7 + 1.002 * kit.clean.time)


@defect("data.joints_present")
def _(kit: Kit) -> Subject:
    return kit.without("left_elbow")


@defect("data.messages_decode")
def _(kit: Kit) -> Subject:
    return kit.transport(malformed=3)


@defect("data.messages_lost")
def _(kit: Kit) -> Subject:
    return kit.transport(lost=60)


@defect("data.finite")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    position[50, kit.columns("left_wrist")] = np.nan
    return replace(kit.clean, position=position)


@defect("data.no_zero_positions")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    position[:, kit.columns("head_top")] = 0.0
    return replace(kit.clean, position=position)


@defect("data.within_reach")
def _(kit: Kit) -> Subject:
    return kit.moved(kit.clean.points, [2000.0, 0.0, 0.0])


@defect("data.unit_quaternions")
def _(kit: Kit) -> Subject:
    return replace(kit.clean, rotation=1.01 * kit.clean.rotation)


@defect("data.presence")
def _(kit: Kit) -> Subject:
    return kit.invalid(kit.clean.points, slice(30, 200, 2))


@defect("data.coverage")
def _(kit: Kit) -> Subject:
    return kit.invalid(("left_shoulder",), np.arange(len(kit.clean)) % 3 > 0)


@defect("data.validity_trend")
def _(kit: Kit) -> Subject:
    fingers = tuple(name for name in kit.clean.points if is_finger(name))
    return kit.invalid(fingers, slice(len(kit.clean) - 110, None))


@defect("data.flag_agrees")
def _(kit: Kit) -> Subject:
    return kit.transport(all_tracked=np.zeros(len(kit.clean), dtype=bool))


@defect("data.frozen_frames")
def _(kit: Kit) -> Subject:
    position, rotation = kit.clean.position.copy(), kit.clean.rotation.copy()
    position[60:90], rotation[60:90] = position[60], rotation[60]
    return replace(kit.clean, position=position, rotation=rotation)


@defect("data.frozen_joint", "anatomy.bone_constancy")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    inside = np.flatnonzero(kit.during("march"))[10:30]
    position[np.ix_(inside, kit.columns("left_knee"))] = position[inside[0], kit.columns("left_knee")]
    return replace(kit.clean, position=position)


@defect("data.joints_apart", "anatomy.arm_proportion", "anatomy.bone_symmetry", "anatomy.arms_to_legs")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    hand = [name for name in kit.below("left_wrist")]
    position[:, kit.columns(*hand)] -= (kit.clean.position - np.roll(kit.clean.position, 0))[:, kit.columns(*hand)]
    move = kit.clean.position[:, kit.columns("left_elbow")] - kit.clean.position[:, kit.columns("left_wrist")]
    position[:, kit.columns(*hand)] += move
    return replace(kit.clean, position=position)


@defect("data.windows_wellformed")
def _(kit: Kit) -> Subject:
    first, second, *rest = kit.steps
    return kit.script(first, Step(second.label, first.end - 1, second.end), *rest)


@defect("data.windows_covered")
def _(kit: Kit) -> Subject:
    *first, last = kit.steps
    return kit.script(*first, Step("other", last.start, last.end + 10))


# Anatomy


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


@defect("anatomy.rotations_and_positions", "poses.none")
def _(kit: Kit) -> Subject:
    late = np.roll(kit.clean.rotation, 12, axis=0)
    wild = quaternion_exp(RANDOM.normal(0, 0.02, late.shape[:-1] + (3,)))
    slow = quaternion_exp(0.9 * np.sin(0.05 * np.arange(len(late)))[:, None, None] * np.ones((1, late.shape[1], 3)))
    return replace(
        kit.clean,
        rotation=quaternion_multiply(kit.clean.rotation, quaternion_multiply(slow, wild * 0 + [1.0, 0, 0, 0])),
    )


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


@defect("anatomy.knees_forward")
def _(kit: Kit) -> Subject:
    skeleton = kit.pose.skeleton
    rotation = kit.pose.rotation.copy()
    for name in ("left_knee", "right_knee"):
        k = skeleton.index(name)
        rotation[:, k] = quaternion_conjugate(rotation[:, k])
    return given_out(planted(skeleton, rotation), kit.steps)


def limit_defect(check: str, angles: dict[str, np.ndarray], *companions: str) -> None:
    defect(check, *companions)(lambda kit: kit.turned(angles))


limit_defect("anatomy.limits_knees", {"left_knee": about(y=120)})
limit_defect("anatomy.limits_hips", {"left_hip": about(y=175)})
limit_defect("anatomy.limits_ankles", {"left_ankle": about(y=175)})
limit_defect("anatomy.limits_spine", {"spine2": about(y=120)})
limit_defect("anatomy.limits_neck", {"neck": about(y=150)})
limit_defect("anatomy.limits_shoulders", {"left_shoulder": about(x=175)})
limit_defect("anatomy.limits_elbows", {"left_elbow": about(y=85)})
limit_defect("anatomy.limits_wrists", {"left_wrist": about(z=170)})


@defect("anatomy.legs_apart")
def _(kit: Kit) -> Subject:
    return kit.turned({"left_hip": about(z=-14), "right_hip": about(z=14)})


@defect("anatomy.arms_outside")
def _(kit: Kit) -> Subject:
    return kit.turned({"left_elbow": about(z=-60), "left_shoulder": about(z=-10)})


@defect("anatomy.arms_apart")
def _(kit: Kit) -> Subject:
    return kit.turned({})
