"""`bodysense evaluate scenes`: its figures, its picture and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest


@pytest.mark.slow
def test_scenes_are_scored_and_drawn(tmp_path: Path, run) -> None:
    from PIL import Image

    numbers, sheet = tmp_path / "scenes.json", tmp_path / "sheet.png"
    output = run(
        *("evaluate", "scenes", "--split", "val", "--scenes", 1, "--kinds", "stand", "turn", "--jobs", 1),
        *("--sets", "six_point", "lost_hands", "--sheet", sheet, "--json", numbers),
    )
    assert "stand" in output and "turn" in output and "lost hands" in output
    found = json.loads(numbers.read_text())
    assert found["scenes_six_point_error_cm"] < found["scenes_lost_hands_error_cm"]
    assert "scenes_lost_hands_stand_lost_hand_cm" in found and "scenes_six_point_lost_hand_cm" not in found
    assert found["scenes_six_point_turn_missed_steps_share"] == 0
    with Image.open(sheet) as picture:
        assert picture.width > 1000 and picture.height == 2 * 2 * 160  # two scenes, truth over result


def test_unknown_scenes_and_folders_are_refused(tmp_path: Path, refused) -> None:
    assert "no scene of this kind" in refused("evaluate", "scenes", "--kinds", "handstand")
    assert "headset_takes.npz" in refused("evaluate", "scenes", "--headset", tmp_path)
    missing = refused("evaluate", "scenes", "--json", tmp_path / "none" / "a.json")
    assert "does not exist; create it" in missing
