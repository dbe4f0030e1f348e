"""Findings in words, the same in all reports.

A verdict as JUnit XML, which continuous integration shows: a suite a group, a case a check.

A verdict as plain data: what every report says, with the hashes and versions that make it repeatable.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from bodysense.files import written_beside
from bodysense_conform.check import Check, Finding
from bodysense_conform.checks import TABLE
from bodysense_conform.verdict import GROUPS, Verdict


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


_FORBIDDEN = re.compile(r"[^\t\n\r -퟿-�𐀀-􏿿]")  # characters that no XML may hold


def write_junit(path: Path, verdict: Verdict) -> None:
    """Write a verdict; the file appears whole or not at all."""
    root = ElementTree.Element("testsuites", name=_clean(verdict.subject.name))
    for group in GROUPS:
        found = [one for one in verdict.findings if one.check.group == group]
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=group,
            tests=str(len(found)),
            failures=str(sum(one.outcome in ("fail", "retake") for one in found)),
            skipped=str(sum(one.outcome == "not enough" for one in found)),
            errors="0",
        )
        for one in found:
            _case(suite, one)
    ElementTree.indent(root)
    with written_beside(path) as beside:
        ElementTree.ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)


def _case(suite: ElementTree.Element, finding: Finding) -> None:
    check = finding.check
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"conform.{check.group}", name=check.id.partition(".")[2]
    )
    if finding.outcome in ("fail", "retake"):
        blamed = "device" if finding.outcome == "fail" else "performer"
        ElementTree.SubElement(case, "failure", type=blamed, message=_clean(sentence(finding)))
    elif finding.outcome == "not enough":
        ElementTree.SubElement(case, "skipped", message=_clean(finding.reason))
    else:
        ElementTree.SubElement(case, "system-out").text = _clean(f"{figure(finding)} (limit {check.limit})")


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("�", text)


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
