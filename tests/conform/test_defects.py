"""Defects of a faultless performance are found, the named ones at their size and well below."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import Pose
from bodysense_conform.evaluate import find, judge
from bodysense_conform.subject import Step, Subject
from bodysense_conform.table import Check, table

from .defects import NAMED, OTHERS, Defect, Performance, reorder_frames


@pytest.fixture(scope="session")
def performance(clean: Subject, performed: tuple[Pose, list[Step]]) -> Performance:
    return Performance(clean, performed[0], tuple(performed[1]))


NOISE = tuple(f"motion.{name}" for name in ("repeats", "skips", "stall", "stalls", "spike", "tremor"))


def _check(name: str) -> Check:
    return next(check for check in table().checks if check.id == name)


@pytest.mark.parametrize("defect", NAMED, ids=lambda defect: defect.name)
def test_a_named_defect_is_found_at_its_size_and_at_its_bound(defect: Defect, performance: Performance) -> None:
    checks = [_check(name) for name in defect.checks]

    def found(size: float) -> bool:
        subject = defect.spoil(performance, size)
        return any(find(check, subject).outcome == "fail" for check in checks)

    assert [found(size) for size in (0.0, defect.bound, defect.size)] == [False, True, True]


@pytest.mark.parametrize("defect", NAMED[::12], ids=lambda defect: defect.name)
def test_a_check_that_fails_fails_the_take(defect: Defect, performance: Performance) -> None:
    assert judge(defect.spoil(performance, defect.size)).judgement == "fail"


@pytest.mark.parametrize("name", OTHERS)
def test_a_check_finds_its_defect(name: str, performance: Performance) -> None:
    check = _check(name)
    expected = "retake" if check.blame == "performer" else "fail"
    assert find(check, OTHERS[name](performance)).outcome == expected
    assert find(check, performance.subject).outcome == "pass"


@pytest.mark.parametrize("rate", [30.0, 60.0, 120.0])
def test_noise_of_a_still_body_is_no_stutter(rate: float, performance: Performance) -> None:
    """A tracker's noise of 2 mm repeats no frame and skips none, at any rate."""
    still = reorder_frames(performance.subject, np.full(len(performance.subject), 100))
    noise = np.random.default_rng(7).normal(0, 0.002, still.position.shape)
    time = np.arange(len(still)) / rate
    subject = replace(still, position=still.position + noise, time=time, steps=())
    outcomes = {name: find(_check(name), subject).outcome for name in NOISE}
    assert not [name for name, outcome in outcomes.items() if outcome == "fail"]


def test_a_slow_pace_repeats_no_frame(performance: Performance) -> None:
    """Uneven steps are no repeats: every second frame is late by 0.6 of a frame."""
    subject, frames = performance.subject, np.arange(len(performance.subject))
    late = np.interp(frames - 0.6 * (frames % 2), frames, frames)
    columns = subject.position.reshape(len(subject), -1)
    position = np.stack([np.interp(late, frames, column) for column in columns.T], axis=1)
    uneven = replace(subject, position=position.reshape(subject.position.shape))
    assert find(_check("motion.repeats"), uneven).outcome == "pass"


def test_most_checks_have_a_defect() -> None:
    """Checks without a defect measure the performer's angles: a bend or a height in a step."""
    reached = set(OTHERS).union(*(defect.checks for defect in NAMED))
    blamed = {check.id for check in table().checks if check.blame == "device"}
    assert reached <= {check.id for check in table().checks}
    assert len(blamed & reached) > 0.6 * len(blamed)
