"""Verdict: all findings of a subject, and what follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from bodysense_conform.check import Check, Finding, Group, Outcome, find
from bodysense_conform.checks import TABLE
from bodysense_conform.subject import Subject

Judgement = Literal["pass", "fail", "retake", "not enough"]
GROUPS: tuple[Group, ...] = ("data", "anatomy", "motion", "poses", "hands")
EXIT_STATUS: dict[Judgement, int] = {"pass": 0, "fail": 1, "retake": 2, "not enough": 2}


@dataclass(frozen=True, eq=False)
class Verdict:
    """What was found of a subject."""

    subject: Subject
    findings: tuple[Finding, ...]

    def of(self, *outcomes: Outcome) -> list[Finding]:
        """The findings with one of these outcomes."""
        return [one for one in self.findings if one.outcome in outcomes]

    @property
    def judgement(self) -> Judgement:
        """Fail if the device failed a check; else retake if the performer did; else whether there was enough."""
        if self.of("fail"):
            return "fail"
        if self.of("retake"):
            return "retake"
        missing = [one for one in self.of("not enough") if one.check.required]
        return "not enough" if missing else "pass"


def judge(subject: Subject, checks: Sequence[Check] = TABLE) -> Verdict:
    """Put all checks to a subject, in their order."""
    findings: list[Finding] = []
    broken: frozenset[str] = frozenset()
    for check in checks:
        finding = find(check, subject, broken)
        findings.append(finding)
        if finding.outcome in ("fail", "retake"):
            broken |= {check.id}
    return Verdict(subject, tuple(findings))
