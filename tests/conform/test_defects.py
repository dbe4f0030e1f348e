"""Defects of a faultless performance are found, the named ones at their size and well below."""

from __future__ import annotations

import pytest

from bodysense.body.pose import Pose
from bodysense_conform.evaluate import find, judge
from bodysense_conform.subject import Step, Subject
from bodysense_conform.table import Check, table

from .defects import NAMED, OTHERS, Defect, Performance

_HALVINGS = 5  # of the search for the smallest size


@pytest.fixture(scope="session")
def performance(clean: Subject, performed: tuple[Pose, list[Step]]) -> Performance:
    return Performance(clean, performed[0], tuple(performed[1]))


def _check(name: str) -> Check:
    return next(check for check in table().checks if check.id == name)


@pytest.mark.parametrize("defect", NAMED, ids=lambda defect: defect.name)
def test_a_named_defect_fails_the_take(defect: Defect, performance: Performance) -> None:
    verdict = judge(defect.spoil(performance, defect.size))
    assert verdict.judgement == "fail"


@pytest.mark.parametrize("defect", NAMED, ids=lambda defect: defect.name)
def test_the_smallest_size_found_is_bounded(defect: Defect, performance: Performance) -> None:
    checks = [_check(name) for name in defect.checks]

    def found(size: float) -> bool:
        subject = defect.spoil(performance, size)
        return any(find(check, subject).outcome == "fail" for check in checks)

    assert found(defect.size) and not found(0.0)
    low, high = 0.0, defect.size
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if found(middle) else (middle, high)
    print(f"{defect.name}: found from {high:.3g} of {defect.size:g}")
    assert high <= defect.bound


@pytest.mark.parametrize("name", OTHERS)
def test_a_check_finds_its_defect(name: str, performance: Performance) -> None:
    check = _check(name)
    expected = "retake" if check.blame == "performer" else "fail"
    assert find(check, OTHERS[name](performance)).outcome == expected
    assert find(check, performance.subject).outcome == "pass"


def test_most_checks_have_a_defect() -> None:
    """Those without are the performer's angles, which evaluate nothing but a bend or a height in a step."""
    reached = set(OTHERS).union(*(defect.checks for defect in NAMED))
    blamed = {check.id for check in table().checks if check.blame == "device"}
    assert reached <= {check.id for check in table().checks}
    assert len(blamed & reached) > 0.6 * len(blamed)
