"""Whole trainings of the body network, finger synthesis and the three-point upper body: data, variations, export.

Writing UNOC's networks, each as one self-describing ONNX file.

How fast a network trains: on windows, as in the paper, beside whole sequences with carried state.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import torch
from rich.progress import track
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.three_point import POINTS
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.clip import Clip
from bodysense.papers.point_model import FORMAT as POINT_FORMAT
from bodysense.papers.point_model import Task
from bodysense_lab.datasets import learned_clips
from bodysense_lab.export import export
from bodysense_lab.fit import begin, fit, launched
from bodysense_lab.unoc.learned import FORMAT
from bodysense_lab.unoc.network import PAPER, BodyNetwork, BodyNetworkConfig, PredictorState, TrackedBody
from bodysense_lab.unoc.options import BodyTraining, PointTraining
from bodysense_lab.unoc.point_network import (
    FINGERS,
    PAPER_FINGERS,
    PAPER_UPPER_BODY,
    UPPER_BODY,
    PointNetwork,
    PointNetworkConfig,
    TrackedPoints,
)
from bodysense_lab.unoc.point_task import PointEpisode, PointSchedule, PointTask, PointVariation, make_point_episode
from bodysense_lab.unoc.task import RATE, BodySchedule, BodyTask, Episode, LossWeights, Variation, make_episode


class _BodyStep(nn.Module):
    """The network with its state spelled out as separate inputs and outputs."""

    def __init__(self, model: BodyNetwork) -> None:
        super().__init__()
        self.model = model

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        count = len(TrackedBody._fields)
        completed, state = self.model(TrackedBody(*values[:count]), PredictorState(*values[count:]))
        return (*completed, *state)


def write_onnx(model: BodyNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export one streaming step of `model` with its metadata; large weights in half precision.

    `card` holds what a user should know: training data, licence, test figures, and `fastest_rate`, Hz, where the
    network was taught to step faster than at `RATE`. The file appears whole or not at all.
    """
    model = model.eval()
    points = len(model.skeleton.points)
    state = model.start(1)
    tracked = TrackedBody(
        position=torch.zeros(1, 1, points, 3),
        visible=torch.ones(1, 1, points, dtype=torch.bool),
        head_position=torch.zeros(1, 1, 3),
        head_rotation=torch.tensor([[[1.0, 0, 0, 0]]]),
        interval=torch.full((1, 1), 1 / RATE),
        bone_length=model.typical_bone[None],
        height=torch.tensor([1.7]),
    )
    inputs = [*TrackedBody._fields, *(f"state_{name}" for name in PredictorState._fields)]
    outputs = ["completed", "occluded", "error", *(f"next_{name}" for name in PredictorState._fields)]
    start = {
        f"state_{name}": {"shape": list(value.shape), "dtype": str(value.numpy().dtype)}
        | ({"values": np.round(value.flatten().numpy().astype(float), 5).tolist()} if value.any() else {})
        for name, value in zip(PredictorState._fields, state, strict=True)
    }
    card = {
        "points": model.skeleton.points,
        "rate": RATE,
        "fastest_rate": RATE,
        "state": start,
        "network": vars(model.config),
        "weights": sum(parameter.numel() for parameter in model.parameters()),
        **card,
    }
    export(_BodyStep(model), (*tracked, *state), inputs, outputs, FORMAT, card, path)


class _PointStep(nn.Module):
    """The network with its inputs spelled out."""

    def __init__(self, network: PointNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.network(TrackedPoints(*values[:-1]), values[-1])


def write_point_network(network: PointNetwork, path: Path, task: Task, card: dict[str, Any]) -> None:
    """Export one streaming step with its metadata; large weights in half precision. Whole or not at all."""
    network = network.eval()
    skeleton, config = network.skeleton, network.config
    memory = network.start(1)
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    tracked = TrackedPoints(
        position=torch.zeros(1, 1, len(config.reads), 3),
        rotation=upright.expand(1, 1, len(POINTS), 4).clone(),
        rest=torch.zeros(1, len(config.places), 3),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.height], dtype=torch.float32),
    )
    card = {
        "task": task,
        "reads": config.reads,
        "places": config.places,
        "points": len(skeleton.points),
        "rate": RATE,
        "state": {"shape": list(memory.shape), "dtype": str(memory.numpy().dtype)},
        "network": asdict(config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **card,
    }
    inputs, outputs = [*TrackedPoints._fields, "state_memory"], ["placed", "error", "next_memory"]
    export(_PointStep(network), (*tracked, memory), inputs, outputs, POINT_FORMAT, card, path)


E = TypeVar("E", Episode, PointEpisode)
# Hidden joints count more: a tracked joint's measured position replaces the prediction.
SHIPPED_LOSS = LossWeights(occluded=3.0)
VARIED_RATES = (20.0, 60.0)  # Hz
Form = Literal["shipped", "paper"]
CONFIGS: dict[tuple[Task, Form], PointNetworkConfig] = {
    ("fingers", "shipped"): FINGERS,
    ("fingers", "paper"): PAPER_FINGERS,
    ("upper-body", "shipped"): UPPER_BODY,
    ("upper-body", "paper"): PAPER_UPPER_BODY,
}
# As recorded and mirrored, then both on other bodies. Of the upper body there are many clips: three passes suffice, two
# of them with wrists that bend where none were recorded; clips with fingers, which are few, take all.
VARIATIONS: dict[Task, tuple[PointVariation, ...]] = {
    "fingers": (
        PointVariation(),
        PointVariation(mirrored=True),
        *(PointVariation(mirrored=k % 2 == 1, limb_spread=0.05) for k in range(4)),
    ),
    "upper-body": (
        PointVariation(),
        PointVariation(mirrored=True, limb_spread=0.05, wrist_bend=0.25),
        PointVariation(limb_spread=0.05, wrist_bend=0.25),
        *(PointVariation(mirrored=k % 2 == 0, limb_spread=0.05) for k in range(5)),
    ),
}
PASSES: dict[Task, int] = {"fingers": 6, "upper-body": 3}  # of clips without recorded hands
PAPER_VARIATIONS = (PointVariation(), PointVariation(mirrored=True))
SCHEDULES: dict[tuple[Task, Form], PointSchedule] = {
    ("fingers", "shipped"): PointSchedule(
        batch=64, distance="squared", average_decay=0.98, check_every=50, weight_decay=0.5
    ),
    ("fingers", "paper"): PointSchedule(batch=256, average_decay=0.0),
    ("upper-body", "shipped"): PointSchedule(learning_rate=2e-3, check_every=500),
    ("upper-body", "paper"): PointSchedule(batch=256, average_decay=0.0),
}


def train_body(run: BodyTraining) -> None:
    """Train the body network and export it."""
    check_place(run.out)
    begin(run.seed, run.threads)
    fabric = launched(run.devices, run.nodes)
    forms = {"shipped": BodyNetworkConfig(), "paper": PAPER, "paper-world-axes": replace(PAPER, frame="world")}
    network = BodyNetwork(replace(forms[run.form], hidden=run.hidden), default_skeleton())
    shipped = run.form == "shipped"
    schedule = run.paced(
        BodySchedule(
            steps=run.steps,
            epochs=run.epochs,
            window_stride=run.window_stride,
            lanes=run.lanes,
            chunk=run.chunk,
            finger_share=run.finger_share,
            average_decay=0.999 if shipped else 0.0,
            loss=SHIPPED_LOSS if shipped else LossWeights(),
        )
    )
    variations = tuple(variation_of(number, shipped) for number in range(run.passes + run.finger_passes))
    make = partial(_body_episodes, config=network.config, variations=variations, passes=run.passes, seed=run.seed)
    watched = partial(_body_episodes, config=network.config, variations=(Variation(),), passes=1, seed=run.seed)
    episodes = _prepared(learned_clips(run.data, "train", run.limit), make, "seeing the train split")
    validation = _prepared(learned_clips(run.data, "val", run.limit), watched, "seeing the val split")
    minutes = sum(len(episode) for episode in episodes) / 30 / 60
    fabric.print(f"{len(episodes)} clips, {minutes:.0f} minutes, {network.features} features a frame")
    task = BodyTask(network, schedule, episodes, validation, run.limited or None)
    scores = fit(task, run.out.with_suffix(".ckpt"), fabric=fabric)
    if not fabric.is_global_zero:
        return
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{len(episodes)} clips, {minutes:.0f} minutes at 30 Hz",
        "form": run.form,
        "fastest_rate": VARIED_RATES[1] if shipped and len(variations) > 1 else RATE,
        "seed": run.seed,
        "validation": {f"{name}_occluded_rmsjpe_cm": round(value, 2) for name, value in scores.items()},
    }
    write_onnx(network.cpu(), run.out, card)
    print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def train_points(run: PointTraining) -> None:
    """Train a network that places points and export it."""
    check_place(run.out)
    begin(run.seed, run.threads)
    fabric = launched(run.devices, run.nodes)
    config = CONFIGS[run.task, run.form]
    schedule = run.paced(replace(SCHEDULES[run.task, run.form], steps=run.steps))
    network = PointNetwork(config, default_skeleton())
    variations = VARIATIONS[run.task] if run.form == "shipped" else PAPER_VARIATIONS
    episodes = _point_episodes_in(run, config, "train", variations)
    validation = _point_episodes_in(run, config, "val", (PointVariation(),))
    minutes = sum(len(episode) for episode in episodes) / 1800
    fabric.print(f"{len(episodes)} episodes, {minutes:.0f} minutes, {network.features} features a frame")
    task = PointTask(network, schedule, episodes, validation, run.limited or None)
    scores = fit(task, run.out.with_suffix(".ckpt"), fabric=fabric)
    if not fabric.is_global_zero:
        return
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{len(episodes)} episodes, {minutes:.0f} minutes at 30 Hz",
        "form": run.form,
        "seed": run.seed,
        "validation": {"rmsjpe_cm": round(scores["rmsjpe_cm"], 2)},
    }
    write_point_network(network.cpu(), run.out, run.task, card)
    print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def variation_of(number: int, shipped: bool) -> Variation:
    """How the n-th pass over the data differs: as recorded, then mirrored, then both again with other limbs."""
    if not shipped:
        return Variation(mirrored=number % 2 == 1)
    return Variation(
        mirrored=number % 2 == 1,
        limb_spread=0.0 if number == 0 else 0.05,
        hand_dropouts_per_minute=0.0 if number == 0 else 6.0,
        rates=(RATE, RATE) if number == 0 else VARIED_RATES,
    )


def _prepared(
    clips: Iterable[Clip], make: Callable[[tuple[int, Clip]], list[E]], what: str, processes: int | None = None
) -> list[E]:
    """The episodes of clips, prepared by several processes."""
    with ProcessPoolExecutor(processes, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        made = track(pool.map(make, enumerate(clips), chunksize=4), description=what)
        return [episode for episodes in made for episode in episodes]


def _point_episodes_in(
    run: PointTraining,
    config: PointNetworkConfig,
    split: Literal["train", "val"],
    variations: tuple[PointVariation, ...],
) -> list[PointEpisode]:
    """The clips of a split as episodes, an episode a variation; for fingers, clips that have them."""
    make = partial(_point_episodes, config=config, variations=variations, passes=PASSES[run.task], seed=run.seed)
    clips = (clip for clip in learned_clips(run.data, split, run.limit) if run.task != "fingers" or clip.has_fingers)
    episodes = _prepared(clips, make, f"preparing the {split} split", run.threads)
    if not episodes:
        raise BodysenseError(f"{run.data}: no clip of its {split} split has fingers; give motion with recorded fingers")
    return episodes


# Every clip and variation has a generator of its own, so that the order of work does not matter. Of the variations a
# clip without fingers takes the first `passes` only. The weights of a network that prepares features do not matter.


def _body_episodes(
    numbered: tuple[int, Clip], config: BodyNetworkConfig, variations: tuple[Variation, ...], passes: int, seed: int
) -> list[Episode]:
    index, clip = numbered
    network = _body_reader(config)
    return [
        make_episode(clip, network, variation, np.random.default_rng([seed, number, index]))
        for number, variation in enumerate(variations if clip.has_fingers else variations[:passes])
    ]


def _point_episodes(
    numbered: tuple[int, Clip],
    config: PointNetworkConfig,
    variations: tuple[PointVariation, ...],
    passes: int,
    seed: int,
) -> list[PointEpisode]:
    index, clip = numbered
    network = _point_reader(config)
    return [
        make_point_episode(clip, network, variation, np.random.default_rng([seed, number, index]))
        for number, variation in enumerate(variations if clip.has_fingers else variations[:passes])
    ]


@lru_cache(maxsize=1)
def _body_reader(config: BodyNetworkConfig) -> BodyNetwork:
    return BodyNetwork(config, default_skeleton())


@lru_cache(maxsize=1)
def _point_reader(config: PointNetworkConfig) -> PointNetwork:
    return PointNetwork(config, default_skeleton())


def throughput(clip: Clip, steps: int, threads: int) -> dict[str, float]:
    """Windows and taught frames a second of the paper's GRU on windows and on sequences; and their ratio.

    Both train the same layers with the losses of the paper, in the precision and batch sizes that training uses.
    """
    torch.set_num_threads(threads)
    schedule = BodySchedule(epochs=10**6, epoch_batches=(1024,) * 10**3)
    found: dict[str, float] = {}
    for form, config in (("window", PAPER), ("sequence", replace(PAPER, window=None))):
        model = BodyNetwork(config, default_skeleton())
        episode = make_episode(clip, model, Variation(), np.random.default_rng(0))
        episodes = [episode] * 4  # more windows than a batch holds
        task = BodyTask(model, schedule, episodes, [])
        optimizer, memory, rng = task.optimizer(), None, np.random.default_rng(0)
        frames, begun = 0, 0.0
        for step, batch in enumerate(itertools.islice(task.batches(rng), steps + 1)):
            if step == 1:
                frames, begun = 0, time.perf_counter()
            terms, memory = task.loss(batch, memory)
            optimizer.zero_grad()
            terms["loss"].backward()
            optimizer.step()
            frames += int(batch.valid.sum()) if config.window is None else len(batch.valid)
        found[f"{form}_frames_per_second"] = frames / (time.perf_counter() - begun)
    found["windows_per_second"] = found["window_frames_per_second"]
    found["ratio"] = found["sequence_frames_per_second"] / found["window_frames_per_second"]
    return found
