"""Training of the completion networks, from recorded motion to the best weights on validation people."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from lightning_fabric import Fabric

from bodysense.errors import BodysenseError
from bodysense_lab.completion.data.corpus import Corpus, CorpusReader
from bodysense_lab.completion.data.sensor_draws import draw_sensors, draw_without_head
from bodysense_lab.completion.networks.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.score.finger_errors import finger_validation
from bodysense_lab.completion.training.drawing import Drawing
from bodysense_lab.completion.training.options import FINGER_SCHEDULE, CompletionTraining, FingerTraining
from bodysense_lab.completion.training.task import (
    SETS,
    UPDATE_SETS,
    CompletionTask,
    CompletionTaskConfig,
    CorpusSampler,
    FingerTask,
    FingerTaskConfig,
    validation_batches,
)
from bodysense_lab.core.checkpoint import best_weights, checkpoint_identity
from bodysense_lab.core.fit import fit, set_seed_and_threads

_VALIDATION_STRIDE = 3  # every n-th validation clip is scored at a checkpoint


def train_completion(options: CompletionTraining, fabric: Fabric, corpora: CorpusReader) -> CompletionNetwork:
    """Train or resume, and return the network with the best weights on validation people.

    With `options.keep`, they are averaged with the initial weights (Wortsman et al. 2022, "Robust fine-tuning of
    zero-shot models"), which keeps part of the training's effect at a smaller loss of accuracy. Raises BodysenseError
    if fingers are to be trained and no training clip has fingers.
    """
    train, val = _begin(options, fabric, corpora)
    if options.finger_steps and not len(train.with_fingers):
        raise BodysenseError(f"{options.data}: no training clip has fingers that move; give --finger-steps 0")
    fabric.print(f"{train.minutes:.0f} minutes of motion to train on, {val.minutes:.0f} to validate")
    network = _initial_network(options.begin_with, options.update_rank)
    config = CompletionTaskConfig(network.config, backward=options.backward, streams=options.streams)
    for name, parameter in network.named_parameters():
        parameter.requires_grad_(not options.update_rank or name.startswith("updates."))
    initial = {name: value.clone() for name, value in network.state_dict().items()}
    sets = UPDATE_SETS if options.update_rank else SETS
    validation = validation_batches(val, _VALIDATION_STRIDE, options.backward, sets)
    sensors, drawing = draw_without_head if options.update_rank else draw_sensors, None
    if options.draw_processes:
        sampler = CorpusSampler(corpora, options.backward, sensors)
        drawing = Drawing(sampler, options.folder / "ring", options.draw_processes, options.plays)
    source = options.trial_settings or None
    task = CompletionTask(
        *(network, config, options.schedule, train, validation, source), sensors=sensors, drawing=drawing
    )
    fit(task, options.folder / "completion.ckpt", fabric=fabric)
    network = network.cpu()
    if options.keep:
        trained = network.state_dict()
        network.load_state_dict({name: torch.lerp(trained[name], initial[name], options.keep) for name in trained})
    return network


def completion_finger_network(run: CompletionTraining, fabric: Fabric, corpora: CorpusReader) -> FingerNetwork:
    """Return the finger network for the file of a body's network.

    It is trained for `run.finger_steps`. With 0 steps it is that of the file `run.begin_with`; without that file, or if
    time runs backward, it is one with relaxed fingers.
    """
    if run.finger_steps:
        schedule = replace(FINGER_SCHEDULE, steps=run.finger_steps, seed=run.schedule.seed)
        shared = {name: getattr(run, name) for name in ("data", "limit", "threads", "devices", "nodes")}
        options = FingerTraining(out=run.folder / "fingers.ckpt", schedule=schedule, **shared)
        return train_fingers(options, fabric, corpora)
    if run.begin_with is not None and run.begin_with.suffix == ".safetensors" and not run.backward:
        from bodysense_lab.completion.networks.weights_file import read_weights

        return read_weights(run.begin_with)[1]
    return FingerNetwork(FingerConfig()).relaxed_only()


def train_fingers(
    options: FingerTraining, fabric: Fabric, corpora: CorpusReader, config: FingerTaskConfig = FingerTaskConfig()
) -> FingerNetwork:
    """Train or resume, and return the finger network with the best weights on validation clips."""
    train, val = _begin(options, fabric, corpora)
    if options.leave_out:
        train, val = (without_person(corpus, options.leave_out) for corpus in (train, val))
    network = FingerNetwork(config.network)
    config = replace(config, left_out=options.leave_out)
    validation, source = finger_validation(val, train), options.trial_settings or None
    task = FingerTask(network, config, options.schedule, train, validation, source)
    fit(task, options.out, fabric=fabric)
    return network.cpu()


def _begin(
    options: CompletionTraining | FingerTraining, fabric: Fabric, corpora: CorpusReader
) -> tuple[Corpus, Corpus]:
    """Set seed and threads, and return the training and the validation motion."""
    set_seed_and_threads(options.schedule.seed, options.threads)
    with fabric.rank_zero_first():  # other processes find the corpus in the cache
        return corpora("train"), corpora("val")


def _initial_network(path: Path | None, rank: int) -> CompletionNetwork:
    """Return the network to train: a new one, or that of a checkpoint or a published file with its updates.

    Raises BodysenseError if it has another size, or updates of another rank than `rank`, unless that is 0.
    """
    from bodysense_lab.completion.networks.weights_file import read_weights

    if path is None:
        return CompletionNetwork(CompletionConfig())
    if path.suffix == ".safetensors":
        config, weights = (published := read_weights(path)[0]).config, published.state_dict()
    else:
        trained = checkpoint_identity(path).get("network", {}).get("network", {})
        config = CompletionConfig(update_rank=int(trained.get("update_rank", 0)))
        weights = best_weights(path, CompletionNetwork(config))
    if replace(config, update_rank=0) != CompletionConfig():
        raise BodysenseError(f"{path}: built as {config}, wanted {CompletionConfig()}; give another --begin-with")
    if rank and config.update_rank not in (0, rank):
        raise BodysenseError(f"--update-rank {rank}: {path} has updates of rank {config.update_rank}; give that")
    network = CompletionNetwork(replace(config, update_rank=rank or config.update_rank))
    network.load_state_dict(network.state_dict() | weights)
    return network


def without_person(corpus: Corpus, person: str) -> Corpus:
    """Return the corpus without the fingers of a person. Raises BodysenseError if it has no fingers of that person."""
    theirs, others = corpus.finger_clips(person)
    if not len(theirs):
        people = sorted({str(corpus.name[clip]).split("/")[0] for clip in others})
        raise BodysenseError(f"--leave-out {person}: no one of that name has fingers; valid are {', '.join(people)}")
    return corpus.select(np.setdiff1d(np.arange(len(corpus)), theirs))
