"""Recalibrate expected errors and bounds of a completion network after a change of the core's step.

Runs the tracker over people in the training data and over validation people, fits the maps of errors, and writes the
same weights with them. The packaged network takes a quarter of an hour of one core:

    python scripts/calibrate_network.py src/bodysense/weights/completion.safetensors --data DATA -o new.safetensors
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from bodysense_lab.completion.networks.publish import publish
from bodysense_lab.completion.networks.weights_file import read_safetensors, read_weights


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=Path, help="completion network, .safetensors")
    parser.add_argument("--data", type=Path, required=True, help="folder of motion files or a prepared store")
    parser.add_argument("-o", "--out", type=Path, required=True, help="file to write")
    parser.add_argument("--limit", type=int, help="number of clips of each split, for a trial; all if omitted")
    args = parser.parse_args()
    body, fingers = read_weights(args.network)
    _, metadata = read_safetensors(args.network)
    card = {name: json.loads(value) for name, value in metadata.items() if name != "format"}
    publish(body, fingers, args.data, args.out, card, args.limit, card.get("backward", False))


if __name__ == "__main__":
    main()
