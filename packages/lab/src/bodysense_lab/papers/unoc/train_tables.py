"""Training every network of UNOC's Tables 2 to 4 into one folder."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import make_folder, write_json
from bodysense.parallel import worker_pool
from bodysense_lab.core.checkpoint import identity, write_weights_file
from bodysense_lab.core.fit import Report, announce_run, figures_line, fit, launch_fabric, set_seed_and_threads
from bodysense_lab.core.progress import with_progress_log
from bodysense_lab.core.sweep import is_trained_as_configured, sweep
from bodysense_lab.data.clips import read_clips
from bodysense_lab.papers.unoc.network.losses import LossWeights
from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyNetworkConfig
from bodysense_lab.papers.unoc.network.variants import TABLES, VARIANTS
from bodysense_lab.papers.unoc.options import TablesTraining
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, BodySequence, make_body_sequence
from bodysense_lab.papers.unoc.task import BodySchedule, BodyTask, step_count

_ARRAYS = ("features", "known", "offset", "visible")


def cached_sequences(
    folder: Path, identity: dict[str, Any], make: Callable[[], Iterable[BodySequence]]
) -> list[BodySequence]:
    """Read the sequences in `folder`, made first if it does not exist.

    The folder appears whole or not at all. Raises BodysenseError when it holds sequences of another `identity`, which
    must be JSON, and if there are no networks to train.
    """
    if not folder.is_dir():
        _write(folder, identity, make())
    index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    if index["identity"] != identity:
        changed = [name for name in identity if index["identity"].get(name) != identity[name]]
        raise BodysenseError(
            f"{folder} was made from something else ({', '.join(changed)} differ); take it away or choose another --out"
        )
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in _ARRAYS}
    sequences, start = [], 0
    for row in index["clips"]:
        part = {name: values[start : start + row["frames"]] for name, values in arrays.items()}
        sequences.append(BodySequence(fingers=row["fingers"], **part))
        start += row["frames"]
    return sequences


def _write(folder: Path, identity: dict[str, Any], sequences: Iterable[BodySequence]) -> None:
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    beside.mkdir(parents=True)
    clips, shapes, types = [], {}, {}
    try:
        with ExitStack() as stack:
            files = {name: stack.enter_context((beside / f"{name}.raw").open("wb")) for name in _ARRAYS}
            for sequence in sequences:
                clips.append({"fingers": sequence.fingers, "frames": len(sequence)})
                for name in _ARRAYS:
                    values = np.ascontiguousarray(getattr(sequence, name))
                    shapes[name], types[name] = values.shape[1:], values.dtype
                    files[name].write(values.tobytes())
        if not clips:
            raise BodysenseError(f"{folder}: there is no clip to make sequences of")
        frames = sum(row["frames"] for row in clips)
        for name in _ARRAYS:
            raw = np.memmap(beside / f"{name}.raw", types[name], "r", shape=(frames, *shapes[name]))
            np.save(beside / f"{name}.npy", raw)
            del raw
            (beside / f"{name}.raw").unlink()
        (beside / "index.json").write_text(json.dumps({"identity": identity, "clips": clips}), encoding="utf-8")
        try:
            os.replace(beside, folder)
        except OSError:
            if not folder.is_dir():  # otherwise another process, on this machine or another, was done first
                raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)


PAPER_LOSS = LossWeights(expected_error=0.0)  # the paper's network does not judge its error
_VALIDATED = 3000  # frames that are enough to see how a run goes; the tables come from the test people


def train_tables(run: TablesTraining) -> None:
    """Train the missing networks. Raises BodysenseError if a run in the folder had another configuration."""
    names = chosen_networks(run)
    make_folder(run.out)
    fabric = announce_run(run, BodyTask)
    steps = {}
    for name in names:
        learned = sequences_of(run, VARIANTS[name].config)["train"]
        steps[name] = step_count(VARIANTS[name].config, schedule_of(run, name), learned)
    trained = fabric.broadcast([name for name in names if is_trained(run, name)])
    train = partial(train_network, run, fabric=None if run.jobs > 1 else fabric)
    sweep(steps, train, trained.__contains__, run.out, run.jobs, quiet=not fabric.is_global_zero)
    if fabric.is_global_zero:
        print(f"{len(names)} networks in {run.out}")


def chosen_networks(run: TablesTraining) -> list[str]:
    """Return the chosen networks, each once. Raises BodysenseError for names that do not exist."""
    for given, known, what in ((run.tables, TABLES, "table"), (run.networks, VARIANTS, "network")):
        unknown = [name for name in given if name not in known]
        if unknown:
            raise BodysenseError(f"unknown {what} {unknown[0]!r}; valid are {', '.join(known)}")
    names = run.networks or [name for table in run.tables for name in TABLES[table]]
    return list(dict.fromkeys(names))


def schedule_of(run: TablesTraining, name: str) -> BodySchedule:
    """The paper's schedule, with what the run changes of it."""
    batches = tuple(max(1, round(batch * run.batch_scale)) for batch in BodySchedule().epoch_batches)
    return run.with_options(
        BodySchedule(
            steps=run.steps,
            epochs=run.epochs,
            epoch_batches=batches,
            window_stride=run.window_stride,
            average_decay=0.0,
            check_every=100,
            loss=replace(PAPER_LOSS, sums=run.loss_sum, **VARIANTS[name].loss),
        )
    )


def train_network(run: TablesTraining, name: str, report: Report, fabric: Fabric | None = None) -> str:
    """Train one network of the tables, write its weights next to its checkpoint and log, and return a line about it.

    A process of its own, without `fabric`, takes the devices that the run names.
    """
    fabric = fabric or launch_fabric(run.devices, run.nodes)
    set_seed_and_threads(run.seed, run.threads)
    config, schedule, begun = VARIANTS[name].config, schedule_of(run, name), time.monotonic()
    network, sequences = BodyNetwork(config, default_skeleton()), sequences_of(run, config)
    task = BodyTask(network, schedule, sequences["train"], _few(sequences["val"]), run.trial_settings or None)
    scores = fit(task, run.out / f"{name}.ckpt", report, fabric, report)
    if fabric.is_global_zero:
        write_weights_file(network.cpu(), run.out / f"{name}.pt", {})
        trained = identity(config, schedule, run.trial_settings or None)
        write_json(run.out / f"{name}.json", {"identity": trained, "seconds": time.monotonic() - begun})
    fabric.barrier()
    return f"trained {VARIANTS[name].title}: {task.steps} steps; occluded RMSJPE, cm: {figures_line(scores, 2)}"


def is_trained(run: TablesTraining, name: str) -> bool:
    """Whether the folder holds the network, trained as this run asks. Raises BodysenseError if trained otherwise."""
    path = run.out / f"{name}.json"
    if not path.is_file():
        return False
    before = json.loads(path.read_text(encoding="utf-8"))["identity"]
    return is_trained_as_configured(
        path, before, identity(VARIANTS[name].config, schedule_of(run, name), run.trial_settings or None)
    )


def sequences_of(run: TablesTraining, config: BodyNetworkConfig) -> dict[str, list[BodySequence]]:
    """Training and validation people as a network of this configuration reads them, cached in the folder of the run."""
    reads = {"inputs": config.inputs, "frame": config.frame, "finger_origin": config.finger_origin}
    folder = run.out / "episodes" / "-".join(reads.values())
    found = {}
    for split in ("train", "val"):
        expected: dict[str, Any] = {**reads, "data": str(run.data.resolve()), "split": split, **run.trial_settings}
        found[split] = cached_sequences(folder / split, expected, partial(_make, run, config, split))
    return found


def _make(run: TablesTraining, config: BodyNetworkConfig, split: Any) -> Iterator[BodySequence]:
    # Features of a clip do not depend on the weights or the size of a network.
    reader = replace(config, cell="gru", hidden=1, branch=(1,), judge_branch=(1,))
    make = partial(_body_sequence, config=reader)
    clips, what = list(read_clips(run.data, split, run.limit)), f"seeing the {split} split"
    if run.jobs == 1:
        yield from with_progress_log(map(make, clips), what, len(clips))
        return
    with worker_pool(run.jobs, partial(torch.set_num_threads, 1)) as pool:
        yield from with_progress_log(pool.map(make, clips, chunksize=4), what, len(clips))


def _body_sequence(clip: Any, config: BodyNetworkConfig) -> BodySequence:
    return make_body_sequence(clip, BodyNetwork(config, default_skeleton()), Augmentation(), np.random.default_rng(0))


def _few(sequences: Sequence[BodySequence]) -> list[BodySequence]:
    """Choose some sequences evenly, some of them with fingers, and cut long ones."""
    fingers = [sequence for sequence in sequences if sequence.fingers]
    others = [sequence for sequence in sequences if not sequence.fingers]
    chosen: list[BodySequence] = []
    for part in (fingers, others):
        frames = 0
        for sequence in part[:: max(1, len(part) // 8)]:
            length = min(len(sequence), 600, _VALIDATED // 2 - frames)
            if length > 0:
                chosen.append(replace(sequence, **{name: getattr(sequence, name)[:length] for name in _ARRAYS}))
                frames += length
    return chosen
