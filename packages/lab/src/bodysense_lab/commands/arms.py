"""`bodysense train arms`, `arms-table`, `bodysense evaluate pahmt-table1`, `bodysense bench arms` (PAHMT)."""

from __future__ import annotations

from pathlib import Path

from bodysense_lab.commands.reporting import finish, open_data, progress_over
from bodysense_lab.options import Flat
from bodysense_lab.pahmt.options import ArmEvaluation, ArmTableTraining, ArmTraining


def arms(run: Flat[ArmTraining]) -> None:
    """Train arms and hands from key-points of a video (PAHMT). Training resumes after a stop.

    Training takes the clips with fingers of the train split and keeps the weights that are best on the val split.
    It writes NAME.onnx with the weights next to it as NAME.pt, or NAME.pt alone.
    """
    from bodysense_lab.pahmt.train import run_arms

    run_arms(run)


def arms_table(run: Flat[ArmTableTraining]) -> None:
    """Train every network of PAHMT's Table 1 into one folder; `bodysense evaluate pahmt-table1` reads it.

    Training resumes after a stop.
    """
    from bodysense_lab.pahmt.train import run_table

    run_table(run)


def pahmt_table1(run: Flat[ArmEvaluation]) -> None:
    """PAHMT, Table 1: CNN, AHMT and PAHMT; hands alone; with and without each loss. One process does it."""
    from bodysense_lab.pahmt.tables import arm_report, rows_in, score_arms

    chosen, rows = open_data(run.data, run.table), rows_in(run.networks, run.model)
    with progress_over([chosen]) as advance:
        scored = score_arms(rows, chosen, run.stride, run.seed, advance, run.studio)
    finish(arm_report(scored, chosen, run.studio.keypoints == "perfect"), run.table)


def bench_arms(frames: int = 2000, model: Path | None = None, json: Path | None = None) -> None:
    """Time the network of arms and hands on a window of 32 frames, and the estimator a frame at a time.

    Args:
        frames: Windows, and frames, to time, after 100 to warm up.
        model: A network written by `bodysense train arms`; the packaged one if omitted.
        json: Write the numbers here, as one flat object.
    """
    import numpy as np

    from bodysense.body.keypoints import ArmKeypoints
    from bodysense.demo import packaged_performance
    from bodysense.devices.simulated.camera_view import FRONT, sample_cameras, view, view_points
    from bodysense.devices.video.arms import Arms, ArmSettings, load_arms
    from bodysense_lab.commands.timing import percentiles, report

    clip, network = packaged_performance(), load_arms(model)
    points = view_points(clip.pose)
    camera = sample_cameras(points[:1], np.random.default_rng(0), FRONT)
    seen = view(points[None], clip.time, camera)
    keypoints = ArmKeypoints(seen.time, *(getattr(seen, name)[0] for name in list(vars(seen))[1:]))
    count = int(network.card["frames"])
    window = {name: np.nan_to_num(value[:count]) for name, value in vars(keypoints).items() if name != "time"}
    window = {name: value if value.dtype == bool else value.astype(np.float32) for name, value in window.items()}

    def whole(_: int) -> None:
        network.rotations(window)

    numbers = percentiles(whole, frames)
    for name, settings in (("frame", ArmSettings()), ("live_frame", ArmSettings(look_ahead=0.0))):
        estimator = Arms(clip.pose.skeleton, network, settings)
        state = estimator.start()

        def one(frame: int, estimator: Arms = estimator) -> None:
            nonlocal state
            place = frame % len(clip)
            state = estimator.step(keypoints[place : place + 1], estimator.start() if place == 0 else state)[1]

        numbers |= {f"{name}_{key}": value for key, value in percentiles(one, frames).items()}
    report("arms", numbers, json)
