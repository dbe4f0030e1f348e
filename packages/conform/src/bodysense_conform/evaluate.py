"""Evaluator: applies the table of checks to a subject and gives the verdict."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bodysense.geometry.gaps import runs
from bodysense_conform.expressions import columns
from bodysense_conform.series import NotEnough, need
from bodysense_conform.subject import Subject
from bodysense_conform.table import Check, CheckTable, table

Outcome = Literal["pass", "fail", "retake", "measured", "not enough"]
Judgement = Literal["pass", "fail", "retake", "not enough"]
OUTCOMES: tuple[Outcome, ...] = ("pass", "fail", "retake", "measured", "not enough")
EXIT_STATUS: dict[Judgement, int] = {"pass": 0, "fail": 1, "retake": 2, "not enough": 2}
_HELD = 0.6  # share of a step at its end in which a pose is held and judged


@dataclass(frozen=True)
class Finding:
    """Result of one check."""

    check: Check
    outcome: Outcome
    value: float | None = None
    where: str = ""  # joint, bone or side
    frame: int | None = None
    reason: str = ""  # why there is no answer


@dataclass(frozen=True, eq=False)
class Verdict:
    """All findings of a subject."""

    subject: Subject
    table: CheckTable
    findings: tuple[Finding, ...]

    def of(self, *outcomes: Outcome) -> list[Finding]:
        """Return the findings with one of these outcomes."""
        return [one for one in self.findings if one.outcome in outcomes]

    @property
    def judgement(self) -> Judgement:
        """Fail if the device failed a check; else retake if the performer did; else whether there was enough."""
        if self.of("fail"):
            return "fail"
        if self.of("retake"):
            return "retake"
        return "not enough" if any(one.check.required for one in self.of("not enough")) else "pass"

    @property
    def unanswered(self) -> dict[str, list[str]]:
        """Checks that could not be judged, by reason."""
        reasons: dict[str, list[str]] = {}
        for one in self.of("not enough"):
            reasons.setdefault(one.reason, []).append(one.check.id)
        return reasons


def judge(subject: Subject, checks: CheckTable | None = None) -> Verdict:
    """Apply all checks to a subject, in order. A group is skipped if a gate of it, or of a group it needs, fails."""
    checks = checks or table()
    findings: list[Finding] = []
    closed: dict[str, str] = {}  # group: the gate that failed
    for check in checks.checks:
        shut = [closed[group] for group in sorted(checks.before(check.group)) if group in closed]
        if shut:
            finding = Finding(check, "not enough", reason=f"{shut[0]} failed")
        else:
            finding = find(check, subject)
        findings.append(finding)
        if check.gate and finding.outcome in ("fail", "retake"):
            closed.setdefault(check.group, check.id)
    return Verdict(subject, checks, tuple(findings))


def find(check: Check, subject: Subject) -> Finding:
    """Apply one check to a subject: the statistic of its quantity in its window, the worst column and step."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)  # NumPy warns of NaN, which means unknown here
            found = max(_figures(check, subject), key=lambda one: _excess(check, one[0]), default=None)
    except NotEnough as reason:
        return Finding(check, "not enough", reason=str(reason))
    if found is None:
        return Finding(check, "not enough", reason="too few frames with a value")
    if check.most is None and check.least is None:
        return Finding(check, "measured", *found)
    blamed = "retake" if check.blame == "performer" else "fail"
    return Finding(check, "pass" if _excess(check, found[0]) <= 0 else blamed, *found)


def _figures(check: Check, subject: Subject) -> Iterator[tuple[float, str, int | None]]:
    """Return value, column and frame of every column in every window."""
    windows = _windows(check.window, subject)
    found = columns(check, subject)
    for during in windows:
        for name, column in found.items():
            values = np.atleast_1d(np.asarray(column, dtype=float))
            constant = len(values) != len(subject)
            kept = values if constant else np.where(during, values, np.nan)
            if np.isfinite(kept).sum() < (1 if constant else check.enough):
                continue
            value = reduced(check.statistic, kept, subject.frames(1.0), subject.interval)
            if np.isfinite(value):
                sign = -1 if check.least is not None and value < check.least else 1
                yield value, name, None if constant else int(np.nanargmax(sign * kept))


def _windows(window: str, subject: Subject) -> list[np.ndarray]:
    """Return the frames (T,) of the take, or of every step with a label."""
    if window == "take":
        return [np.ones(len(subject), dtype=bool)]
    label = window.removeprefix("held ")
    share = 1.0 if label == window else _HELD
    steps = [step for step in need(subject.steps, "no script") if step.label == label]
    return [subject.during(step, share) for step in need(steps, f"no step {label!r} in the script")]


def _excess(check: Check, value: float) -> float:
    """Return how far a value is beyond the limits; the value itself if the check has no limits."""
    if check.least is None and check.most is None:
        return value
    low, high = (-np.inf if check.least is None else check.least), (np.inf if check.most is None else check.most)
    return max(low - value, value - high)


def reduced(statistic: str, values: np.ndarray, second: int, interval: float) -> float:
    """Return a statistic of values (T,), NaN if unknown: the words of the column 'statistic' in the table.

    Args:
        statistic: 'max', 'min', 'mean', 'median', 'sum', percentiles as 'p25', 'share' (of true values, %), 'longest'
            (run of true values, s), 'per minute', 'spread' (p5 to p95), 'variation' (coefficient of, %), 'scatter'
            (mean departure from the median, % of it), 'change' (greatest difference of the medians of two seconds).
            With '> 1' or '< 1' at its end, it is the statistic of this comparison.
        values: the quantity in the window.
        second: frames per second.
        interval: s between frames.
    """
    if statistic.split()[-2:-1] in (["<"], [">"]):
        statistic, sign, limit = statistic.rsplit(maxsplit=2)
        beyond = values > float(limit) if sign == ">" else values < float(limit)
        values = np.where(np.isfinite(values), beyond, np.nan)
    known = values[np.isfinite(values)]
    if statistic.startswith("p") and statistic[1:].isdigit():
        return float(np.percentile(known, int(statistic[1:])))
    if statistic == "longest":
        return interval * max((end - start for start, end in runs(np.nan_to_num(values) > 0)), default=0)
    if statistic == "change":
        medians = [np.nanmedian(values[k : k + second]) for k in range(0, max(len(values) - second, 1), second)]
        return float(np.nanmax(medians) - np.nanmin(medians))
    low, high = np.percentile(known, [2.5, 97.5])
    middle = float(np.median(known))
    figure = {
        "max": known.max,
        "min": known.min,
        "mean": known.mean,
        "median": lambda: middle,
        "sum": known.sum,
        "share": lambda: 100 * known.mean(),
        "per minute": lambda: 60 * known.sum() / max(len(known) * interval, 1e-9),
        "spread": lambda: np.subtract(*np.percentile(known, [95, 5])),
        "variation": lambda: 100 * np.clip(known, low, high).std() / max(abs(middle), 1e-9),
        "scatter": lambda: 100 * np.abs(known - middle).mean() / max(abs(middle), 1e-9),
    }[statistic]
    return float(figure())
