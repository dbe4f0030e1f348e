"""Defects of a faultless performance: the name, the size that must be found, and the checks that find it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense_conform.subject import SIDES, Step, Subject, is_finger

from .conftest import about, given_out


@dataclass(frozen=True)
class Performance:
    """A faultless performance: the subject, and its pose and script."""

    subject: Subject
    pose: Pose
    steps: tuple[Step, ...]

    def turned(self, turns: dict[str, np.ndarray]) -> Subject:
        """Return the performance with joints turned further, rotation vectors in rad, in their own frames."""
        rotation = np.array(self.pose.rotation)
        for name, vector in turns.items():
            k = self.pose.skeleton.index(name)
            rotation[:, k] = quaternion_multiply(rotation[:, k], quaternion_exp(vector))
        return given_out(replace(self.pose, rotation=rotation), self.steps)

    def scaled(self, changes: dict[str, float]) -> Subject:
        """Return the performance by a body with bones of other lengths."""
        offset = self.pose.skeleton.rest_offset.copy()
        for name, factor in changes.items():
            offset[self.pose.skeleton.index(name)] *= factor
        skeleton = self.pose.skeleton.with_offsets(offset)
        return given_out(replace(self.pose, skeleton=skeleton), self.steps)


Spoil = Callable[[Performance, float], Subject]


@dataclass(frozen=True)
class Defect:
    """A defect of a given size."""

    name: str
    spoil: Spoil
    size: float  # that must be found
    bound: float  # the smallest size found must be at most this
    checks: tuple[str, ...]  # of which one finds it


def below(joint: str) -> list[str]:
    """Return a joint and all points that hang on it."""
    ours = default_skeleton()
    return [name for k, name in enumerate(ours.points) if joint == "pelvis" or ours.path[k, ours.index(joint)]]


def shift(subject: Subject, names: Sequence[str], by: Any, frames: Any = slice(None)) -> Subject:
    """Return a subject with some points moved by `by`, (3,) or (T, 3) m."""
    position = subject.position.copy()
    by = np.broadcast_to(by, (len(subject), 3))[frames, None]
    columns = subject.columns([name for name in names if name in subject.points])
    position[np.ix_(np.arange(len(subject))[frames], columns)] += by
    return replace(subject, position=position)


def _stands(subject: Subject) -> np.ndarray:
    """Return the frames (T,) in which no step of the script moves the feet."""
    return ~subject.within("march", "left_leg_raise", "right_leg_raise", "other")


def reorder_frames(subject: Subject, frames: np.ndarray) -> Subject:
    """Return a subject with the poses of frames `frames` (T,) at its own times."""
    return replace(subject, position=subject.position[frames], rotation=subject.rotation[frames])


def kept(subject: Subject, frames: np.ndarray) -> Subject:
    """Return some frames of a subject, with their times."""

    def cut(part: Any, *names: str) -> dict[str, np.ndarray | None]:
        values = {name: getattr(part, name) for name in names}
        return {name: None if value is None else value[frames] for name, value in values.items()}

    clocks = cut(subject.transport, "log_time", "available", "device_time", "all_tracked", "all_valid")
    rows = cut(subject, "time", "position", "rotation", "valid", "measured")
    return replace(subject, **rows, transport=replace(subject.transport, **clocks))


def _lost(subject: Subject, share: float) -> Subject:
    here = np.random.default_rng(1).random(len(subject)) >= share
    here[[0, -1]] = True
    return kept(subject, np.flatnonzero(here))


def _lost_without_times(subject: Subject, share: float) -> Subject:
    rest = _lost(subject, share)
    time = np.arange(len(rest)) * subject.interval
    return replace(rest, time=time, steps=(), transport=replace(rest.transport, available=time, log_time=None))


def _twice(subject: Subject, share: float) -> Subject:
    frames = np.arange(len(subject))
    again = np.flatnonzero(np.random.default_rng(0).random(len(frames) // 2) < share)
    frames[2 * again + 1] = frames[2 * again]
    return reorder_frames(subject, frames)


def _frozen(subject: Subject, start: np.ndarray, frozen: np.ndarray) -> Subject:
    return reorder_frames(subject, np.where(frozen, np.searchsorted(subject.time, start), np.arange(len(subject))))


def _available(subject: Subject, delay: np.ndarray | float) -> Subject:
    return replace(subject, transport=replace(subject.transport, available=subject.time + delay))


def _late(subject: Subject, ms: float) -> Subject:
    columns = subject.position.reshape(len(subject), -1).T
    late = np.stack([np.interp(subject.time - ms / 1000, subject.time, column) for column in columns], axis=1)
    return replace(
        subject, position=late.reshape(subject.position.shape), reference=subject, rotated=0 * subject.rotated
    )


def _shin(subject: Subject, percent: float) -> Subject:
    longer = percent / 100 * (np.arange(len(subject)) % 2)[:, None]
    return shift(
        subject, below("left_ankle"), np.nan_to_num(longer * (subject.at("left_ankle") - subject.at("left_knee")))
    )


def _neck(subject: Subject, cm: float) -> Subject:
    bone = subject.at("head") - subject.at("neck")
    return shift(subject, below("head"), np.nan_to_num(cm / 100 * bone / np.linalg.norm(bone, axis=-1, keepdims=True)))


def _pelvis(performance: Performance, degrees: float) -> Subject:
    """Turn the pelvis; its children keep their world rotations."""
    turn, rotation = quaternion_exp(about(y=degrees)), np.array(performance.pose.rotation)
    rotation[:, 0] = quaternion_multiply(rotation[:, 0], turn)
    for name in ("left_hip", "right_hip", "spine1"):
        k = performance.pose.skeleton.index(name)
        rotation[:, k] = quaternion_multiply(quaternion_conjugate(turn), rotation[:, k])
    return given_out(replace(performance.pose, rotation=rotation), performance.steps)


def _noise(subject: Subject, mm: float, joint: str) -> Subject:
    return shift(subject, below(joint), np.random.default_rng(1).normal(0, mm / 1000, (len(subject), 3)))


def _glide(subject: Subject, cm: float) -> Subject:
    """Move feet and knees away and back twice within four seconds of standing."""
    there = cm / 200 * (1 - np.cos(np.pi * np.clip(subject.time - 3, 0, 4)))
    return shift(subject, [*below("left_knee"), *below("right_knee")], np.outer(there, [0, 0, 1]))


def _each(part: str, vector: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{side}_{part}": vector for side in SIDES}


def _march(subject: Subject) -> float:
    return next(step.start for step in subject.steps if step.label == "march") + 3.0


NAMED = (
    Defect("lost frames (share)", lambda p, x: _lost(p.subject, x), 0.05, 0.03, ("time.lost",)),
    Defect(
        "lost frames without times (share)",
        lambda p, x: _lost_without_times(p.subject, x),
        0.05,
        0.04,
        ("motion.skips",),
    ),
    Defect("frames twice (share)", lambda p, x: _twice(p.subject, x), 1.0, 0.5, ("motion.repeats", "motion.skips")),
    Defect(
        "latency step (ms)",
        lambda p, x: _available(p.subject, 0.02 + x / 1000 * (p.subject.time > 30)),
        100,
        60,
        ("time.latency_change",),
    ),
    Defect("late messages (ms)", lambda p, x: _available(p.subject, x / 1000), 100, 95, ("time.latency",)),
    Defect("late content (ms)", lambda p, x: _late(p.subject, x), 100, 65, ("time.lag",)),
    Defect(
        "drift (cm/s)",
        lambda p, x: shift(p.subject, p.subject.points, np.outer(p.subject.time, [x / 100, 0, 0])),
        1.0,
        0.8,
        ("motion.drift",),
    ),
    Defect(
        "freeze each second (s)",
        lambda p, x: _frozen(p.subject, np.floor(p.subject.time), p.subject.time % 1 < x),
        0.2,
        0.2,
        ("motion.stall", "motion.stalls"),
    ),
    Defect(
        "freeze in a march (s)",
        lambda p, x: _frozen(
            p.subject,
            _march(p.subject) + 0 * p.subject.time,
            np.abs(p.subject.time - _march(p.subject) - x / 2) <= x / 2,
        ),
        2.0,
        0.4,
        ("motion.stall",),
    ),
    Defect("longer shin in every other frame (%)", lambda p, x: _shin(p.subject, x), 3.0, 1.5, ("shape.flicker",)),
    Defect("knees backward (°)", lambda p, x: p.turned(_each("knee", about(x=-x))), 20, 12, ("joints.knees_forward",)),
    Defect(
        "soles under a known floor (cm)",
        lambda p, x: shift(p.subject, p.subject.points, [0, -x / 100, 0]),
        4.0,
        3.2,
        ("floor.sunk",),
    ),
    Defect("twisted wrist (°)", lambda p, x: p.turned({"left_wrist": about(x=x)}), 120, 120, ("joints.wrist_twist",)),
    Defect("twisted foot (°)", lambda p, x: p.turned({"left_ankle": about(y=x)}), 120, 100, ("joints.foot_twist",)),
    Defect("turned head (°)", lambda p, x: p.turned({"head": about(y=x)}), 120, 100, ("joints.head_turn",)),
    Defect("turned pelvis (°)", _pelvis, 180, 120, ("joints.trunk_twist", "axes.left_right")),
    Defect("longer neck (cm)", lambda p, x: _neck(p.subject, x), 30, 15, ("shape.human",)),
    Defect("tremor of a wrist (mm)", lambda p, x: _noise(p.subject, x, "left_wrist"), 5, 5, ("motion.tremor",)),
    Defect("tremor of the body (mm)", lambda p, x: _noise(p.subject, x, "pelvis"), 5, 5, ("motion.tremor",)),
    Defect("gliding feet (cm)", lambda p, x: _glide(p.subject, x), 10, 10, ("floor.glide",)),
    *(
        Defect(
            f"spike of a wrist over {frames} frames (cm)",
            lambda p, x, frames=frames: shift(
                p.subject, below("left_wrist"), [0, 0, x / 100], slice(100, 100 + frames)
            ),
            30,
            28,
            ("motion.spike",),
        )
        for frames in (1, 2, 3)
    ),
)
"""Defects whose smallest size is searched."""


def _rotated(subject: Subject, change: Callable[[np.ndarray], np.ndarray]) -> Subject:
    return replace(subject, rotation=change(subject.rotation))


def _timed(subject: Subject, time: np.ndarray) -> Subject:
    """Return the frames at other times; all clocks follow."""
    clocks = replace(subject.transport, log_time=time + 0.02, available=time + 0.02, device_time=time + 7)
    return replace(subject, time=time, steps=(), transport=clocks)


def _swapped(subject: Subject, one: str, other: str) -> Subject:
    """Swap the names of two parts of the body and of their descendants."""
    columns, others = (subject.columns([n for n in subject.points if n in below(part)]) for part in (one, other))
    position, rotation = subject.position.copy(), subject.rotation.copy()
    position[:, [*columns, *others]] = subject.position[:, [*others, *columns]]
    rotation[:, [*columns, *others]] = subject.rotation[:, [*others, *columns]]
    return replace(subject, position=position, rotation=rotation)


def _steps(performance: Performance, label: str, turns: dict[str, np.ndarray]) -> Subject:
    """Hold joints at angles during a step; the pelvis keeps its position."""
    rotation, subject = np.array(performance.pose.rotation), performance.subject
    for step in subject.labelled(label):
        for name, vector in turns.items():
            rotation[subject.during(step), performance.pose.skeleton.index(name)] = quaternion_exp(vector)
    return given_out(replace(performance.pose, rotation=rotation), performance.steps)


def _at(subject: Subject, *frames: int) -> np.ndarray:
    return np.isin(np.arange(len(subject)), frames)


OTHERS: dict[str, Callable[[Performance], Subject]] = {
    "time.finite": lambda p: replace(p.subject, time=np.where(_at(p.subject, 100), np.nan, p.subject.time)),
    "time.increases": lambda p: replace(p.subject, time=p.subject.time - 0.2 * _at(p.subject, 100)),
    "time.unit": lambda p: _timed(p.subject, 1000 * p.subject.time),
    "time.rate": lambda p: _timed(p.subject, 3 * p.subject.time),
    "time.regular": lambda p: _timed(p.subject, p.subject.time + 0.015 * (np.arange(len(p.subject)) % 2)),
    "time.gap": lambda p: kept(p.subject, np.flatnonzero((p.subject.time < 3) | (p.subject.time > 3.5))),
    "time.early": lambda p: _available(p.subject, -0.001),
    "time.clock_drift": lambda p: replace(
        p.subject, transport=replace(p.subject.transport, device_time=1.001 * p.subject.time)
    ),
    "stream.malformed": lambda p: replace(p.subject, transport=replace(p.subject.transport, malformed=1)),
    "stream.lost": lambda p: replace(p.subject, transport=replace(p.subject.transport, lost=30)),
    "data.finite": lambda p: replace(
        p.subject, position=np.where(p.subject.position < -0.3, np.nan, p.subject.position)
    ),
    "data.present": lambda p: replace(p.subject, valid=p.subject.valid & (p.subject.time % 1 < 0.9)[:, None]),
    "data.joints": lambda p: replace(
        p.subject, valid=p.subject.valid & np.array([name != "left_knee" for name in p.subject.points])
    ),
    "data.zeros": lambda p: replace(
        p.subject, position=p.subject.position * (np.arange(len(p.subject.points)) % 9 > 0)[:, None]
    ),
    "data.unit_quaternions": lambda p: _rotated(p.subject, lambda turn: 1.01 * turn),
    "size.height": lambda p: replace(p.subject, position=100 * p.subject.position),
    "axes.up": lambda p: replace(
        p.subject,
        position=quaternion_rotate(quaternion_exp(about(x=90)), p.subject.position),
        rotation=quaternion_multiply(quaternion_exp(about(x=90)), p.subject.rotation),
    ),
    "axes.order": lambda p: _rotated(p.subject, lambda turn: np.roll(turn, -1, axis=-1)),
    "axes.inverse": lambda p: _rotated(p.subject, quaternion_conjugate),
    "axes.handedness": lambda p: replace(
        p.subject, position=p.subject.position * [-1.0, 1, 1], rotation=p.subject.rotation * [1.0, 1, -1, -1]
    ),
    "axes.mismatch": lambda p: _rotated(
        p.subject,
        lambda turn: quaternion_multiply(
            turn,
            quaternion_exp(0.5 * np.sin(0.05 * np.arange(len(turn)))[:, None, None] * np.ones((1, turn.shape[1], 3))),
        ),
    ),
    "shape.bones": lambda p: shift(p.subject, below("left_wrist"), np.outer(0.03 * np.sin(p.subject.time), [1, 0, 0])),
    "shape.symmetry": lambda p: p.scaled({"left_wrist": 1.2}),
    "shape.human": lambda p: p.scaled({f"{side}_{part}": 1.8 for side in SIDES for part in ("collar", "shoulder")}),
    "joints.knees": lambda p: p.turned({"left_knee": about(y=120)}),
    "joints.spine": lambda p: p.turned({"spine2": about(y=120)}),
    "joints.shoulders": lambda p: p.turned({"left_shoulder": about(x=-143, y=-86)}),
    "joints.elbows": lambda p: p.turned({"left_elbow": about(x=165)}),
    "joints.wrists": lambda p: p.turned({"left_wrist": about(z=170)}),
    "joints.pelvis_turn": lambda p: replace(
        p.subject,
        rotation=np.where(
            (np.arange(len(p.subject.points)) == 0)[:, None],
            quaternion_multiply(p.subject.rotation, quaternion_exp(about(y=70))),
            p.subject.rotation,
        ),
    ),
    "motion.teleport": lambda p: shift(p.subject, p.subject.points, [0.7, 0, 0], p.subject.time > 5),
    "motion.flip": lambda p: replace(
        p.subject,
        rotation=np.where(
            (p.subject.time > 5)[:, None, None],
            quaternion_multiply(quaternion_exp(about(y=179)), p.subject.rotation),
            p.subject.rotation,
        ),
    ),
    "motion.rotation_tremor": lambda p: _rotated(
        p.subject,
        lambda turn: quaternion_multiply(
            turn, quaternion_exp(np.random.default_rng(1).normal(0, 0.06, (*turn.shape[:-1], 3)))
        ),
    ),
    "motion.alive": lambda p: reorder_frames(p.subject, 0 * np.arange(len(p.subject))),
    "floor.level": lambda p: shift(p.subject, p.subject.points, [0, 0.2, 0]),
    "floor.hover": lambda p: shift(
        p.subject,
        p.subject.points,
        np.outer(0.5 * np.clip(np.minimum(p.subject.time - 2, 8 - p.subject.time), 0, 1), [0, 1, 0]),
    ),
    "floor.idle_steps": lambda p: shift(
        p.subject,
        below("left_ankle"),
        np.outer(_stands(p.subject) * 0.05 * np.sin(4 * np.pi * p.subject.time), [1, 0, 0]),
    ),
    "tracking.loss": lambda p: shift(p.subject, below("left_wrist"), [0, 0, 0.2], slice(130, 140)),
    "tracking.return": lambda p: shift(p.subject, below("left_wrist"), [0, 0, 0.2], slice(140, 150)),
    "tracking.same_body": lambda p: shift(
        p.subject,
        below("left_wrist"),
        np.nan_to_num(0.1 * (p.subject.at("left_wrist") - p.subject.at("left_elbow"))) * (p.subject.time > 55)[:, None],
    ),
    "hands.joints": lambda p: replace(
        p.subject, valid=p.subject.valid & np.array([name != "left_ring2" for name in p.subject.points])
    ),
    "hands.order": lambda p: _swapped(p.subject, "left_index1", "left_ring1"),
    "hands.size": lambda p: p.scaled({name: 2.0 for name in p.subject.points if is_finger(name)}),
    "joints.knees_fold": lambda p: _steps(p, "left_leg_raise", {"left_hip": about(-60), "left_knee": about(-60)}),
    "data.flag": lambda p: replace(
        p.subject, transport=replace(p.subject.transport, all_valid=np.zeros(len(p.subject), dtype=bool))
    ),
    "motion.repeats": lambda p: _twice(p.subject, 0.9),
    "stand.knees": lambda p: _steps(p, "stand", {"left_hip": about(-35), "left_knee": about(35)}),
    "squat.symmetry": lambda p: _steps(p, "squat", {"left_hip": about(-5), "left_knee": about(5)}),
    "march.lifts": lambda p: _steps(
        p, "march", {f"{side}_{part}": about() for side in SIDES for part in ("hip", "knee")}
    ),
    "fist.closed": lambda p: _steps(p, "fist", {name: about() for name in p.pose.skeleton.joints if is_finger(name)}),
    "pinch.index_not_another": lambda p: replace(
        p.subject,
        steps=tuple(
            replace(s, label={"pinch_index": "pinch_ring", "pinch_ring": "pinch_index"}.get(s.label, s.label))
            for s in p.subject.steps
        ),
    ),
}
"""One defect for each check that the named defects do not cover; the check of that name must find it."""
