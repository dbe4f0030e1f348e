"""`bodysense train completion`: from recorded motion to trained weights, watched on validation people."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from torch import Tensor

from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.lab.checkpoint import best_weights
from bodysense.lab.completion.corpus import Corpus, read_corpus
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.options import CompletionTraining
from bodysense.lab.completion.points import INPUT_POINTS
from bodysense.lab.completion.sensor_draws import DrawnSensors
from bodysense.lab.completion.sequences import Draw, Track, TrainingBody, make_sequence
from bodysense.lab.completion.stored import read_networks
from bodysense.lab.completion.task import WORN, CompletionTask, CompletionTaskConfig, SequenceBatch, collate
from bodysense.lab.fit import begin, fit

SETS = ("three_point", "head", "six_point", "headset_camera")
_HANDS = ("head", "left_wrist", "right_wrist")
_SENSORS = {
    "three_point": _HANDS,
    "head": ("head",),
    "six_point": (*_HANDS, "pelvis", "left_ankle", "right_ankle"),
    "headset_camera": ("head",),
}
_GROUP = 16  # sequences side by side


def validation_batches(corpus: Corpus, stride: int) -> dict[str, list[SequenceBatch]]:
    """Whole clips of what wearers do, every `stride`-th, on their own body and on a stranger's; by set and body."""
    clips = [k for k in range(len(corpus)) if corpus.category[k] in WORN][::stride]
    if not clips:
        raise BodysenseError("the val split has no everyday motion; give --data with some, or without categories")
    clips.sort(key=lambda k: corpus.length[k] / corpus.rate[k])
    strangers = sample_bodies("validation", len(clips))
    batches: dict[str, list[SequenceBatch]] = {}
    for name in SETS:
        for whose in ("own", "stranger"):
            pieces = []
            for place, clip in enumerate(clips):
                true = corpus.rest_offset[clip].astype(float) if whose == "own" else strangers[place]
                body = TrainingBody(true, true, np.zeros(len(true)))
                rng = np.random.default_rng([7, clip])
                pieces.append((make_sequence(corpus, clip, Draw(body, track=_worn(name)), rng), 0))
            groups = [pieces[first : first + _GROUP] for first in range(0, len(pieces), _GROUP)]
            batches[f"{name}_{whose}"] = [
                collate(group, max(len(one) for one, _ in group), np.ones(len(group), dtype=bool)) for group in groups
            ]
    return batches


def _worn(name: str) -> Track:
    """A named set of sensors."""

    def track(visible: np.ndarray, interval: float, rng: np.random.Generator) -> DrawnSensors:
        del interval, rng
        position, rotation = (np.isin(points, _SENSORS[name]) for points in (INPUT_POINTS, BODY))
        frames = len(visible)
        has_position = (visible | position) if name == "headset_camera" else np.tile(position, (frames, 1))
        return DrawnSensors(has_position, np.tile(rotation, (frames, 1)), np.ones(frames, dtype=bool))

    return track


_VALIDATION_STRIDE = 3  # of the validation clips every n-th is scored at a checkpoint


def train_completion(options: CompletionTraining) -> CompletionNetwork:
    """Train, or resume, and return the network with the weights that did best on validation people."""
    begin(options.schedule.seed, options.threads)
    train, val = (read_corpus(options.data, split, options.folder / f"{split}.npz") for split in ("train", "val"))
    print(f"{train.minutes:.0f} minutes to learn from, {val.minutes:.0f} to validate")
    config = CompletionTaskConfig()
    network = CompletionNetwork(config.network)
    if options.begin_with is not None:
        network.load_state_dict(_weights(options.begin_with, network))
    task = CompletionTask(network, config, options.schedule, train, validation_batches(val, _VALIDATION_STRIDE))
    fit(task, options.folder / "completion.ckpt")
    return network


def _weights(path: Path, network: CompletionNetwork) -> dict[str, Tensor]:
    """Weights to begin with: the best of a checkpoint, or those of a published file."""
    if path.suffix != ".onnx":
        return best_weights(path, network)
    published, _ = read_networks(path)
    if published.config != network.config:
        raise BodysenseError(f"{path}: built as {published.config}, wanted {network.config}; give another --begin-with")
    return published.state_dict()
