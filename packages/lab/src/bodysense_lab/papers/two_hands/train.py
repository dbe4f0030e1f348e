"""A whole training run of the networks of a glove: data, synthesised hands, training, export."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from lightning_fabric import Fabric
from rich.console import Console
from torch import Tensor, nn

from bodysense.body.hands.glove import MARKERS
from bodysense.body.hands.hand import FREEDOMS
from bodysense.body.hands.hand_family import draw_hand
from bodysense.devices.gloves.networks import JOINT_FORMAT, MARKER_FORMAT
from bodysense.errors import BodysenseError
from bodysense.files import make_folder
from bodysense_lab.core.export import export
from bodysense_lab.core.fit import announce_run, fit, progress_printer, set_seed_and_threads
from bodysense_lab.core.progress import with_progress_log
from bodysense_lab.data.clips import open_clips, read_clips
from bodysense_lab.papers.two_hands.drawing import JointTask, MarkerTask
from bodysense_lab.papers.two_hands.frames import RATE, GloveFrames, frames_of, join
from bodysense_lab.papers.two_hands.network import (
    MARKER_VALUES,
    PAPER_JOINTS,
    PAPER_MARKERS,
    SHAPE_VALUES,
    JointNetwork,
    JointNetworkConfig,
    MarkerNetwork,
    MarkerNetworkConfig,
)
from bodysense_lab.papers.two_hands.options import Form, GloveTraining, Network
from bodysense_lab.papers.two_hands.task import (
    PAPER_JOINT_SCHEDULE,
    PAPER_MARKER_SCHEDULE,
    GloveSchedule,
)
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion, hand_pairs
from bodysense_lab.synthesis.pairs import synthesize_pair


class _Folded(nn.Module):
    """A network with its scales in its first and last layer."""

    def __init__(self, network: MarkerNetwork | JointNetwork) -> None:
        super().__init__()
        self.network = network
        self.layers = network.folded()

    def forward(self, markers: Tensor, hand: Tensor) -> Tensor:
        return self.layers(self.network.raw(markers, hand))


def write_glove_network(network: MarkerNetwork | JointNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export a network for any number of hands at once, with its metadata. The file appears whole or not at all.

    Its inputs are `markers` (H, 27) m, registered and at the default hand's size, and `hand` (H, 87) m; its output
    `filled` (H, 27) m or `angles` (H, 26) rad.
    """
    network = network.eval()
    outputs, format = ["filled"], MARKER_FORMAT
    example = (torch.full((2, MARKER_VALUES), 0.01), torch.full((2, SHAPE_VALUES), 0.03))
    if isinstance(network, JointNetwork):
        outputs, format = ["angles"], JOINT_FORMAT
        card = {"angles": [f"{row.joint} {row.angle}" for row in FREEDOMS], **card}
    card = {
        "markers": MARKERS,
        "network": asdict(network.config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **card,
    }
    hands = torch.export.Dim("hands", min=1)
    export(_Folded(network), example, ["markers", "hand"], outputs, format, card, path, ({0: hands}, {0: hands}))


FILES: dict[Network, str] = {name: f"glove_{name}.onnx" for name in get_args(Network)}
SCHEDULES: dict[tuple[Network, Form], GloveSchedule] = {
    ("markers", "shipped"): GloveSchedule(steps=30_000),
    ("markers", "paper"): PAPER_MARKER_SCHEDULE,
    ("joints", "shipped"): GloveSchedule(steps=12_000),
    ("joints", "paper"): PAPER_JOINT_SCHEDULE,
}
_OWN, _DRAWN = 2, 6  # how often a recorded motion is learned on its own hand, and on hands of the family
_DRAWN_TOO = 2  # likewise, of a synthesised one beside once on its own
_TRAIN, _VALIDATION = 1, 2  # of the generators of synthesised hands


def run_gloves(run: GloveTraining) -> None:
    """Train and export each network, and write its log (`.jsonl`) and checkpoint (`.ckpt`) next to it."""
    make_folder(run.out)
    fabric = announce_run(run, MarkerTask)
    set_seed_and_threads(run.seed, run.threads)
    console = Console(quiet=not fabric.is_global_zero)
    frames, validation = prepare(run, "train"), prepare(run, "val")
    minutes = len(frames) / RATE / 60
    console.print(f"{len(frames.rest)} hands, {minutes:.0f} minutes at {RATE:g} Hz", highlight=False)
    for name in run.networks:
        _train(run, name, frames, validation, console, fabric)


def people_with_fingers(data: Path | None) -> tuple[str, ...]:
    """Return the people of the train split with recorded fingers. Raises BodysenseError for fewer than two."""
    clips = () if data is None else open_clips(data, "train")
    people = tuple(sorted({clip.person for clip in clips if clip.has_fingers and clip.person}))
    if len(people) < 2:
        raise BodysenseError(
            f"--leave-one-out: {len(people)} people with recorded fingers; give --data with two or more"
        )
    return people


def prepare(run: GloveTraining, split: Literal["train", "val"]) -> GloveFrames:
    """The hands of a split: recorded ones in every variation, and synthesised ones."""
    return join([*_recorded(run, split), *_synthesised(run, split)])


def _recorded(run: GloveTraining, split: Literal["train", "val"]) -> Iterator[GloveFrames]:
    if run.data is None:
        return
    own, drawn = (1, 0) if run.form == "paper" else (_OWN, _DRAWN) if split == "train" else (1, 1)
    clips = (clip for clip in read_clips(run.data, split, run.limit) if clip.person not in run.without)
    for index, (left, right) in enumerate(hand_pairs(clips, RATE)):
        yield from _both(left, right, own, drawn, [run.seed, index])


def _synthesised(run: GloveTraining, split: Literal["train", "val"]) -> Iterator[GloveFrames]:
    """Half-minute motions of hands of the family; those of validation are a tenth, and of another generator.

    A trial takes as many at most as clips.
    """
    part, stream, drawn = (1.0, _TRAIN, _DRAWN_TOO) if split == "train" else (0.1, _VALIDATION, 1)
    hands, pairs = (math.ceil(2 * part * minutes) for minutes in (run.hand_minutes, run.pair_minutes))
    if run.limit is not None:
        hands, pairs = min(hands, run.limit), min(pairs, run.limit)
    for number in with_progress_log(range(hands), f"synthesising hands of the {split} split", hands):
        rng = np.random.default_rng([run.seed, stream, 0, number])
        motion = synthesize_hand(draw_hand(rng).skeleton, 30.0, rng, RATE)
        yield frames_of(motion)
        for _ in range(drawn):
            yield frames_of(motion, draw_hand(rng))
    for number in with_progress_log(range(pairs), f"synthesising pairs of hands of the {split} split", pairs):
        rng = np.random.default_rng([run.seed, stream, 1, number])
        left, right = synthesize_pair(draw_hand(rng).skeleton, 30.0, rng, RATE)
        yield from _both(left, right, 1, 1, [run.seed, stream, 2, number])


def _both(left: HandMotion, right: HandMotion, own: int, drawn: int, seed: list[int]) -> Iterator[GloveFrames]:
    """Each hand of a person, some times on its own hand and some on hands of the family."""
    for number in range(own + drawn):
        for side, hand in enumerate((left, right)):
            other_hand = None if number < own else draw_hand(np.random.default_rng([*seed, number, side]))
            yield frames_of(hand, other_hand)


def _train(
    run: GloveTraining,
    name: Network,
    frames: GloveFrames,
    validation: GloveFrames,
    console: Console,
    fabric: Fabric,
) -> None:
    schedule = run.with_options(SCHEDULES[name, run.form])
    if run.steps is not None:
        schedule = replace(schedule, steps=run.steps)
    torch.manual_seed(run.seed)
    out = run.out / FILES[name]
    source: dict[str, Any] = {
        "frames": len(frames),
        "without": list(run.without),
        "hands": len(frames.rest),
        "rate": RATE,
        **run.trial_settings,
    }
    if name == "markers":
        network = MarkerNetwork(MarkerNetworkConfig() if run.form == "shipped" else PAPER_MARKERS)
    else:
        network = JointNetwork(JointNetworkConfig() if run.form == "shipped" else PAPER_JOINTS)
    learn = MarkerTask if name == "markers" else JointTask
    task = learn(network, schedule, frames, validation, source, fabric.global_rank)
    figures = fit(task, out.with_suffix(".ckpt"), progress_printer(name), fabric, progress_printer(name))
    if not fabric.is_global_zero:
        return
    made = f"{run.hand_minutes:g} minutes of synthesised hands and {run.pair_minutes:g} of pairs"
    recorded = "" if run.data is None else f"{run.data.name}, train split, left and right hands; "
    card = {
        "licence": run.licence,
        "training_data": run.data_note or f"{recorded}{made}",
        "form": run.form,
        "rate": 60.0,
        "seed": run.seed,
        "without": list(run.without),
        "validation": {"error_cm": round(figures["error_cm"], 3)},
    }
    write_glove_network(network.cpu(), out, card)
    console.print(f"wrote {out} ({out.stat().st_size / 1e6:.2f} MB)")
