"""A body from a person's landmarks in 3-D, by inverse kinematics: the landmarks give directions, the skeleton lengths.

Landmarks come from a picture: their directions are good, their lengths are guesses. So every limb is laid along its
landmarks with the skeleton's own bones, from the pelvis outward, and inverse kinematics finds the rotations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.arms import CHEST, HAND_POINTS, SIDES
from bodysense.body.ik import IkSettings, IkState, InverseKinematics
from bodysense.body.keypoints import torso_rotation
from bodysense.body.pose import Pose
from bodysense.body.products import CONJUGATE, MATRIX, multiply
from bodysense.body.rotation import matrix_to_quaternion
from bodysense.body.skeleton import Skeleton
from bodysense.capture.landmarks import BODY_LANDMARKS
from bodysense.capture.person import VISIBLE, PersonLandmarks

_MARK = {name: place for place, name in enumerate(BODY_LANDMARKS)}
# Limbs from the root outward: (start, end) of each bone among the skeleton's points, and the landmarks along it.
_BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))
_LEGS = ("knee", "ankle", "toe")
_KNUCKLES = {"index1": "index", "pinky1": "pinky", "thumb2": "thumb"}  # of a hand that is seen only as part of an arm
_TURN_WEIGHT = 0.04  # m²/rad²: pull of the turns of pelvis, chest and head
_HINT = 0.1  # pull of what is not seen, or only roughly


@dataclass(frozen=True)
class LandmarkBody:
    """Solves bodies of one skeleton. The pose stands where the pelvis is the origin, in the landmarks' axes."""

    skeleton: Skeleton
    ik: InverseKinematics

    def solve(self, person: PersonLandmarks, state: IkState | None) -> tuple[Pose, IkState]:
        """The pose of one frame that has a body, from the frame before."""
        target, weight, turn, turn_weight = self.targets(person)
        return self.ik.solve(target, weight, turn, turn_weight, state)

    def targets(self, person: PersonLandmarks) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Where points should be (P, 3) m and how joints should be turned (J, 4), each with its weights."""
        skeleton, mark, seen = self.skeleton, person.world[0], person.visible[0]
        offset = skeleton.rest_offset
        rest = skeleton.path @ offset
        target, weight = np.full((len(skeleton.points), 3), np.nan), np.zeros(len(skeleton.points))
        turn, turn_weight = np.full((len(skeleton.joints), 4), np.nan), np.zeros(len(skeleton.joints))

        def at(name: str) -> np.ndarray:
            return mark[[_MARK[f"left_{name}"], _MARK[f"right_{name}"]]]

        def aim(joint: str, rotation: np.ndarray) -> None:
            turn[skeleton.index(joint)], turn_weight[skeleton.index(joint)] = rotation, _TURN_WEIGHT

        def put(name: str, place: np.ndarray, pull: float) -> None:
            target[skeleton.index(name)], weight[skeleton.index(name)] = place, pull

        shoulders, hips = at("shoulder"), at("hip")
        torso = torso_rotation(shoulders, hips)
        pelvis = _frame(hips[0] - hips[1], shoulders.mean(axis=0) - hips.mean(axis=0))
        chest = _matrix(multiply(torso[None], self._rest_torso[None] * CONJUGATE))[0]
        aim("pelvis", matrix_to_quaternion(pelvis))
        aim(CHEST, matrix_to_quaternion(chest))
        aim("head", matrix_to_quaternion(_head(mark)))
        put("pelvis", np.zeros(3), 1.0)
        heading = _frame(np.array([pelvis[0, 0], 0.0, pelvis[2, 0]]), np.array([0.0, 1.0, 0.0]))
        for side in SIDES:
            for part, frame in (("hip", pelvis), ("shoulder", chest)):
                point = skeleton.index(f"{side}_{part}")
                put(skeleton.points[point], frame @ rest[point], 1.0)
            for start, end in _BONES:
                first, last = skeleton.index(f"{side}_{start}"), skeleton.index(f"{side}_{end}")
                bone = rest[last] - rest[first]
                is_seen = min(seen[_MARK[f"{side}_{start}"]], seen[_MARK[f"{side}_{end}"]]) >= VISIBLE
                if is_seen or end not in _LEGS:
                    bone = _along(mark[_MARK[f"{side}_{end}"]] - mark[_MARK[f"{side}_{start}"]], bone)
                else:  # a leg out of sight stands straight
                    bone = heading @ bone
                put(skeleton.points[last], target[first] + bone, 1.0 if is_seen else _HINT)
            self._hand(side, person, target, weight)
        return target, weight, turn, turn_weight

    def _hand(self, side: str, person: PersonLandmarks, target: np.ndarray, weight: np.ndarray) -> None:
        """Targets of a hand, from the hand that was found or else from the arm's own landmarks; in place."""
        skeleton, number = self.skeleton, SIDES.index(side)
        wrist = skeleton.index(f"{side}_wrist")
        places = skeleton.indices([f"{side}_{name}" for name in HAND_POINTS])
        if not person.has_hand[0, number]:
            for name, mark in _KNUCKLES.items():
                point = skeleton.index(f"{side}_{name}")
                bone = skeleton.path[point] - skeleton.path[wrist]
                length = bone @ skeleton.rest_offset
                seen = person.world[0, _MARK[f"{side}_{mark}"]] - person.world[0, _MARK[f"{side}_wrist"]]
                target[point], weight[point] = target[wrist] + _along(seen, length), _HINT
            return
        found = person.hand_world[0, number]
        for k, point in enumerate(places[1:], start=1):
            above = int(np.flatnonzero(places == skeleton.parents[point])[0])
            bone = _along(found[k] - found[above], skeleton.rest_offset[point])
            target[point], weight[point] = target[places[above]] + bone, 1.0

    @cached_property
    def _rest_torso(self) -> np.ndarray:
        """(4,) the torso's turn at rest, which is hardly one."""
        rest = self.skeleton.path @ self.skeleton.rest_offset
        shoulders, hips = (
            rest[self.skeleton.indices([f"{side}_{part}" for side in SIDES])] for part in ("shoulder", "hip")
        )
        return torso_rotation(shoulders, hips)


def landmark_body(skeleton: Skeleton) -> LandmarkBody:
    """The solver for a skeleton of the default names. Raises BodysenseError where one is missing."""
    skeleton.indices([f"{side}_{name}" for side in SIDES for name in ("toe", *HAND_POINTS)])
    return LandmarkBody(skeleton, InverseKinematics(skeleton, IkSettings(tolerance=1e-4, max_iterations=12)))


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


def _along(direction: np.ndarray, bone: np.ndarray) -> np.ndarray:
    """A bone (3,) of the same length along a direction."""
    return direction * (np.linalg.norm(bone) / max(float(np.linalg.norm(direction)), 1e-9))


def _matrix(q: np.ndarray) -> np.ndarray:
    """(N, 4) → (N, 3, 3)."""
    return ((q[:, :, None] * q[:, None, :]).reshape(-1, 16) @ MATRIX).reshape(-1, 3, 3)
