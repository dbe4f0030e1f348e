"""Joining of two estimates of a recording: the forward pass knows only the past, the backward pass only the future.

Each pass jumps when a hidden point is seen again. The hidden frames before are turned so that they lead to the new
pose. Then local rotations of both passes are averaged, which keeps bone lengths.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bodysense.body.skeleton import ARM, BODY, LEG, Skeleton, default_skeleton
from bodysense.geometry.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    smooth_step,
)
from bodysense.geometry.series import smoothed

Array = np.ndarray
LEAD = 0.25  # s before a point is seen again in which the pose turns toward it; 0.1 and 0.5 are within 1 %
LEAD_PER_TURN = 0.5  # additional s for each radian of the turn
FASTEST_TURN = 9.0  # rad/s; maximum speed of a joint when it is seen again
# Share of the backward pass if both are equally certain, weight of certainty, and s over which expected errors are
# averaged. Chosen on 24 validation clips.
BACKWARD_SHARE, SURENESS, STEADY = 1 / 2, 2.0, 0.33


@lru_cache(maxsize=1)
def groups() -> dict[str, tuple[int, ...]]:
    """Return the points of the body by groups that move together: trunk, arms, legs, fingers of each hand."""
    found: dict[str, list[int]] = {}
    for point, name in enumerate(default_skeleton().points):
        side, _, part = name.partition("_")
        if side not in ("left", "right"):
            group = "trunk"
        else:
            group = f"{side}_{'arm' if part in ARM else 'leg' if part in LEG else 'fingers'}"
        found.setdefault(group, []).append(point)
    return {group: tuple(points) for group, points in found.items()}


def joints_of_group(group: str) -> list[int]:
    """Return the joints that turn if points of a group are seen again: all for the trunk, else those of the group."""
    count = len(default_skeleton().joints)
    if group == "trunk":
        return list(range(count))
    return [point for point in groups()[group] if point < count]


def lead_to_returns(rotation: Array, head: Array, seen: Array, seconds: float) -> tuple[Array, Array]:
    """Turn the hidden frames of a pass so that they lead to points that are seen again.

    Args:
        rotation: (T, J, 4) local rotations, in the order in which the pass ran.
        head: (T, 3) m, positions of the head.
        seen: (T, P) bool: points that are tracked.
        seconds: time between frames.

    Returns:
        New local rotations and positions of the head.
    """
    rotation, head = rotation.copy(), head.copy()
    top = default_skeleton().index("head")
    for group, points in groups().items():
        joints = joints_of_group(group)
        returns = seen[1:, points] & ~seen[:-1, points]
        for frame in (1 + np.flatnonzero(returns.any(axis=1))).tolist():
            came = np.flatnonzero(returns[frame - 1])
            around = rotation[max(frame - 2, 0) : frame + 2, joints]
            turn = _jump(around, min(frame, 2), FASTEST_TURN * seconds)
            wanted = max(LEAD, LEAD_PER_TURN * float(np.linalg.norm(turn, axis=-1).max())) / seconds
            # How long all of these points were hidden before.
            visible = np.asarray(seen[max(frame - max(1, round(wanted)), 0) : frame, points][:, came].any(axis=1))[::-1]
            count = int(visible.argmax()) if visible.any() else len(visible)
            share = smooth_step(np.arange(1, count + 1) / count)
            span = slice(frame - count, frame)
            more = quaternion_exp(share[:, None, None] * turn)
            rotation[span, joints] = quaternion_multiply(rotation[span, joints], more)
            if group == "trunk" and top in (points[k] for k in came):
                head[span] += share[:, None] * (head[frame] - head[frame - 1])
    return rotation, head


def _jump(rotation: Array, frame: int, most: float) -> Array:
    """Return rotation vectors (J, 3) of the jump into `frame` of local rotations (≤ 4, J, 4).

    The jump is the step into the frame minus the mean step of its neighbours, which is at most `most` rad.
    """
    steps = np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(rotation[:-1]), rotation[1:])))
    beside = np.delete(steps, frame - 1, axis=0)
    speed = beside.sum(axis=0) / 2
    size = np.linalg.norm(speed, axis=-1, keepdims=True)
    return steps[frame - 1] - speed * np.minimum(1.0, most / np.maximum(size, 1e-9))


def future_share(past: Array, future: Array, seconds: float) -> Array:
    """Return the weight (T,) of the backward pass in the mean, from the expected errors (T, P) m of both passes.

    It changes slowly. All joints share one weight, so that the body stays coherent.
    """
    body = default_skeleton().indices(BODY)
    ratio = np.log(past[:, body].mean(axis=1) / future[:, body].mean(axis=1))
    odds = BACKWARD_SHARE / (1 - BACKWARD_SHARE) * np.exp(SURENESS * smoothed(ratio, STEADY / seconds))
    return odds / (1 + odds)


def keep_tracked_rotations(skeleton: Skeleton, rotation: Array, world: Array, turned: Array) -> Array:
    """Return local rotations (T, J, 4) in which `turned` (T, J) joints have their `world` (T, J, 4) rotation."""
    rotation, placed = rotation.copy(), np.zeros_like(rotation)
    above: set[int] = set()  # turned joints and the joints that carry them
    for turning in np.flatnonzero(turned.any(axis=0)).tolist():
        joint = turning
        while joint >= 0 and joint not in above:
            above.add(joint)
            joint = skeleton.parents[joint]
    for level, _ in skeleton.levels:
        joints = [joint for joint in level.tolist() if joint in above]
        if not joints:
            continue
        parents, kept, own = [skeleton.parents[joint] for joint in joints], turned[:, joints, None], world[:, joints]
        if parents == [-1]:
            rotation[:, joints] = placed[:, joints] = np.where(kept, own, rotation[:, joints])
            continue
        own = quaternion_multiply(quaternion_conjugate(placed[:, parents]), own)
        local = rotation[:, joints] = np.where(kept, own, rotation[:, joints])
        placed[:, joints] = quaternion_multiply(placed[:, parents], local)
    return rotation
