"""Points of a skeleton from a person's landmarks: landmarks give directions, the skeleton gives lengths.

Landmarks come from a picture: their directions are good, their lengths are guesses. So every bone of the skeleton gets
the direction of its landmarks and keeps its own length, from the pelvis outward.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.arms import CHEST, SIDES
from bodysense.body.keypoints import torso_rotation
from bodysense.body.skeleton import Skeleton
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.devices.video.posture_constants import NEAR, VISIBLE
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_to_matrix,
)

_MARK = {name: place for place, name in enumerate(BODY_LANDMARKS)}
_LOCATING = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # landmarks that define the body's position
TRUNK = ("shoulder", "hip")  # the same before legs are known
# Bones of limbs, from the trunk outward.
_ARM, _LEG = (("shoulder", "elbow"), ("elbow", "wrist")), (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))


@dataclass(frozen=True, eq=False)
class FittedPoints:
    """Points of one frame, from the pelvis, in the axes of the landmarks; NaN if unknown."""

    position: np.ndarray  # (P, 3) m; legs that are not seen stand straight
    visible: np.ndarray  # (P,) probability that a point is seen; 0 if unknown
    rotation: np.ndarray  # (J, 4) wxyz, of pelvis, chest and head
    turned: np.ndarray  # (J,) probability that the landmarks that define the rotation are seen


@dataclass(frozen=True)
class LandmarkPoints:
    """Fit of a skeleton's points to landmarks. Raises BodysenseError for a skeleton without toes or balls of feet."""

    skeleton: Skeleton

    def __post_init__(self) -> None:
        self.skeleton.indices([f"{side}_{name}" for side in SIDES for name in ("toe", "foot")])

    def fit(self, person: PersonLandmarks) -> FittedPoints:
        """Return the points of one frame with a body."""
        skeleton, mark, seen = self.skeleton, person.world[0], person.visible[0]
        rest, count = self._rest, len(skeleton.points)
        position, visible = np.full((count, 3), np.nan), np.zeros(count)
        rotation, turned = np.full((len(skeleton.joints), 4), np.nan), np.zeros(len(skeleton.joints))

        def at(name: str) -> np.ndarray:
            return mark[[_MARK[f"{side}_{name}"] for side in SIDES]]

        def sure(*names: str) -> float:
            return float(min(seen[_MARK[f"{side}_{name}"]] for name in names for side in SIDES))

        def put(name: str, place: np.ndarray, probability: float) -> None:
            position[skeleton.index(name)], visible[skeleton.index(name)] = place, probability

        def aim(joint: str, matrix: np.ndarray, probability: float) -> None:
            rotation[skeleton.index(joint)] = matrix_to_quaternion(matrix)
            turned[skeleton.index(joint)] = probability

        shoulders, hips = at("shoulder"), at("hip")
        pelvis = _frame(hips[0] - hips[1], shoulders.mean(axis=0) - hips.mean(axis=0))
        chest = quaternion_to_matrix(
            quaternion_multiply(torso_rotation(shoulders, hips), quaternion_conjugate(self._rest_torso))
        )
        # In a level head the nose is as high as the ears.
        left, right = mark[_MARK["left_ear"]], mark[_MARK["right_ear"]]
        across, ahead = left - right, mark[_MARK["nose"]] - (left + right) / 2
        head = _frame(across, np.cross(ahead, across))
        aim("pelvis", pelvis, sure("hip", "shoulder"))
        aim(CHEST, chest, sure("shoulder"))
        aim("head", head, sure("ear"))
        put("pelvis", np.zeros(3), sure("hip"))
        # The neck is turned half as far as the head.
        neck = rest[skeleton.index("head")] - rest[skeleton.index("neck")]
        top = chest @ rest[skeleton.index("neck")] + (chest @ neck + head @ neck) / 2
        put("head", top, min(sure("ear"), sure("shoulder")))
        heading = _frame(np.array([pelvis[0, 0], 0.0, pelvis[2, 0]]), np.array([0.0, 1.0, 0.0]))
        for side in SIDES:
            for part, frame in (("hip", pelvis), ("shoulder", chest)):
                point = skeleton.index(f"{side}_{part}")
                put(skeleton.points[point], frame @ rest[point], float(seen[_MARK[f"{side}_{part}"]]))
            for start, end in (*_ARM, *_LEG):
                first, last = skeleton.index(f"{side}_{start}"), skeleton.index(f"{side}_{end}")
                bone = rest[last] - rest[first]
                is_seen = min(seen[_MARK[f"{side}_{start}"]], seen[_MARK[f"{side}_{end}"]]) >= VISIBLE
                if is_seen or (start, end) in _ARM:
                    bone = with_direction(mark[_MARK[f"{side}_{end}"]] - mark[_MARK[f"{side}_{start}"]], bone)
                else:  # an unseen leg stands straight
                    bone = heading @ bone
                probability = min(visible[first], seen[_MARK[f"{side}_{end}"]])
                put(skeleton.points[last], position[first] + bone, float(probability))
            self._ball(side, position, visible)
        return FittedPoints(position, visible, rotation, turned)

    def _ball(self, side: str, position: np.ndarray, visible: np.ndarray) -> None:
        """Fill in the ball of a foot, between ankle and toes, in place."""
        knee, ankle, toe, ball = self.skeleton.indices([f"{side}_{name}" for name in ("knee", "ankle", "toe", "foot")])
        rest = self._rest
        before = _frame(rest[toe] - rest[ankle], rest[knee] - rest[ankle])
        after = _frame(position[toe] - position[ankle], position[knee] - position[ankle])
        position[ball] = position[ankle] + after @ before.T @ (rest[ball] - rest[ankle])
        visible[ball] = visible[toe]

    @cached_property
    def _rest(self) -> np.ndarray:
        """(P, 3) m, points of the rest pose from the root."""
        return self.skeleton.path @ self.skeleton.rest_offset

    @cached_property
    def _rest_torso(self) -> np.ndarray:
        """(4,) rotation of the torso in the rest pose, close to the identity."""
        shoulders, hips = (
            self._rest[self.skeleton.indices([f"{side}_{part}" for side in SIDES])] for part in ("shoulder", "hip")
        )
        return torso_rotation(shoulders, hips)


def _frame(across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) with x along `across` and y closest to `up`."""
    x = across / max(float(np.linalg.norm(across)), 1e-9)
    y = up - (up @ x) * x
    y = y / max(float(np.linalg.norm(y)), 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def with_direction(direction: np.ndarray, bone: np.ndarray) -> np.ndarray:
    """Return a bone (3,) of the same length with another direction (3,)."""
    return direction * (np.linalg.norm(bone) / max(float(np.linalg.norm(direction)), 1e-9))


def locate_pelvis(
    fitted: FittedPoints,
    person: PersonLandmarks,
    skeleton: Skeleton,
    focal: float,
    parts: tuple[str, ...] = _LOCATING,
) -> np.ndarray:
    """Return the position (3,) m of the pelvis in the camera's axes that projects joints of `parts` onto landmarks.

    A joint at q from a pelvis at (x, y, −depth) is seen at focal · (q + (x, y)) / (depth − q_z). This is linear in x, y
    and depth, and solved by least squares.
    """
    names = [f"{side}_{part}" for part in parts for side in SIDES]
    marks = [BODY_LANDMARKS.index(name) for name in names]
    q = fitted.position[skeleton.indices(names)]
    seen, pull = person.picture[0, marks], np.clip(person.visible[0, marks], 0.05, 1.0)
    rows, values = np.zeros((2, len(names), 3)), np.empty((2, len(names)))
    for axis in range(2):
        rows[axis, :, axis] = focal
        rows[axis, :, 2] = -seen[:, axis]
        values[axis] = -focal * q[:, axis] - seen[:, axis] * q[:, 2]
    place = np.linalg.lstsq((rows * pull[:, None]).reshape(-1, 3), (values * pull).ravel(), rcond=None)[0]
    place[2] = -max(place[2], NEAR)
    return place
