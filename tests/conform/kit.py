"""Ways to spoil a faultless performance, one at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import BODY
from bodysense_conform.subject import Step, Subject

from .conftest import given_out, planted


@dataclass(frozen=True)
class Kit:
    """The performance and ways to spoil it."""

    clean: Subject
    pose: Pose
    steps: list[Step]

    def during(self, label: str, share: float = 1.0) -> np.ndarray:
        return np.any([self.clean.during(step, share) for step in self.clean.labelled(label)], axis=0)

    def columns(self, *names: str) -> np.ndarray:
        return np.array([self.clean.points.index(name) for name in names], dtype=np.int64)

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

    def set(self, angles: dict[str, np.ndarray], label: str, plant: bool = True, ramp: float = 0.2) -> Subject:
        """Joints turned so and no further while a step lasts, blended at its ends."""
        inside = self.during(label)
        rotation = self.pose.rotation.copy()
        count = int(inside.sum())
        share = np.clip(np.minimum(np.arange(count), np.arange(count)[::-1]) / (ramp * count), 0, 1)[:, None]
        for name, vector in angles.items():
            k = self.pose.skeleton.index(name)
            old = rotation[inside, k]
            new = np.broadcast_to(quaternion_exp(vector), old.shape)
            mixed = (1 - share) * old + share * new
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
        body = [name in BODY for name in self.clean.points]
        transport = replace(self.clean.transport, all_tracked=valid[:, body].all(axis=1))
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
