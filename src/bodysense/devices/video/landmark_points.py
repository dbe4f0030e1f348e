"""A person's landmarks as points of a skeleton: landmarks give directions, the skeleton lengths.

Landmarks come from a picture: their directions are good, their lengths are guesses. So every limb is placed along its
landmarks with the skeleton's own bones, from the pelvis outward.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.arms import CHEST, SIDES
from bodysense.body.keypoints import torso_rotation
from bodysense.body.rotation import (
    matrix_to_quaternion,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_to_matrix,
)
from bodysense.body.skeleton import Skeleton
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import VISIBLE, PersonLandmarks

_MARK = {name: place for place, name in enumerate(BODY_LANDMARKS)}
# Limbs from the trunk outward: start and end of each bone among the skeleton's points, and the landmarks along it.
_PLACED_BY = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # landmarks that define the body's position
_NEAR = 0.3  # m from the camera, least distance of a person
_ARM, _LEG = (("shoulder", "elbow"), ("elbow", "wrist")), (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))


@dataclass(frozen=True, eq=False)
class LaidPoints:
    """One frame. Lengths from the pelvis, axes those of the landmarks; NaN if unknown."""

    position: np.ndarray  # (P, 3) m: also of legs that are not seen, which stand straight
    visible: np.ndarray  # (P,) probability that a point is seen; 0 if unknown
    rotation: np.ndarray  # (J, 4) wxyz, of pelvis, chest and head
    turned: np.ndarray  # (J,) probability that what the rotation is made of is seen


@dataclass(frozen=True)
class LandmarkPoints:
    """Lays the limbs of a skeleton along landmarks. Raises BodysenseError for one that lacks a point of them."""

    skeleton: Skeleton

    def __post_init__(self) -> None:
        self.skeleton.indices([f"{side}_{name}" for side in SIDES for name in ("toe", "foot")])

    def lay(self, person: PersonLandmarks) -> LaidPoints:
        """The points of one frame that has a body."""
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
        head = _head(mark)
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
                    bone = along(mark[_MARK[f"{side}_{end}"]] - mark[_MARK[f"{side}_{start}"]], bone)
                else:  # a leg out of sight stands straight
                    bone = heading @ bone
                probability = min(visible[first], seen[_MARK[f"{side}_{end}"]])
                put(skeleton.points[last], position[first] + bone, float(probability))
            self._ball(side, position, visible)
        return LaidPoints(position, visible, rotation, turned)

    def _ball(self, side: str, position: np.ndarray, visible: np.ndarray) -> None:
        """The ball of a foot, between its ankle and its toes; in place."""
        knee, ankle, toe, ball = self.skeleton.indices([f"{side}_{name}" for name in ("knee", "ankle", "toe", "foot")])
        rest = self._rest
        before = _frame(rest[toe] - rest[ankle], rest[knee] - rest[ankle])
        after = _frame(position[toe] - position[ankle], position[knee] - position[ankle])
        position[ball] = position[ankle] + after @ before.T @ (rest[ball] - rest[ankle])
        visible[ball] = visible[toe]

    @cached_property
    def _rest(self) -> np.ndarray:
        """(P, 3) m, from the root."""
        return self.skeleton.path @ self.skeleton.rest_offset

    @cached_property
    def _rest_torso(self) -> np.ndarray:
        """(4,) the torso's turn at rest, which is hardly one."""
        shoulders, hips = (
            self._rest[self.skeleton.indices([f"{side}_{part}" for side in SIDES])] for part in ("shoulder", "hip")
        )
        return torso_rotation(shoulders, hips)


def _frame(across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(3, 3) rotation whose x is along `across` and whose y is nearest to `up`."""
    x = across / max(float(np.linalg.norm(across)), 1e-9)
    y = up - (up @ x) * x
    y = y / max(float(np.linalg.norm(y)), 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _head(mark: np.ndarray) -> np.ndarray:
    """(3, 3) the head's turn from landmarks (33, 3): the nose is as high as the ears when it is level."""
    left, right = mark[_MARK["left_ear"]], mark[_MARK["right_ear"]]
    across, ahead = left - right, mark[_MARK["nose"]] - (left + right) / 2
    return _frame(across, np.cross(ahead, across))


def along(direction: np.ndarray, bone: np.ndarray) -> np.ndarray:
    """A bone (3,) of the same length along a direction."""
    return direction * (np.linalg.norm(bone) / max(float(np.linalg.norm(direction)), 1e-9))


def located(laid: LaidPoints, person: PersonLandmarks, skeleton: Skeleton, focal: float) -> np.ndarray:
    """(3,) m: where the pelvis is in the camera's axes, so that joints are seen where the landmarks are.

    A joint at q from a pelvis at (x, y, −depth) is seen at focal · (q + (x, y)) / (depth − q_z): linear in all
    three, solved in the least squares.
    """
    names = [f"{side}_{part}" for part in _PLACED_BY for side in SIDES]
    marks = [BODY_LANDMARKS.index(name) for name in names]
    q = laid.position[skeleton.indices(names)]
    seen, pull = person.picture[0, marks], np.clip(person.visible[0, marks], 0.05, 1.0)
    rows, values = np.zeros((2, len(names), 3)), np.empty((2, len(names)))
    for axis in range(2):
        rows[axis, :, axis] = focal
        rows[axis, :, 2] = -seen[:, axis]
        values[axis] = -focal * q[:, axis] - seen[:, axis] * q[:, 2]
    place = np.linalg.lstsq((rows * pull[:, None]).reshape(-1, 3), (values * pull).ravel(), rcond=None)[0]
    place[2] = -max(place[2], _NEAR)
    return place
