"""Training and scoring of HMD-VAE by commands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "net.txt"), "net.txt: the network is written as .onnx or .pt; give a name with this ending"),
        (("-o", "net.pt", "--steps", 0), "--steps 0: give a whole number"),
        (("-o", "net.onnx", "--origin", "pelvis"), "net.onnx: no device tracks the pelvis, so a network with that"),
        (("-o", "net.pt", "--sweep"), "--sweep trains its own decoders into a folder; give a folder as --out"),
        (("-o", "net.pt", "--model", 3), "model 3 takes the decoder of a model 0: train that first"),
        (("-o", "net.pt", "--decoder", "zero.pt"), "--decoder is for models 3 and 4; model 2 trains its own"),
        (("-o", "net.pt", "--grid", "few"), "--grid few is of a sweep; add --sweep, or leave --grid out"),
        (("-o", "nets", "--sweep", "--model", 3), "--sweep trains models 0 to 4; leave --model 3 out"),
        (("-o", "nets", "--sweep", "--beta", 1), "--grid few has settings of its own; leave --beta 1.0 out, or give"),
        (
            ("-o", "nets", "--sweep", "--grid", "all", "--latent", 15, "--blocks", 6),
            "--grid all has settings of its own; leave --latent 15 --blocks 6 out, or give --grid one",
        ),
    ],
)
def test_training_refuses_invalid_options(refused, tmp_path: Path, arguments: tuple, message: str, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert refused("train", "hmd-vae", "--data", tmp_path, *arguments).startswith(message)
    assert not list(tmp_path.iterdir())


def test_a_sweep_uses_the_given_settings(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bodysense_lab.papers.hmd_vae import train as body_vae_run

    sweeps = []
    monkeypatch.setattr(body_vae_run, "run_sweep", lambda _, configs, clips: sweeps.append(configs))
    for more in (("--grid", "one", "--beta", 1, "--origin", "pelvis"), ()):
        run("train", "hmd-vae", "--data", tmp_path, "-o", tmp_path / "nets", "--sweep", *more)
    assert {(one.beta, one.latent, one.blocks, one.origin) for one in sweeps[0]} == {(1.0, 30, 3, "pelvis")}
    assert (len(sweeps[0]), len(sweeps[1])) == (5, 20)


@pytest.mark.slow
def test_the_test_motions_of_a_split_file_are_scored(
    run, refused, small_vae: Path, tmp_path: Path, waving_clip: Clip
) -> None:
    data, listing = tmp_path / "data", tmp_path / "split.txt"
    data.mkdir()
    for name in ("one", "two", "three"):
        write_bvh(data / f"{name}.bvh", waving_clip)
    listing.write_text("one.bvh train\ntwo.bvh test\nthree.bvh test\n")
    command = ("evaluate", "hmd-vae", "--data", data, "--networks", small_vae.parent, "--out", tmp_path / "tables")
    command = (*command, "--split-file", listing)
    output = run(*command, "--json", tmp_path / "n.json", "--threads", 1)
    assert f"Of it, the test motions of {listing}." in output
    assert json.loads((tmp_path / "n.json").read_text())["clips"] == 2
    for more in (("--split", "val"), ("--quick",)):
        line = refused(*command, *more)
        assert line.startswith("--split-file scores its own test motions; leave --split and --quick")


@pytest.mark.slow
def test_the_tables_and_their_files_are_written(run, small_vae: Path, tmp_path: Path, waving_clip: Clip) -> None:
    data = tmp_path / "data"
    data.mkdir()
    write_bvh(data / "anna_waves.bvh", waving_clip)
    command = ("evaluate", "hmd-vae", "--data", data, "--networks", small_vae.parent, "--split", "all")
    output = run(*command, "--out", tmp_path / "tables", "--json", tmp_path / "n.json", "--threads", 1)
    assert "HMD-VAE, Figs 5 to 7" in output and "2 sequence" in output
    numbers = json.loads((tmp_path / "n.json").read_text())
    wanted = {
        f"model2_{part}_{measure}"
        for part in ("full", "legs")
        for measure in ("position_cm", "velocity_cm_s", "acceleration_m_s2")
    }
    assert wanted | {"paper_best_mpjpe_cm"} <= set(numbers)
    assert numbers["paper_best_mpjpe_cm"] == numbers["model2_full_position_cm"]
    names = {path.name for path in (tmp_path / "tables").iterdir()}
    assert names == {"hmd-vae.csv", "hmd-vae-metrics.csv"}
