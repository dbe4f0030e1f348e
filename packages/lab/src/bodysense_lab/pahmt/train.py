"""A whole training run of a network of arms and hands, or of all that PAHMT's Table 1 compares; resumable."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from lightning_fabric import Fabric
from numpy.random import default_rng
from rich.progress import track
from torch import Tensor, nn

from bodysense.body.arms import ARM_JOINTS
from bodysense.body.rotation import normalize, quaternion_canonical
from bodysense.devices.video.arms import FORMAT
from bodysense.errors import BodysenseError
from bodysense.files import check_place, make_folder
from bodysense_lab.checkpoint import identity
from bodysense_lab.datasets import learned_clips, learned_count
from bodysense_lab.export import export, in_bytes
from bodysense_lab.fit import Report, begin, fit, is_same, launched, sweep
from bodysense_lab.pahmt.features import RATE, ArmRecordings, Window, read_arm_recordings
from bodysense_lab.pahmt.network import ArmNetwork, read_arms, write_arms
from bodysense_lab.pahmt.options import ArmRun, ArmTableTraining, ArmTraining
from bodysense_lab.pahmt.tables import TABLE_1
from bodysense_lab.pahmt.task import ArmTask, Pair, epoch_steps, step_count

_MOST = 63  # of each sign: 7 bits change arms by 0.19° in the mean, and their error by nothing


class OneWindow(nn.Module):
    """Network from captured key-points of one window to local rotations (B, T, 38, 4) of `ARM_JOINTS`.

    The network is asked twice, once in a mirror, and the mean of its answers taken: exactly as good with either hand.
    """

    def __init__(self, network: ArmNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> Tensor:
        """The fields of `Window`, in order."""
        window = Window(*values)
        both = Window(*(torch.cat(pair) for pair in zip(window, mirrored(window), strict=True)))
        said, reflected = self.network.quaternions(self.network(both)).chunk(2)
        reflected = mirrored_rotations(reflected)
        alike = torch.where((said * reflected).sum(dim=-1, keepdim=True) < 0, -reflected, reflected)
        return quaternion_canonical(normalize(said + alike))


def mirrored(window: Window) -> Window:
    """Mirror a window: swap left and right, and negate the picture's x."""
    flip = torch.tensor([-1.0, 1.0, 1.0])
    return Window(
        arm=window.arm.flip(2) * flip,
        has_arm=window.has_arm.flip(2),
        torso=window.torso * torch.tensor([1.0, 1.0, -1.0, -1.0]),
        has_torso=window.has_torso,
        hand=window.hand.flip(2) * flip[:2],
        has_hand=window.has_hand.flip(2),
    )


def mirrored_rotations(rotation: Tensor) -> Tensor:
    """Rotations (..., 38, 4) of `ARM_JOINTS` of the mirror image."""
    left, right = rotation.chunk(2, dim=-2)
    return torch.cat([right, left], dim=-2) * torch.tensor([1.0, 1.0, -1.0, -1.0])


def write_arms_onnx(network: ArmNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export the network with its card; large weights in 7 bits. The file appears whole or not.

    Raises BodysenseError for a network of hands alone: it has no arms to give.
    """
    config = network.config
    if config.input == "hands":
        raise BodysenseError(f"{path}: a network of hands alone is not for video; keep it as .pt, for the table")
    frames = config.frames
    example = Window(
        arm=torch.zeros(1, frames, 2, 2, 3),
        has_arm=torch.ones(1, frames, 2, dtype=torch.bool),
        torso=torch.tensor([1.0, 0, 0, 0]).expand(1, frames, 4).clone(),
        has_torso=torch.ones(1, frames, dtype=torch.bool),
        hand=torch.zeros(1, frames, 2, 21, 2),
        has_hand=torch.ones(1, frames, 2, dtype=torch.bool),
    )
    card = {
        "joints": ARM_JOINTS,
        "frames": frames,
        "rate": RATE,
        "network": asdict(config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **{name: value for name, value in card.items() if name != "identity"},
    }
    export(
        OneWindow(network.eval()),
        example,
        list(Window._fields),
        ["rotation"],
        FORMAT,
        card,
        path,
        shrink=partial(in_bytes, most=_MOST),
    )


@dataclass(frozen=True, eq=False)
class ArmData:
    """Training and validation data of a run."""

    train: ArmRecordings
    validation: ArmRecordings

    @property
    def note(self) -> str:
        """For a card."""
        return f"{len(self.train)} clips, {self.train.minutes:.0f} minutes at 30 Hz, as cameras would see them"


def read_data(run: ArmRun) -> ArmData:
    """The training split and the clips with hands of the validation split."""
    total = learned_count(run.data, "train", run.limit)
    clips = track(learned_clips(run.data, "train", run.limit), "reading the train split", total)
    stiff = run.schedule.without_hands > 0
    learned = read_arm_recordings(
        (clip for clip in clips if clip.has_fingers or stiff), run.bodies, default_rng(run.schedule.seed)
    )
    watched = read_arm_recordings(clip for clip in learned_clips(run.data, "val", run.limit) if clip.has_fingers)
    return ArmData(learned, watched)


def run_arms(run: ArmTraining) -> None:
    """Train one network; the weights (.pt), log (.jsonl) and checkpoint (.ckpt) are written next to `run.out`."""
    check_place(run.out)
    weights = run.out.with_suffix(".pt")
    fabric = launched(run.devices, run.nodes)
    if not is_trained(run, weights):
        data = read_data(run)
        fabric.print(f"{data.note}; {epoch_steps(data.train, run.schedule)} steps an epoch")
        train_network(run, weights, data, fabric)
    if not fabric.is_global_zero:
        return
    network, card = read_arms(weights)
    if run.out.suffix == ".onnx":
        write_arms_onnx(network, run.out, card)
    print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def run_table(run: ArmTableTraining) -> None:
    """Train what is not trained yet of the table's networks into the folder `run.out`."""
    names = run.networks or tuple(TABLE_1)
    unknown = [name for name in names if name not in TABLE_1]
    if unknown:
        raise BodysenseError(f"unknown network {unknown[0]!r}; valid are {', '.join(TABLE_1)}")
    make_folder(run.out)
    fabric = launched(run.devices, run.nodes)
    runs = {name: row_run(run, name) for name in names}
    if not all(is_trained(one, one.out) for one in runs.values()):
        data = read_data(run)

        def train(name: str, report: Report) -> str:
            train_network(runs[name], runs[name].out, data, fabric, report)
            figures = read_arms(runs[name].out)[1]["validation"]
            return f"trained {name}: " + ", ".join(f"{key} {value}" for key, value in figures.items())

        steps = dict.fromkeys(runs, step_count(data.train, run.schedule))
        quiet = not fabric.is_global_zero
        sweep(steps, train, lambda name: is_trained(runs[name], runs[name].out), run.out, quiet=quiet)
    fabric.print(f"{len(runs)} networks in {run.out}")


def row_run(run: ArmRun, name: str) -> ArmRun:
    """The run of one network of the table."""
    row = TABLE_1[name]
    config = replace(run.config, kind=row.kind, input=row.input)
    schedule = replace(run.schedule, losses=row.losses)
    plain = {one.name: getattr(run, one.name) for one in fields(ArmRun)}
    return ArmRun(**plain | {"out": run.out / f"{name}.pt", "config": config, "schedule": schedule})


def train_network(run: ArmRun, weights: Path, data: ArmData, fabric: Fabric, report: Report | None = None) -> None:
    """Train one network and write its weights, with a card that says what they are."""
    begin(run.schedule.seed, run.threads)
    begun, source, pair = time.monotonic(), source_of(run), Pair(ArmNetwork(run.config))
    task = ArmTask(pair, run.schedule, data.train, data.validation, source, fabric.global_rank)
    figures = fit(task, weights.with_suffix(".ckpt"), report, fabric, report)
    card = {
        "identity": identity(run.config, run.schedule, source),
        "licence": run.licence,
        "training_data": run.data_note or data.note,
        "seed": run.schedule.seed,
        "seconds": round(time.monotonic() - begun, 1),
        "validation": {name: round(value, 4) for name, value in figures.items()},
    }
    if fabric.is_global_zero:
        write_arms(pair.network.cpu(), weights, card)
    fabric.barrier()


def source_of(run: ArmRun) -> dict[str, Any]:
    """Return the sources of a run, for its identity."""
    return {"data": str(run.data.resolve()), "bodies": run.bodies, **run.limited}


def is_trained(run: ArmRun, weights: Path) -> bool:
    """Whether the weights are there, trained as this run asks. Raises BodysenseError if trained otherwise."""
    if not weights.is_file():
        return False
    now = identity(run.config, run.schedule, source_of(run))
    return is_same(weights, read_arms(weights)[1]["identity"], now)
