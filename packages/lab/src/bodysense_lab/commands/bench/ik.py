"""`bodysense bench ik`: inverse kinematics of the whole body."""

from __future__ import annotations

import numpy as np

from bodysense.ranges import Count
from bodysense_lab.commands.bench.timing import percentiles, report
from bodysense_lab.core.options import Json


def ik(frames: Count = 3000, noise: float = 0.0, json: Json = None) -> None:
    """Time inverse kinematics of the whole body frame by frame, starting from the previous frame.

    Args:
        frames: number of frames, after 100 to warm up.
        noise: standard deviation in metres of noise on every target.
    """
    from bodysense.body.pose import forward_kinematics
    from bodysense.demo import packaged_performance
    from bodysense_lab.papers.ik.ik import InverseKinematics

    clip = packaged_performance()
    target = np.asarray(forward_kinematics(clip.pose)[0])
    target = target + np.random.default_rng(0).normal(scale=noise, size=target.shape) if noise else target
    solver, state = InverseKinematics(clip.pose.skeleton), None

    def one(frame: int) -> None:
        nonlocal state
        place = frame % len(clip)
        _, state = solver.solve(target[place], state=None if place == 0 else state)

    report("ik", percentiles(one, frames), json)
