"""Output of reports: files, and numbers of samples."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bodysense_lab.commands.reporting import finish
from bodysense_lab.core.options import TableOptions
from bodysense_lab.core.table import Report
from bodysense_lab.data.datasets import DataSet


def test_a_report_is_written_as_rows_and_numbers(tmp_path: Path) -> None:
    report = Report("plain", "A table", ("what", "cm"), (("one", 1.0),), {"one_cm": 1.0})
    finish(report, TableOptions(out=tmp_path, json=tmp_path / "plain.json"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plain.csv", "plain.json"]


@pytest.mark.parametrize("quick", [True, False])
def test_the_numbers_of_a_sample_have_the_number_of_all_clips(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: bool
) -> None:
    monkeypatch.setattr("bodysense_lab.data.clips.count_clips", lambda path, split: 38)
    report = Report("plain", "A table", ("what", "cm"), (("one", 1.0),), {"clips": 12.0})
    out = tmp_path / "plain.json"
    finish(report, TableOptions(out=tmp_path, json=out, quick=quick), DataSet("some", tmp_path))
    assert json.loads(out.read_text()).get("clips_in_split") == (38.0 if quick else None)
