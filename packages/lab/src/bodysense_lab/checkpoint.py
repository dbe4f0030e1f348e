"""Checkpoints, from which a run goes on as the run that it was, and files of weights."""

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
    """Return the identity on which a checkpoint must agree: the dataclasses of network and schedule.

    `source` is what the run learns from, in plain values.
    """
    parts: dict[str, Any] = {"network": asdict(config), "schedule": asdict(schedule)}
    return json.dumps(parts if source is None else {**parts, "source": dict(source)}, sort_keys=True)


def identity_differences(before: str, now: str) -> str:
    """In what two identities differ, each as 'name: before → now'."""

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
) -> None:
    """Write a checkpoint, whole or not at all, so that a run (its `identity`) may be killed at any moment.

    `best` holds the best weights so far, if the run keeps them.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    state = {"network": network.state_dict(), "optimizer": optimizer.state_dict(), "average": average.state_dict()}
    with written_beside(path) as beside:
        torch.save({"identity": run, "step": step, "best": best, **state}, beside)


def load_checkpoint(
    path: Path, run: str, network: nn.Module, optimizer: torch.optim.Optimizer, average: AveragedModel
) -> tuple[int, dict[str, Any] | None]:
    """Restore the run of this identity; its step and its `best` so far. (0, None) where there is no checkpoint."""
    if not path.exists():
        return 0, None
    saved = _read(path)
    if saved.get("identity") != run:
        raise BodysenseError(
            f"{path} belongs to another configuration ({identity_differences(saved.get('identity', '{}'), run)}); "
            "give another --out, or the settings it was begun with"
        )
    network.load_state_dict(saved["network"])
    optimizer.load_state_dict(saved["optimizer"])
    average.load_state_dict(saved["average"])
    return int(saved["step"]), saved["best"]


def best_weights(path: Path, network: nn.Module) -> dict[str, Tensor]:
    """The weights that did best in the run of a checkpoint. Raises BodysenseError where they are of another network."""
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
    except Exception as error:  # PyTorch raises what it likes: pickle, zip, end of file
        raise BodysenseError(
            f"{path}: not a readable checkpoint ({type(error).__name__}); take it away to begin anew"
        ) from None


Network = TypeVar("Network", bound=nn.Module)


def write_weights_file(network: nn.Module, path: Path, card: Mapping[str, Any]) -> None:
    """Write weights, `network.config` (a dataclass) and card (numbers and texts) in one file, whole or not at all."""
    config: Any = network.config
    plain = json.loads(json.dumps(dict(card)))  # subclasses of numbers could not be read again
    with written_beside(path) as beside:
        torch.save({"config": asdict(config), "weights": network.state_dict(), "card": plain}, beside)


def read_weights_file(
    path: Path, make: Callable[[Any], Network], what: str, command: str
) -> tuple[Network, dict[str, Any]]:
    """The network that `make` builds of a configuration, with its weights, and its card.

    Raises BodysenseError for a file that is not there, or not of `what`, which `command` writes.
    """
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file; train it with `{command}`")
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        network = make(saved["config"])
        network.load_state_dict(saved["weights"])
    except BodysenseError:
        raise
    except Exception as error:  # PyTorch raises what it likes
        raise BodysenseError(
            f"{path}: not the weights of {what} ({type(error).__name__}); give the .pt of `{command}`"
        ) from None
    return network.eval(), saved.get("card", {})
