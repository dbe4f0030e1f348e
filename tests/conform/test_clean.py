"""A faultless performance: every check is answered, and none fails."""

from bodysense_conform.checks import TABLE
from bodysense_conform.subject import Subject
from bodysense_conform.verdict import judge


def test_a_faultless_performance_answers_every_check_and_passes(clean: Subject) -> None:
    verdict = judge(clean)
    assert [(one.check.id, one.value, one.where) for one in verdict.of("fail", "retake")] == []
    assert [(one.check.id, one.reason) for one in verdict.of("not enough")] == []
    assert verdict.judgement == "pass"


def test_there_are_sixty_checks_and_more_each_once_and_after_what_it_depends_on() -> None:
    ids = [check.id for check in TABLE]
    assert len(ids) == len(set(ids)) >= 60
    for place, check in enumerate(TABLE):
        assert set(check.after) <= set(ids[:place]), check.id
