"""`bodysense train completion`: from recorded motion to trained weights."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from bodysense.errors import BodysenseError
from bodysense.lab.checkpoint import best_weights
from bodysense.lab.completion.corpus import read_corpus
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.options import CompletionTraining
from bodysense.lab.completion.stored import read_networks
from bodysense.lab.completion.task import CompletionTask, CompletionTaskConfig
from bodysense.lab.completion.validation import validation_batches
from bodysense.lab.fit import begin, fit

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
