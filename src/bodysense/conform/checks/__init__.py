"""All checks, in the order in which they are put: what others depend on comes before them."""

from __future__ import annotations

from bodysense.conform.check import Check
from bodysense.conform.checks import anatomy, data, hands, limits, motion, poses, tracking

TABLE: tuple[Check, ...] = (
    *data.CHECKS,
    *anatomy.CHECKS,
    *limits.CHECKS,
    *motion.CHECKS,
    *tracking.CHECKS,
    *poses.CHECKS,
    *hands.CHECKS,
)
