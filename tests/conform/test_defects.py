"""One defect each: of a faultless performance, changed in one way, exactly the checks fail that are named for it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bodysense.body.pose import Pose
from bodysense_conform.checks import TABLE
from bodysense_conform.subject import Step, Subject
from bodysense_conform.verdict import judge

from . import defects_anatomy, defects_data, defects_hands, defects_motion, defects_poses
from .kit import DEFECTS, Kit

assert defects_anatomy and defects_data and defects_hands and defects_motion and defects_poses  # they fill DEFECTS


@pytest.fixture(scope="session")
def kit(clean: Subject, performed: tuple[Pose, list[Step]]) -> Kit:
    return Kit(clean, *performed)


PERFORMED = ("poses.squat_symmetry",)  # whose defect the performer may have: a knee that bends less lifts its ankle
LIMITED = [check for check in TABLE if check.most is not None or check.least is not None]


def test_every_check_with_a_limit_has_its_defect() -> None:
    assert {check.id for check in LIMITED} - {"data.long_enough"} == set(DEFECTS)


def test_who_stands_still_instead_of_performing_is_asked_again(kit: Kit) -> None:
    """The head sways as people's do: the device works."""
    still = kit.cut(kit.clean.time < 9.0)
    verdict = judge(replace(still, steps=(Step("other", 0.0, 9.0),)))
    assert [one.check.id for one in verdict.of("retake")] == ["motion.dead"] and not verdict.of("fail")


@pytest.mark.slow
@pytest.mark.parametrize("check", sorted(DEFECTS))
def test_a_defect_fails_exactly_what_is_named_for_it(check: str, kit: Kit) -> None:
    spoil, expected = DEFECTS[check]
    verdict = judge(spoil(kit))
    failed = {one.check.id: one.value for one in verdict.of("fail", "retake")}
    assert set(failed) == expected, failed
    blamed = {one.check.id: one.outcome for one in verdict.of("fail", "retake")}[check]
    row = next(one for one in TABLE if one.id == check)
    assert blamed == ("retake" if row.blame == "performer" or check in PERFORMED else "fail")
