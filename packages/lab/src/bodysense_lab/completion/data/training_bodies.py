"""Bodies of training sequences: true proportions, and proportions known to the tracker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.shape import Measured, shape_space
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense_lab.completion.data.points import FINGER_OF, FINGERS, HAND_POINTS

# Distances between points that sensors can measure.
_LENGTHS = (
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("left_hip", "left_ankle"),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("pelvis", "head"),
)
_OWN, _BETWEEN = 0.2, 0.3  # shares of sequences on the recording's own body, and on one between it and a random body
_IMAGES = default_skeleton().mirror  # indices of the mirror images of the 65 points
_MIRRORED = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class TrainingBody:
    """Rest offsets of a body (65, 3) m: true ones, and ones known to the tracker."""

    true: np.ndarray
    known: np.ndarray
    certainty: np.ndarray  # (65,) m, standard deviation of the known bone lengths; 0: exact

    @classmethod
    def fully_known(cls, offset: np.ndarray) -> TrainingBody:
        """Return a body whose true rest offsets are known."""
        return cls(offset, offset, np.zeros(len(offset)))


def draw_body(own: np.ndarray, rng: np.random.Generator) -> TrainingBody:
    """Draw true proportions (the recording's own, a random body's, or between both) and how much of them is known."""
    space = shape_space()
    drawn = rng.uniform()
    true = own.copy()
    if drawn >= _OWN:
        true = space.offsets(np.clip(rng.standard_normal(len(space.components)), -2.5, 2.5))
        if drawn < _OWN + _BETWEEN:
            share = rng.uniform(-0.2, 1.0)
            true = share * own + (1 - share) * true * (_height(own) / _height(true))
        true = _jittered(true, rng)
    return TrainingBody(true, *_draw_known(true, rng))


def with_other_hands(body: TrainingBody, rng: np.random.Generator) -> TrainingBody:
    """Vary the hands of a body: their size, and the lengths and rest directions of the fingers.

    If the proportions are known, the varied hands are known too; otherwise the known offsets stay unchanged.
    """
    true = body.true.copy()
    left = true[HAND_POINTS[0]]
    scale = np.exp(rng.normal(0, 0.05)) * rng.uniform(0.92, 1.08, len(FINGERS))[FINGER_OF, None]
    turn = quaternion_exp(rng.normal(0, np.radians(2.5), left.shape))
    changed = quaternion_rotate(turn, left) * scale
    true[HAND_POINTS[0]], true[HAND_POINTS[1]] = changed, changed * _MIRRORED
    return TrainingBody(true, body.known if body.certainty.any() else true, body.certainty)


def _draw_known(true: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw known rest offsets (65, 3) m and their deviations (65,) m.

    Known are all offsets, the height, a guess of the height, or a guess and some lengths.
    """
    drawn = rng.uniform()
    if drawn < 0.55:
        return true, np.zeros(len(true))
    height, lengths = _height(true), {}
    if drawn < 0.78:
        measured = Measured(height, 0.005)
    elif drawn < 0.9:
        measured = Measured(height * (1 + rng.normal(0, 0.035)), 0.06)
    else:
        measured = Measured(height * (1 + rng.normal(0, 0.015)), 0.03)
        place = default_skeleton().path @ true
        for pair in _LENGTHS:
            if rng.uniform() < 0.5:
                a, b = default_skeleton().indices(pair)
                lengths[pair] = Measured(float(np.linalg.norm(place[a] - place[b])) * (1 + rng.normal(0, 0.01)), 0.01)
    likeliest = shape_space().likeliest(lengths, measured)
    return shape_space().offsets(likeliest.coefficients), likeliest.bone_deviation


def _jittered(offset: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Vary directions and lengths of offsets a little, equally on both sides."""
    turn = quaternion_exp(rng.normal(0, np.radians(2.5), (len(offset), 3)))
    scale = np.exp(rng.normal(0, 0.03, (len(offset), 1)))
    changed = quaternion_rotate(turn, offset) * scale
    mirrored = changed[_IMAGES] * _MIRRORED
    # The left point of each pair is mirrored to the right; points in the middle stay in the middle.
    left = np.array([name.startswith("left_") for name in default_skeleton().points])[:, None]
    right = np.array([name.startswith("right_") for name in default_skeleton().points])[:, None]
    changed = np.where(left, changed, np.where(right, mirrored, (changed + mirrored) / 2))
    path = default_skeleton().path  # leaves out the root's own offset
    sunk = (path @ offset)[:, 1].min() - (path @ changed)[:, 1].min()
    changed[0] = offset[0] + [0.0, sunk, 0.0]
    return changed


def _height(offset: np.ndarray) -> float:
    return float(np.ptp((default_skeleton().path @ offset)[:, 1]))
