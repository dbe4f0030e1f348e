"""Arms along the lines on which they are seen: a picture tells directions across it well, and depth badly.

A network says how far the bones of an arm point toward the camera; where they point across the picture is measured.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.rotation import normalize

_BLUNT = 0.13  # m: of a bone that is seen so short the picture tells its direction no better than the network


def along_lines(bones: np.ndarray, places: np.ndarray, focal: float, distance: float) -> np.ndarray:
    """Unit directions (..., 2, 3) of upper arm and forearm that are seen where the landmarks are.

    Args:
        bones: (..., 2, 3) unit directions in the camera's axes, of which the depth is kept.
        places: (..., 3, 2) shoulder, elbow and wrist in heights of the picture.
        focal: focal length in heights of the picture.
        distance: m from the camera to the body.

    A bone d in the middle of places m is seen along d_xy + m d_z / focal, which is to be s times the seen direction;
    d has unit length.
    """
    line, middle = np.diff(places, axis=-2), (places[..., 1:, :] + places[..., :-1, :]) / 2
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    seen, depth = line / np.maximum(length, 1e-9), bones[..., 2:]
    shift = middle * depth / focal
    along = (seen * shift).sum(axis=-1, keepdims=True)
    across = along**2 - (shift * shift).sum(axis=-1, keepdims=True) + 1 - depth**2
    scale = along + np.sqrt(np.maximum(across, 0.0))
    there = np.concatenate([scale * seen - shift, depth], axis=-1)
    trust = length**4 / (length**4 + (_BLUNT * focal / distance) ** 4)
    return np.asarray(normalize(trust * np.asarray(normalize(there)) + (1 - trust) * bones))
