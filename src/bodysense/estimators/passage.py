"""From one way of completing a body to another without a jump.

What is shown starts where it was and settles on the new answer, critically damped, from rest: no point goes faster than
a stated speed because of it. Head and hands that are measured are where they are measured all the while.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.products import CONJUGATE, exp, log, multiply, world_rotation
from bodysense.body.skeleton import BODY
from bodysense.body.spring import spring_step
from bodysense.errors import BodysenseError
from bodysense.estimators.whole_body import WholeBody

_HEAD = BODY.index("head")
_PEAK = 0.617  # half-life times the greatest speed, over the distance
_TRIES = 4
_NEAR = 2e-4  # m and rad: what is left of a passage when it is over


@dataclass(frozen=True)
class PassageSettings:
    """How fast a passage is."""

    fastest: float = 2.0  # m/s that a point moves because of it
    half_life: float = 0.06  # s in which half of the way is made, at least

    def __post_init__(self) -> None:
        for name in ("fastest", "half_life"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"passage settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class Passage:
    """What is left of the way, in rows of m or rad: head, wrists and ankles, turns in the world, those of fingers."""

    offset: np.ndarray  # (5 + 22 + F, 3)
    velocity: np.ndarray  # the same, per s
    half_life: float  # s


def begun(
    body: WholeBody, shown: Pose, pose: Pose, moved: np.ndarray, turned: np.ndarray, settings: PassageSettings
) -> Passage:
    """The passage from the pose that was shown to another one, both without batch axes.

    Args:
        body: Of whom.
        shown: In the frame before.
        pose: That is to be shown.
        moved: (3, 3) m: how far head and hands went meanwhile, as it was measured; 0 where it was not.
        turned: (3,) bool: whose rotations are measured and do not pass.
        settings: How fast.
    """
    old, new = _Parts.of(body, shown), _Parts.of(body, pose)
    turn = multiply(old.turn, new.turn * CONJUGATE)
    turn[[_HEAD, *body.wrists]] = np.where(turned[:, None], [1.0, 0, 0, 0], turn[[_HEAD, *body.wrists]])
    ends = old.ends - new.ends
    ends[:3] += moved
    offset = np.concatenate([ends, log(turn), log(multiply(old.finger, new.finger * CONJUGATE))])
    far = float(np.linalg.norm(old.position - new.position, axis=1).max())
    half_life = max(settings.half_life, _PEAK * far / settings.fastest)
    return Passage(offset, np.zeros_like(offset), half_life)


def passed(
    body: WholeBody, pose: Pose, interval: float, settings: PassageSettings, passage: Passage
) -> tuple[Pose, np.ndarray, Passage | None]:
    """What is shown `interval` s later instead of `pose`, its points (P, 3) m, and what is left; None: nothing."""
    parts = _Parts.of(body, pose)
    _, before = _shown(body, pose, parts, passage.offset)

    def after(share: float) -> tuple[np.ndarray, np.ndarray, Pose, np.ndarray, float]:
        offset, velocity = spring_step(passage.offset, passage.velocity, passage.half_life, share * interval)
        shown, position = _shown(body, pose, parts, offset)
        step = float(np.linalg.norm(position - before, axis=1).max())
        return offset, velocity, shown, position, step / (settings.fastest * interval)

    share = 1.0
    offset, velocity, shown, position, haste = after(share)
    for _ in range(_TRIES):  # limbs that are nearly straight bend fast: then it takes a little longer
        if haste > 1:
            share *= 0.9 / haste
            offset, velocity, shown, position, haste = after(share)
    if np.abs(offset).max() < _NEAR:
        return pose, parts.position, None
    return shown, position, Passage(offset, velocity, passage.half_life)


def _shown(body: WholeBody, pose: Pose, parts: _Parts, offset: np.ndarray) -> tuple[Pose, np.ndarray]:
    """A pose so far off, and its points (P, 3) m."""
    joints = len(BODY)
    ends = parts.ends + offset[:5]
    turn = multiply(exp(offset[5 : 5 + joints]), parts.turn)
    place = body.placed_joints(turn)
    place += ends[0] - place[_HEAD]
    body.reach(place, turn, ends[1:])
    _, world = body.placed(place[0], turn)
    local = body.local(world)
    finger = multiply(exp(offset[5 + joints :]), parts.finger)
    local[body.fingers] = finger * np.copysign(1.0, finger[:, :1])
    shown = Pose(pose.skeleton, place[0], local)
    return shown, np.asarray(forward_kinematics(shown)[0])


@dataclass(frozen=True, eq=False)
class _Parts:
    """A pose as a passage sees it."""

    ends: np.ndarray  # (5, 3) m: head, wrists, ankles
    turn: np.ndarray  # (22, 4) world ← joint
    finger: np.ndarray  # (F, 4) parent ← joint
    position: np.ndarray  # (P, 3) m

    @staticmethod
    def of(body: WholeBody, pose: Pose) -> _Parts:
        local = np.asarray(pose.rotation)
        position = np.asarray(forward_kinematics(pose)[0])
        world = world_rotation(pose.skeleton, local)[body.joints]
        place = position[body.joints]
        ends = place[[_HEAD, *body.limbs[2]]]
        return _Parts(ends, world, local[body.fingers], position)
