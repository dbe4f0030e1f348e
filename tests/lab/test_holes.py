"""The table of filled holes: what is scored, and that takes tracked together are those tracked alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense_lab import holes


def clips() -> list[Clip]:
    """Two clips of different length."""
    clip = packaged_performance()
    return [
        replace(clip, name=name, pose=clip.pose[: int(seconds * clip.frame_rate)])
        for name, seconds in (("a", 3.6), ("b", 3.2))
    ]


def test_takes_tracked_together_are_those_tracked_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Clip] = []
    together = holes.score_holes(clips(), advance=seen.append)
    monkeypatch.setattr(holes, "_TOGETHER", 1)
    alone = holes.score_holes(clips())
    assert [clip.name for clip in seen] == ["a", "b"]
    assert [(gap.limb, gap.seconds, gap.method) for gap in together] == [
        (gap.limb, gap.seconds, gap.method) for gap in alone
    ]
    assert {gap.seconds for gap in together} == {1.0} and {gap.limb for gap in together} == set(holes.LIMBS)
    for one, other in zip(together, alone, strict=True):
        assert one.error == pytest.approx(other.error, abs=1e-5) and one.speed == pytest.approx(other.speed, abs=1e-3)


def test_the_table_holds_every_limb_and_length() -> None:
    gaps = [holes.Gap(limb, 1.0, method, 0.01, 0.5, 0.6) for limb in holes.LIMBS for method in holes.METHODS]
    report = holes.report_of(gaps, "made up")
    assert [row[:3] for row in report.rows] == [(limb, "1 s", 1) for limb in holes.LIMBS]
    assert report.numbers["left_leg_1s_filled_cm"] == pytest.approx(1.0)
    assert np.isfinite(list(report.numbers.values())).all()
