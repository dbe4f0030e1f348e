"""All checks, in the order in which they are put: what others depend on comes before them."""

from __future__ import annotations

from bodysense_conform.check import Check
from bodysense_conform.checks import (
    anatomy,
    data,
    exercises,
    frames,
    ground,
    hands,
    limits,
    motion,
    poses,
    still,
    timing,
    tracking,
)

TABLE: tuple[Check, ...] = (
    *timing.CHECKS,
    *data.CHECKS,
    *anatomy.CHECKS,
    *frames.CHECKS,
    *limits.CHECKS,
    *motion.CHECKS,
    *still.CHECKS,
    *ground.CHECKS,
    *tracking.CHECKS,
    *poses.CHECKS,
    *exercises.CHECKS,
    *hands.CHECKS,
)
