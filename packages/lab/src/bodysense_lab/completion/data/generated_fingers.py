"""Synthetic finger motion: gestures, pinches, counting and hands that touch each other, at realistic speeds.

`lab.synthesis.hands` moves single hands, and `lab.synthesis.pairs` both hands together. Handshapes respect joint limits
and synergies between fingers; tips touch the palm, the thumb and the other hand. Each piece is seeded by its number, so
the first hour is the same for any total duration.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from bodysense.body.hands.hand import HAND_JOINTS, Side, hand_skeleton, mirrored_rotations
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense_lab.completion.data.hands import GENERATED_RATE as RATE
from bodysense_lab.core.progress import with_progress_log
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.pairs import synthesize_pair

FORMAT = "bodysense-fingers-1"
_PIECE = 30.0  # s of one seeded piece
_PAIRS = 0.3  # share of pieces in which both hands interact
_SIDES: tuple[Side, Side] = ("left", "right")


def generate_fingers(hours: float, seed: int = 1) -> np.ndarray:
    """Return local rotations (N, 30, 4) float16 of the fingers of both hands at `RATE`, in the order of a corpus.

    Raises BodysenseError if `hours` is not between 0 and 1000.
    """
    if not 0 < hours < 1000:
        raise BodysenseError(f"--hours {hours:g}: give more than 0 and less than 1000 hours")
    skeleton = default_skeleton()
    hand = hand_skeleton(skeleton, "left")
    places = [skeleton.indices([f"{side}_{name}" for name in HAND_JOINTS[1:]]) - len(BODY) for side in _SIDES]
    pieces = []
    count = math.ceil(hours * 3600 / _PIECE)
    for number in with_progress_log(range(count), "generating fingers", count):
        rng = np.random.default_rng([seed, number])
        if rng.uniform() < _PAIRS:
            both = synthesize_pair(hand, _PIECE, rng, RATE)
        else:
            both = [synthesize_hand(hand, _PIECE, rng, RATE) for _ in _SIDES]
        local = np.empty((len(both[0]), 2 * (len(HAND_JOINTS) - 1), 4), dtype=np.float16)
        for side, place, motion in zip(_SIDES, places, both, strict=True):
            local[:, place] = mirrored_rotations(motion.pose.rotation[:, 1:], side)
        pieces.append(local)
    return np.concatenate(pieces)[: round(hours * 3600 * RATE)]


def kept_fingers(hours: float, seed: int, folder: Path) -> np.ndarray:
    """Return generated fingers, which are stored in a folder. Errors: see `generate_fingers` and `read_fingers`."""
    kept = folder / f"fingers-{hours:g}h-{seed}.npz"
    if not kept.is_file():
        write_fingers(kept, generate_fingers(hours, seed))
    return read_fingers(kept)


def write_fingers(path: Path, fingers: np.ndarray) -> None:
    """Write generated fingers as .npz; the file appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_beside(path) as beside, beside.open("wb") as file:
        np.savez(file, format=FORMAT, rate=RATE, fingers=fingers)


def read_fingers(path: Path) -> np.ndarray:
    """Read a file of `write_fingers`. Raises BodysenseError for any other file."""
    try:
        with np.load(path, allow_pickle=False) as saved:
            if str(saved["format"]) == FORMAT:
                return saved["fingers"]
    except (OSError, ValueError, KeyError):
        pass
    raise BodysenseError(f"{path}: no generated fingers; give the file that `bodysense data fingers` wrote")
