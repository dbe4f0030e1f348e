"""Write usual postures of hands, from generated motion: devices/gloves/postures.npy.

    python scripts/hand_postures.py

The first row is the mean of the 26 angles (`body.hand.FREEDOMS`), rad; the others take what differs from it to numbers
of variance one, at most: directions that hardly vary are taken to vary by 0.05 rad.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.body.hands.hand import angles_of, hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense_lab.synthesis.hands import synthesize_hand

FILE = Path(__file__).parents[1] / "src" / "bodysense" / "devices" / "gloves" / "postures.npy"
PIECES, SECONDS, RATE, SEED, LEAST = 15, 20.0, 10.0, 77000, 0.05


def main() -> None:
    """Generate motion and write the file."""
    hand = hand_skeleton(default_skeleton(), "left")
    pieces = [synthesize_hand(hand, SECONDS, np.random.default_rng(SEED + k), RATE).pose for k in range(PIECES)]
    angles = np.concatenate([np.asarray(angles_of(pose.rotation[:, 1:])) for pose in pieces])
    variance, direction = np.linalg.eigh(np.cov(angles.T))
    white = direction / np.sqrt(np.maximum(variance, LEAST**2))
    np.save(FILE, np.concatenate([angles.mean(axis=0)[None], white]).astype(np.float32))


if __name__ == "__main__":
    main()
