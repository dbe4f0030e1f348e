"""Validation of fingers: clips that no one trains on, on recorded and on strangers' hands, beside simple baselines."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.shape import sample_bodies
from bodysense.lab.completion.corpus import Corpus
from bodysense.lab.completion.finger_sequences import (
    FingersTracked,
    TrackFingers,
    clips_with_fingers,
    hand_kinematics,
    make_finger_sequence,
)
from bodysense.lab.completion.finger_task import (
    FingerBatch,
    FingerValidation,
    collate_fingers,
    finger_positions,
    mean_error,
    with_measured,
)
from bodysense.lab.completion.fingers import FINGER_JOINTS, FINGER_POINTS, HAND_JOINTS
from bodysense.lab.completion.sequences import Draw, TrainingBody

SETS = ("nothing", "camera", "tips")
_BODY_JOINTS = int(HAND_JOINTS.min())
_GROUP = 16  # sequences side by side
_ROUNDS = 50  # of the mean hand's search


def finger_validation(corpus: Corpus, train: Corpus) -> dict[str, FingerValidation]:
    """Sequences of `finger_batches` with a baseline.

    The baseline is the hand as it was last known, and the mean hand of `train` where it never was.
    """
    mean = mean_hand(train)
    return {
        name: FingerValidation(batches, mean_error([last_known_error(one, mean) for one in batches], batches))
        for name, batches in finger_batches(corpus, SETS).items()
    }


def finger_batches(corpus: Corpus, sets: tuple[str, ...]) -> dict[str, list[FingerBatch]]:
    """Whole clips with fingers, on their own hands and on a stranger's, told, by set of sensors."""
    clips = [int(clip) for clip in clips_with_fingers(corpus)]
    clips.sort(key=lambda clip: corpus.length[clip] / corpus.rate[clip])
    strangers = sample_bodies("validation", len(clips))
    result: dict[str, list[FingerBatch]] = {}
    for name in sets:
        pieces = []
        for place, clip in enumerate(clips):
            for true in (corpus.rest_offset[clip].astype(float), strangers[place]):
                body, rng = TrainingBody(true, true, np.zeros(len(true))), np.random.default_rng([7, clip])
                pieces.append((make_finger_sequence(corpus, clip, Draw(body), _tracked(name), rng), 0))
        groups = [pieces[first : first + _GROUP] for first in range(0, len(pieces), _GROUP)]
        result[name] = [
            collate_fingers(group, max(len(one) for one, _ in group), np.ones(len(group), dtype=bool))
            for group in groups
        ]
    return result


def mean_hand(corpus: Corpus) -> Tensor:
    """The rotations (15, 3, 3) wrist ← joint of a left hand that miss the recorded ones least, right ones mirrored.

    The least sum of distances of matrices (Weiszfeld 1937), projected on rotations.
    """
    frames = np.concatenate(
        [np.arange(int(corpus.length[clip])) + corpus.finger_start[clip] for clip in clips_with_fingers(corpus)]
    )
    local = corpus.fingers[frames].astype(float)[:, HAND_JOINTS - _BODY_JOINTS]
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


def last_known_error(batch: FingerBatch, mean: Tensor) -> Tensor:
    """Distances (B, T, 2, 20), m, of the hand as it was last seen, and before that of the hand `mean` (15, 3, 3)."""
    mirror = torch.tensor([[1.0, -1, -1], [-1.0, 1, 1], [-1.0, 1, 1]])
    held = torch.stack([mean, mean * mirror])[None].expand(len(batch.begins), -1, -1, -1, -1)
    seen = batch.signal.has_position.all(dim=-1)[..., None, None, None]
    rotations = []
    for frame in range(seen.shape[1]):
        held = torch.where(seen[:, frame], batch.true_rotation[:, frame], held)
        rotations.append(held)
    rotation = with_measured(torch.stack(rotations, dim=1), batch.signal)
    return (finger_positions(rotation, batch.signal.rest_offset) - batch.true_position).norm(dim=-1)


def _tracked(name: str) -> TrackFingers:
    """A named set of sensors, wrists tracked too where fingers are or controllers."""

    def track(visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingersTracked:
        del interval, rng
        frames = len(visible)
        has_position = np.zeros((frames, 2, FINGER_POINTS), dtype=bool)
        if name == "tips":
            has_position[..., FINGER_JOINTS:] = True
        if name == "camera":
            has_position[:] = visible[..., None]
        has_wrist = visible if name == "camera" else np.ones_like(visible)
        return FingersTracked(has_position, np.zeros((frames, 2, FINGER_JOINTS), dtype=bool), has_wrist)

    return track
