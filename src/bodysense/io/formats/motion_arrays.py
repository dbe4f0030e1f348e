"""Arrays of one motion, from whatever holds them: .npz, .npy, pickles with dictionaries in dictionaries.

Arrays of joint places come in many shapes: a batch of one, joints first, samples of text-to-motion, and 263 numbers a
frame (HumanML3D: Guo et al., Generating Diverse and Natural 3D Human Motions from Text, CVPR 2022).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.arrays import holds_objects, object_pickle, read_array, read_arrays
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.io.formats.pickled import ENDINGS, read_pickled, unpickled

MOTION = "motion"  # of text-to-motion: (samples, joints, 3, T)
_WORLD = ("global", "world")  # in names of results in the world, which go before those of a camera
_CAMERA = ("incam", "cam")
JOINTS = (22, 24)  # numbers of joints in SMPL's order
VECTOR = 263  # numbers of a frame of HumanML3D


def is_pickled(path: Path) -> bool:
    """Whether a file holds objects of Python: a pickle, or an .npy of objects."""
    return path.suffix.lower() in ENDINGS or (path.suffix.lower() == ".npy" and holds_objects(path))


def motion_arrays(path: Path, keys: Sequence[str], poses: Sequence[str], figure: int | None = None) -> dict[str, Any]:
    """Return the arrays of a motion by name, those of `keys` alone; that of an .npy is 'poses'.

    `poses` are names by which a dictionary in a result is one of a motion; `figure` chooses among several.

    Raises BodysenseError, naming the file and the fix, if it holds no motion, or several without a choice.
    """
    ending = path.suffix.lower()
    if ending == ".npz":
        return dict(read_arrays(path, keys))
    if not is_pickled(path):
        return {"poses": read_array(path)}
    content = read_pickled(path) if ending in ENDINGS else unpickled(object_pickle(path), path)
    found = list(_motions(content, (*poses, MOTION), ""))
    if not found:
        names = [str(key) for key in content] if isinstance(content, dict) else [type(content).__name__]
        raise BodysenseError(
            f"{path}: no poses among {', '.join(names[:8])}; save them with numpy.savez as 'poses', 'trans'"
        )
    best = min(_rank(name) for name, _ in found)
    found = [(name, one) for name, one in found if _rank(name) == best]
    if len(found) > 1 and figure is None:
        names = ", ".join(f"{k} ({name})" for k, (name, _) in enumerate(found[:6], start=1))
        raise BodysenseError(f"{path}: {len(found)} motions in it: {names}; choose one with --figure 1")
    chosen = found[min((figure or 1) - 1, len(found) - 1)][1]
    arrays = {name: np.asarray(value) for name, value in chosen.items() if name in (*keys, MOTION, "lengths")}
    return {name: value for name, value in arrays.items() if value.dtype != object}


def as_frames(array: np.ndarray, place: str, figure: int | None = None) -> np.ndarray:
    """Return joint places (T, J, 3) of an array in another order: a batch of one, joints first, samples.

    Raises BodysenseError for several motions without a choice. Other arrays are returned unchanged.
    """
    shape = array.shape
    if array.ndim == 4 and (shape[2:] in {(count, 3) for count in JOINTS} or shape[1:3] in {(n, 3) for n in JOINTS}):
        if len(array) > 1 and figure is None:
            raise BodysenseError(f"{place}: {len(array)} motions {shape}; choose one with --figure 1")
        if figure is not None and figure > len(array):
            raise BodysenseError(f"{place}: --figure {figure}: there are {len(array)} motions")
        return as_frames(array[(figure or 1) - 1], place)
    if array.ndim == 3 and shape[:2] in {(count, 3) for count in JOINTS} and shape[1:] not in {(n, 3) for n in JOINTS}:
        return np.moveaxis(array, 2, 0)
    return array


def places_of_vectors(vectors: np.ndarray) -> np.ndarray:
    """Return joint places (T, 22, 3) of HumanML3D's vectors (T, 263), as its recover_from_ric does."""
    angle = np.concatenate([[0.0], np.cumsum(vectors[:-1, 0])])
    heading = np.stack([np.cos(angle), 0 * angle, -np.sin(angle), 0 * angle], axis=-1)  # back to the world
    step = np.zeros((len(vectors), 3))
    step[1:, [0, 2]] = vectors[:-1, 1:3]
    root = np.cumsum(quaternion_rotate(heading, step), axis=0)
    root[:, 1] = vectors[:, 3]
    joints = quaternion_rotate(heading[:, None], vectors[:, 4:67].reshape(-1, 21, 3))
    joints[..., [0, 2]] += root[:, None, [0, 2]]
    return np.concatenate([root[:, None], joints], axis=1)


def _motions(content: Any, poses: Sequence[str], name: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the dictionaries in a result that hold poses, with their path."""
    if isinstance(content, dict):
        if any(key in content for key in poses):
            yield name or "result", content
            return
        for key, part in content.items():
            yield from _motions(part, poses, f"{name}/{key}" if name else str(key))
    elif isinstance(content, list) and not all(isinstance(part, (int, float, str)) for part in content):
        for k, part in enumerate(content):
            yield from _motions(part, poses, f"{name}[{k}]")


def _rank(name: str) -> int:
    lower = name.lower()
    return 0 if any(word in lower for word in _WORLD) else 2 if any(word in lower for word in _CAMERA) else 1
