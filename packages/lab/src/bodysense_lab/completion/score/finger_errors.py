"""Errors of untracked fingers in whole clips: of a network, and of the last known hand.

Errors are distances in the frame of the wrist.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense_lab.completion.data.batches import HandBatch, whole_clips
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.hands import RECORDED, hand_kinematics
from bodysense_lab.completion.data.points import FINGER_JOINTS, FINGER_POINTS
from bodysense_lab.completion.data.sensor_draws import fixed_fingers
from bodysense_lab.completion.data.sequences import CAMERA
from bodysense_lab.completion.networks.fingers import BENDING_POINTS, FingerNetwork, finger_positions, with_measured

_SETS = ("nothing", "camera", "tips")
_ROUNDS = 50  # iterations of `mean_hand`


class FingerValidation(NamedTuple):
    """Sequences of a sensor set, and the mean error of a baseline on them."""

    batches: list[HandBatch]
    baseline: float  # m


def finger_validation(corpus: Corpus, train: Corpus) -> dict[str, FingerValidation]:
    """Return the batches of `hand_batches` and the error of a baseline, by sensor set.

    The baseline is the last known hand, or the mean hand of `train` before a hand is first seen.
    """
    mean, result = mean_hand(train), dict[str, FingerValidation]()
    for name in _SETS:
        batches = hand_batches(corpus, name)
        distances = untracked_distances(partial(last_known_fingers, mean), batches)
        result[name] = FingerValidation(batches, float(distances.mean()))
    return result


def hand_batches(corpus: Corpus, sensors: str) -> list[HandBatch]:
    """Return whole clips with fingers, on their own and on unseen hands, both known, tracked by `fixed_fingers`."""
    bodies, fingers = ("own", "stranger"), partial(fixed_fingers, sensors)
    found = whole_clips(corpus, corpus.with_fingers.tolist(), bodies, sensors=CAMERA, fingers=fingers)
    return [batch.hands for batch in found if batch.hands is not None]


def untracked_distances(rotations: Callable[[HandBatch], Tensor], batches: list[HandBatch]) -> Tensor:
    """Return distances (N,) m between estimated and true positions of untracked `BENDING_POINTS`.

    `rotations` returns the estimated rotations (B, T, 2, 15, 3, 3) of a batch. Measured rotations replace them.
    """
    parts = list[Tensor]()
    for hands in batches:
        position = finger_positions(with_measured(rotations(hands), hands.signal), hands.signal.rest_offset)
        distance = (position - hands.true_position).norm(dim=-1)[..., BENDING_POINTS]
        parts.append(distance[~hands.signal.has_position[..., BENDING_POINTS] & hands.valid[..., None, None]])
    return torch.cat(parts)


def predicted_fingers(network: FingerNetwork, hands: HandBatch) -> Tensor:
    """Return the network's rotations (B, T, 2, 15, 3, 3) for whole sequences."""
    return network(hands.signal, network.begin(len(hands.valid)))[0]


def mean_hand(corpus: Corpus) -> Tensor:
    """Return the mean rotations (15, 3, 3), wrist ← joint, of the recorded hands as left hands.

    It is the geometric median of the matrices (Weiszfeld 1937), projected on rotations. Right hands are mirrored.
    """
    frames = np.concatenate(
        [np.arange(int(corpus.length[clip])) + corpus.finger_start[clip] for clip in corpus.with_fingers]
    )
    local = corpus.fingers[frames].astype(float)[:, RECORDED]
    rotation, _ = hand_kinematics(local, np.zeros((2, FINGER_POINTS, 3)))
    rotation[:, 1] *= [1.0, 1.0, -1.0, -1.0]
    matrix = quaternion_to_matrix(rotation.reshape(-1, FINGER_JOINTS, 4))
    middle = matrix.mean(axis=0)
    for _ in range(_ROUNDS):
        weight = 1 / np.maximum(np.linalg.norm(matrix - middle, axis=(-2, -1)), 1e-3)
        middle = (weight[..., None, None] * matrix).sum(axis=0) / weight.sum(axis=0)[:, None, None]
    u, _, v = np.linalg.svd(middle)
    u[..., 2] *= np.linalg.det(u @ v)[:, None]
    return torch.tensor(u @ v, dtype=torch.float32)


def last_known_fingers(mean: Tensor, hands: HandBatch) -> Tensor:
    """Return rotations (B, T, 2, 15, 3, 3) of the last seen hand, or of `mean` (15, 3, 3) before a hand is seen."""
    mirror = torch.tensor([[1.0, -1, -1], [-1.0, 1, 1], [-1.0, 1, 1]])
    held = torch.stack([mean, mean * mirror])[None].expand(len(hands.valid), -1, -1, -1, -1)
    seen = hands.signal.has_position.all(dim=-1)[..., None, None, None]
    rotations = []
    for frame in range(seen.shape[1]):
        held = torch.where(seen[:, frame], hands.true_rotation[:, frame], held)
        rotations.append(held)
    return torch.stack(rotations, dim=1)
