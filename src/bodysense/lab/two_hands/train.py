"""A whole training run of the networks of a glove: data, synthesised hands, training, export."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from rich.console import Console
from torch import Tensor, nn

from bodysense.body.glove import MARKERS
from bodysense.body.hand import FREEDOMS
from bodysense.body.hand_family import draw_hand
from bodysense.devices.gloves.networks import JOINT_FORMAT, MARKER_FORMAT
from bodysense.errors import BodysenseError
from bodysense.files import make_folder
from bodysense.lab.clips import open_clips
from bodysense.lab.export import export
from bodysense.lab.fit import printed
from bodysense.lab.synthesis.hand_motion import HandMotion, hand_pairs
from bodysense.lab.synthesis.hands import synthesize_hand
from bodysense.lab.synthesis.pairs import synthesize_pair
from bodysense.lab.two_hands.drawing import JointTask, MarkerTask, MemoryTask
from bodysense.lab.two_hands.frames import GloveFrames, frames_of, join
from bodysense.lab.two_hands.network import (
    MARKER_VALUES,
    PAPER_JOINTS,
    PAPER_MARKERS,
    RECURRENT_MARKERS,
    SHAPE_VALUES,
    TWO_HANDS,
    JointNetwork,
    JointNetworkConfig,
    MarkerNetwork,
    MarkerNetworkConfig,
)
from bodysense.lab.two_hands.options import Form, GloveTraining, Network
from bodysense.lab.two_hands.task import (
    PAPER_JOINT_SCHEDULE,
    PAPER_MARKER_SCHEDULE,
    GloveSchedule,
    Lesson,
    train_glove,
)
from bodysense.lab.two_hands.variants import MEMORY_FORMAT, TWO_HANDS_FORMAT


class _Folded(nn.Module):
    """A network with its scales in its first and last layer."""

    def __init__(self, network: MarkerNetwork | JointNetwork) -> None:
        super().__init__()
        self.network = network
        self.layers = network.folded()

    def forward(self, markers: Tensor, hand: Tensor, other: Tensor | None = None) -> Tensor:
        beside = () if other is None else (other,)
        return self.layers(self.network.raw(markers, hand, *beside))


class _OneStep(nn.Module):
    """A network with memory as one frame of it."""

    def __init__(self, network: MarkerNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, markers: Tensor, hand: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        filled, memory = self.network.step(markers[:, None], hand[:, None], memory)
        return filled[:, 0], memory


def write_glove_network(network: MarkerNetwork | JointNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export a network for any number of hands at once, with its metadata. The file appears whole or not at all.

    Its inputs are `markers` (H, 27) m, registered and at the default hand's size, `hand` (H, 87) m, and, where it reads
    them, `other` (H, 27) or `state_memory` (H, M); its outputs `filled` (H, 27) m, with `next_memory`, or `angles`
    (H, 26) rad.
    """
    network = network.eval()
    inputs, outputs, format = ["markers", "hand"], ["filled"], MARKER_FORMAT
    example = [torch.full((2, MARKER_VALUES), 0.01), torch.full((2, SHAPE_VALUES), 0.03)]
    step: nn.Module
    if isinstance(network, JointNetwork):
        step, outputs, format = _Folded(network), ["angles"], JOINT_FORMAT
        card = {"angles": [f"{row.joint} {row.angle}" for row in FREEDOMS], **card}
    elif network.config.memory:
        inputs, outputs, format = [*inputs, "state_memory"], [*outputs, "next_memory"], MEMORY_FORMAT
        example.append(network.start(2))
        step, card = _OneStep(network), {"memory": network.config.memory, **card}
    else:
        step = _Folded(network)
        if network.config.reads_other:
            inputs, format = [*inputs, "other"], TWO_HANDS_FORMAT
            example.append(torch.full((2, MARKER_VALUES), 0.01))
    card = {
        "markers": MARKERS,
        "network": asdict(network.config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **card,
    }
    hands = torch.export.Dim("hands", min=1)
    export(step, tuple(example), inputs, outputs, format, card, path, tuple({0: hands} for _ in example))


FILES: dict[Network, str] = {name: f"glove_{name.replace('-', '_')}.onnx" for name in get_args(Network)}
RATE = 30.0  # Hz, of the frames that are learned
MEMORY_RATE = 60.0  # of the recurrent network's, for which time matters
SCHEDULES: dict[tuple[Network, Form], GloveSchedule] = {
    ("markers", "shipped"): GloveSchedule(steps=7_000),
    ("markers", "paper"): PAPER_MARKER_SCHEDULE,
    ("joints", "shipped"): GloveSchedule(steps=8_000),
    ("joints", "paper"): PAPER_JOINT_SCHEDULE,
    ("two-hands", "shipped"): GloveSchedule(steps=5_000),
    ("recurrent", "shipped"): GloveSchedule(steps=2_500, batch=64, check_every=500),
}
_OWN, _DRAWN = 2, 6  # how often a recorded motion is learned on its own hand, and on hands of the family
_DRAWN_TOO = 2  # likewise, of a synthesised one beside once on its own
_TRAIN, _VALIDATION = 1, 2  # of the generators of synthesised hands


def run_gloves(run: GloveTraining) -> None:
    """Train, export, and leave log (`.jsonl`) and checkpoint (`.ckpt`) of each network beside it in the folder."""
    make_folder(run.out)
    if run.threads is not None:
        torch.set_num_threads(run.threads)
    console = Console()
    for rate in sorted({_rate(name) for name in run.networks}):
        console.print("preparing hands", highlight=False)
        frames, validation = prepare(run, "train", rate), prepare(run, "val", rate)
        minutes = len(frames) / rate / 60
        console.print(f"{len(frames.rest)} hands, {minutes:.0f} minutes at {rate:g} Hz", highlight=False)
        for name in run.networks:
            if _rate(name) == rate:
                _train(run, name, frames, validation, rate, console)


def people_with_fingers(data: Path | None) -> tuple[str, ...]:
    """Whose fingers were recorded, among the train split. Raises BodysenseError for fewer than two."""
    clips = () if data is None else open_clips(data, "train")
    people = tuple(sorted({clip.person for clip in clips if clip.has_fingers and clip.person}))
    if len(people) < 2:
        raise BodysenseError(
            f"--leave-one-out: {len(people)} people with recorded fingers; give --data with two or more"
        )
    return people


def prepare(run: GloveTraining, split: Literal["train", "val"], rate: float) -> GloveFrames:
    """The hands of a split: recorded ones in every variation, and synthesised ones."""
    return join([*_recorded(run, split, rate), *_synthesised(run, split, rate)])


def _recorded(run: GloveTraining, split: Literal["train", "val"], rate: float) -> Iterator[GloveFrames]:
    if run.data is None:
        return
    own, drawn = (1, 0) if run.form == "paper" else (_OWN, _DRAWN) if split == "train" else (1, 1)
    clips = (clip for clip in open_clips(run.data, split) if clip.person not in run.without)
    for index, (left, right) in enumerate(hand_pairs(clips, rate)):
        yield from _both(left, right, own, drawn, [run.seed, index])


def _synthesised(run: GloveTraining, split: Literal["train", "val"], rate: float) -> Iterator[GloveFrames]:
    """Half-minute motions of hands of the family; those of validation are a tenth, and of another generator."""
    part, stream, drawn = (1.0, _TRAIN, _DRAWN_TOO) if split == "train" else (0.1, _VALIDATION, 1)
    for number in range(math.ceil(2 * part * run.hand_minutes)):
        rng = np.random.default_rng([run.seed, stream, 0, number])
        motion = synthesize_hand(draw_hand(rng).skeleton, 30.0, rng, rate)
        yield frames_of(motion)
        for _ in range(drawn):
            yield frames_of(motion, draw_hand(rng))
    for number in range(math.ceil(2 * part * run.pair_minutes)):
        rng = np.random.default_rng([run.seed, stream, 1, number])
        left, right = synthesize_pair(draw_hand(rng).skeleton, 30.0, rng, rate)
        yield from _both(left, right, 1, 1, [run.seed, stream, 2, number])


def _both(left: HandMotion, right: HandMotion, own: int, drawn: int, seed: list[int]) -> Iterator[GloveFrames]:
    """Each hand of a person beside the other, some times on their own hands and some on hands of the family."""
    for number in range(own + drawn):
        for side, (hand, other) in enumerate(((left, right), (right, left))):
            worn = None if number < own else draw_hand(np.random.default_rng([*seed, number, side]))
            yield frames_of(hand, worn, other)


def _train(
    run: GloveTraining, name: Network, frames: GloveFrames, validation: GloveFrames, rate: float, console: Console
) -> None:
    schedule = run.paced(SCHEDULES[name, run.form])
    if run.steps is not None:
        schedule = replace(schedule, steps=run.steps)
    torch.manual_seed(run.seed)
    network, task = _task(name, run.form, frames, validation, schedule, rate)
    out = run.out / FILES[name]
    source: dict[str, Any] = {
        "frames": len(frames),
        "without": list(run.without),
        "hands": len(frames.rest),
        "rate": rate,
    }
    _, score = train_glove(network, task, schedule, source, out.with_suffix(".ckpt"), printed(name))
    made = f"{run.hand_minutes:g} minutes of synthesised hands and {run.pair_minutes:g} of pairs"
    recorded = "" if run.data is None else f"{run.data.name}, train split, left and right hands; "
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{recorded}{made}",
        "form": run.form,
        "rate": 60.0,
        "seed": run.seed,
        "without": list(run.without),
        "validation": {"error_cm": round(score, 3)},
    }
    write_glove_network(network, out, card)
    console.print(f"wrote {out} ({out.stat().st_size / 1e6:.2f} MB)")


def _task(
    name: Network, form: Form, frames: GloveFrames, validation: GloveFrames, schedule: GloveSchedule, rate: float
) -> tuple[MarkerNetwork | JointNetwork, Lesson]:
    """The network and what it learns."""
    if name == "joints":
        config = JointNetworkConfig() if form == "shipped" else PAPER_JOINTS
        return JointNetwork(config), JointTask(frames, validation, schedule)
    if name == "recurrent":
        return MarkerNetwork(RECURRENT_MARKERS), MemoryTask(frames, validation, schedule)
    if name == "two-hands":
        frames, validation = (one.only(~np.isnan(one.other[:, 0, 0])) for one in (frames, validation))
        return MarkerNetwork(TWO_HANDS), MarkerTask(frames, validation, schedule, rate)
    config = MarkerNetworkConfig() if form == "shipped" else PAPER_MARKERS
    return MarkerNetwork(config), MarkerTask(frames, validation, schedule, rate)


def _rate(name: Network) -> float:
    return MEMORY_RATE if name == "recurrent" else RATE
