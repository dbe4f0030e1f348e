"""Defects of a faultless performance are found, the named ones at their size and well below."""

from __future__ import annotations

import pytest

from bodysense.body.pose import Pose
from bodysense_conform.evaluate import find, judge
from bodysense_conform.subject import Step, Subject
from bodysense_conform.table import Check, table

from .defects import NAMED, OTHERS, Defect, Performance


@pytest.fixture(scope="session")
def performance(clean: Subject, performed: tuple[Pose, list[Step]]) -> Performance:
    return Performance(clean, performed[0], tuple(performed[1]))


def _check(name: str) -> Check:
    return next(check for check in table().checks if check.id == name)


@pytest.mark.parametrize("defect", NAMED, ids=lambda defect: defect.name)
def test_a_named_defect_is_found_at_its_size_and_at_its_bound(defect: Defect, performance: Performance) -> None:
    checks = [_check(name) for name in defect.checks]

    def found(size: float) -> bool:
        subject = defect.spoil(performance, size)
        return any(find(check, subject).outcome == "fail" for check in checks)

    assert [found(size) for size in (0.0, defect.bound, defect.size)] == [False, True, True]


@pytest.mark.parametrize("defect", NAMED[::6], ids=lambda defect: defect.name)
def test_a_check_that_fails_fails_the_take(defect: Defect, performance: Performance) -> None:
    assert judge(defect.spoil(performance, defect.size)).judgement == "fail"


@pytest.mark.parametrize("name", OTHERS)
def test_a_check_finds_its_defect(name: str, performance: Performance) -> None:
    check = _check(name)
    expected = "retake" if check.blame == "performer" else "fail"
    assert find(check, OTHERS[name](performance)).outcome == expected
    assert find(check, performance.subject).outcome == "pass"


def test_most_checks_have_a_defect() -> None:
    """Checks without a defect measure the performer's angles: a bend or a height in a step."""
    reached = set(OTHERS).union(*(defect.checks for defect in NAMED))
    blamed = {check.id for check in table().checks if check.blame == "device"}
    assert reached <= {check.id for check in table().checks}
    assert len(blamed & reached) > 0.6 * len(blamed)
