"""Arms and hands from landmarks by inverse kinematics, a baseline for the network of arms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.video.device import LANDMARK_SMOOTHING, VideoSettings
from bodysense.devices.video.landmark_points import LandmarkPoints, with_direction
from bodysense.devices.video.landmark_smoothing import smooth_frame
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.devices.video.posture_constants import VISIBLE
from bodysense_lab.papers.ik.ik import IkSettings, IkState, InverseKinematics

_KNUCKLES = {"index1": "index", "pinky1": "pinky", "thumb2": "thumb"}  # of a hand without its own landmarks
_LAID = tuple(f"{side}_{part}" for side in SIDES for part in ("elbow", "wrist", "knee", "ankle", "toe"))
_TRUNK = ("pelvis", *(f"{side}_{part}" for side in SIDES for part in ("hip", "shoulder")))
_TURN_WEIGHT = 0.04  # m²/rad², weight of the rotations of pelvis, chest and head
_HINT = 0.1  # weight of invisible or rough points


@dataclass(frozen=True)
class LandmarkIk:
    """Solver for bodies of one skeleton. Poses have the pelvis at the origin, in the landmarks' axes."""

    skeleton: Skeleton

    @cached_property
    def _points(self) -> LandmarkPoints:
        return LandmarkPoints(self.skeleton)

    @cached_property
    def _ik(self) -> InverseKinematics:
        return InverseKinematics(self.skeleton, IkSettings(tolerance=1e-4, max_iterations=12))

    def complete(self, person: PersonLandmarks, settings: VideoSettings = VideoSettings()) -> Pose:
        """Return poses (T, …) from landmarks of T frames, smoothed as for videos; a lost body keeps its pose."""
        poses: list[Pose] = []
        state = None
        for frame in range(len(person)):
            smooth = smooth_frame(person, frame, LANDMARK_SMOOTHING, settings.look_ahead)
            if smooth.has_body[0]:
                pose, state = self.solve(smooth, state)
                poses += [pose] * (frame + 1 - len(poses))  # before the first body, as the first
            elif poses:
                poses.append(poses[-1])
        return Pose(
            self.skeleton, np.stack([pose.root_position for pose in poses]), np.stack([pose.rotation for pose in poses])
        )

    def solve(self, person: PersonLandmarks, state: IkState | None) -> tuple[Pose, IkState]:
        """Solve the pose of one frame with a detected body, starting from the previous frame's state."""
        fitted = self._points.fit(person)
        target, weight = fitted.position.copy(), np.zeros(len(self.skeleton.points))
        weight[self.skeleton.indices(_TRUNK)] = 1.0
        limbs = self.skeleton.indices(_LAID)
        weight[limbs] = np.where(fitted.visible[limbs] >= VISIBLE, 1.0, _HINT)
        for side in SIDES:
            self._hand(side, person, target, weight)
        target[weight == 0] = np.nan
        turn_weight = np.where(np.isnan(fitted.rotation[:, 0]), 0.0, _TURN_WEIGHT)
        return self._ik.solve(target, weight, fitted.rotation, turn_weight, state)

    def _hand(self, side: str, person: PersonLandmarks, target: np.ndarray, weight: np.ndarray) -> None:
        """Set the targets of a hand in place, from the detected hand, or else from the arm's landmarks."""
        skeleton, number = self.skeleton, SIDES.index(side)
        wrist = skeleton.index(f"{side}_wrist")
        places = skeleton.indices([f"{side}_{name}" for name in HAND_POINTS])
        if not person.has_hand[0, number]:
            for name, mark in _KNUCKLES.items():
                point = skeleton.index(f"{side}_{name}")
                bone = (skeleton.path[point] - skeleton.path[wrist]) @ skeleton.rest_offset
                start, end = (BODY_LANDMARKS.index(f"{side}_{landmark}") for landmark in ("wrist", mark))
                target[point] = target[wrist] + with_direction(person.world[0, end] - person.world[0, start], bone)
                weight[point] = _HINT
            return
        found = person.hand_world[0, number]
        for k, point in enumerate(places[1:], start=1):
            above = int(np.flatnonzero(places == skeleton.parents[point])[0])
            target[point] = target[places[above]] + with_direction(found[k] - found[above], skeleton.rest_offset[point])
            weight[point] = 1.0
