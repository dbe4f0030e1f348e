"""`bodysense train hmd-vae`, `bodysense evaluate hmd-vae`: the paper's variational autoencoders and its figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.lab.commands.reporting import Common, checked, finish
from bodysense.lab.hmd_vae.options import VaeTraining
from bodysense.lab.options import Flat


def hmd_vae(run: Flat[VaeTraining]) -> None:
    """Train HMD-VAE, a whole body from a headset and two hands. Training resumes after a stop.

    Of the data's train split 5 % of the sequences of each data set are held out. Written is NAME.onnx, with the weights
    beside it as NAME.pt, or NAME.pt alone; of a sweep, a folder.
    """
    from bodysense.lab.hmd_vae.train import run_sweep, run_vae, sweep_configs

    if run.sweep:
        run_sweep(run, sweep_configs(run.config, run.grid or "few"))
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
