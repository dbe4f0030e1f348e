"""A check and what it finds."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from bodysense_conform.subject import Subject

Group = Literal["data", "anatomy", "motion", "poses", "hands"]
Blame = Literal["device", "performer"]
Outcome = Literal["pass", "fail", "retake", "measured", "not enough"]


@dataclass(frozen=True)
class Value:
    """A figure, with where it was found."""

    value: float
    where: str = ""  # joints, bones, steps: for the reader
    frame: int | None = None  # that shows it best
    blame: Blame | None = None  # in place of the check's own


@dataclass(frozen=True)
class Unanswered:
    """Why a check has no figure."""

    reason: str


Measure = Callable[[Subject], "Value | Unanswered"]


@dataclass(frozen=True)
class Check:
    """One question with its limits; without a limit it is measured only."""

    id: str  # group.name
    measure: Measure
    unit: str
    why: str  # what it means for who uses the tracker, one sentence
    most: float | None = None
    least: float | None = None
    blame: Blame = "device"
    after: tuple[str, ...] = ()  # checks that must not fail for this one to mean anything
    required: bool = False  # unanswered, the subject cannot be judged

    @property
    def group(self) -> str:
        """The first part of the id."""
        return self.id.partition(".")[0]

    @property
    def limit(self) -> str:
        """The limits in words."""
        unit = f" {self.unit}" if self.unit else ""
        if self.least is not None and self.most is not None:
            return f"{self.least:g} … {self.most:g}{unit}"
        if self.most is not None:
            return f"≤ {self.most:g}{unit}"
        return f"≥ {self.least:g}{unit}" if self.least is not None else "–"


def check_of(
    group: Group,
    name: str,
    measure: Measure,
    unit: str,
    why: str,
    *,
    before: Sequence[str] = (),
    after: Sequence[str] = (),
    **limits: Any,
) -> Check:
    """A check of a group, after `before`, which many have, and `after`: names without a group are of the same one.

    `limits` are the other fields of `Check`.
    """
    earlier = tuple(one if "." in one else f"{group}.{one}" for one in (*before, *after))
    return Check(f"{group}.{name}", measure, unit, why, after=earlier, **limits)


@dataclass(frozen=True)
class Finding:
    """What one check found."""

    check: Check
    outcome: Outcome
    value: float | None = None
    where: str = ""
    frame: int | None = None
    reason: str = ""  # why it is not answered


def find(check: Check, subject: Subject, failed: frozenset[str]) -> Finding:
    """Put one check to a subject; `failed` are the checks that failed before it."""
    broken = [name for name in check.after if name in failed]
    if broken:
        return Finding(check, "not enough", reason=f"depends on {broken[0]}, which failed")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # NaN is what is missing here, and NumPy warns of it
        found = check.measure(subject)
    if isinstance(found, Unanswered):
        return Finding(check, "not enough", reason=found.reason)
    if check.most is None and check.least is None:
        outcome: Outcome = "measured"
    elif _within(check, found.value):
        outcome = "pass"
    else:
        outcome = "retake" if (found.blame or check.blame) == "performer" else "fail"
    return Finding(check, outcome, found.value, found.where, found.frame)


def _within(check: Check, value: float) -> bool:
    """Whether a value keeps the limits; NaN does not."""
    over = check.most is None or value <= check.most
    return over and (check.least is None or value >= check.least)
