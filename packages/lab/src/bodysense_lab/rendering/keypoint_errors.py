"""Errors of a detector of key-points, measured as the parameters of `bodysense_lab/papers/pahmt/keypoint_noise.py`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.body.arms import ARM_POINTS, SIDES
from bodysense.body.keypoints import ArmKeypoints, Camera
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.geometry.rotation import normalize, quaternion_conjugate, quaternion_log, quaternion_multiply
from bodysense_lab.papers.pahmt.keypoint_noise import flattened

ARM_BONES = ("upper_arm", "forearm")
MEASURES = {
    "upper_arm_picture_deg": "upper arm in the picture, °",
    "forearm_picture_deg": "forearm, °",
    "upper_arm_space_deg": "upper arm in space, °",
    "forearm_space_deg": "forearm, °",
    "wrist_acceleration": "wrists, m/s²",
}
_MIN_VISIBLE = 0.35  # share of a bone's length in the picture; directions of shorter bones are not compared
_MARKS = [[BODY_LANDMARKS.index(f"{side}_{part}") for part in ARM_POINTS] for side in SIDES]


@dataclass(frozen=True, eq=False)
class ArmBones:
    """Shoulder, elbow and wrist of both sides over T frames; NaN in frames without a person."""

    space: np.ndarray  # (T, 2, 3, 3) m, in the camera's axes
    picture: np.ndarray  # (T, 2, 3, 2) positions in the picture

    def __getitem__(self, key: slice) -> ArmBones:
        """Return the frames of a slice."""
        return ArmBones(self.space[key], self.picture[key])


def bones_of(pose: Pose, camera: Camera) -> ArmBones:
    """Return the bones of a body (T, …) in world axes, seen by one camera or by cameras (T,)."""
    points = pose.skeleton.indices([f"{side}_{part}" for side in SIDES for part in ARM_POINTS])
    position = np.asarray(forward_kinematics(pose)[0])[:, points]
    space = (position - camera.position[..., None, :]) @ camera.axes
    focal = np.asarray(camera.focal)[..., None, None]
    picture = focal * space[..., :2] / -space[..., 2:]
    shape = (len(position), len(SIDES), len(ARM_POINTS))
    return ArmBones(space.reshape(*shape, 3), picture.reshape(*shape, 2))


def bones_of_landmarks(person: PersonLandmarks) -> ArmBones:
    """Return the bones of a person's landmarks."""
    return ArmBones(person.world[:, _MARKS], person.picture[:, _MARKS])


def bone_errors(estimated: ArmBones, truth: ArmBones, interval: float) -> dict[str, np.ndarray]:
    """Return the values of each of `MEASURES` over T frames, at an interval in s; bones that are hidden are omitted."""
    flat, deep = np.diff(truth.picture, axis=2), np.diff(truth.space, axis=2)
    is_seen = np.linalg.norm(deep[..., :2], axis=-1) > _MIN_VISIBLE * np.linalg.norm(deep, axis=-1)
    in_picture, in_space = (
        _angles(np.diff(estimated.picture, axis=2), flat),
        _angles(np.diff(estimated.space, axis=2), deep),
    )
    reach = estimated.space[:, :, -1] - estimated.space[:, :, 0]
    shake = np.linalg.norm(np.diff(reach, 2, axis=0), axis=-1) / interval**2
    found: dict[str, np.ndarray] = {"wrist_acceleration": shake}
    for k, bone in enumerate(ARM_BONES):
        found[f"{bone}_picture_deg"] = in_picture[..., k][is_seen[..., k]]
        found[f"{bone}_space_deg"] = in_space[..., k]
    return {name: values[np.isfinite(values)] for name, values in found.items()}


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles between vectors, degrees."""
    cosine = (np.asarray(normalize(a)) * np.asarray(normalize(b))).sum(axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


Errors = dict[str, list[np.ndarray]]  # arrays (T, …) by kind of error; NaN if nothing was detected


def keypoint_errors(found: ArmKeypoints, true: ArmKeypoints) -> Errors:
    """Return the errors of detected key-points (T,) relative to true ones.

    Keys of the result:
        arm, arm_true: (T, 2, 2, 3) directions of the arms' bones, detected and true.
        torso: (T, 3) rotation vector of the error, rad.
        shape: (T, 2, 4) linear map from the true hand to the detected one, both around their centres, minus identity.
        hand: (T, 2, 21, 2) remaining errors, in shares of the longer side of the true hand's box.
        missed, arm_missed: (T, 2) 1 if a visible part was not detected.
    """
    arms, hands = found.has_arm & true.has_arm, found.has_hand & true.has_hand
    torso = quaternion_log(quaternion_multiply(found.torso, quaternion_conjugate(true.torso)))
    around = [hand - hand.mean(axis=-2, keepdims=True) for hand in (found.hand, true.hand)]
    around = [np.where(hands[..., None, None], one, np.nan) for one in around]
    ours, actual = around
    size = (actual.max(axis=-2) - actual.min(axis=-2)).max(axis=-1)
    square = np.einsum("thpi,thpj->thij", actual, actual)
    square[~hands] = np.eye(2)
    shape = np.linalg.solve(square, np.einsum("thpi,thpj->thij", actual, ours))
    return {
        "arm": [np.where(arms[..., None, None], found.arm, np.nan)],
        "arm_true": [np.where(arms[..., None, None], true.arm, np.nan)],
        "torso": [np.where((found.has_torso & true.has_torso)[:, None], torso, np.nan)],
        "shape": [(shape - np.eye(2)).reshape(len(shape), 2, 4)],
        "hand": [(ours - actual @ shape) / size[..., None, None]],
        "missed": [np.where(true.has_hand, ~found.has_hand, np.nan)],
        "arm_missed": [np.where(true.has_arm, ~found.has_arm, np.nan)],
    }


def noise_figures(parts: Sequence[Errors]) -> dict[str, float]:
    """Return figures of several videos, with the names and units of the fields of `DetectorNoise`.

    Angles are in degrees; figures without detections are NaN. Jitter is white noise, estimated from second differences;
    drift is the remaining error. Directions are compared with true ones that are flattened as by the detector:
    `…_depth_kept` times their depth, shifted by `…_nearer` toward the camera. `depth` is the ratio of the remaining
    errors along the camera's axis to those across it.
    """
    errors = {name: [array for part in parts for array in part[name]] for name in parts[0]}
    lines = [_fit_line(errors["arm"], errors["arm_true"], bone) for bone in range(len(ARM_BONES))]
    kept, nearer = np.array(lines).T
    flat = [flattened(true, kept, nearer) for true in errors["arm_true"]]
    wrong = [found - true for found, true in zip(errors["arm"], flat, strict=True)]
    across, along = [array[..., :2] for array in wrong], [array[..., 2:] for array in wrong]
    figures = {}
    for bone, (share, shift) in zip(ARM_BONES, lines, strict=True):
        figures |= {f"{bone}_depth_kept": share, f"{bone}_nearer": shift}
    for name, arrays, scale in (
        ("arm", across, np.degrees(1.0)),
        ("torso", errors["torso"], np.degrees(1.0)),
        ("hand", errors["hand"], 1.0),
    ):
        jitter = _size([np.diff(array, 2, axis=0) for array in arrays]) / np.sqrt(6.0)  # of white noise, 1 − 2 + 1
        drift = float(np.sqrt(np.maximum(_size(arrays) ** 2 - jitter**2, 0.0)))
        figures |= {f"{name}_drift": drift * scale, f"{name}_jitter": jitter * scale}
    return figures | {
        "depth": _size(along) / (_size(across) or np.nan),
        "hand_shape": _size(errors["shape"]),
        "missed": _mean(errors["missed"]),
        "arm_missed": _mean(errors["arm_missed"]),
    }


def _fit_line(found: Sequence[np.ndarray], true: Sequence[np.ndarray], bone: int) -> tuple[float, float]:
    """Fit a line to detected depths of a bone's directions over true ones; returns slope and intercept."""
    y, x = (np.concatenate([array[..., bone, 2].ravel() for array in arrays]) for arrays in (found, true))
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return float("nan"), float("nan")
    slope, begin = np.linalg.lstsq(np.stack([x, np.ones_like(x)], axis=-1)[known], y[known], rcond=None)[0].tolist()
    return slope, begin


def _size(arrays: Sequence[np.ndarray]) -> float:
    """Return the root mean square of finite values."""
    return float(np.sqrt(_mean([array**2 for array in arrays])))


def _mean(arrays: Sequence[np.ndarray]) -> float:
    values = np.concatenate([array.ravel() for array in arrays])
    values = values[np.isfinite(values)]
    return float(values.mean()) if values.size else float("nan")
