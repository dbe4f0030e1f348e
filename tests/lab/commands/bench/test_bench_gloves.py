from __future__ import annotations

import json
from pathlib import Path

from bodysense_lab.commands.bench.gloves import gloves
from bodysense_lab.synthesis.glove_stream import glove_stream


def test_bench_gloves_writes_times_for_one_and_two_hands(tmp_path: Path) -> None:
    gloves(frames=20, json=tmp_path / "numbers.json")
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    for name in ("one_hand", "one_hand_all", "two_hands", "two_hands_all"):
        assert 0 < numbers[f"{name}_p50_ms"] <= numbers[f"{name}_p99_ms"]


def test_one_marker_of_each_hand_is_hidden() -> None:
    skeletons, observation = glove_stream(("left", "right"), frames=90, hidden=1)
    assert list(skeletons) == ["left", "right"]
    hidden = ~observation.has_position.reshape(90, 2, 9)
    assert (hidden.sum(axis=2) == 1).all()
    assert (hidden[29] != hidden[30]).any()
