"""The driver of UNOC's tables: trains what is missing, refuses other settings, and shares what networks read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from people.split import write_people

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.papers.unoc import train_tables as tables
from bodysense_lab.papers.unoc.network import variants
from bodysense_lab.papers.unoc.network.network import PAPER, BodyNetworkConfig, read_weights
from bodysense_lab.papers.unoc.network.variants import TABLES, VARIANTS, Variant
from bodysense_lab.papers.unoc.options import TablesTraining
from bodysense_lab.papers.unoc.sequences.body_sequences import BodySequence
from bodysense_lab.papers.unoc.train_tables import cached_sequences, chosen_networks, schedule_of, train_tables

SMALL = replace(PAPER, hidden=4, branch=(4,), judge_branch=(4,), window=9)


@pytest.fixture
def folder(tmp_path: Path, waving_clip: Clip) -> Path:
    """A person to train on and one to watch."""
    return write_people(tmp_path / "data", {"train": [waving_clip], "val": [waving_clip]})


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two networks of a size for tests."""
    two = {"gru": Variant("GRU", SMALL), "no_bone": Variant("w/o bones", SMALL, {"body_bone": 0.0})}
    monkeypatch.setattr(variants, "VARIANTS", two)
    monkeypatch.setattr(tables, "VARIANTS", two)
    monkeypatch.setattr(tables, "TABLES", {"2": ("gru",), "4": ("gru", "no_bone")})


def options_for(folder: Path, out: Path) -> TablesTraining:
    return TablesTraining(
        data=folder, out=out, tables=("2", "4"), epochs=2, window_stride=10, batch_scale=0.02, threads=1
    )


def test_every_table_names_networks_that_exist() -> None:
    assert {name for names in TABLES.values() for name in names} == set(VARIANTS)
    configurations = {(variant.config, tuple(sorted(variant.loss.items()))) for variant in VARIANTS.values()}
    assert len(configurations) == len(VARIANTS)  # no two are the same
    assert (
        VARIANTS["gru"].config
        == PAPER
        == BodyNetworkConfig(
            "gru", 512, (512, 512), None, 0.3, (512, 512), 27, "positions", "heading", "wrist", True, ("occlusion",)
        )
    )


def test_a_run_trains_each_network_once(small: None, folder: Path, tmp_path: Path, capsys) -> None:
    run = options_for(folder, tmp_path / "out")
    train_tables(run)
    for name in ("gru", "no_bone"):
        assert read_weights(run.out / f"{name}.pt", default_skeleton()).config == SMALL
    written = {path: path.stat().st_mtime_ns for path in run.out.rglob("*") if path.is_file()}
    assert "trained GRU: " in capsys.readouterr().out
    train_tables(run)
    assert {path: path.stat().st_mtime_ns for path in run.out.rglob("*") if path.is_file()} == written


def test_another_configuration_is_refused_with_the_difference(small: None, folder: Path, tmp_path: Path) -> None:
    run = replace(options_for(folder, tmp_path / "out"), tables=("2",))
    train_tables(run)
    with pytest.raises(BodysenseError, match=r"gru\.json is of another configuration \(schedule\.epochs: 2 → 3\)"):
        train_tables(replace(run, epochs=3))


def test_the_loss_of_an_ablation_is_the_papers_but_for_its_terms(tmp_path: Path) -> None:
    run = TablesTraining(data=tmp_path, out=tmp_path)
    gru, bare = schedule_of(run, "gru").loss, schedule_of(run, "no_parent_no_bone").loss
    assert (gru.body, gru.finger, gru.parent, gru.body_bone, gru.finger_bone) == (10, 100, 3, 7, 10)
    assert (gru.occluded, gru.occlusion, gru.expected_error) == (1.2, 0.025, 0.0)
    assert bare == replace(gru, parent=0.0, body_bone=0.0, finger_bone=0.0)
    assert schedule_of(replace(run, loss_sum=True), "gru").loss == replace(gru, sums=True) != gru
    assert schedule_of(run, "gru").epoch_batches == (256, 512, 1024, 1024, 1024)
    assert schedule_of(replace(run, batch_scale=0.25), "gru").epoch_batches == (64, 128, 256, 256, 256)


def test_names_that_do_not_exist_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="unknown table '7'; valid are 2, 3, 4, smoothness"):
        chosen_networks(TablesTraining(data=tmp_path, out=tmp_path, tables=("7",)))
    with pytest.raises(BodysenseError, match="unknown network 'grü'; valid are gru, rnn"):
        chosen_networks(TablesTraining(data=tmp_path, out=tmp_path, networks=("grü",)))
    assert chosen_networks(TablesTraining(data=tmp_path, out=tmp_path, tables=("2", "4")))[:5] == [
        *TABLES["2"],
        "no_occlusion",
    ]


def test_cached_sequences_are_read_from_disk(few_sequences: list[BodySequence], tmp_path: Path) -> None:
    made = cached_sequences(tmp_path / "a", {"data": "x"}, lambda: iter(few_sequences))
    again = cached_sequences(tmp_path / "a", {"data": "x"}, lambda: iter([]))
    for sequences in (made, again):
        for ours, theirs in zip(sequences, few_sequences, strict=True):
            assert ours.fingers == theirs.fingers
            for name in ("features", "known", "offset", "visible"):
                np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    with pytest.raises(BodysenseError, match=r"made from something else \(data differ\)"):
        cached_sequences(tmp_path / "a", {"data": "y"}, lambda: iter(few_sequences))
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_failed_caching_leaves_no_files(tmp_path: Path, few_sequences: list[BodySequence]) -> None:
    def failing():
        yield few_sequences[0]
        raise BodysenseError("no more")

    with pytest.raises(BodysenseError, match="no more"):
        cached_sequences(tmp_path / "a", {}, failing)
    with pytest.raises(BodysenseError, match="no clip to make sequences of"):
        cached_sequences(tmp_path / "a", {}, lambda: iter([]))
    assert not list(tmp_path.iterdir())
