"""A verdict as plain data: what every report says, with the hashes and versions that make it repeatable."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.conform.check import Check, Finding
from bodysense.conform.checks import TABLE
from bodysense.conform.verdict import Verdict
from bodysense.files import written_beside

FORMAT = "bodysense conform 1"


def record(verdict: Verdict) -> dict[str, Any]:
    """The verdict as JSON has it: finite numbers, or null with the reason beside."""
    subject = verdict.subject
    return {
        "format": FORMAT,
        "judgement": verdict.judgement,
        "input": {
            "name": subject.name,
            "format": subject.format,
            "sha256": subject.sha256,
            "frames": len(subject),
            "seconds": _number(subject.seconds),
            "rate": _number(1 / subject.interval if subject.interval > 0 else math.nan),
            "points": list(subject.points),
            "floor": subject.floor,
            "script": [{"label": step.label, "start": step.start, "end": step.end} for step in subject.steps],
        },
        "versions": versions(),
        "counts": {
            outcome: len(verdict.of(outcome)) for outcome in ("pass", "fail", "retake", "measured", "not enough")
        },
        "findings": [_row(finding) for finding in verdict.findings],
    }


def write_json(path: Path, verdict: Verdict) -> None:
    """Write the record of a verdict; the file appears whole or not at all."""
    with written_beside(path) as beside:
        beside.write_text(json.dumps(record(verdict), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def versions() -> dict[str, str]:
    """What judged: the package, its table of checks, and what it ran on."""
    from bodysense import __version__

    return {
        "bodysense": __version__,
        "checks": checks_hash(TABLE),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def checks_hash(checks: Sequence[Check]) -> str:
    """SHA-256 of the checks and their limits: two reports with the same hash asked the same questions."""
    rows = [(c.id, c.unit, c.most, c.least, c.blame, c.required, c.after) for c in checks]
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()


def _row(finding: Finding) -> dict[str, Any]:
    check = finding.check
    return {
        "id": check.id,
        "outcome": finding.outcome,
        "value": _number(finding.value),
        "unit": check.unit,
        "limit": check.limit,
        "where": finding.where,
        "frame": finding.frame,
        "why": check.why,
        "reason": finding.reason,
    }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), 6)
