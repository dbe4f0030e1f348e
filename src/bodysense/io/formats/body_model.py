"""SMPL, SMPL-H and SMPL-X model files (.npz): the bones of a body from its shape coefficients.

Joints are `J_regressor` · (`v_template` + `shapedirs` · betas), SMPL eq. 10 (Loper et al. 2015). The models are not
included: their licences forbid it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense.arrays import read_arrays
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.amass import checked_array, read_shape
from bodysense.io.rigs.canonical import complete_skeleton

GENDERS = ("female", "male", "neutral")  # in this order: 'female' contains 'male'
# Rows of a model's joints that are ours, by their number: SMPL has no fingers, SMPL-X has jaw and eyes before them.
_ROWS = {24: np.arange(22), 52: np.arange(52), 55: np.r_[0:22, 25:55]}
_SHAPES = 300  # coefficients of shape in SMPL-X's full files; the others are of the face
_SHORT = 20  # directions of SMPL-X's short files, of which half are of the face
_FOOT = 0.05  # m over the lowest vertex: these vertices may be the soles of another shape


@dataclass(frozen=True, eq=False)
class Shape:
    """A body of some shape coefficients."""

    skeleton: Skeleton  # its root offset puts the soles on y = 0 in the rest pose
    pelvis: np.ndarray  # (3,) m, place of the pelvis at rest in the model's own frame, to which `trans` is added


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A model file: rest joints and soles, and how shape coefficients move them."""

    path: Path
    joints: np.ndarray  # (J, 3) m
    joint_directions: np.ndarray  # (J, 3, B) m a unit of a coefficient
    parents: np.ndarray  # (J,)
    soles: np.ndarray  # (F, 3) m, vertices near the floor
    sole_directions: np.ndarray  # (F, 3, B)

    def shape(self, betas: np.ndarray) -> Shape:
        """Return the body of coefficients (N,). Coefficients that the model lacks are ignored."""
        betas = np.asarray(betas, dtype=float)[: self.joint_directions.shape[2]]
        place = self.joints + self.joint_directions[..., : len(betas)] @ betas
        lowest = (self.soles + self.sole_directions[..., : len(betas)] @ betas)[:, 1].min()
        names, rows = default_skeleton().joints, _ROWS[len(place)]
        offset = {joint: place[row] - place[self.parents[row]] for joint, row in zip(names[1:], rows[1:], strict=False)}
        return Shape(complete_skeleton(offset, np.array([0.0, place[0, 1] - lowest, 0.0])), place[0])


def shape_in_file(path: Path, place: Path) -> Shape:
    """Return the body of the `betas` and the gender in a file; `place` is a model file or a folder (`model_for`)."""
    betas, gender = read_shape(path)
    return model_for(place, gender).shape(betas)


def model_for(place: Path, gender: str) -> BodyModel:
    """Return the model of a file, or of the file in a folder whose path names the gender.

    Raises BodysenseError, with the fix, if the folder has no such file.
    """
    if not place.is_dir():
        return read_model(place)
    files: dict[str, Path] = {}
    for path in sorted(place.rglob("*.npz"), reverse=True):
        inside = path.relative_to(place).as_posix().lower()
        files[next((one for one in GENDERS if one in inside), "")] = path
    if gender not in files:
        there = ", ".join(sorted(one for one in files if one)) or "none"
        raise BodysenseError(
            f"--smpl-model {place}: no .npz file for a {gender or 'nameless'} body, of {there}; add it, as in "
            f"{gender or 'neutral'}/model.npz, or give one file for all bodies"
        )
    return read_model(files[gender])


def read_model(path: Path) -> BodyModel:
    """Read a model file; cached until the file changes. Refuse a .pkl with a command that converts it."""
    if path.suffix != ".npz":
        keep = "v_template=np.array(m['v_template']), shapedirs=np.array(m['shapedirs']), kintree_table=np.array("
        script = f"import pickle, numpy as np; m = pickle.load(open('{path.name}', 'rb'), encoding='latin1'); "
        script += f"j = m['J_regressor']; np.savez('{path.stem}.npz', {keep}m['kintree_table']), "
        script += "J_regressor=getattr(j, 'toarray', lambda: np.array(j))())"
        raise BodysenseError(
            f"--smpl-model {path}: a model is read from .npz; a pickle may run any code when it is read. If you trust "
            f'it, convert it once (pip install scipy chumpy): python -c "{script}"'
        )
    return _read_model(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=3)
def _read_model(path: Path, changed: int) -> BodyModel:
    """Read a model file; `changed` is its modification time, the key of the cache."""
    arrays = read_arrays(path, ("J_regressor", "v_template", "kintree_table", "shapedirs"))
    vertices = checked_array(path, arrays, "v_template", (None, 3))
    directions = checked_array(path, arrays, "shapedirs", (len(vertices), 3, None))
    regressor = checked_array(path, arrays, "J_regressor", (None, len(vertices)))
    count = len(regressor)
    if count not in _ROWS:
        raise BodysenseError(f"{path}: a model of {count} joints; valid are SMPL (24), SMPL-H (52) and SMPL-X (55)")
    if count == 55:
        directions = directions[..., : directions.shape[2] // 2 if directions.shape[2] == _SHORT else _SHAPES]
    parents = checked_array(path, arrays, "kintree_table", (2, count))[0].astype(np.int64)
    _check_tree(path, parents)
    near = vertices[:, 1] < vertices[:, 1].min() + _FOOT
    joint_directions = np.tensordot(regressor, directions, axes=1)
    return BodyModel(path, regressor @ vertices, joint_directions, parents, vertices[near], directions[near])


def _check_tree(path: Path, parents: np.ndarray) -> None:
    ours, rows = default_skeleton(), _ROWS[len(parents)]
    for joint, row in zip(ours.joints[1:], rows[1:], strict=False):
        expected = rows[ours.parents[ours.index(joint)]]
        if parents[row] != expected:
            raise BodysenseError(
                f"{path}: kintree_table hangs joint {row} on {parents[row]}, but SMPL's {joint!r} hangs on {expected}; "
                "is this a SMPL, SMPL-H or SMPL-X model?"
            )
