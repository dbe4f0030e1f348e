"""Checkpoints of trainings, from which a run resumes, and files of weights."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from bodysense.errors import BodysenseError
from bodysense.files import written_beside


def identity(config: Any, schedule: Any, source: Mapping[str, Any] | None = None) -> str:
    """Return a run's identity as JSON: the dataclasses of network and schedule, and the source of its data.

    A run resumes only from a checkpoint with the same identity. `source` describes the training data in plain values.
    """
    parts: dict[str, Any] = {"network": asdict(config), "schedule": asdict(schedule)}
    return json.dumps(parts if source is None else {**parts, "source": dict(source)}, sort_keys=True)


def identity_differences(before: str, now: str) -> str:
    """Return the differences of two identities, each as 'name: before → now'."""

    def flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
        parts = (
            flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
            for name, value in values.items()
        )
        return {name: value for part in parts for name, value in part.items()}

    a, b = flat(json.loads(before)), flat(json.loads(now))
    names = [name for name in {**a, **b} if a.get(name) != b.get(name)]
    return ", ".join(f"{name}: {a.get(name, 'none')} → {b.get(name, 'none')}" for name in names)


def save_checkpoint(
    path: Path,
    run: str,
    step: int,
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    average: AveragedModel,
    best: dict[str, Any] | None = None,
    seconds: float = 0.0,
) -> None:
    """Write a checkpoint of the run with identity `run`. The file is complete or not written.

    `best` has the best weights so far, if the run keeps them. `seconds` is the time that the run took so far.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    state = {"network": network.state_dict(), "optimizer": optimizer.state_dict(), "average": average.state_dict()}
    with written_beside(path) as beside:
        torch.save({"identity": run, "step": step, "seconds": seconds, "best": best, **state}, beside)


def load_checkpoint(
    path: Path, run: str, network: nn.Module, optimizer: torch.optim.Optimizer, average: AveragedModel
) -> tuple[int, dict[str, Any] | None, float]:
    """Restore the run with identity `run`, and return its step, its `best` so far and its time in seconds.

    They are (0, None, 0) without a checkpoint.

    Raises BodysenseError if the checkpoint belongs to a run with another identity.
    """
    if not path.exists():
        return 0, None, 0.0
    saved = _read(path)
    if saved.get("identity") != run:
        raise BodysenseError(
            f"{path} belongs to another configuration ({identity_differences(saved.get('identity', '{}'), run)}); "
            "give another --out, or the settings with which it began"
        )
    network.load_state_dict(saved["network"])
    optimizer.load_state_dict(saved["optimizer"])
    average.load_state_dict(saved["average"])
    return int(saved["step"]), saved["best"], float(saved.get("seconds", 0.0))


def best_weights(path: Path, network: nn.Module) -> dict[str, Tensor]:
    """Return the best weights of a checkpoint's run. Raises BodysenseError if they do not fit the network."""
    weights = (_read(path).get("best") or {}).get("weights", {})
    if {name: value.shape for name, value in weights.items()} != {
        name: value.shape for name, value in network.state_dict().items()
    }:
        raise BodysenseError(f"{path} is of a network of another size; give the settings that it was trained with")
    return weights


def checkpoint_identity(path: Path) -> dict[str, Any]:
    """Return the `identity` of a checkpoint's run as nested dictionaries. Raises BodysenseError if it has none."""
    return json.loads(_read(path).get("identity", "{}"))


def _read(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise BodysenseError(f"{path}: no such checkpoint; give the .ckpt of another run")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # PyTorch raises many kinds: pickle, zip, end of file
        raise BodysenseError(
            f"{path}: not a readable checkpoint ({type(error).__name__}); remove it to train from the beginning"
        ) from None


Network = TypeVar("Network", bound=nn.Module)


def write_weights_file(network: nn.Module, path: Path, card: Mapping[str, Any]) -> None:
    """Write weights, `network.config` (a dataclass) and card (numbers and texts) into one file, completely or not."""
    config: Any = network.config
    plain = json.loads(json.dumps(dict(card)))  # subclasses of numbers could not be read again
    with written_beside(path) as beside:
        torch.save({"config": asdict(config), "weights": network.state_dict(), "card": plain}, beside)


def read_weights_file(
    path: Path, make: Callable[[Any], Network], what: str, command: str
) -> tuple[Network, dict[str, Any]]:
    """Return the network that `make` builds from a configuration, with its weights, and its card.

    Raises BodysenseError if the file is missing or is not of `what`. `command`, which writes such files, is in the
    message.
    """
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file; train it with `{command}`")
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        network = make(saved["config"])
        network.load_state_dict(saved["weights"])
    except BodysenseError:
        raise
    except Exception as error:  # PyTorch raises many kinds
        raise BodysenseError(
            f"{path}: not the weights of {what} ({type(error).__name__}); give the .pt of `{command}`"
        ) from None
    return network.eval(), saved.get("card", {})
