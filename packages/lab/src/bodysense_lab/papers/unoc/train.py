"""Training of the body network, finger synthesis and the three-point upper body: data, augmentation, export."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import torch
from lightning_fabric import Fabric

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.clip import Clip
from bodysense.parallel import worker_pool
from bodysense_lab.core.fit import announce_run, fit, set_seed_and_threads
from bodysense_lab.core.options import SplitReader
from bodysense_lab.core.progress import with_progress_log
from bodysense_lab.papers.unoc.network.losses import LossWeights
from bodysense_lab.papers.unoc.network.network import PAPER, BodyNetwork, BodyNetworkConfig
from bodysense_lab.papers.unoc.network.point_network import (
    FINGERS,
    PAPER_FINGERS,
    PAPER_UPPER_BODY,
    UPPER_BODY,
    PointNetwork,
    PointNetworkConfig,
)
from bodysense_lab.papers.unoc.options import BodyTraining, PointTraining
from bodysense_lab.papers.unoc.point_task import PointSchedule, PointTask
from bodysense_lab.papers.unoc.sequences.body_sequences import RATE, Augmentation, make_body_sequence
from bodysense_lab.papers.unoc.sequences.point_sequences import PointSequence, make_point_sequence
from bodysense_lab.papers.unoc.task import BodySchedule, BodyTask

if TYPE_CHECKING:
    from bodysense_lab.papers.formats import PointNetworkTask

E = TypeVar("E")  # a training sequence
N = TypeVar("N")  # a network that reads it
V = TypeVar("V")  # an augmentation
# Hidden joints count more: a tracked joint's measured position replaces the prediction.
SHIPPED_LOSS = LossWeights(occluded=3.0)
VARIED_RATES = (20.0, 60.0)  # Hz
Form = Literal["shipped", "paper"]
CONFIGS: dict[tuple[PointNetworkTask, Form], PointNetworkConfig] = {
    ("fingers", "shipped"): FINGERS,
    ("fingers", "paper"): PAPER_FINGERS,
    ("upper-body", "shipped"): UPPER_BODY,
    ("upper-body", "paper"): PAPER_UPPER_BODY,
}
# As recorded and mirrored, then both on other bodies. Of the upper body there are many clips: three passes suffice, two
# of them with wrists that bend where none were recorded; clips with fingers, which are few, take all.
AUGMENTATIONS: dict[PointNetworkTask, tuple[Augmentation, ...]] = {
    "fingers": (
        Augmentation(),
        Augmentation(mirrored=True),
        *(Augmentation(mirrored=k % 2 == 1, limb_spread=0.05) for k in range(4)),
    ),
    "upper-body": (
        Augmentation(),
        Augmentation(mirrored=True, limb_spread=0.05, wrist_bend=0.25),
        Augmentation(limb_spread=0.05, wrist_bend=0.25),
        *(Augmentation(mirrored=k % 2 == 0, limb_spread=0.05) for k in range(5)),
    ),
}
PASSES: dict[PointNetworkTask, int] = {"fingers": 6, "upper-body": 3}  # of clips without recorded hands
PAPER_AUGMENTATIONS = (Augmentation(), Augmentation(mirrored=True))
SCHEDULES: dict[tuple[PointNetworkTask, Form], PointSchedule] = {
    ("fingers", "shipped"): PointSchedule(
        batch=64, distance="squared", average_decay=0.98, check_every=50, weight_decay=0.5
    ),
    ("fingers", "paper"): PointSchedule(batch=256, average_decay=0.0),
    ("upper-body", "shipped"): PointSchedule(learning_rate=2e-3, check_every=500),
    ("upper-body", "paper"): PointSchedule(batch=256, average_decay=0.0),
}


def train_body(run: BodyTraining, clips: SplitReader) -> None:
    """Train the body network and export it."""
    from bodysense_lab.papers.unoc.network.export import write_onnx

    check_place(run.out)
    set_seed_and_threads(run.seed, run.threads)
    fabric = announce_run(run, BodyTask)
    forms = {"shipped": BodyNetworkConfig(), "paper": PAPER, "paper-world-axes": replace(PAPER, frame="world")}
    network = BodyNetwork(replace(forms[run.form], hidden=run.hidden), default_skeleton())
    shipped = run.form == "shipped"
    schedule = run.with_options(
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
    augmentations = tuple(augmentation_of(number, shipped) for number in range(run.passes + run.finger_passes))
    config = replace(network.config, hidden=1, branch=(1,), judge_branch=(1,))
    read = make_body_sequence, partial(BodyNetwork, config, default_skeleton())
    sequences = _prepared(clips("train"), *read, augmentations, run.passes, run.seed)
    validation = _prepared(clips("val"), *read, (Augmentation(),), 1, run.seed)
    task = BodyTask(network, schedule, sequences, validation, run.trial_settings or None)
    _finish(
        *(run, task, fabric, "clips"),
        lambda card: write_onnx(network.cpu(), run.out, card),
        lambda scores: {f"{name}_occluded_rmsjpe_cm": round(value, 2) for name, value in scores.items()},
        fastest_rate=VARIED_RATES[1] if shipped and len(augmentations) > 1 else RATE,
    )


def train_points(run: PointTraining, clips: SplitReader) -> None:
    """Train a network that places points and export it."""
    from bodysense_lab.papers.unoc.network.export import write_point_network

    check_place(run.out)
    set_seed_and_threads(run.seed, run.threads)
    fabric = announce_run(run, PointTask)
    config = CONFIGS[run.task, run.form]
    schedule = run.with_options(replace(SCHEDULES[run.task, run.form], steps=run.steps))
    network = PointNetwork(config, default_skeleton())
    augmentations = AUGMENTATIONS[run.task] if run.form == "shipped" else PAPER_AUGMENTATIONS
    reader = partial(PointNetwork, replace(config, hidden=1, branch=(1,)), default_skeleton())
    sequences = _points(run, clips, reader, "train", augmentations)
    validation = _points(run, clips, reader, "val", (Augmentation(),))
    task = PointTask(network, schedule, sequences, validation, run.trial_settings or None)
    _finish(
        *(run, task, fabric, "sequences"),
        lambda card: write_point_network(network.cpu(), run.out, run.task, card),
        lambda scores: {"rmsjpe_cm": round(scores["rmsjpe_cm"], 2)},
    )


def _finish(
    run: BodyTraining | PointTraining,
    task: BodyTask | PointTask,
    fabric: Fabric,
    what: str,
    write: Callable[[dict[str, Any]], None],
    validation: Callable[[dict[str, float]], dict[str, float]],
    **more: Any,
) -> None:
    """Train the network of a task on its sequences, which are called `what`, and write it with its card."""
    amount = f"{len(task.sequences)} {what}, {sum(map(len, task.sequences)) / 30 / 60:.0f} minutes"
    fabric.print(f"{amount}, {task.network.features} features a frame")
    scores = fit(task, run.out.with_suffix(".ckpt"), fabric=fabric)
    if not fabric.is_global_zero:
        return
    learned = run.data_note or f"{amount} at 30 Hz"
    card = {"licence": run.licence, "training_data": learned, "form": run.form, **more, "seed": run.seed}
    write({**card, "validation": validation(scores)})
    print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def augmentation_of(number: int, shipped: bool) -> Augmentation:
    """Return the augmentation of the n-th pass: as recorded, then mirrored, then both again with other limbs."""
    if not shipped:
        return Augmentation(mirrored=number % 2 == 1)
    return Augmentation(
        mirrored=number % 2 == 1,
        limb_spread=0.0 if number == 0 else 0.05,
        hand_dropouts_per_minute=0.0 if number == 0 else 6.0,
        rates=(RATE, RATE) if number == 0 else VARIED_RATES,
    )


def _prepared(
    clips: Iterable[Clip],
    make: Callable[[Clip, N, V, np.random.Generator], E],
    reader: Callable[[], N],
    augmentations: tuple[V, ...],
    passes: int,
    seed: int,
    processes: int | None = None,
) -> list[E]:
    """Prepare the sequences of clips, one for each augmentation, in several processes.

    `reader` makes the network that prepares features; its weights do not matter. Of the augmentations a clip without
    fingers takes the first `passes`.
    """
    work = partial(_augmented, make=make, reader=reader, augmentations=augmentations, passes=passes, seed=seed)
    with worker_pool(processes, partial(torch.set_num_threads, 1)) as pool:
        made = [pool.submit(work, numbered) for numbered in enumerate(clips)]
        done = with_progress_log(made, "preparing sequences of the clips", len(made))
        return [sequence for sequences in done for sequence in sequences.result()]


def _augmented(
    numbered: tuple[int, Clip],
    make: Callable[[Clip, N, V, np.random.Generator], E],
    reader: Callable[[], N],
    augmentations: tuple[V, ...],
    passes: int,
    seed: int,
) -> list[E]:
    """The sequences of a clip; each has a generator of its own, so that the order of work does not matter."""
    (index, clip), network = numbered, reader()
    return [
        make(clip, network, augmentation, np.random.default_rng([seed, number, index]))
        for number, augmentation in enumerate(augmentations if clip.has_fingers else augmentations[:passes])
    ]


def _points(
    run: PointTraining,
    clips: SplitReader,
    reader: Callable[[], PointNetwork],
    split: Literal["train", "val"],
    augmentations: tuple[Augmentation, ...],
) -> list[PointSequence]:
    """The clips of a split as sequences; for fingers, clips that have them."""
    chosen = (clip for clip in clips(split) if run.task != "fingers" or clip.has_fingers)
    sequences = _prepared(chosen, make_point_sequence, reader, augmentations, PASSES[run.task], run.seed, run.threads)
    if not sequences:
        raise BodysenseError(f"{run.data}: no clip of its {split} split has fingers; give motion with recorded fingers")
    return sequences
