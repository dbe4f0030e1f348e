"""Arms that a video shows beside true ones: where their bones point in the picture and in depth, how wrists shake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.arms import ARM_POINTS, SIDES
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import normalize
from bodysense.devices.simulated.camera_view import Camera
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks

BONES = ("upper_arm", "forearm")
MEASURES = {
    "upper_arm_picture_deg": "upper arm in the picture, °",
    "forearm_picture_deg": "forearm, °",
    "upper_arm_space_deg": "upper arm in space, °",
    "forearm_space_deg": "forearm, °",
    "wrist_acceleration": "wrists, m/s²",
}
_BLUNT = 0.35  # share of a bone's length that is seen, from which the picture shows where it points
_MARKS = [[BODY_LANDMARKS.index(f"{side}_{part}") for part in ARM_POINTS] for side in SIDES]


@dataclass(frozen=True, eq=False)
class ArmBones:
    """Shoulder, elbow and wrist of both sides over T frames; NaN where nobody was found."""

    space: np.ndarray  # (T, 2, 3, 3) m, in the camera's axes
    picture: np.ndarray  # (T, 2, 3, 2) places in the picture


def bones_of(pose: Pose, camera: Camera) -> ArmBones:
    """Of a body (T, …) in the room, and the camera, one or (T,), that sees it."""
    points = pose.skeleton.indices([f"{side}_{part}" for side in SIDES for part in ARM_POINTS])
    position = np.asarray(forward_kinematics(pose)[0])[:, points]
    space = (position - camera.position[..., None, :]) @ camera.axes
    focal = np.asarray(camera.focal)[..., None, None]
    picture = focal * space[..., :2] / -space[..., 2:]
    shape = (len(position), len(SIDES), len(ARM_POINTS))
    return ArmBones(space.reshape(*shape, 3), picture.reshape(*shape, 2))


def bones_of_landmarks(person: PersonLandmarks) -> ArmBones:
    """Of a person's landmarks."""
    return ArmBones(person.world[:, _MARKS], person.picture[:, _MARKS])


def bone_errors(said: ArmBones, truth: ArmBones, interval: float) -> dict[str, np.ndarray]:
    """`MEASURES` of T frames, each with as many values as it has: of bones in the picture where they are seen."""
    flat, deep = np.diff(truth.picture, axis=2), np.diff(truth.space, axis=2)
    is_seen = np.linalg.norm(deep[..., :2], axis=-1) > _BLUNT * np.linalg.norm(deep, axis=-1)
    in_picture, in_space = _angles(np.diff(said.picture, axis=2), flat), _angles(np.diff(said.space, axis=2), deep)
    reach = said.space[:, :, -1] - said.space[:, :, 0]
    shake = np.linalg.norm(np.diff(reach, 2, axis=0), axis=-1) / interval**2
    found: dict[str, np.ndarray] = {"wrist_acceleration": shake}
    for k, bone in enumerate(BONES):
        found[f"{bone}_picture_deg"] = in_picture[..., k][is_seen[..., k]]
        found[f"{bone}_space_deg"] = in_space[..., k]
    return {name: values[np.isfinite(values)] for name, values in found.items()}


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between vectors."""
    cosine = (np.asarray(normalize(a)) * np.asarray(normalize(b))).sum(axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))
