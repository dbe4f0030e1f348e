"""A whole training run: data, variations, training, export."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from lightning_fabric import Fabric
from rich.console import Console
from rich.progress import track

from bodysense.body.skeleton import default_skeleton
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.lab.clips import open_clips
from bodysense.lab.export import write_onnx
from bodysense.lab.unoc.episodes import RATE, Episode, Variation, make_episode
from bodysense.lab.unoc.losses import LossWeights
from bodysense.lab.unoc.network import PAPER, BodyNetwork, BodyNetworkConfig
from bodysense.lab.unoc.training import Progress, Schedule, train, validate

# What a wearer meets counts more than the error of a joint that is seen: the measured place overrides that one.
SHIPPED_LOSS = LossWeights(occluded=3.0)
VARIED_RATES = (20.0, 60.0)  # Hz


@dataclass(frozen=True)
class BodyRun:
    """What `bodysense train body-gru` was asked for."""

    data: Path
    out: Path
    form: Literal["shipped", "paper", "paper-world-axes"]
    steps: int
    epochs: int
    window_stride: int
    passes: int
    finger_passes: int
    lanes: int
    chunk: int
    hidden: int
    finger_share: float
    seed: int
    threads: int | None
    devices: int
    licence: str
    data_note: str


def run_body(run: BodyRun) -> None:
    """Train, export, and leave the log (`.jsonl`) and checkpoint (`.ckpt`) beside the network."""
    if not run.out.parent.is_dir():
        raise BodysenseError(f"{run.out}: the folder {run.out.parent} does not exist; create it")
    if run.threads is not None:
        torch.set_num_threads(run.threads)
    torch.manual_seed(run.seed)
    console = Console()
    forms = {"shipped": BodyNetworkConfig(), "paper": PAPER, "paper-world-axes": replace(PAPER, frame="world")}
    config = replace(forms[run.form], hidden=run.hidden)
    model = BodyNetwork(config, default_skeleton())
    shipped = run.form == "shipped"
    schedule = Schedule(
        steps=run.steps,
        epochs=run.epochs,
        window_stride=run.window_stride,
        lanes=run.lanes,
        chunk=run.chunk,
        finger_share=run.finger_share,
        seed=run.seed,
        average_decay=0.999 if shipped else 0.0,
        loss=SHIPPED_LOSS if shipped else LossWeights(),
    )
    variations = tuple(variation_of(number, shipped) for number in range(run.passes + run.finger_passes))
    episodes = see(run, model, "train", variations)
    validation = see(run, model, "val", (Variation(),))
    frames = sum(len(episode) for episode in episodes)
    console.print(f"{len(episodes)} clips, {frames / 30 / 60:.0f} minutes, {model.features} features a frame")

    log = run.out.with_suffix(".jsonl")

    def report(progress: Progress) -> None:
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(vars(progress)) + "\n")
        scores = ", ".join(f"{name} {value:.2f}" for name, value in progress.validation.items())
        console.print(
            f"step {progress.step}/{progress.steps}, {progress.seconds:.0f} s, loss {progress.terms['loss']:.4f}; "
            f"occluded RMSJPE, cm: {scores}",
            highlight=False,
        )

    fabric = Fabric(accelerator="auto", devices=run.devices, precision="bf16-mixed")
    fabric.launch()
    model = train(model, schedule, episodes, validation, run.out.with_suffix(".ckpt"), report, fabric)
    if fabric.is_global_zero:
        scores = validate(model, validation)
        card = {
            "licence": run.licence,
            "training_data": run.data_note or f"{len(episodes)} clips, {frames / 30 / 60:.0f} minutes at 30 Hz",
            "form": run.form,
            "fastest_rate": VARIED_RATES[1] if shipped and len(variations) > 1 else RATE,
            "seed": run.seed,
            "validation": {f"{name}_occluded_rmsjpe_cm": round(value, 2) for name, value in scores.items()},
        }
        write_onnx(model.cpu(), run.out, card)
        console.print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


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


def see(
    run: BodyRun, model: BodyNetwork, split: Literal["train", "val"], variations: tuple[Variation, ...]
) -> list[Episode]:
    """All clips of a split as episodes, an episode a variation, prepared by several processes.

    Of the variations a clip without fingers takes the first `run.passes` only.
    """
    make = partial(_episodes_of, config=model.config, variations=variations, passes=run.passes, seed=run.seed)
    clips = enumerate(open_clips(run.data, split))
    with ProcessPoolExecutor(initializer=torch.set_num_threads, initargs=(1,)) as pool:
        made = track(pool.map(make, clips, chunksize=4), description=f"seeing the {split} split")
        return [episode for episodes in made for episode in episodes]


def _episodes_of(
    numbered: tuple[int, Clip], config: BodyNetworkConfig, variations: tuple[Variation, ...], passes: int, seed: int
) -> list[Episode]:
    """Every clip and variation has a generator of its own, so that the order of work does not matter."""
    index, clip = numbered
    chosen = variations if clip.has_fingers else variations[:passes]
    network = _untrained(config)
    return [
        make_episode(clip, network, variation, np.random.default_rng([seed, number, index]))
        for number, variation in enumerate(chosen)
    ]


@lru_cache(maxsize=1)
def _untrained(config: BodyNetworkConfig) -> BodyNetwork:
    """A network that prepares features in a worker; its weights do not matter for that."""
    return BodyNetwork(config, default_skeleton())
