"""`bodysense train arms`, `train arms-table` and `evaluate pahmt-table1` (PAHMT)."""

from __future__ import annotations

from pathlib import Path

from bodysense.ranges import Count, Seed
from bodysense_lab.commands.reporting import finish, open_data, progress_bar
from bodysense_lab.core.options import Data, Flat, Table, TableOptions
from bodysense_lab.papers.pahmt.options import ArmTableTraining, ArmTraining, VideoSimulation


def arms(run: Flat[ArmTraining]) -> None:
    """Train arms and hands from key-points of a video (PAHMT). Training resumes after a stop.

    Training takes the clips with fingers of the train split and keeps the weights that are best on the val split.
    It writes NAME.onnx with the weights next to it as NAME.pt, or NAME.pt alone.
    """
    from bodysense_lab.data.clips import clips_of
    from bodysense_lab.papers.pahmt.train import run_arms

    run_arms(run, clips_of(run))


def arms_table(run: Flat[ArmTableTraining]) -> None:
    """Train every network of PAHMT's Table 1 into one folder; `bodysense evaluate pahmt-table1` reads it.

    Training resumes after a stop.
    """
    from bodysense_lab.data.clips import clips_of
    from bodysense_lab.papers.pahmt.train import run_table

    run_table(run, clips_of(run))


def pahmt_table1(
    data: Data,
    networks: Path,
    model: Path | None = None,
    studio: Flat[VideoSimulation] = VideoSimulation(),
    stride: Count = 5,
    seed: Seed = 1,
    table: Table = TableOptions(),
) -> None:
    """PAHMT, Table 1: CNN, AHMT and PAHMT; hands alone; with and without each loss.

    Only clips with fingers are scored, in one process.

    Args:
        networks: folder that `bodysense train arms-table` wrote.
        model: .pt of a network with other settings, written by `bodysense train arms`, for one more row.
        stride: frames between the starts of windows.
        seed: random seed of cameras and of the detector's errors.
    """
    from bodysense_lab.papers.pahmt.tables import arm_report, rows_in, score_arms

    chosen, rows = open_data(data, table), rows_in(networks, model)
    with progress_bar("scored", chosen.count()) as advance:
        scored = score_arms(rows, chosen, stride, seed, advance, studio)
    finish(arm_report(scored, chosen, studio.keypoints == "perfect"), table)
