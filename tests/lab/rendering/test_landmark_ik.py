from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense_lab.rendering.landmark_ik import LandmarkIk

SKELETON = default_skeleton()
MARK = {name: k for k, name in enumerate(BODY_LANDMARKS)}
OTHER = {"pinky": "pinky1", "index": "index1", "thumb": "thumb2"}  # landmarks by our points


def posed(seed: int = 0, turn: float = 0.0) -> Pose:
    """Return a standing body with random rotations of arms and legs, turned by `turn` rad."""
    rng, pose = np.random.default_rng(seed), standing_pose(SKELETON)
    for name in ("shoulder", "elbow", "hip", "knee"):
        for side in SIDES:
            place = SKELETON.index(f"{side}_{name}")
            pose.rotation[place] = quaternion_multiply(
                pose.rotation[place], quaternion_exp(rng.normal(0, 0.3, 3) * (name != "knee"))
            )
    pose.rotation[0] = quaternion_exp(np.array([0.0, turn, 0.0]))
    return pose


def landmarks_of(poses: list[Pose], scale: float = 1.0) -> PersonLandmarks:
    """Return exact landmarks of bodies, with lengths scaled by `scale`."""
    rows, hands = [], []
    for pose in poses:
        position, rotation = (np.asarray(part) for part in forward_kinematics(pose))
        head = SKELETON.index("head")
        axes = np.array([np.asarray(_turned(rotation[head], axis)) for axis in np.eye(3)])
        at = np.tile(position[head], (len(BODY_LANDMARKS), 1))
        at[MARK["nose"]] += 0.1 * axes[2]
        for sign, side in zip((1, -1), SIDES, strict=True):
            at[MARK[f"{side}_ear"]] += sign * 0.07 * axes[0]
            for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe", *OTHER):
                at[MARK[f"{side}_{name}"]] = position[SKELETON.index(f"{side}_{OTHER.get(name, name)}")]
        rows.append(scale * (at - at[[MARK["left_hip"], MARK["right_hip"]]].mean(axis=0)))
        places = [SKELETON.indices([f"{side}_{name}" for name in HAND_POINTS]) for side in SIDES]
        hands.append(position[np.array(places)])
    count = len(rows)
    return PersonLandmarks(
        time=np.arange(count) / 30,
        world=np.array(rows),
        picture=np.zeros((count, len(BODY_LANDMARKS), 2)),
        visible=np.ones((count, len(BODY_LANDMARKS))),
        has_body=np.ones(count, dtype=bool),
        hand=np.zeros((count, 2, 21, 2)),
        hand_world=np.array(hands),
        has_hand=np.ones((count, 2), dtype=bool),
    )


def _turned(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    from bodysense.geometry.rotation import quaternion_rotate

    return np.asarray(quaternion_rotate(q, vector))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.3])
@pytest.mark.parametrize("turn", [0.0, 2.5])
def test_exact_landmarks_give_the_body_back(scale: float, turn: float) -> None:
    body = LandmarkIk(SKELETON)
    for seed in range(3):
        pose = posed(seed, turn)
        found, _ = body.solve(landmarks_of([pose], scale), None)
        place, true = (np.asarray(forward_kinematics(one)[0]) for one in (found, pose))
        away = np.linalg.norm((place - place[0]) - (true - true[0]), axis=-1)
        assert away.max() < 0.02, SKELETON.points[int(away.argmax())]
        assert float(np.degrees(geodesic_angle(found.rotation[0], pose.rotation[0]))) < 2.0


def test_invisible_legs_are_straight() -> None:
    body, person = LandmarkIk(SKELETON), landmarks_of([posed(1, 0.5)])
    for name in ("knee", "ankle", "toe"):
        for side in SIDES:
            person.visible[0, MARK[f"{side}_{name}"]] = 0.1
            person.world[0, MARK[f"{side}_{name}"]] = 5.0
    found, _ = body.solve(person, None)
    position = np.asarray(forward_kinematics(found)[0])
    for side in SIDES:
        hip, knee, ankle = (position[SKELETON.index(f"{side}_{name}")] for name in ("hip", "knee", "ankle"))
        for upper, lower in ((hip, knee), (knee, ankle)):
            bone = (upper - lower) / np.linalg.norm(upper - lower)
            assert bone[1] > np.cos(np.radians(15))


def test_a_missing_hand_follows_the_landmarks_of_the_arm() -> None:
    body, pose = LandmarkIk(SKELETON), posed(2)
    person = landmarks_of([pose])
    person.has_hand[...] = False
    person.hand_world[...] = np.nan
    found, _ = body.solve(person, None)
    place, true = (np.asarray(forward_kinematics(one)[0]) for one in (found, pose))
    for side in SIDES:
        wrist, knuckle = SKELETON.index(f"{side}_wrist"), SKELETON.index(f"{side}_index1")
        cosine = (place[knuckle] - place[wrist]) @ (true[knuckle] - true[wrist])
        cosine /= np.prod([np.linalg.norm(one[knuckle] - one[wrist]) for one in (place, true)])
        assert np.degrees(np.arccos(min(cosine, 1.0))) < 15
