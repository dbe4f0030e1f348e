"""`bodysense train hmd-vae` and `evaluate hmd-vae`: the paper's variational autoencoders and its figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.io.reading_options import AS_FOUND
from bodysense.ranges import Processes
from bodysense_lab.commands.reporting import finish, open_data, progress_bar, with_progress_bar
from bodysense_lab.core.options import Data, Flat, Output, Table, TableOptions, check_ending
from bodysense_lab.papers.hmd_vae.options import VaeTraining, check_list


def hmd_vae(run: Flat[VaeTraining]) -> None:
    """Train HMD-VAE, a whole body from a headset and two hands. Training resumes after a stop.

    5 % of the sequences of each data set in the train split are held out. The command writes NAME.onnx with the weights
    next to it as NAME.pt, or NAME.pt alone; a sweep writes a folder.
    """
    from bodysense_lab.papers.hmd_vae.listed_clips import vae_clips_of
    from bodysense_lab.papers.hmd_vae.train import run_sweep, run_vae, sweep_configs

    if run.sweep:
        run_sweep(run, sweep_configs(run.config, run.grid or "few"), vae_clips_of(run))
    else:
        run_vae(run, vae_clips_of(run))


def hmd_vae_figure4(
    motion: Annotated[Path, tyro.conf.Positional],
    out: Output,
    networks: tuple[Path, ...] = (),
    span: tuple[float, float] | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """HMD-VAE, Fig. 4: draw a motion by several models below the truth, with joints coloured by their error.

    Args:
        motion: motion, such as a walk: .bvh, AMASS or SMPL .npz, .glb.
        out: picture, .png or .webp.
        networks: networks that `bodysense train hmd-vae` wrote as .onnx, a row each; the packaged one if omitted.
        span: first and last second that is drawn; the whole motion if omitted.
        reading: properties that the file does not contain.
    """
    from bodysense.cli.recordings import load_clip
    from bodysense.files import check_place
    from bodysense_lab.papers.hmd_vae.figure import draw_reconstructions, frames_within, mean_errors, reconstructed

    check_place(out)
    check_ending(out, ".png", ".webp", what="a picture")
    clip = load_clip(motion, reading)
    frames_within(clip, span)
    rows = reconstructed(clip, {path.stem: path for path in networks} or {"model 4": None})
    draw_reconstructions(out, clip, rows, span)
    for name, error in mean_errors(clip, rows, span).items():
        print(f"{name}: {error:.2f} cm")
    print(f"wrote {out}")


def hmd_vae_figures(
    data: Data,
    networks: Path,
    split_file: Path | None = None,
    threads: Processes | None = None,
    table: Table = TableOptions(),
) -> None:
    """HMD-VAE, Figs 5 to 7: models 1 to 4 with and without history, from scratch and pretrained, 3 and 6 blocks.

    A second table has the measures of later papers, with published figures.

    Args:
        networks: folder that `bodysense train hmd-vae` wrote, or one network as .onnx.
        split_file: list of the training; its motions 'PATH test' are scored instead of a split by person.
        threads: PyTorch threads; its own choice if omitted.
    """
    from bodysense_lab.papers.hmd_vae.scores import read_test, score_vae, vaes_in
    from bodysense_lab.papers.hmd_vae.split_list import read_split_file
    from bodysense_lab.papers.hmd_vae.tables import metrics_report, vae_report

    check_list(split_file)
    if split_file is not None and (table.split != "test" or table.quick):
        raise BodysenseError("--split-file scores its own test motions; leave --split and --quick out")
    chosen, files = open_data(data, table), vaes_in(networks)
    total = chosen.count() if split_file is None else list(read_split_file(split_file).values()).count("test")
    with progress_bar("read", total) as advance:
        frames, census = read_test(chosen, advance, split_file)
    scored = [score_vae(name, files[name], frames, threads) for name in with_progress_bar(files, "scored", len(files))]
    figures, later = vae_report(scored, census, chosen), metrics_report(scored, census, chosen)
    if split_file is not None:
        listed = f"Of it, the test motions of {split_file}."
        figures, later = (replace(one, data=(*one.data, listed)) for one in (figures, later))
    finish(later, replace(table, json=None))
    finish(replace(figures, numbers=later.numbers | figures.numbers), table)
