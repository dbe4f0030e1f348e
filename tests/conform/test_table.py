"""The table of checks and its evaluator: healthy motion passes, harmless changes change nothing, gates skip groups."""

from __future__ import annotations

import statistics
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.demo import packaged_performance, performance_of_unseen_body
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import list_sources, read_source
from bodysense_conform.evaluate import Verdict, find, judge, reduced
from bodysense_conform.sources.files import clip_subject
from bodysense_conform.subject import Step, Subject, is_finger
from bodysense_conform.table import Check, CheckTable, table

from .defects import kept, shift

_LIMITED = [check for check in table().checks if check.least is not None or check.most is not None]
_DATA_CLIPS = 24  # of the motion data, evenly spread


def _faults(verdict: Verdict) -> dict[str, float | None]:
    return {one.check.id: one.value for one in verdict.of("fail", "retake")}


def test_a_faultless_performance_answers_every_check_and_passes(clean: Subject) -> None:
    verdict = judge(replace(clean, reference=clean))
    assert _faults(verdict) == {} and verdict.unanswered == {}
    assert verdict.judgement == "pass"


@pytest.mark.parametrize("clip", [packaged_performance(), performance_of_unseen_body()], ids=lambda clip: clip.name)
def test_packaged_performances_pass(clip: Clip) -> None:
    assert _faults(judge(clip_subject(clip, "clip"))) == {}


@pytest.mark.slow
def test_real_motion_passes(motion_data: Path) -> None:
    sources = list_sources(motion_data)
    failed = {}
    for source in sources[:: len(sources) // _DATA_CLIPS]:
        if faults := _faults(judge(clip_subject(read_source(source), "clip"))):
            failed[source.path.name] = faults
    assert failed == {}


def test_ids_are_unique_and_groups_come_after_those_they_need() -> None:
    groups = [group.id for group in table().groups]
    ids = [check.id for check in table().checks]
    assert len(set(ids)) == len(ids) and {check.group for check in table().checks} == set(groups)
    for place, group in enumerate(table().groups):
        assert set(group.needs) <= set(groups[:place]), group.id
    assert sorted(ids, key=lambda name: groups.index(name.partition(".")[0])) == ids


def test_every_check_has_a_reason_and_sensible_limits() -> None:
    for check in table().checks:
        assert check.why.endswith("."), check.id
        assert check.least is None or check.most is None or check.least < check.most, check.id
        assert np.isfinite(reduced(check.statistic, np.ones(50), 10, 0.1)), check.id


@settings(max_examples=2)
@given(st.floats(-180, 180), st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 2**32 - 1))
def test_heading_place_and_signs_of_quaternions_do_not_matter(
    clean: Subject, heading: float, x: float, z: float, seed: int
) -> None:
    sign = np.random.default_rng(seed).choice([-1.0, 1.0], clean.rotation.shape[:2])
    turn = quaternion_exp(np.radians([0.0, heading, 0.0]))
    position = quaternion_rotate(turn, clean.position) + np.array([x, 0, z])
    rotation = quaternion_multiply(turn, clean.rotation) * sign[..., None]
    assert _faults(judge(replace(clean, position=position, rotation=rotation))) == {}


@pytest.mark.parametrize(("garbage", "with_wrists"), [(np.nan, False), (1e9, True)])
def test_hands_that_are_honestly_missing_do_not_fail(clean: Subject, garbage: float, with_wrists: bool) -> None:
    missing = np.array([is_finger(name) or (with_wrists and "wrist" in name) for name in clean.points])
    valid = clean.valid & ~missing
    flags = np.zeros(len(clean), dtype=bool)  # the summary is of the body and the hands
    subject = replace(
        clean,
        valid=valid,
        position=np.where(missing[:, None], garbage, clean.position),
        rotation=np.where(missing[:, None], garbage, clean.rotation),
        transport=replace(clean.transport, all_tracked=flags, all_valid=flags),
    )
    verdict = judge(subject)
    assert verdict.judgement == "pass", _faults(verdict)
    assert "hands.size" in verdict.unanswered["no hand comes with all its fingers"]


def test_an_unknown_floor_is_where_the_lower_sole_usually_is(clean: Subject) -> None:
    leaps = shift(clean, clean.points, [0.0, 0.4, 0.0], np.arange(len(clean)) % 5 == 0)
    assert abs(replace(leaps, floor=None).ground - clean.ground) < 0.03


@pytest.mark.parametrize("frames", [1, 3, 25])
def test_a_short_take_is_judged_without_an_error(clean: Subject, frames: int) -> None:
    short = kept(clean, np.arange(frames))
    for subject in (short, replace(short, valid=np.zeros_like(short.valid)), replace(short, reference=short, steps=())):
        assert judge(subject).judgement != "pass" or frames > 20


def test_a_failed_gate_skips_its_group_and_those_that_need_it(clean: Subject) -> None:
    verdict = judge(replace(clean, position=100 * clean.position))
    assert set(_faults(verdict)) == {"size.height"}
    skipped = {name.partition(".")[0] for name in verdict.unanswered["size.height failed"]}
    assert {"axes", "joints", "motion", "hands"} <= skipped and not {"time", "data"} & skipped


def test_a_missing_answer_to_a_required_check_is_not_enough(clean: Subject) -> None:
    short = replace(clean, time=0.01 * clean.time)
    length = CheckTable((table().groups[0],), tuple(one for one in table().checks if one.id == "time.length"), "")
    assert judge(short, length).judgement == "not enough"


def test_a_still_performer_must_repeat_the_take(clean: Subject) -> None:
    still = kept(clean, np.flatnonzero(clean.time < 9))  # the head sways like a living one's
    verdict = judge(replace(still, steps=(Step("other", 0.0, 9.0),)))
    assert set(_faults(verdict)) == {"motion.moves"} and verdict.judgement == "retake"


@given(st.lists(st.integers(-8000, 8000).map(lambda n: n / 8), min_size=12, max_size=40), st.integers(-1000, 1000))
def test_statistics_follow_their_definitions(values: list[float], limit: int) -> None:
    percent, fortieths = (statistics.quantiles(values, n=n, method="inclusive") for n in (100, 40))
    clipped = [min(max(value, fortieths[0]), fortieths[-1]) for value in values]
    middle = statistics.median(values)
    medians = [statistics.median(values[k : k + 10]) for k in range(0, len(values) - 10, 10)]
    beyond = [value > limit for value in values]
    runs = "".join("1" if flag else " " for flag in beyond).split()
    wanted = {
        **{"max": max(values), "min": min(values), "mean": statistics.fmean(values), "sum": sum(values)},
        **{"median": middle, "p20": percent[19], "spread": percent[94] - percent[4]},
        "variation": 100 * statistics.pstdev(clipped) / max(abs(middle), 1e-9),
        "scatter": 100 * statistics.fmean(abs(value - middle) for value in values) / max(abs(middle), 1e-9),
        "per minute": 60 * sum(values) / (0.1 * len(values)),
        f"share > {limit}": 100 * statistics.fmean(beyond),
        f"share < {limit}": 100 * statistics.fmean(value < limit for value in values),
        f"longest > {limit}": 0.1 * max(map(len, runs), default=0),
    }
    for name, value in wanted.items():
        assert np.isclose(reduced(name, np.array([np.nan, *values]), 10, 0.1), value), name
    assert reduced("change", np.array(values), 10, 0.1) == max(medians) - min(medians)


def test_an_impossible_limit_fails_and_blames(clean: Subject) -> None:
    """The value that a check finds decides: with limits on its other side the same value fails."""
    subject = replace(clean, reference=clean)
    outcomes = {check.id: _against_its_limit(check, subject) for check in _LIMITED}
    assert outcomes == {check.id: "retake" if check.blame == "performer" else "fail" for check in _LIMITED}


def _against_its_limit(check: Check, subject: Subject) -> str:
    """Return the outcome of a check whose limit excludes the value that it finds."""
    value = find(check, subject).value
    assert value is not None, check.id
    strict = replace(check, least=None, most=value - 1) if check.most is not None else replace(check, least=value + 1)
    return find(strict, subject).outcome
