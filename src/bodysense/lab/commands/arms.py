"""`bodysense train arms`, `arms-table`, `bodysense evaluate pahmt-table1`, `bodysense bench arms` (PAHMT)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.errors import BodysenseError
from bodysense.lab.commands.reporting import Common, checked, finish, progress_over
from bodysense.lab.options import Flat, Output

if TYPE_CHECKING:
    from bodysense.lab.pahmt.train import ArmRun
    from bodysense.lab.pahmt.windows import Studio

Keypoints = Literal["detected", "perfect"]


@dataclass(frozen=True)
class ArmOptions:
    """Size and schedule, the paper's by default."""

    width: int = 512
    """width of the features over time; a multiple of 16"""
    layers: int = 4
    """Layers over time."""
    spatial_width: int = 64
    """width of a token of the branch over joints"""
    spatial_layers: int = 2
    """Layers of that branch."""
    dropout: float = 0.1
    """dropout of all networks"""
    epochs: int = 300
    """Times that every window is seen, each time by another camera."""
    batch: int = 128
    """Windows a step."""
    learning_rate: float = 1e-3
    """At the start."""
    halve_every: int = 50
    """Epochs after which it is halved."""
    weight_decay: float = 5e-4
    """Of Adam."""
    bodies: int = 1
    """copies of each clip; all but the first are augmented: other proportions, arms that wander, arms of other clips"""
    keypoints: Keypoints = "detected"
    """With the errors of a detector, or without any."""
    seed: int = 1
    """random seed"""
    threads: int | None = None
    """PyTorch threads; its own choice if omitted"""


def arms(
    data: Path,
    out: Output,
    model: Literal["cnn", "ahmt", "pahmt"] = "pahmt",
    input: Literal["hands", "arms-hands"] = "arms-hands",
    losses: tuple[Literal["rotation", "smooth", "fk", "gan", "motion"], ...] = ("rotation", "smooth", "fk", "gan"),
    rotation_weight: float = 1.0,
    smooth_weight: float = 1.0,
    fk_weight: float = 1.0,
    gan_weight: float = 0.05,
    motion_weight: float = 10.0,
    arms_factor: float = 1.0,
    rotation: Literal["axis-angle", "6d"] = "axis-angle",
    more_inputs: bool = False,
    from_directions: bool = False,
    from_palms: bool = False,
    without_hands: float = 0.0,
    schedule: Flat[ArmOptions] = ArmOptions(),
    licence: str = "Apache-2.0",
    data_note: str = "",
) -> None:
    """Train arms and hands from key-points of a video (PAHMT). Training resumes after a stop.

    Args:
        data: A folder of motion files or a prepared store; of its train split the clips with fingers are learned, the
            weights that do best on those of its val split are kept.
        out: NAME.onnx, with the weights beside it as NAME.pt, or NAME.pt alone; checkpoint and log lie beside.
        model: Temporal convolutions, a transformer over time, or that with a branch over joints.
        input: 'hands' sees hands alone and answers for fingers alone.
        losses: rotation, smooth, fk and gan are the paper's; motion compares the change of positions.
        rotation_weight: weight of the loss of rotations.
        smooth_weight: weight of the change from frame to frame.
        fk_weight: weight of joint positions, per metre.
        gan_weight: weight of the adversarial loss.
        motion_weight: weight of the difference of changes, per metre; only where --losses has motion.
        arms_factor: How much more a joint of an arm counts in the loss of rotations than one of a finger.
        rotation: What is regressed.
        more_inputs: Read the torso's turn, the hands' place and size, and what was found; for use, not for the table.
        from_directions: Blend with arms whose elbows are hinges, as the directions of their bones have them; with '6d'.
        from_palms: Blend with wrists as the pictures of palms have them; with --from-directions.
        without_hands: Share of windows from recordings without fingers, of which the arms are learned.
        schedule: Size and schedule.
        licence: licence of the network, for its card.
        data_note: what it was trained on, for its card.
    """
    if out.suffix not in (".onnx", ".pt"):
        raise BodysenseError(f"{out}: a network is written as .onnx or .pt; give a name that ends so")
    if input == "hands" and out.suffix == ".onnx":
        raise BodysenseError(f"{out}: a network of hands alone is for the table only; give a name that ends in .pt")
    if not 0 <= without_hands < 1:
        raise BodysenseError(f"--without-hands {without_hands:g}: give a share from 0 to below 1")

    from bodysense.lab.pahmt.train import run_arms

    run = _run(data, out, schedule)
    config = replace(run.config, kind=model, input=input, rotation=rotation, more_inputs=more_inputs)
    config = replace(config, from_directions=from_directions, from_palms=from_palms)
    trained = replace(
        run.schedule,
        losses=losses,
        rotation=rotation_weight,
        smooth=smooth_weight,
        fk=fk_weight,
        gan=gan_weight,
        arms=arms_factor,
        motion=motion_weight if "motion" in losses else 0.0,
        without_hands=without_hands,
    )
    run_arms(replace(run, config=config, schedule=trained, licence=licence, data_note=data_note))


def arms_table(
    data: Path,
    out: Output,
    networks: tuple[str, ...] = (),
    schedule: Flat[ArmOptions] = ArmOptions(),
    data_note: str = "",
) -> None:
    """Train every network of PAHMT's Table 1 into one folder; `bodysense evaluate pahmt-table1` reads it.

    Training resumes after a stop.

    Args:
        data: A folder of motion files or a prepared store; of its train split the clips with fingers are learned.
        out: The folder.
        networks: some of them only: cnn-hands, cnn-plain, cnn-smooth, cnn-fk, cnn, ahmt, pahmt.
        schedule: Size and schedule.
        data_note: What they were trained on, for their cards.
    """
    from bodysense.lab.pahmt.rows import TABLE_1
    from bodysense.lab.pahmt.train import run_table

    run_table(replace(_run(data, out, schedule), data_note=data_note), networks or tuple(TABLE_1))


def pahmt_table1(
    data: str,
    networks: Path,
    model: Path | None = None,
    keypoints: Keypoints = "detected",
    stride: int = 5,
    seed: int = 1,
    common: Flat[Common] = Common(),
) -> None:
    """PAHMT, Table 1: CNN, AHMT and PAHMT; hands alone; with and without each loss.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table. Clips with fingers count.
        networks: The folder into which `bodysense train arms-table` wrote the networks.
        model: The .pt of a network of other settings (`bodysense train arms`), for a row beside.
        keypoints: With the errors of a detector, or without any.
        stride: Frames from one window to the next.
        seed: random seed of cameras and of the detector's errors.
        common: Common options; one process does it.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.pahmt.tables import arm_report, rows_in, score_arms

    checked(common, stride)
    chosen, rows = named_data(data, common.split, common.quick), rows_in(networks, model)
    with progress_over([chosen]) as advance:
        scored = score_arms(rows, chosen, stride, seed, advance, _studio(keypoints))
    finish(arm_report(scored, chosen, keypoints == "perfect"), common)


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
    from bodysense.estimators.arms import Arms, ArmSettings, load_arms
    from bodysense.lab.commands.bench import percentiles, report
    from bodysense.occlusion.camera_view import FRONT, sample_cameras, view, view_points

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


def _studio(keypoints: Keypoints) -> Studio:
    from bodysense.lab.pahmt.windows import Studio

    return Studio(noise=None) if keypoints == "perfect" else Studio()


def _run(data: Path, out: Path, chosen: ArmOptions) -> ArmRun:
    from bodysense.lab.pahmt.network import ArmNetworkConfig
    from bodysense.lab.pahmt.task import ArmSchedule
    from bodysense.lab.pahmt.train import ArmRun

    for name in ("epochs", "batch", "halve_every", "bodies"):
        if getattr(chosen, name) < 1:
            raise BodysenseError(f"--{name.replace('_', '-')} {getattr(chosen, name)}: give at least 1")
    config = ArmNetworkConfig(
        width=chosen.width,
        layers=chosen.layers,
        spatial_width=chosen.spatial_width,
        spatial_layers=chosen.spatial_layers,
        dropout=chosen.dropout,
    )
    schedule = ArmSchedule(
        epochs=chosen.epochs,
        batch=chosen.batch,
        learning_rate=chosen.learning_rate,
        halve_every=chosen.halve_every,
        weight_decay=chosen.weight_decay,
        studio=_studio(chosen.keypoints),
        seed=chosen.seed,
    )
    return ArmRun(data, out, config, schedule, chosen.bodies, chosen.threads)
