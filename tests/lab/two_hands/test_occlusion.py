"""How many markers are hidden and for how long: counting against plain loops, the report, and the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from bodysense.cli import main
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.io.clip import Clip
from bodysense_lab.data.datasets import Census
from bodysense_lab.papers.two_hands.score.hand_pairs import over_clips
from bodysense_lab.papers.two_hands.score.occlusion import (
    PUBLISHED_AT_ONCE,
    SETTINGS,
    MarkerHiding,
    count_hidden,
    count_pair,
    numbers_of,
    occlusion_report,
)

RING = CameraRing(count=4)


def looped_spans(seen: np.ndarray, rate: float) -> list[float]:
    """Lengths of the runs of hidden frames that touch neither end, marker by marker."""
    spans = []
    for marker in range(seen.shape[1]):
        runs = [(hidden, len(list(frames))) for hidden, frames in groupby(~seen[:, marker])]
        spans += [length / rate for hidden, length in runs[1:-1] if hidden]
    return spans


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.97, 1.0])
def test_counts_equal_those_of_plain_loops(share: float) -> None:
    seen = np.random.default_rng(0).random((400, 9)) >= share
    found = count_hidden(seen, 50.0)
    np.testing.assert_allclose(np.sort(found.spans), np.sort(looped_spans(seen, 50.0)))
    assert found.at_once.sum() == pytest.approx(400 / 50)
    for n in range(10):
        assert found.at_once[n] == pytest.approx(sum(int((~row).sum()) == n for row in seen) / 50)
    assert found.hidden == pytest.approx((~seen).mean())


def test_counts_add_up() -> None:
    rng = np.random.default_rng(1)
    parts = [rng.random((200, 9)) > 0.3 for _ in range(3)]
    total = count_hidden(parts[0], 60.0) + count_hidden(parts[1], 60.0) + count_hidden(parts[2], 60.0)
    assert total.hidden == pytest.approx((~np.concatenate(parts)).mean())
    assert len(total.spans) == sum(len(looped_spans(part, 60.0)) for part in parts)
    assert total.shorter(1e9) == 1.0 and total.shorter(0.0) == 0.0


def test_nothing_hidden_has_no_spans() -> None:
    nothing = count_hidden(np.ones((10, 9), dtype=bool), 60.0)
    assert nothing.hidden == 0 and not len(nothing.spans) and np.isnan(nothing.shorter(1.0))
    numbers = numbers_of({"main": dict.fromkeys(SETTINGS, nothing)})
    assert numbers["one_0_share"] == 1.0 and "one_short_share" not in numbers, "no figure where there is none"


def test_clips_are_counted_by_category_and_those_without_fingers_left_out(waving_clip: Clip) -> None:
    short = replace(waving_clip, pose=waving_clip.pose[:12])
    clips = [replace(short, category="sit"), replace(short, category="sport"), replace(short, has_fingers=False)]
    advanced: list[Clip] = []
    counted, census = over_clips(partial(count_pair, cameras=RING), clips, 1, advanced.append)
    assert sorted(counted) == ["main", "sport"] and len(advanced) == 3 and census.clips == 2
    for settings in counted.values():
        assert settings["both"].at_once.shape == (19,) and settings["one"].at_once.shape == (10,)
        # Each hand is counted by itself, both together for half as long.
        assert settings["each"].at_once.sum() == pytest.approx(2 * settings["both"].at_once.sum())
        assert settings["each"].hidden == pytest.approx(settings["both"].hidden)
        assert settings["one"].hidden <= settings["each"].hidden, "another hand hides, it never shows"
    report = occlusion_report(counted, RING, None, Census())
    assert {row[0] for row in report.rows} == {"main", "sport"} and "one_hidden_share_sport" in report.numbers


def test_published_shares_are_of_frames_with_one_to_four_hidden() -> None:
    """The paper's network is trained with them: they make up the whole."""
    assert sum(PUBLISHED_AT_ONCE) == pytest.approx(1.0)
    hiding = MarkerHiding(np.array([5.0, 7.0, 1.7, 0.8, 0.5, 9, 0, 0, 0, 0]), np.array([0.1, 0.2, 0.5]))
    report = occlusion_report({"main": dict.fromkeys(SETTINGS, hiding)}, RING, None, Census())
    rows = {row[1]: row for row in report.rows}
    for n, published in enumerate(PUBLISHED_AT_ONCE, start=1):
        row = rows[f"{n}, where 1 to 4 are"]
        assert row[2] == pytest.approx(row[-1]) == pytest.approx(100 * published)
    assert rows["spans below 0.36 s"][2] == pytest.approx(100 * 2 / 3)


@pytest.mark.slow
def test_the_command_writes_table_and_numbers(tmp_path: Path) -> None:
    given = ["evaluate", "gloves-occlusion", "--quick", "--jobs", "1", "--cameras", "3", "--out", str(tmp_path)]
    assert main([*given, "--json", str(tmp_path / "numbers.json")]) == 0
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    for setting, most in (("one", 9), ("each", 9), ("both", 18)):
        assert sum(numbers[f"{setting}_{n}_share"] for n in range(most + 1)) == pytest.approx(1.0)
    assert numbers["both_several_share"] > numbers["one_several_share"]
    with (tmp_path / "gloves-occlusion.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[-1] == "published, one hand" and len(rows) == 12


def test_bad_options_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path)]
    for options, message in (
        (["--cameras", "1"], "2 of 1 cameras"),
        (["--data", str(tmp_path / "none")], "no such folder"),
    ):
        assert main(["evaluate", "gloves-occlusion", *options, *out]) == 2
        assert message in capsys.readouterr().err
