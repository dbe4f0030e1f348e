"""Scores in files: what was written comes back for the same work, and for no other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.takes.last_known import KNOWN
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet
from bodysense_lab.papers.unoc.score.kept_scores import (
    Scores,
    better_last_known,
    identity_of,
    read_scores,
    scores_path,
    write_scores,
)


def scores_with(error: float, group: str = "main") -> Scores:
    tally = Tally()
    tally.add(np.full(5, error))
    return Scores(Tallies({(group, "body", "occluded"): tally}), Census(2, frozenset({"a", "b"}), 3.5, 1, 0.5))


def test_there_and_back(tmp_path: Path, data: DataSet) -> None:
    network = tmp_path / "gru.pt"
    network.write_bytes(b"1234")
    identity = identity_of(data, 2, network, "settings")
    path = scores_path(tmp_path, "gru", data)
    write_scores(path, scores_with(2.5), identity)
    back = read_scores(path, identity)
    assert back is not None and back.census == scores_with(0).census
    assert back.get("body", "occluded").rmsjpe == 2.5 and back.get("body", "all").count == 0
    others = [
        identity_of(data, 1, network, "settings"),
        identity_of(data, 2, None, "settings"),
        identity_of(replace(data, split="val"), 2, network, "settings"),
        identity_of(data, 2, network, "others"),
    ]
    network.write_bytes(b"12345")
    others.append(identity_of(data, 2, network, "settings"))
    assert all(read_scores(path, other) is None for other in others)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"identity": 1, "tallies": {"a": [1]}}'])
def test_a_damaged_file_is_counted_anew(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    assert read_scores(tmp_path / "a.json", {}) is None
    assert read_scores(tmp_path / "none.json", {}) is None


@pytest.mark.parametrize("group", ["main", "sport"])
@pytest.mark.parametrize("best", KNOWN)
def test_the_better_baseline(best: str, group: str) -> None:
    scores = {f"last_known_{frame}": scores_with(1.0 if frame == best else 2.0, group) for frame in KNOWN}
    assert better_last_known(scores) == best
