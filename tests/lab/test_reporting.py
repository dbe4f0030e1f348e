"""A report without a picture is written all the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from bodysense_lab.commands.reporting import finish
from bodysense_lab.options import TableOptions
from bodysense_lab.table import Report


def test_a_report_without_panels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = Report("plain", "A table", ("what", "cm"), (("one", 1.0),), {"one_cm": 1.0})
    finish(report, TableOptions(out=tmp_path, json=tmp_path / "plain.json"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plain.csv", "plain.json"]
    assert "plain.png" not in capsys.readouterr().out
