"""A room camera's view of a person's arms: points in its axes and in its picture (PAHMT, section 4.2).

All functions take batches: one window of motion each, with a camera of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.keypoints import ArmKeypoints, Camera, arm_directions, torso_rotation
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.rays import segment_meets_capsule
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import cross, normalize

VIEW_POINTS = ("shoulder", "elbow", "hip", *HAND_POINTS)  # of a side: the points of all key-points
_SHOULDER, _ELBOW, _HIP, _WRIST = (VIEW_POINTS.index(name) for name in ("shoulder", "elbow", "hip", "wrist"))
_NEAREST = 0.15  # m; closer points cannot be detected
_MARGIN = 0.1  # of the picture's height: a pose detector still places a joint this far outside
_SEEN = 0.6  # share of a hand's points that must be in the picture
_TORSO_RADIUS = 0.11  # m, of a capsule from hips to shoulders that hides hands


@dataclass(frozen=True)
class CameraRange:
    """Distribution of cameras; each number is drawn uniformly from its range."""

    distance: tuple[float, float] = (0.8, 4.0)  # m, from between the shoulders; uniform in its logarithm
    height: tuple[float, float] = (-0.5, 0.5)  # m, over the shoulders
    heading: tuple[float, float] = (-60.0, 60.0)  # degrees, from the direction of the chest
    field_of_view: tuple[float, float] = (35.0, 75.0)  # degrees, over the picture's height
    aspect: tuple[float, float] = (0.56, 1.78)  # width / height
    aim: tuple[float, float] = (-0.25, 0.25)  # m off the middle of the trunk, across and up
    roll: tuple[float, float] = (-4.0, 4.0)  # degrees

    def __post_init__(self) -> None:
        for name, (low, high) in vars(self).items():
            if not low <= high:
                raise BodysenseError(f"camera {name} from {low:g} to {high:g}: give the smaller number first")
        if not (
            self.distance[0] > 0 and self.aspect[0] > 0 and 0 < self.field_of_view[0] <= self.field_of_view[1] < 180
        ):
            raise BodysenseError("cameras need a positive distance and aspect, and a field of view of 0 to 180 degrees")


FRONT = CameraRange((2.5, 2.5), (0.0, 0.0), (0.0, 0.0), (50.0, 50.0), (1.0, 1.0), (0.0, 0.0), (0.0, 0.0))


def view_points(pose: Pose) -> np.ndarray:
    """Return world positions (..., 2, 24, 3) m of `VIEW_POINTS`, left and right."""
    names = [f"{side}_{name}" for side in SIDES for name in VIEW_POINTS]
    position = np.asarray(forward_kinematics(pose)[0])[..., pose.skeleton.indices(names), :]
    return position.reshape(*position.shape[:-2], len(SIDES), len(VIEW_POINTS), 3)


def sample_cameras(points: np.ndarray, rng: np.random.Generator, where: CameraRange = CameraRange()) -> Camera:
    """Draw a camera for each of N poses, points (N, 2, 24, 3) m, around that person and aimed at them."""
    count = len(points)

    def drawn(name: str) -> np.ndarray:
        return rng.uniform(*getattr(where, name), size=count)

    shoulders, hips = points[:, :, _SHOULDER], points[:, :, _HIP]
    neck, trunk = shoulders.mean(axis=1), (shoulders.mean(axis=1) + hips.mean(axis=1)) / 2
    across = shoulders[:, 0] - shoulders[:, 1]
    faces = np.arctan2(-across[:, 2], across[:, 0])  # 0 faces +z
    away = np.exp(rng.uniform(*np.log(where.distance), size=count))
    angle = faces + np.radians(drawn("heading"))
    position = neck + np.stack([away * np.sin(angle), drawn("height"), away * np.cos(angle)], axis=-1)
    up = np.broadcast_to([0.0, 1.0, 0.0], position.shape)
    toward = normalize(position - trunk)
    right = normalize(cross(up, toward))
    target = trunk + right * drawn("aim")[:, None] + up * drawn("aim")[:, None]
    back = normalize(position - target)
    right = normalize(cross(up, back))
    upward = cross(back, right)
    roll = np.radians(drawn("roll"))[:, None]
    axes = np.stack(
        [right * np.cos(roll) + upward * np.sin(roll), upward * np.cos(roll) - right * np.sin(roll), back], axis=-1
    )
    focal = 0.5 / np.tan(np.radians(drawn("field_of_view")) / 2)
    return Camera(position, axes, focal, drawn("aspect"))


def view(points: np.ndarray, time: np.ndarray, camera: Camera) -> ArmKeypoints:
    """Return error-free key-points of world points (..., T, 2, 24, 3) m at `time` (T,) s, from cameras (...).

    An arm is found if its three joints are in the picture or slightly outside, a torso likewise by its shoulders; a
    hand if most of its points are in the picture and the trunk does not hide its wrist.
    """
    local = (points - camera.position[..., None, None, None, :]) @ camera.axes[..., None, None, :, :]
    depth = -local[..., 2]
    ahead = depth > _NEAREST
    focal, aspect = (value[..., None, None, None] for value in (camera.focal, camera.aspect))
    picture = focal[..., None] * local[..., :2] / np.where(ahead, depth, 1.0)[..., None]
    outside = np.maximum(np.abs(picture[..., 0]) - aspect / 2, np.abs(picture[..., 1]) - 0.5)
    near = ahead & (outside < _MARGIN)
    first = len(VIEW_POINTS) - len(HAND_POINTS)
    has_hand = (ahead & (outside <= 0))[..., first:].mean(axis=-1) >= _SEEN
    has_hand &= ahead[..., first:].all(axis=-1) & ~_behind_trunk(local)
    arms = local[..., [_SHOULDER, _ELBOW, _WRIST], :]
    return ArmKeypoints(
        time=np.asarray(time, dtype=float),
        arm=arm_directions(arms),
        has_arm=np.asarray(near[..., [_SHOULDER, _ELBOW, _WRIST]].all(axis=-1)),
        torso=torso_rotation(local[..., _SHOULDER, :], local[..., _HIP, :]),
        has_torso=np.asarray(near[..., _SHOULDER].all(axis=-1)),
        hand=picture[..., first:, :],
        has_hand=has_hand,
    )


def _behind_trunk(local: np.ndarray) -> np.ndarray:
    """Return (..., 2) bool: wrists hidden by the trunk, from points (..., 2, 24, 3) in the camera's axes."""
    wrist = np.moveaxis(local[..., _WRIST, :], -1, 0)
    top, low = (np.moveaxis(local[..., place, :].mean(axis=-2), -1, 0)[..., None] for place in (_SHOULDER, _HIP))
    shape = wrist.shape
    start = np.broadcast_to(low, shape)
    hidden = segment_meets_capsule(wrist, start, np.broadcast_to(top - low, shape), np.array(_TORSO_RADIUS))
    return hidden & (-wrist[2] > -(top[2] + low[2]) / 2)  # a hand that rests on the belly is in front
