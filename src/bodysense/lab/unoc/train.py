"""Whole trainings of the body network, finger synthesis and the three-point upper body: data, variations, export."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache, partial
from typing import Literal, TypeVar

import numpy as np
import torch
from rich.progress import track

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.clip import Clip
from bodysense.lab.clips import open_clips
from bodysense.lab.fit import begin, fit, launched
from bodysense.lab.unoc.episodes import RATE, Episode, Variation, make_episode
from bodysense.lab.unoc.export import write_onnx, write_point_network
from bodysense.lab.unoc.losses import LossWeights
from bodysense.lab.unoc.network import PAPER, BodyNetwork, BodyNetworkConfig
from bodysense.lab.unoc.options import BodyTraining, PointTraining
from bodysense.lab.unoc.point_episodes import PointEpisode, PointVariation, make_point_episode
from bodysense.lab.unoc.point_model import Task
from bodysense.lab.unoc.point_network import (
    FINGERS,
    PAPER_FINGERS,
    PAPER_UPPER_BODY,
    UPPER_BODY,
    PointNetwork,
    PointNetworkConfig,
)
from bodysense.lab.unoc.point_task import PointSchedule, PointTask
from bodysense.lab.unoc.task import BodySchedule, BodyTask

E = TypeVar("E", Episode, PointEpisode)
# What a wearer meets counts more than the error of a joint that is seen: the measured place overrides that one.
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
    fabric = launched(run.devices)
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
    episodes = _prepared(open_clips(run.data, "train"), make, "seeing the train split")
    validation = _prepared(open_clips(run.data, "val"), watched, "seeing the val split")
    minutes = sum(len(episode) for episode in episodes) / 30 / 60
    print(f"{len(episodes)} clips, {minutes:.0f} minutes, {network.features} features a frame")
    scores = fit(BodyTask(network, schedule, episodes, validation), run.out.with_suffix(".ckpt"), fabric=fabric)
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
    config = CONFIGS[run.task, run.form]
    schedule = run.paced(replace(SCHEDULES[run.task, run.form], steps=run.steps))
    network = PointNetwork(config, default_skeleton())
    variations = VARIATIONS[run.task] if run.form == "shipped" else PAPER_VARIATIONS
    episodes = _point_episodes_in(run, config, "train", variations)
    validation = _point_episodes_in(run, config, "val", (PointVariation(),))
    minutes = sum(len(episode) for episode in episodes) / 1800
    print(f"{len(episodes)} episodes, {minutes:.0f} minutes, {network.features} features a frame")
    scores = fit(PointTask(network, schedule, episodes, validation), run.out.with_suffix(".ckpt"))
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{len(episodes)} episodes, {minutes:.0f} minutes at 30 Hz",
        "form": run.form,
        "seed": run.seed,
        "validation": {"rmsjpe_cm": round(scores["rmsjpe_cm"], 2)},
    }
    write_point_network(network, run.out, run.task, card)
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
    clips = (clip for clip in open_clips(run.data, split) if run.task != "fingers" or clip.has_fingers)
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
