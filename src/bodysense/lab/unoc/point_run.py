"""A whole training run of finger synthesis or of the three-point upper body: data, variations, training, export."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from rich.console import Console
from rich.progress import track

from bodysense.body.skeleton import default_skeleton
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.lab.clips import open_clips
from bodysense.lab.unoc.finger_configs import FINGERS, PAPER_FINGERS
from bodysense.lab.unoc.point_episodes import PointEpisode, PointVariation, make_point_episode
from bodysense.lab.unoc.point_model import Task
from bodysense.lab.unoc.point_network import PointNetwork, PointNetworkConfig
from bodysense.lab.unoc.point_onnx import write_point_network
from bodysense.lab.unoc.regression import PointSchedule, train_points
from bodysense.lab.unoc.training import Progress
from bodysense.lab.unoc.upper_body_configs import PAPER_UPPER_BODY, UPPER_BODY

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


@dataclass(frozen=True)
class PointRun:
    """What `bodysense train fingers` or `bodysense train upper-body` was asked for."""

    task: Task
    data: Path
    out: Path
    form: Form
    steps: int
    seed: int
    threads: int | None
    licence: str
    data_note: str


def run_points(run: PointRun) -> None:
    """Train, export, and leave the log (`.jsonl`) and checkpoint (`.ckpt`) beside the network."""
    check_place(run.out)
    if run.threads is not None:
        torch.set_num_threads(run.threads)
    torch.manual_seed(run.seed)
    console = Console()
    config = CONFIGS[run.task, run.form]
    schedule = replace(SCHEDULES[run.task, run.form], steps=run.steps, seed=run.seed)
    network = PointNetwork(config, default_skeleton())
    episodes = prepare(run, config, "train", VARIATIONS[run.task] if run.form == "shipped" else PAPER_VARIATIONS)
    validation = prepare(run, config, "val", (PointVariation(),))
    frames = sum(len(episode) for episode in episodes)
    console.print(f"{len(episodes)} episodes, {frames / 1800:.0f} minutes, {network.features} features a frame")
    log = run.out.with_suffix(".jsonl")

    def report(progress: Progress) -> None:
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(vars(progress)) + "\n")
        scores = ", ".join(f"{name} {value:.2f}" for name, value in progress.validation.items())
        loss = progress.terms["loss"]
        console.print(
            f"step {progress.step}/{progress.steps}, {progress.seconds:.0f} s, loss {loss:.4f}; {scores}",
            highlight=False,
        )

    network, score = train_points(network, schedule, episodes, validation, run.out.with_suffix(".ckpt"), report)
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{len(episodes)} episodes, {frames / 1800:.0f} minutes at 30 Hz",
        "form": run.form,
        "seed": run.seed,
        "validation": {"rmsjpe_cm": round(score, 2)},
    }
    write_point_network(network, run.out, run.task, card)
    console.print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def prepare(
    run: PointRun, config: PointNetworkConfig, split: Literal["train", "val"], variations: tuple[PointVariation, ...]
) -> list[PointEpisode]:
    """The clips of a split as episodes, an episode a variation; for fingers, clips that have them."""
    make = partial(_episodes_of, config=config, variations=variations, passes=PASSES[run.task], seed=run.seed)
    clips = (clip for clip in open_clips(run.data, split) if run.task != "fingers" or clip.has_fingers)
    with ProcessPoolExecutor(run.threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        made = track(pool.map(make, enumerate(clips), chunksize=4), description=f"preparing the {split} split")
        episodes = [episode for several in made for episode in several]
    if not episodes:
        raise BodysenseError(f"{run.data}: no clip of its {split} split has fingers; give motion with recorded fingers")
    return episodes


def _episodes_of(
    numbered: tuple[int, Clip],
    config: PointNetworkConfig,
    variations: tuple[PointVariation, ...],
    passes: int,
    seed: int,
) -> list[PointEpisode]:
    """Every clip and variation has a generator of its own, so that the order of work does not matter."""
    index, clip = numbered
    network = _untrained(config)
    chosen = variations if clip.has_fingers else variations[:passes]
    return [
        make_point_episode(clip, network, variation, np.random.default_rng([seed, number, index]))
        for number, variation in enumerate(chosen)
    ]


@lru_cache(maxsize=1)
def _untrained(config: PointNetworkConfig) -> PointNetwork:
    """A network that prepares features in a worker; its weights do not matter for that."""
    return PointNetwork(config, default_skeleton())
