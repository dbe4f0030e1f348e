"""Training every network of UNOC's Tables 2 to 4 with one command: resumable, several processes, one progress bar."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn, track

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.lab.checkpoint import differences, identity
from bodysense.lab.clips import open_clips
from bodysense.lab.unoc.episode_cache import cached_episodes
from bodysense.lab.unoc.episodes import Episode, Variation, make_episode
from bodysense.lab.unoc.losses import LossWeights
from bodysense.lab.unoc.network import BodyNetwork, BodyNetworkConfig, write_weights
from bodysense.lab.unoc.training import Progress as Report
from bodysense.lab.unoc.training import Schedule, step_count, train
from bodysense.lab.unoc.variants import TABLES, VARIANTS

PAPER_LOSS = LossWeights(expected_error=0.0)  # the paper's network does not judge its error
_VALIDATED = 3000  # frames that are enough to see how a run goes; the tables come from the test people


@dataclass(frozen=True)
class TablesRun:
    """What `bodysense train unoc-tables` was asked for."""

    data: Path
    out: Path
    tables: tuple[str, ...] = tuple(TABLES)
    networks: tuple[str, ...] = ()  # instead of whole tables
    epochs: int = 5
    window_stride: int = 1
    batch_scale: float = 1.0  # on the paper's batch sizes
    seed: int = 1
    jobs: int = 1
    threads: int | None = None
    devices: int = 1
    nodes: int = 1


def run_tables(run: TablesRun) -> None:
    """Train what is not trained yet. Raises BodysenseError where a run in the folder had another configuration."""
    names = chosen_networks(run)
    if run.jobs > 1 and (run.devices > 1 or run.nodes > 1):
        raise BodysenseError(f"--jobs {run.jobs} trains networks side by side; with --devices or --nodes leave it at 1")
    run.out.mkdir(parents=True, exist_ok=True)
    fabric = launched(run)
    for name in names:
        episodes_of(run, VARIANTS[name].config)
    steps = {name: step_count(VARIANTS[name].config, schedule_of(run, name), training_of(run, name)) for name in names}
    todo = fabric.broadcast([name for name in names if not is_trained(run, name)])
    console = Console(quiet=not fabric.is_global_zero)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as progress:
        bar = progress.add_task("training", total=sum(steps.values()))
        for name in _trained(run, todo, fabric, lambda: progress.update(bar, completed=_done(run, steps))):
            console.print(f"trained {VARIANTS[name].title}: {summary(run, name)}", highlight=False)
        progress.update(bar, completed=_done(run, steps))
    console.print(f"{len(names)} networks in {run.out}", highlight=False)


def chosen_networks(run: TablesRun) -> list[str]:
    """The networks that were asked for, each once. Raises BodysenseError for names that do not exist."""
    for given, known, what in ((run.tables, TABLES, "table"), (run.networks, VARIANTS, "network")):
        unknown = [name for name in given if name not in known]
        if unknown:
            raise BodysenseError(f"unknown {what} {unknown[0]!r}; valid are {', '.join(known)}")
    names = run.networks or [name for table in run.tables for name in TABLES[table]]
    return list(dict.fromkeys(names))


def schedule_of(run: TablesRun, name: str) -> Schedule:
    """The paper's schedule, with what the run changes of it."""
    batches = tuple(max(1, round(batch * run.batch_scale)) for batch in Schedule().epoch_batches)
    return Schedule(
        epochs=run.epochs,
        epoch_batches=batches,
        window_stride=run.window_stride,
        average_decay=0.0,
        checkpoint_every=100,
        seed=run.seed,
        loss=replace(PAPER_LOSS, **VARIANTS[name].loss),
    )


def launched(run: TablesRun) -> Fabric:
    """The devices of this process, and its place among those of a run on several, which share one folder."""
    fabric = Fabric(accelerator="auto", devices=run.devices, num_nodes=run.nodes, precision="bf16-mixed")
    fabric.launch()
    return fabric


def train_network(run: TablesRun, name: str, fabric: Fabric | None = None) -> str:
    """Train one network of the tables and write its weights beside its checkpoint and log; returns its name.

    A process of its own, without `fabric`, takes the devices that the run names.
    """
    fabric = fabric or launched(run)
    if run.threads is not None:
        torch.set_num_threads(run.threads)
    torch.manual_seed(run.seed)
    config, schedule, begun = VARIANTS[name].config, schedule_of(run, name), time.monotonic()
    log = run.out / f"{name}.jsonl"

    def report(progress: Report) -> None:
        if fabric.is_global_zero:
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(vars(progress)) + "\n")

    model = BodyNetwork(config, default_skeleton())
    few = _few(episodes_of(run, config)["val"])
    model = train(model, schedule, training_of(run, name), few, run.out / f"{name}.ckpt", report, fabric)
    if fabric.is_global_zero:
        write_weights(model.cpu(), run.out / f"{name}.pt")
        with written_beside(run.out / f"{name}.json") as beside:
            trained = {"identity": identity(config, schedule), "seconds": time.monotonic() - begun}
            beside.write_text(json.dumps(trained), encoding="utf-8")
    fabric.barrier()
    return name


def is_trained(run: TablesRun, name: str) -> bool:
    """Whether the folder holds the network, trained as this run asks. Raises BodysenseError if trained otherwise."""
    path = run.out / f"{name}.json"
    if not path.is_file():
        return False
    before = json.loads(path.read_text(encoding="utf-8"))["identity"]
    now = identity(VARIANTS[name].config, schedule_of(run, name))
    if before != now:
        raise BodysenseError(
            f"{path} is of another configuration ({differences(before, now)}); give another --out, or those settings"
        )
    return True


def summary(run: TablesRun, name: str) -> str:
    """The last line of a network's log, in words."""
    last = json.loads((run.out / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()[-1])
    scores = ", ".join(f"{key} {value:.2f}" for key, value in last["validation"].items())
    return f"{last['step']} steps in {last['seconds']:.0f} s; occluded RMSJPE, cm: {scores}"


def training_of(run: TablesRun, name: str) -> list[Episode]:
    """The training people's episodes, as the network reads them."""
    return episodes_of(run, VARIANTS[name].config)["train"]


def episodes_of(run: TablesRun, config: BodyNetworkConfig) -> dict[str, list[Episode]]:
    """Training and validation people as a network of this configuration reads them, kept in the run's folder."""
    reads = {"inputs": config.inputs, "frame": config.frame, "finger_origin": config.finger_origin}
    folder = run.out / "episodes" / "-".join(reads.values())
    found = {}
    for split in ("train", "val"):
        asked: dict[str, Any] = {**reads, "data": str(run.data.resolve()), "split": split}
        found[split] = cached_episodes(folder / split, asked, partial(_make, run, config, split))
    return found


def _make(run: TablesRun, config: BodyNetworkConfig, split: Any) -> Iterator[Episode]:
    # What a clip looks like to a network does not depend on its weights, nor on its size.
    reader = replace(config, cell="gru", hidden=1, branch=(1,), judge_branch=(1,))
    make = partial(_episode, config=reader)
    with ProcessPoolExecutor(max(1, run.jobs), initializer=torch.set_num_threads, initargs=(1,)) as pool:
        clips = open_clips(run.data, split)
        yield from track(pool.map(make, clips, chunksize=4), description=f"seeing the {split} split")


def _episode(clip: Any, config: BodyNetworkConfig) -> Episode:
    return make_episode(clip, BodyNetwork(config, default_skeleton()), Variation(), np.random.default_rng(0))


def _few(episodes: Sequence[Episode]) -> list[Episode]:
    """Some of them, fingers among them, spread evenly over all; long ones are cut."""
    fingers = [episode for episode in episodes if episode.fingers]
    others = [episode for episode in episodes if not episode.fingers]
    chosen: list[Episode] = []
    for part in (fingers, others):
        frames = 0
        for episode in part[:: max(1, len(part) // 8)]:
            length = min(len(episode), 600, _VALIDATED // 2 - frames)
            if length > 0:
                cut = {key: getattr(episode, key)[:length] for key in ("features", "known", "offset", "visible")}
                chosen.append(replace(episode, **cut))
                frames += length
    return chosen


def _trained(run: TablesRun, names: Sequence[str], fabric: Fabric, tick: Any) -> Iterator[str]:
    """Train networks, `run.jobs` at a time, in processes of their own; `tick` is called every second."""
    if run.jobs == 1:
        for name in names:
            yield train_network(run, name, fabric)
        return
    with ProcessPoolExecutor(run.jobs, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(train_network, run, name) for name in names}
        while waiting:
            done, waiting = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
            tick()
            for future in done:
                yield future.result()


def _done(run: TablesRun, steps: dict[str, int]) -> int:
    """Steps of all networks that their logs report."""
    total = 0
    for name, most in steps.items():
        log = run.out / f"{name}.jsonl"
        if log.is_file() and (lines := log.read_text(encoding="utf-8").splitlines()):
            total += min(most, json.loads(lines[-1])["step"])
    return total
