"""Findings in words, the same in all reports."""

from __future__ import annotations

import math

from bodysense.conform.check import Finding


def figure(finding: Finding) -> str:
    """The value with its unit."""
    if finding.value is None:
        return "–"
    value = _short(finding.value) if math.isfinite(finding.value) else "not a number"
    unit = finding.check.unit
    return value + ("" if not unit else f"{unit}" if unit.startswith("°") else f" {unit}")


def _short(value: float) -> str:
    """Three digits; rounding errors are nothing."""
    return "0" if abs(value) < 5e-5 else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def sentence(finding: Finding) -> str:
    """One line: what was found, where, and what would have passed."""
    if finding.outcome == "not enough":
        return finding.reason
    where = f" ({finding.where})" if finding.where else ""
    frame = f" at frame {finding.frame}" if finding.frame is not None else ""
    return f"{figure(finding)}{where}{frame}; limit {finding.check.limit}. {finding.check.why}"
