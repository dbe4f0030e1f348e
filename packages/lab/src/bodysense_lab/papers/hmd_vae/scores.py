"""Scoring HMD-VAE's networks on a data set: Figs 5 to 7 of the paper and the figures of later papers.

Each frame is answered from the window that ends with it, at the posterior's mean. Positions are from the head, in the
world's axes, whatever the origin that a network was trained with, so that all compare. Needs PyTorch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bodysense.body.body_joints import body_skeleton
from bodysense.body.pose import local_rotation
from bodysense.body.skeleton import BODY, LOWER_BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_log
from bodysense.quality.metrics import on_floor
from bodysense_lab.core.scoring import group_named
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet, census_of
from bodysense_lab.data.windows import Windows
from bodysense_lab.papers.hmd_vae.body_vae import BodyVaeModel, load_body_vae
from bodysense_lab.papers.hmd_vae.body_windows import make_batch
from bodysense_lab.papers.hmd_vae.frames import (
    RATE,
    STRIDE,
    TEST_LENGTH,
    TRAIN_LENGTH,
    BodyFrames,
    read_body_frames,
)
from bodysense_lab.papers.hmd_vae.listed_clips import listed_clips
from bodysense_lab.papers.hmd_vae.network import BodyVae, read_vae
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig

LEGS = tuple(name for name in BODY if name.partition("_")[2] in ("knee", "ankle", "foot"))
JOINTS = {"full": BODY, "legs": LEGS}
FEET = ("left_foot", "right_foot")
_BATCH = 512  # windows that are computed together


Answers = Callable[[BodyFrames, Windows], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Scored:
    """One network's figures; those of a measure are means over frames, or over sequences of 64."""

    name: str
    config: BodyVaeConfig
    card: Mapping[str, Any] = field(repr=False)
    tallies: Tallies = field(repr=False)  # by category group and measure

    def get(self, measure: str, group: str = "main") -> float:
        """A mean; NaN where nothing was counted."""
        return self.tallies.mean(group, measure)


def vaes_in(folder: Path) -> dict[str, Path]:
    """Return the trained models 1 to 4 of a folder, or one that was exported, by name.

    Raises BodysenseError for a folder without any, and for other files.
    """
    if folder.suffix == ".onnx":
        if _config_of(load_body_vae(folder)).model == 0:
            raise BodysenseError(f"{folder}: a model 0 reads the whole body; give a model 1 to 4")
        return {folder.stem: folder}
    found = {path.stem: path for path in sorted(folder.glob("*.pt"))}
    kept = {name: path for name, path in found.items() if read_vae(path)[0].config.model != 0}
    if not kept:
        raise BodysenseError(
            f"{folder}: no trained model 1 to 4 in it; train them with `bodysense train hmd-vae --sweep` into it"
        )
    return kept


def read_test(
    data: DataSet, advance: Callable[[Any], None], split_file: Path | None = None
) -> tuple[BodyFrames, Census]:
    """The data set at 30 Hz, and how much of it is used: clips of 64 frames and more.

    With a split list, the test motions of that list instead of the people of `data.split`.
    """
    clips = data.clips() if split_file is None else listed_clips(data.path, "test", split_file)
    census = Census()

    def counted() -> Any:
        nonlocal census
        for clip in clips:
            advance(clip)
            if clip.seconds * RATE >= TEST_LENGTH - 1:
                census += census_of(clip)
            yield clip

    frames = read_body_frames(counted())
    return frames, census


def score_vae(name: str, path: Path, frames: BodyFrames, threads: int | None = None) -> Scored:
    """Every measure of one network on every clip."""
    if threads is not None:
        torch.set_num_threads(threads)
    config, card, answered = _opened(path)
    tallies = Tallies()
    for clip in range(len(frames)):
        windows = frames.windows(max(config.length, TRAIN_LENGTH), stride=1, clips=np.array([clip]))
        position, local = answered(frames, windows)
        now = windows.frames()[:, -1]
        group = group_named(frames.category[clip])
        for measure, values in measures(position, local, frames.position[now], frames.rotation[now]).items():
            tallies.add((group, measure), values, frames.person[clip])
    return Scored(name, config, card, tallies)


def _opened(path: Path) -> tuple[BodyVaeConfig, Mapping[str, Any], Answers]:
    """The setting and card of a .pt or .onnx, and what answers windows with it."""
    if path.suffix == ".onnx":
        model = load_body_vae(path)
        card = {**model.card, "validation_position_cm": model.card["validation"]["position_cm"]}
        return _config_of(model), card, partial(exported_answers, model)
    network, card = read_vae(path)
    return network.config, card, partial(answers, network)


def _config_of(model: BodyVaeModel) -> BodyVaeConfig:
    return BodyVaeConfig(**model.card["network"])


@torch.no_grad()
def answers(network: BodyVae, frames: BodyFrames, windows: Windows) -> tuple[np.ndarray, np.ndarray]:
    """Positions from the head in the world's axes (W, 22, 3) m, and local rotations (W, 22, 4), one a window."""
    positions, rotations = [], []
    for first in range(0, len(windows), _BATCH):
        batch = make_batch(network.config, frames, windows, np.arange(first, min(first + _BATCH, len(windows))))
        body = network.decode(network.posterior(batch.seen, batch.rest_offset)[0], batch.rest_offset)
        relative, local = body.facing(batch.frame.facing)
        positions.append(relative.numpy())
        rotations.append(local.numpy())
    return np.concatenate(positions).astype(float), np.concatenate(rotations).astype(float)


def exported_answers(model: BodyVaeModel, frames: BodyFrames, windows: Windows) -> tuple[np.ndarray, np.ndarray]:
    """Return the same of an exported network, whose weights are rounded to bytes."""
    reads, head = [BODY.index(name) for name in model.card["reads"]], BODY.index("head")
    positions, rotations = [], []
    for history, clip in zip(windows.frames()[:, -model.frames :], windows.clip, strict=True):
        seen = {
            "position": frames.position[history][:, reads],
            "rotation": frames.rotation[history][:, reads],
            "trust": np.ones(1),
            "noise": np.zeros(model.latent),
            "rest_offset": frames.rest_offset[clip],
        }
        body = model.run({name: values[None].astype(np.float32) for name, values in seen.items()})
        positions.append(body["joint_position"][0] - frames.position[history[-1], head])
        rotations.append(body["local_rotation"][0])
    return np.array(positions, dtype=float), np.array(rotations, dtype=float)


def measures(
    position: np.ndarray, local: np.ndarray, true_position: np.ndarray, true_rotation: np.ndarray
) -> dict[str, np.ndarray]:
    """One value a frame (or a sequence of 64) of every measure, of consecutive frames.

    Args:
        position: (T, 22, 3) m, predicted, from the head.
        local: (T, 22, 4) wxyz, predicted, parent ← joint, the pelvis' of the world.
        true_position: (T, 22, 3) m, world.
        true_rotation: (T, 22, 4) wxyz, world ← joint.

    Position error in cm, velocity error in cm/s (backward differences at 30 Hz), acceleration as the sum of its
    components' sizes (eq. 11: the L1 norm) in m/s², of the full body and of the legs: eqs. 8 to 12. The head's own
    motion is not in it. In the world, under the measured head: jitter in 10² m/s³, foot skate, depth under the floor.
    """
    head = true_position[:, [BODY.index("head")]].astype(float)
    truth, true_rotation = true_position.astype(float) - head, true_rotation.astype(float)
    result: dict[str, np.ndarray] = {}
    for part, names in JOINTS.items():
        chosen = [BODY.index(name) for name in names]
        ours, wanted = position[:, chosen], truth[:, chosen]
        for measure, values, length in (
            ("position_cm", 100 * _size(ours - wanted), TEST_LENGTH),
            ("velocity_cm_s", 100 * RATE * _size(np.diff(ours - wanted, axis=0)), TEST_LENGTH - 1),
            ("acceleration_m_s2", RATE**2 * _taxicab(np.diff(ours, 2, axis=0)), TEST_LENGTH - 2),
            ("truth_acceleration_m_s2", RATE**2 * _taxicab(np.diff(wanted, 2, axis=0)), TEST_LENGTH - 2),
        ):
            result[f"{part}_{measure}"] = values
            result[f"{part}_{measure}_sequences"] = over_sequences(values, length)
    error = 100 * np.linalg.norm(position - truth, axis=-1)
    lower = [BODY.index(name) for name in LOWER_BODY]
    result["lower_position_cm"] = error[:, lower].mean(axis=-1)
    result["upper_position_cm"] = np.delete(error, lower, axis=1).mean(axis=-1)
    true_local = np.asarray(local_rotation(body_skeleton(default_skeleton()), true_rotation))
    result["rotation_deg"] = np.degrees(geodesic_angle(local, true_local)).mean(axis=-1)
    component = np.abs(quaternion_log(local) - quaternion_log(true_local)).mean(axis=(-1, -2))
    result["mpjre_component_deg"] = np.degrees(component)
    ours, wanted = position + head, truth + head
    result["jitter"] = _size(np.diff(ours, 3, axis=0)) * RATE**3 / 100
    result["truth_jitter"] = _size(np.diff(wanted, 3, axis=0)) * RATE**3 / 100
    feet = [BODY.index(name) for name in FEET]
    slide = 100 * RATE * np.linalg.norm(np.diff(ours[:, feet], axis=0)[..., [0, 2]], axis=-1)
    result["skate_cm_s"] = slide[on_floor(wanted[:, feet], RATE)]
    result["penetration_cm"] = 100 * np.maximum(-ours[:, feet, 1], 0).mean(axis=-1)
    return result


def over_sequences(values: np.ndarray, length: int) -> np.ndarray:
    """The mean over every sequence of `length` values (T,), 4 apart."""
    if len(values) < length:
        return np.zeros(0)
    return np.lib.stride_tricks.sliding_window_view(values, length)[::STRIDE].mean(axis=-1)


def _size(vectors: np.ndarray) -> np.ndarray:
    """Mean length of the joints' vectors: (T, J, 3) → (T,)."""
    return np.linalg.norm(vectors, axis=-1).mean(axis=-1)


def _taxicab(vectors: np.ndarray) -> np.ndarray:
    """Mean L1 norm of the joints' vectors: (T, J, 3) → (T,)."""
    return np.abs(vectors).sum(axis=-1).mean(axis=-1)
