"""A trained network in one .pt file: configuration, weights and card, plain values that nothing has to unpickle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import nn

from bodysense.errors import BodysenseError
from bodysense.files import written_beside

Network = TypeVar("Network", bound=nn.Module)


def write_weights_file(network: nn.Module, config: Any, path: Path, card: Mapping[str, Any]) -> None:
    """Weights, configuration (a dataclass) and card (plain numbers and texts), whole or not at all."""
    with written_beside(path) as beside:
        torch.save({"config": asdict(config), "weights": network.state_dict(), "card": dict(card)}, beside)


def read_weights_file(
    path: Path, make: Callable[[dict[str, Any]], Network], what: str, command: str
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
    return network.eval(), saved["card"]
