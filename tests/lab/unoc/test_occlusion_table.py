"""Table 1: columns, the numbers in them, and what lies in the published range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.devices.simulated.headset_camera import HeadsetCamera, see
from bodysense.io.clip import Clip
from bodysense_lab.datasets import DataSet
from bodysense_lab.unoc.occlusion import GROUPS, PUBLISHED, columns_of, count_clips, numbers_of, occlusion_report


@pytest.fixture(scope="module")
def clips(waving_clip: Clip) -> list[Clip]:
    short = replace(waving_clip, pose=waving_clip.pose[:30])
    return [replace(short, category="sit", person="a"), replace(waving_clip, category="sport", person="b")]


def test_a_column_a_category(clips: list[Clip], data: DataSet) -> None:
    seen: list[str] = []
    counted, census = count_clips(clips, 1, lambda clip: seen.append(clip.category))
    assert seen == ["sit", "sport"] and len(census.people) == 2
    columns = columns_of(counted)
    assert [one.name for one in columns] == ["sit", "sport", "all"]
    report = occlusion_report([(data, counted, census)])
    assert report.columns[1:] == ("sit", "sport", "all", *(f"{one.name}, published" for one in PUBLISHED))
    rows = {row[0]: row[1:] for row in report.rows}
    assert rows["frames"][:3] == (30, 90, 120)
    skeleton = clips[0].pose.skeleton
    elbows = skeleton.indices(["left_elbow", "right_elbow"])
    hidden = ~see(clips[1].pose).visible[:, elbows]
    assert rows["elbow hidden, %"][1] == pytest.approx(100 * hidden.mean())
    assert rows["elbow hidden, %"][3] == 13.0 and rows["hand hidden, %"][5] is None, "published"
    numbers = report.numbers
    assert numbers["sport_elbow_hidden"] == pytest.approx(hidden.mean())
    assert {f"all_{group}_hidden" for group in GROUPS} <= set(numbers) and numbers["clips"] == 2
    assert numbers_of(columns).items() <= numbers.items()


def test_several_sets_have_a_column_each(clips: list[Clip], data: DataSet) -> None:
    counted = [
        (replace(data, name=name), *count_clips(clips[k : k + 1], 1, lambda clip: None)) for k, name in enumerate("xy")
    ]
    report = occlusion_report(counted)
    assert report.columns[1:3] == ("x", "y") and len(report.data) == 2 + len(PUBLISHED)


def test_the_camera_is_the_one_given(clips: list[Clip]) -> None:
    wide, narrow = (
        columns_of(count_clips(clips[:1], 1, lambda clip: None, HeadsetCamera(field_of_view=field))[0])[-1]
        for field in (200.0, 20.0)
    )
    assert (narrow.hiding["body"].ratio or 0) > (wide.hiding["body"].ratio or 0)
    assert narrow.hiding["body"].ratio == pytest.approx(1.0, abs=0.05)


def test_what_lies_outside_is_named(clips: list[Clip], data: DataSet) -> None:
    counted, census = count_clips(clips[:1], 1, lambda clip: None)
    remark = occlusion_report([(data, counted, census)]).remarks[0]
    for group in GROUPS:
        ratio = columns_of(counted)[0].hiding[group].ratio
        published = [one.hiding[group].ratio for one in PUBLISHED]
        known = [value for value in published if value is not None]
        assert ratio is not None
        inside, outside = remark.split("outside:")
        expected = inside if min(known) <= ratio <= max(known) else outside
        assert f"{group} {100 * ratio:.0f} %" in expected, group
    assert np.isfinite(list(numbers_of(columns_of(counted)).values())).all()
