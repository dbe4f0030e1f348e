"""Verdict as sentences and as JSON."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from bodysense import __version__
from bodysense.files import written_beside
from bodysense_conform.evaluate import OUTCOMES, Finding, Verdict
from bodysense_conform.table import CheckTable, table

FORMAT = "bodysense conform 2"


def figure(finding: Finding) -> str:
    """Return the value with its unit."""
    if finding.value is None:
        return "–"
    value = finding.value
    digits = "0" if abs(value) < 5e-5 else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return finding.check.with_unit(digits)


def sentence(finding: Finding) -> str:
    """Return one line: the value, where it is, and the limit."""
    if finding.outcome == "not enough":
        return finding.reason
    where = f" ({finding.where})" if finding.where else ""
    frame = f" at frame {finding.frame}" if finding.frame is not None else ""
    return f"{figure(finding)}{where}{frame}; limit {finding.check.limit}. {finding.check.why}"


def shortened(ids: Sequence[str]) -> list[str]:
    """Return ids of checks; a group that is complete is replaced by its name."""
    found: list[str] = []
    for group, members in groupby(ids, lambda name: name.partition(".")[0]):
        mine = list(members)
        whole = len(mine) == sum(check.group == group for check in table().checks)
        found += [group] if whole else mine
    return found


def versions(checks: CheckTable) -> dict[str, str]:
    """Return versions of the package, the table of checks and the platform."""
    return {
        "bodysense": __version__,
        "checks": checks.sha256,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def record(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict for JSON: finite numbers, or null with the reason."""
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
        "versions": versions(verdict.table),
        "counts": {outcome: len(verdict.of(outcome)) for outcome in OUTCOMES},
        "unanswered": verdict.unanswered,
        "findings": [
            {
                "id": one.check.id,
                "outcome": one.outcome,
                "value": _number(one.value),
                "unit": one.check.unit,
                "limit": one.check.limit,
                "where": one.where,
                "frame": one.frame,
                "why": one.check.why,
                "reason": one.reason,
            }
            for one in verdict.findings
        ],
    }


def as_json(document: Any) -> str:
    """Return a document as the text of a JSON file."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def write(path: Path | None, text: Callable[[], str]) -> None:
    """Write a report to a path, if there is one, and print so; the file appears whole or not at all."""
    if path is not None:
        with written_beside(path) as beside:
            beside.write_text(text(), encoding="utf-8")
        print(f"wrote {path}")


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), 6)
