"""`bodysense train hmd-vae`, `bodysense evaluate hmd-vae`: the paper's variational autoencoders and its figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from bodysense.errors import BodysenseError
from bodysense.lab.commands.reporting import Common, checked, finish
from bodysense.lab.options import Flat, Output, check_positive


def hmd_vae(
    data: Path,
    out: Output,
    model: Literal[0, 1, 2, 3, 4] | None = None,
    decoder: Path | None = None,
    latent: Literal[15, 30, 60] | None = None,
    beta: float | None = None,
    blocks: Literal[3, 6] | None = None,
    samples: int = 1,
    origin: Literal["head", "pelvis"] = "head",
    steps: int = 6000,
    batch: int = 256,
    sweep: bool = False,
    grid: Literal["one", "few", "all"] | None = None,
    split_file: Path | None = None,
    seed: int = 1,
    threads: int | None = None,
    devices: int = 1,
    nodes: int = 1,
    licence: str = "Apache-2.0",
    data_note: str = "",
) -> None:
    """Train HMD-VAE, a whole body from a headset and two hands. Training resumes after a stop.

    Args:
        data: A folder of motion files or a prepared store; its train split is learned, but for 5 % of the sequences of
            each data set that are held out; its val split is watched.
        out: NAME.onnx, with the weights beside it as NAME.pt, or NAME.pt alone; checkpoint and log lie beside. Of a
            sweep: the folder.
        model: 0 sees the whole body; 1 head and hands now; 2 their last half second; 3 and 4 are 1 and 2 with the
            decoder of a model 0, which stays as it is. 2 by default; a sweep trains all.
        decoder: The .pt of a trained model 0, for models 3 and 4.
        latent: Numbers that make a body; 30 by default.
        beta: Weight of the divergence from the prior; 0.01 by default.
        blocks: Residual blocks of encoder and decoder; 3 by default.
        samples: Draws of the posterior a step.
        origin: 'head' is under the headset; 'pelvis', the paper's, knows where the pelvis is and faces, as no headset
            does, and cannot be exported.
        steps: Optimiser steps.
        batch: Windows a step.
        sweep: Train models 0 to 4 of many settings into the folder `out`, with results.csv; what is there is kept.
        grid: settings of a sweep. 'one': the setting of --latent, --beta, --blocks. 'few', the default: beta 0.01 and
            1, latent 30, blocks 3 and 6: 20 networks. 'all': the paper's 30 settings, 150 networks.
        split_file: Lines 'PATH train' or 'PATH test' instead of the split by person, for a published protocol; the
            sequences that are held out are then watched.
        seed: random seed.
        threads: PyTorch threads; its own choice if omitted.
        devices: Accelerators, where there are any.
        nodes: Machines that share each network's training: start it on each with `torchrun`; they share `out`'s folder.
        licence: licence of the network, for its card.
        data_note: what it was trained on, for its card.
    """
    check_positive(steps=steps, batch=batch)
    if not sweep and out.suffix not in (".onnx", ".pt"):
        raise BodysenseError(f"{out}: a network is written as .onnx or .pt; give a name that ends so")
    if sweep and (out.suffix in (".onnx", ".pt") or decoder is not None):
        raise BodysenseError("--sweep trains its own decoders into a folder; give a folder as --out, and no --decoder")
    if not sweep and grid is not None:
        raise BodysenseError(f"--grid {grid} is of a sweep; add --sweep, or leave --grid out")
    if sweep and model is not None:
        raise BodysenseError(f"--sweep trains models 0 to 4; leave --model {model} out")
    setting = {"latent": latent, "beta": beta, "blocks": blocks}
    given = {name: value for name, value in setting.items() if value is not None}
    if sweep and grid != "one" and given:
        options = " ".join(f"--{name} {value}" for name, value in given.items())
        raise BodysenseError(f"--grid {grid or 'few'} has settings of its own; leave {options} out, or give --grid one")
    if not sweep and out.suffix == ".onnx" and origin != "head":
        raise BodysenseError(
            f"{out}: no device tracks the {origin}, so a network with that origin is not exported; give a name that "
            "ends in .pt, or --origin head"
        )

    from bodysense.lab.hmd_vae.network import BodyVaeConfig
    from bodysense.lab.hmd_vae.task import VaeSchedule
    from bodysense.lab.hmd_vae.train import VaeRun, run_sweep, run_vae, sweep_configs

    chosen = given if model is None else {**given, "model": model}
    config = replace(BodyVaeConfig(samples=samples, origin=origin), **chosen)
    run = VaeRun(
        data=data,
        out=out,
        config=config,
        schedule=VaeSchedule(steps=steps, batch=batch, seed=seed),
        decoder=decoder,
        split_file=split_file,
        threads=threads,
        devices=devices,
        nodes=nodes,
        licence=licence,
        data_note=data_note,
    )
    if sweep:
        run_sweep(run, sweep_configs(config, grid or "few"))
    else:
        run_vae(run)


def hmd_vae_figures(
    data: str,
    networks: Path,
    split_file: Path | None = None,
    threads: int | None = None,
    common: Flat[Common] = Common(),
) -> None:
    """HMD-VAE, Figs 5 to 7: models 1 to 4 with and without history, from scratch and pretrained, 3 and 6 blocks.

    A second table has the measures of later papers, with published figures.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        networks: The folder into which `bodysense train hmd-vae` wrote the networks.
        split_file: list they were trained with: its motions 'PATH test' are scored instead of a split by person.
        threads: PyTorch threads; its own choice if omitted.
        common: Common options.
    """
    from rich.progress import Progress, track

    from bodysense.lab.datasets import named_data
    from bodysense.lab.hmd_vae.frames import read_split_file
    from bodysense.lab.hmd_vae.scores import read_test, score_vae, vaes_in
    from bodysense.lab.hmd_vae.tables import metrics_report, vae_report

    if split_file is not None and (common.split != "test" or common.quick):
        raise BodysenseError("--split-file scores its own test motions; leave --split and --quick out")
    checked(common)
    chosen, files = named_data(data, common.split, common.quick), vaes_in(networks)
    total = None if split_file is None else list(read_split_file(split_file).values()).count("test")
    with Progress() as progress:
        bar = progress.add_task("reading", total=chosen.count() if total is None else total)
        frames, census = read_test(
            chosen, lambda clip: progress.update(bar, advance=1, description=f"read {clip.name}"), split_file
        )
    scored = [score_vae(name, path, frames, threads) for name, path in track(files.items(), "scoring the networks")]
    figures, later = vae_report(scored, census, chosen), metrics_report(scored, census, chosen)
    if split_file is not None:
        listed = f"Of it, the test motions of {split_file}."
        figures, later = (replace(one, data=(*one.data, listed)) for one in (figures, later))
    finish(later, replace(common, json=None))
    finish(replace(figures, numbers=later.numbers | figures.numbers), common)
