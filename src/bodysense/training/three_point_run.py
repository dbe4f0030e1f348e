"""A whole training run of the three-point network: data, variations, training, export."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from rich.console import Console
from rich.progress import track

from bodysense.data.clip import Clip
from bodysense.data.clips import open_clips
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.models.three_point_network import ThreePointConfig, ThreePointNetwork
from bodysense.training.body_network import Progress
from bodysense.training.checkpoint import best_weights
from bodysense.training.three_point import ThreePointSchedule, train_three_point
from bodysense.training.three_point_episodes import (
    Corpus,
    ThreePointEpisode,
    ThreePointVariation,
    corpus_of,
    make_three_point_episode,
)
from bodysense.training.three_point_onnx import FASTEST_RATE, write_three_point

RATES = (22.0, FASTEST_RATE)  # Hz, that a pass draws from
VALIDATION = {"full": ThreePointVariation(), "head_only": ThreePointVariation(hands=False)}


@dataclass(frozen=True)
class ThreePointRun:
    """What `bodysense train three-point` was asked for."""

    data: Path
    out: Path
    steps: int
    passes: int
    lanes: int
    chunk: int
    hidden: int
    dropout: float
    weight_decay: float
    learning_rate: float
    begin_with: Path | None  # checkpoint of another run, whose best weights are where this one begins
    clips: int | None
    seed: int
    threads: int | None
    licence: str
    data_note: str

    def __post_init__(self) -> None:
        for name in ("steps", "passes", "lanes", "hidden"):
            if getattr(self, name) < 1:
                raise BodysenseError(f"--{name} {getattr(self, name)}: give at least 1")
        if self.chunk < 2:
            raise BodysenseError(f"--chunk {self.chunk}: velocities are learned from 2 frames or more")


def run_three_point(run: ThreePointRun) -> None:
    """Train, export, and leave the log (`.jsonl`) and checkpoint (`.ckpt`) beside the network."""
    check_place(run.out)
    if run.threads is not None:
        torch.set_num_threads(run.threads)
    torch.manual_seed(run.seed)
    console = Console()
    network = ThreePointNetwork(ThreePointConfig(hidden=run.hidden, dropout=run.dropout))
    schedule = ThreePointSchedule(
        run.steps, run.lanes, run.chunk, run.learning_rate, weight_decay=run.weight_decay, seed=run.seed
    )
    if run.begin_with is not None:
        network.load_state_dict(best_weights(run.begin_with, network))
    corpus = prepare(run, "train", tuple(variation_of(number) for number in range(run.passes)))
    validation = {name: prepare(run, "val", (variation,)) for name, variation in VALIDATION.items()}
    console.print(f"{len(corpus)} episodes, {corpus.minutes:.0f} minutes, {network.features} features a frame")
    log = run.out.with_suffix(".jsonl")

    def report(progress: Progress) -> None:
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(vars(progress)) + "\n")
        terms, scores = (
            ", ".join(f"{name} {value:.{digits}f}" for name, value in values.items())
            for values, digits in ((progress.terms, 3), (progress.validation, 2))
        )
        console.print(
            f"step {progress.step}/{progress.steps}, {progress.seconds:.0f} s; {terms}; {scores}", highlight=False
        )

    checkpoint = run.out.with_suffix(".ckpt")
    network, figures = train_three_point(network, schedule, corpus, validation, checkpoint, report)
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{len(corpus)} episodes, {corpus.minutes:.0f} minutes",
        "seed": run.seed,
        "validation": {name: round(value, 2) for name, value in figures.items()},
    }
    write_three_point(network, run.out, card)
    console.print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def variation_of(number: int) -> ThreePointVariation:
    """How the n-th pass over the data differs: as recorded, then mirrored and on other bodies, hands coming and going.

    Every third pass bends wrists that were recorded stiff: they would give the forearm away, as no hand does.
    """
    return ThreePointVariation(
        mirrored=number % 2 == 1,
        limb_spread=0.05 if number > 1 else 0.0,
        wrist_bend=0.25 if number % 3 == 2 else 0.0,
        rates=RATES,
        loses_hands=number % 4 > 1,
    )


def prepare(run: ThreePointRun, split: Literal["train", "val"], variations: tuple[ThreePointVariation, ...]) -> Corpus:
    """The clips of a split as episodes, an episode a variation, prepared by `threads` processes."""
    # Its weights do not matter for preparing features.
    make = partial(_episodes_of, network=ThreePointNetwork(ThreePointConfig(hidden=1)), variations=variations)
    clips = enumerate(open_clips(run.data, split, at_most=run.clips))
    with ProcessPoolExecutor(run.threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        made = track(pool.map(partial(make, seed=run.seed), clips, chunksize=4), description=f"preparing {split}")
        return corpus_of([episode for several in made for episode in several])


def _episodes_of(
    numbered: tuple[int, Clip], network: ThreePointNetwork, variations: tuple[ThreePointVariation, ...], seed: int
) -> list[ThreePointEpisode]:
    """Every clip and variation has a generator of its own, so that the order of work does not matter."""
    index, clip = numbered
    return [
        make_three_point_episode(clip, network, variation, np.random.default_rng([seed, number, index]))
        for number, variation in enumerate(variations)
    ]
