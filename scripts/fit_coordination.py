"""Fit the covariance of joints' deviations from an interpolation over a gap: python scripts/fit_coordination.py DATA

DATA is a folder of motion files or a prepared store. From each of its training clips windows are drawn, more from
longer ones. In each window all joints are interpolated over a gap. The covariance of their deviations from that is
written to ``src/bodysense/body/coordination.npz``. Every window counts twice, plain and mirrored.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bodysense.body.coordination import FILE, ROOT, deviations
from bodysense.body.skeleton import BODY
from bodysense.files import written_beside
from bodysense.geometry.rotation import Array
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.data.clips import open_clips

OUTPUT = Path(__file__).parents[1] / "src" / "bodysense" / "body" / FILE
RATE = 30.0  # Hz
LENGTHS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # s, lengths of gaps
EVERY = 4.0  # s of a clip for which one window of each length is drawn
FRAMES = 10  # frames of a gap that are used, evenly spread
MIRRORED = [BODY.index(name.replace("left", "*").replace("right", "left").replace("*", "right")) for name in BODY]


def main() -> None:
    """Draw windows, fit and write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    size = 3 * (ROOT + 1)
    total, count = np.zeros((len(LENGTHS), size, size)), np.zeros(len(LENGTHS), dtype=int)
    for clip in open_clips(options.data, "train"):
        short = resample(clip, RATE)
        for k, seconds in enumerate(LENGTHS):
            for found in windows(short, seconds, rng):
                for one in (found, mirrored(found)):
                    flat = one.reshape(len(one), size)
                    total[k] += flat.T @ flat
                    count[k] += len(flat)
    covariance = total / count[:, None, None]
    rows, columns = np.triu_indices(size)
    with written_beside(options.output) as beside, beside.open("wb") as file:
        np.savez_compressed(file, seconds=np.array(LENGTHS), upper=covariance[:, rows, columns].astype(np.float32))
    print(f"{options.output}: {count.tolist()} frames of gaps of {LENGTHS} s")


def windows(clip: Clip, seconds: float, rng: np.random.Generator) -> list[Array]:
    """Return the deviations (N, J + 1, 3) in some gaps of a clip."""
    count = round(seconds * RATE)
    room = len(clip) - count - 4
    found = []
    if room < 0:
        return found
    joints = clip.pose.skeleton.indices(BODY)
    rotation, root = np.asarray(clip.pose.rotation)[:, joints], np.asarray(clip.pose.root_position)
    kept = np.unique(np.linspace(0, count - 1, FRAMES).round().astype(int))
    for first in rng.integers(0, room + 1, size=max(1, round(len(clip) / RATE / EVERY))).tolist():
        span = slice(first, first + count + 4)
        found.append(deviations(rotation[span], root[span], 2, 2 + count, 1 / RATE)[kept])
    return found


def mirrored(deviation: Array) -> Array:
    """Return the deviations (N, J + 1, 3) of the mirrored motion, with left and right exchanged."""
    turned = deviation[:, MIRRORED] * [1.0, -1.0, -1.0]
    return np.concatenate([turned, deviation[:, ROOT:] * [-1.0, 1.0, 1.0]], axis=1)


if __name__ == "__main__":
    main()
