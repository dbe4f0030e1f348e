"""AMASS: motion of the SMPL-H and SMPL-X body models in .npz files.

Mahmood et al., AMASS: Archive of Motion Capture as Surface Shapes, ICCV 2019. AMASS worlds are Z up; they are turned
to +Y up here, so that a body that faces -Y there faces +Z. `io.body_model` gives a body its bones, `io.placement` its
height and floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.arrays import read_arrays
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import sound
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.io.fingers import with_fingers
from bodysense.observing.world_axes import TURNS
from bodysense.quality.plausible import path_in_metres

# Columns of `poses` that are pelvis and body, then both hands, by width. SMPL-X has jaw and eyes between them.
_LAYOUT = {156: (slice(0, 66), slice(66, 156)), 165: (slice(0, 66), slice(75, 165))}
_KEYS = ("poses", "root_orient", "pose_body", "pose_hand", "trans", "mocap_framerate", "mocap_frame_rate")


def read_amass(
    path: str | Path,
    skeleton: Skeleton | None = None,
    trans_to_pelvis: Any = (0.0, 0.0, 0.0),
    unit: float | None = None,
) -> Clip:
    """Read a motion of SMPL-H (T, 156) or SMPL-X (T, 165) from an .npz file of the AMASS layout.

    `skeleton` has the 52 joints; None takes the default one, which `io.placement` then fits. `trans_to_pelvis` (3,)
    metres is added to `trans` to give the pelvis joint: zeros for files whose `trans` is that joint; for AMASS proper,
    whose `trans` moves the whole model, the rest place of the model's pelvis (`body_model.Shape.pelvis`). `unit` is
    metres of one unit of `trans`; None: metres, or centimetres or millimetres if the body moves too fast in metres.
    Fingers that were not recorded are relaxed (`io.fingers`).
    Raises BodysenseError, naming the file, for anything that is not such a motion.
    """
    path = Path(path)
    arrays = read_arrays(path, _KEYS)
    axis_angle = _axis_angle(path, arrays)
    trans = checked_array(path, arrays, "trans", (len(axis_angle), 3))
    rate = _frame_rate(path, arrays)
    trans, warnings = path_in_metres(trans, rate, unit, "trans")
    skeleton = skeleton or default_skeleton()
    smplh = default_skeleton().joints  # the default skeleton's joints are SMPL-H's, in its order
    if set(skeleton.joints) != set(smplh):
        odd = sorted(set(skeleton.joints) ^ set(smplh))[0]
        raise BodysenseError(f"the skeleton for {path} must have the 52 joints of SMPL-H; {odd!r} differs: complete it")
    rotation = quaternion_exp(axis_angle)[:, [smplh.index(joint) for joint in skeleton.joints]]
    rotation[:, 0] = quaternion_multiply(TURNS["z"], rotation[:, 0])
    root = quaternion_rotate(TURNS["z"], trans + np.asarray(trans_to_pelvis, dtype=float))
    pose = Pose(skeleton, root, quaternion_canonical(rotation))
    pose, has_fingers = with_fingers(pose)
    return Clip(path.stem, pose, rate, has_fingers=has_fingers, warnings=tuple(warnings))


def read_shape(path: str | Path) -> tuple[np.ndarray, str]:
    """Return the shape coefficients (N,) and the gender ('' if it is not in the file) of an AMASS or SMPL file.

    Coefficients of each frame (T, N) are averaged. Raises BodysenseError if a file has none.
    """
    path = Path(path)
    arrays = read_arrays(path, ("betas", "gender"))
    if "betas" in arrays:
        arrays["betas"] = np.atleast_2d(arrays["betas"])
    betas = checked_array(path, arrays, "betas", (None, None)).mean(axis=0)
    gender = str(arrays["gender"].reshape(-1)[0]) if arrays.get("gender", np.zeros(0)).size else ""
    return betas, gender.removeprefix("b'").removesuffix("'").lower()


def _axis_angle(path: Path, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return rotations (T, 52, 3), axis-angle, in SMPL-H order."""
    if "poses" in arrays:
        poses = checked_array(path, arrays, "poses", (None, None))
        if poses.shape[1] not in _LAYOUT:
            raise BodysenseError(
                f"{path}: 'poses' has shape {poses.shape}; valid widths are 156 (SMPL-H) and 165 (SMPL-X), "
                "three numbers a joint"
            )
        body, hands = (poses[:, columns] for columns in _LAYOUT[poses.shape[1]])
        parts = [body, hands]
    elif "root_orient" in arrays:
        root = checked_array(path, arrays, "root_orient", (None, 3))
        parts = [root]
        parts += [checked_array(path, arrays, key, (len(root), n)) for key, n in (("pose_body", 63), ("pose_hand", 90))]
    else:
        raise BodysenseError(
            f"{path}: no 'poses' in it (nor 'root_orient'); save them as 'poses' and 'trans' (docs/data.md), or joint "
            "places (T, 22, 3) as 'poses' alone"
        )
    axis_angle = np.concatenate(parts, axis=1)
    if not len(axis_angle):
        raise BodysenseError(f"{path}: no frames in it; give a recording of at least one frame")
    return axis_angle.reshape(len(axis_angle), 52, 3)


def _frame_rate(path: Path, arrays: Mapping[str, np.ndarray]) -> float:
    key = next((key for key in ("mocap_framerate", "mocap_frame_rate") if key in arrays), None)
    if key is None:
        raise BodysenseError(f"{path}: neither 'mocap_framerate' nor 'mocap_frame_rate' in it; add the rate in Hz")
    rate = arrays[key]
    if rate.size != 1 or rate.dtype.kind not in "fiu" or not (np.isfinite(rate).all() and rate.item() > 0):
        raise BodysenseError(f"{path}: {key} is {rate}; it must be one positive number, in Hz")
    return float(rate.item())


def checked_array(path: Path, arrays: Mapping[str, np.ndarray], key: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return the array `key` as float64, its shape checked (None: any length), all finite."""
    if key not in arrays:
        raise BodysenseError(f"{path}: no {key!r} in it; it is needed, with shape {_shape_text(shape)}")
    array = arrays[key]
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "fiu":
        raise BodysenseError(
            f"{path}: {key!r} has shape {array.shape} of {array.dtype}; it must be numbers {_shape_text(shape)}"
        )
    is_whole = array.dtype.kind != "f"  # an integer table may mark missing values by a number
    array = array.astype(np.float64)
    if not (is_whole or sound(array).all()):
        row = int(np.argwhere(~sound(array))[0][0])
        raise BodysenseError(f"{path}: {key!r} is not finite in row {row}; cut or mend that frame")
    return array


def _shape_text(shape: tuple[int | None, ...]) -> str:
    return "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
