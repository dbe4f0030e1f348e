"""Write a three-point network that answers one wearer at a time again, so that it answers any number at a time.

    python scripts/free_batch_axis.py three_point.onnx -o three_point_many.onnx

Weights and card are those of the file, to the bit. Needs `bodysense[train]`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper

from bodysense.estimators.three_point_answers import load_three_point
from bodysense.models.three_point_network import ThreePointConfig, ThreePointNetwork
from bodysense.training.three_point_onnx import write_three_point


def network_of(path: Path) -> tuple[ThreePointNetwork, dict[str, Any]]:
    """The network of a file that was exported, and its card."""
    card = load_three_point(path).card
    graph = onnx.load(str(path)).graph
    values = {each.name.removesuffix("_half"): numpy_helper.to_array(each) for each in graph.initializer}
    config: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in card["network"].items()
    }
    network = ThreePointNetwork(ThreePointConfig(**config))
    weights = {name: values[f"network.{name}"].astype(np.float32) for name in network.state_dict()}
    network.load_state_dict({name: torch.tensor(value) for name, value in weights.items()})
    return network, card


def main() -> None:
    """Read, write, and see that weights and card are what they were."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    given = parser.parse_args()
    network, card = network_of(given.path)
    write_three_point(network, given.out, card)
    after, card_after = network_of(given.out)
    same = all(
        torch.equal(a, b) for a, b in zip(network.state_dict().values(), after.state_dict().values(), strict=True)
    )
    if not same or card != card_after:
        raise SystemExit(f"{given.out}: weights or card differ from those of {given.path}")
    print(f"{given.out}: the weights and the card of {given.path}, for any number of wearers at a time")


if __name__ == "__main__":
    main()
