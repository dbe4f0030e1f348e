"""Alignment of arms with their lines in the picture, which gives directions across it well, and depth badly.

The directions of an arm's bones across the picture are measured. Landmarks and a network both predict their depths
roughly. The seen lengths bound the depths: a bone seen in full length points neither to the camera nor away from it.
If the legs are hidden, the distance is uncertain, so seen lengths are too, and the network's depths are used.
"""

from __future__ import annotations

import numpy as np

from bodysense.geometry.rotation import normalize

# Fitted on rendered gestures and videos of training people. The mean of network and landmarks predicts the depths of
# upper arm and forearm, as shares of their lengths; bias toward the camera, and error.
_NEARER, _DEPTH_ERROR = np.array([0.0, 0.1]), np.array([0.25, 0.2])
_LENGTH_ERROR = (0.08, 0.28)  # share of a seen length: with the whole body in view, and with its upper half only
_WHOLE = (0.3, 0.8)  # visibility of the legs: depths are the network's below the first, corrected ones above the second
_SHARE = 0.5  # weight of the corrected depth relative to the network's; chosen on videos of validation clips
_DEPTHS = np.linspace(-0.98, 0.98, 50)  # depths that are tried
_BLUNT = 0.13  # m: for bones seen shorter than this the picture is no better than the network


def with_depths(
    bones: np.ndarray,
    landmarks: np.ndarray,
    places: np.ndarray,
    focal: float,
    shoulder: np.ndarray,
    length: np.ndarray,
    whole: float,
) -> np.ndarray:
    """Return unit directions (2, 2, 3) of upper arm and forearm of both sides, with the most likely depths.

    Args:
        bones: (2, 2, 3) unit directions by the network, in the camera's axes.
        landmarks: (2, 2, 3) unit directions by the landmarks.
        places: (2, 3, 2) shoulder, elbow and wrist in the picture, in its heights.
        focal: focal length in heights of the picture.
        shoulder: (2,) m, distances of the shoulders from the camera along its axis.
        length: (2, 2) m, lengths of the bones.
        whole: 0 to 1, visibility of the legs; without them distances are less certain.
    """
    result, away = np.array(bones), np.array(shoulder)
    trust = float(np.interp(whole, _WHOLE, (0.0, _SHARE)))
    if trust == 0:
        return result
    length_error = np.interp(whole, [0.0, 1.0], _LENGTH_ERROR[::-1])
    for k in range(bones.shape[1]):
        predicted = np.clip((bones[:, k, 2] + landmarks[:, k, 2]) / 2 - _NEARER[k], -1, 1)
        line, middle = places[:, k + 1] - places[:, k], (places[:, k + 1] + places[:, k]) / 2
        short = np.linalg.norm(line, axis=-1, keepdims=True)
        expected = _scale(line / np.maximum(short, 1e-9), middle, _DEPTHS[:, None, None], focal)[0][..., 0].T
        distance = away[:, None] - length[:, k, None] / 2 * _DEPTHS
        seen = short * distance / (focal * length[:, k, None])
        cost = ((_DEPTHS - predicted[:, None]) / _DEPTH_ERROR[k]) ** 2 + ((seen - expected) / length_error) ** 2
        weight = np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
        depth = (weight * _DEPTHS).sum(axis=1) / weight.sum(axis=1)
        depth = trust * depth + (1 - trust) * np.clip(bones[:, k, 2], -1, 1)
        across = bones[:, k, :2] / np.maximum(np.linalg.norm(bones[:, k, :2], axis=-1, keepdims=True), 1e-9)
        result[:, k] = np.concatenate([across * np.sqrt(1 - depth[:, None] ** 2), depth[:, None]], axis=-1)
        away = away - length[:, k] * depth
    return result


def align_with_lines(bones: np.ndarray, places: np.ndarray, focal: float, distance: float) -> np.ndarray:
    """Align unit directions (..., 2, 3) of upper arm and forearm with the landmarks in the picture; keep depths.

    Args:
        bones: (..., 2, 3) unit directions in the camera's axes.
        places: (..., 3, 2) shoulder, elbow and wrist in the picture, in its heights.
        focal: focal length in heights of the picture.
        distance: m from the camera to the body.

    A bone with unit direction d and its middle at m in the picture is seen along d_xy + m d_z / focal. This must be s
    times the seen direction.
    """
    line, middle = np.diff(places, axis=-2), (places[..., 1:, :] + places[..., :-1, :]) / 2
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    seen, depth = line / np.maximum(length, 1e-9), bones[..., 2:]
    scale, shift = _scale(seen, middle, depth, focal)
    there = np.concatenate([scale * seen - shift, depth], axis=-1)
    trust = length**4 / (length**4 + (_BLUNT * focal / distance) ** 4)
    return np.asarray(normalize(trust * np.asarray(normalize(there)) + (1 - trust) * bones))


def _scale(seen: np.ndarray, middle: np.ndarray, depth: np.ndarray, focal: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the length (..., 1) of unit bones across the picture, and their shift (..., 2) by perspective.

    Bones have a direction `seen` (..., 2) and a `middle` (..., 2) in the picture, and a `depth` (..., 1).
    """
    shift = middle * depth / focal
    along = (seen * shift).sum(axis=-1, keepdims=True)
    across = along**2 - (shift * shift).sum(axis=-1, keepdims=True) + 1 - depth**2
    return along + np.sqrt(np.maximum(across, 0.0)), shift
