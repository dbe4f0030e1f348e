"""Defects of data and timing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense_conform.subject import Step, Subject, is_finger

from .conftest import RATE
from .kit import Kit, defect


@defect("data.time_finite")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[100] = np.nan
    return replace(kit.clean, time=time)


@defect("data.time_increases")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[[100, 101]] = time[[101, 100]]
    return replace(kit.timed(time), transport=replace(kit.timed(time).transport, log_time=kit.clean.time))


@defect("data.time_repeats")
def _(kit: Kit) -> Subject:
    time = kit.clean.time.copy()
    time[101:400:9] = time[100:399:9]
    return replace(kit.clean, time=time)


@defect("data.time_in_seconds")
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


@defect("data.no_zero_positions", "data.frozen_joint")
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


@defect("data.frozen_joint")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    inside = np.flatnonzero(kit.during("squat"))[14:32]
    hand = kit.columns(*kit.below("left_wrist"))
    position[np.ix_(inside, hand)] = position[inside[0], hand]
    return replace(kit.clean, position=position)


@defect(
    "data.joints_apart", "anatomy.arm_proportion", "anatomy.bone_symmetry", "anatomy.arms_to_legs", "anatomy.rest_axes"
)
def _(kit: Kit) -> Subject:
    return kit.stretched("left_wrist", 0.0)


@defect("data.windows_wellformed")
def _(kit: Kit) -> Subject:
    first, second, *rest = kit.steps
    return kit.script(first, Step(second.label, first.end - 1, second.end), *rest)


@defect("data.windows_covered")
def _(kit: Kit) -> Subject:
    *first, last = kit.steps
    return kit.script(*first, Step("other", last.start, last.end + 10))
