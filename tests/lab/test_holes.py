"""The table of filled holes: what is scored, against what, and under which names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.rotation import quaternion_exp
from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense_lab import holes
from bodysense_lab.chart import draw_panels


def clip_of(seconds: float) -> Clip:
    clip = packaged_performance()
    return replace(clip, name="a", pose=clip.pose[: int(seconds * clip.frame_rate)])


def test_every_part_is_taken_away_from_clips_that_are_long_enough() -> None:
    seen: list[Clip] = []
    gaps = holes.score_holes([clip_of(2.6)], advance=seen.append)
    assert len(seen) == 1 and {gap.seconds for gap in gaps} == {0.1, 0.2, 0.5}
    assert {gap.part for gap in gaps} == set(holes.PARTS) and {gap.method for gap in gaps} == set(holes.METHODS)
    assert all(0 <= gap.error < 1 for gap in gaps)


def test_the_numbers_name_part_and_seconds_and_the_best_of_the_others(tmp_path: Path) -> None:
    errors = {"bodysense": 0.01, "slerp": 0.03, "cubic spline": 0.02, "causal": 0.04}
    gaps = [holes.Gap(part, 0.5, method, error) for part in holes.PARTS for method, error in errors.items()]
    report = holes.report_of(gaps, "made up")
    assert [row[:3] for row in report.rows] == [(part.replace("_", " "), "0.5 s", 1) for part in holes.PARTS]
    assert report.numbers["upper_body_0.5_cm"] == pytest.approx(1.0)
    assert report.numbers["upper_body_0.5_best_other_cm"] == pytest.approx(2.0)
    draw_panels(tmp_path / "holes.png", report.panels, report.title)
    assert (tmp_path / "holes.png").stat().st_size > 1000


@pytest.mark.parametrize(("fill", "power"), [(holes.slerped, 1), (holes.splined, 3)])
def test_the_others_follow_the_motions_that_they_assume(fill, power: int) -> None:
    """Slerp is exact for a turn of constant speed about one axis, the spline for one that is a cubic of time."""
    time = np.linspace(-1, 1, 30)
    rotation = np.asarray(quaternion_exp(np.stack([time**power, 0 * time, 0 * time], axis=1)))
    filled = fill(rotation, 10, 20)
    np.testing.assert_allclose(np.abs((filled * rotation[10:20]).sum(axis=1)), 1, atol=1e-12)
