"""Features of the completion network for training sequences. The compiled core computes them for single frames."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.data.points import (
    ACCELERATION_POINTS,
    BODY_POINTS,
    INPUT_POINTS,
    SPIN_INDICES,
    SPIN_JOINTS,
    partners,
)

# Kind and points of each input. Inputs that networks of earlier releases lack come last, so that only the last columns
# are missing in their weights.
_INPUTS = {
    "position": ("vector", INPUT_POINTS),
    "has_position": ("number", INPUT_POINTS),
    "velocity": ("vector", INPUT_POINTS),
    "accuracy": ("number", INPUT_POINTS),
    "axes": ("axes", BODY),
    "has_rotation": ("number", BODY),
    "spin": ("axes", SPIN_JOINTS),
    "bones": ("vector", BODY_POINTS),
    "certainty": ("number", BODY_POINTS),
    "interval": ("number", ("interval",)),
    "acceleration": ("vector", ACCELERATION_POINTS),
    "has_acceleration": ("number", ACCELERATION_POINTS),
}
# Signs of each kind of input in a mirror image. Axes are rows x, y, z of two columns: a mirrored rotation changes the
# signs of its x row and of its x column.
_MIRROR_SIGNS = {"number": (1.0,), "vector": (-1.0, 1.0, 1.0), "axes": (1.0, -1.0, -1.0, 1.0, -1.0, 1.0)}
WIDTHS = {name: len(_MIRROR_SIGNS[kind]) * len(of) for name, (kind, of) in _INPUTS.items()}
_MAX_VELOCITY, _MAX_SPIN = 5.0, 15.0  # m/s, and change of axes per second; larger values are clipped
_MAX_ACCELERATION, _ACCELERATION_SCALE = 50.0, 0.1  # m/s², clipped likewise; 10 m/s² is 1
_USUAL_INTERVAL = 1 / 30  # s; this interval is 1
_BONE_SCALE, _CERTAINTY_SCALE = 20.0, 20.0  # 1/m: a deviation of 5 cm is 1


class TrackedSignal(NamedTuple):
    """Tracked points in T frames of B sequences, and known proportions. Untracked points have any finite values."""

    position: Tensor  # (B, T, 27, 3) m, world
    rotation: Tensor  # (B, T, 22, 3, 3) world ← joint
    has_position: Tensor  # (B, T, 27) bool
    has_rotation: Tensor  # (B, T, 22) bool
    accuracy: Tensor  # (B, T, 27) m
    interval: Tensor  # (B, T) s
    turn: Tensor  # (B, T, 3, 3) row vectors in the world @ turn = row vectors in the frame under the head
    origin: Tensor  # (B, T, 3) m, world, of that frame
    before: Before
    rest_offset: Tensor  # (B, 25, 3) m, known or estimated
    certainty: Tensor  # (B, 25) m, standard deviation of each bone length; 0 if known
    size: Tensor  # (B,) the wearer's stature divided by the reference stature
    acceleration: Tensor  # (B, T, 12, 3) m/s², world, of `ACCELERATION_POINTS`
    has_acceleration: Tensor  # (B, T, 12) bool


class Before(NamedTuple):
    """Tracked points of the previous frame."""

    position: Tensor  # (B, T, 27, 3) m, world
    has_position: Tensor  # (B, T, 27) bool
    rotation: Tensor  # (B, T, 3, 3, 3) of `SPIN_JOINTS`
    has_rotation: Tensor  # (B, T, 3) bool


def features_of(signal: TrackedSignal, usual_bones: Tensor) -> Tensor:
    """Return features (B, T, F) of a signal, in the order of `WIDTHS`.

    Vectors are in the frame under the head and at the reference stature. Rotations are x and y axes, row by row.

    Args:
        signal: tracked points.
        usual_bones: (25, 3) m, rest offsets of the reference body.
    """
    into, turn, before = signal.turn, signal.turn.mT[:, :, None], signal.before
    size, interval = signal.size[:, None, None, None], signal.interval[..., None, None]
    known = signal.has_rotation[..., None, None]
    moving = (signal.has_position & before.has_position)[..., None]
    spinning = (signal.has_rotation[..., SPIN_INDICES] & before.has_rotation)[..., None, None]
    velocity = (signal.position - before.position) @ into / size / interval
    spin = turn @ (signal.rotation[..., SPIN_INDICES, :, :] - before.rotation)[..., :2] / interval[..., None]
    bones = (signal.rest_offset / size[..., 0] - usual_bones) * _BONE_SCALE
    acceleration = signal.acceleration @ into / size * signal.has_acceleration[..., None]
    parts = {
        "position": (signal.position - signal.origin[..., None, :]) @ into / size * signal.has_position[..., None],
        "has_position": signal.has_position,
        "velocity": (velocity * moving).clamp(-_MAX_VELOCITY, _MAX_VELOCITY),
        "accuracy": (torch.log(signal.accuracy) / math.log(10) + 3) * signal.has_position,
        "axes": turn @ signal.rotation[..., :2] * known,
        "has_rotation": signal.has_rotation,
        "spin": (spin * spinning).clamp(-_MAX_SPIN, _MAX_SPIN),
        # The pelvis has no parent.
        "bones": torch.cat([torch.zeros_like(bones[:, :1]), bones[:, 1:]], dim=1)[:, None],
        "certainty": signal.certainty[:, None] * _CERTAINTY_SCALE,
        "interval": signal.interval[..., None] / _USUAL_INTERVAL,
        "acceleration": acceleration.clamp(-_MAX_ACCELERATION, _MAX_ACCELERATION) * _ACCELERATION_SCALE,
        "has_acceleration": signal.has_acceleration,
    }
    frames = signal.interval.shape
    rows = (parts[name].flatten(2).expand(*frames, -1).to(signal.position) for name in WIDTHS)
    return torch.cat(list(rows), dim=-1)


def flag_index(kind: str, point: str) -> int:
    """Return the place in the features of the number of a kind, such as `has_position`, for a point."""
    names = list(_INPUTS)
    return sum(WIDTHS[name] for name in names[: names.index(kind)]) + _INPUTS[kind][1].index(point)


def mirror_indices() -> list[int]:
    """Return the index of the mirror image of each feature (F,)."""
    places = list[int]()
    for kind, of in _INPUTS.values():
        first, width = len(places), len(_MIRROR_SIGNS[kind])
        places += [first + width * point + part for point in partners(of) for part in range(width)]
    return places


def mirror_signs() -> list[float]:
    """Return the sign by which each mirrored feature is multiplied (F,)."""
    return [sign for kind, of in _INPUTS.values() for _ in of for sign in _MIRROR_SIGNS[kind]]
