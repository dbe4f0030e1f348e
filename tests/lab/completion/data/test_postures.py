"""Postures made from standing people: rotations are valid, knees bend forward, and feet stay on the floor."""

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY, Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply, quaternion_to_matrix
from bodysense.io.clip import Clip
from bodysense_lab.completion.data.postures.postures import KINDS, apply_posture

RATE = 30.0
Standing = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture
def standing(waving_clip: Clip) -> Standing:
    """Return world rotations, pelvis path and offsets of a standing person who waves, played forward and backward."""
    there = np.arange(len(waving_clip))
    pose = waving_clip.pose[np.tile(np.concatenate([there, there[::-1]]), 3)]
    rotation = forward_kinematics(pose)[1][:, : len(BODY)]
    return np.asarray(rotation), np.asarray(pose.root_position), pose.skeleton.rest_offset


def joint_positions(
    rotation: np.ndarray, root: np.ndarray, offset: np.ndarray, skeleton: Skeleton
) -> dict[str, np.ndarray]:
    matrix, places = quaternion_to_matrix(rotation), {"pelvis": root}
    for name in BODY[1:]:
        point = skeleton.index(name)
        parent = skeleton.parents[point]
        places[name] = places[BODY[parent]] + matrix[:, parent] @ offset[point]
    return places


@pytest.mark.parametrize("kind", KINDS)
def test_every_posture_is_a_valid_body(kind: str, standing: Standing) -> None:
    skeleton = default_skeleton()
    for seed in range(2):
        rotation, root = apply_posture(*standing, kind, RATE, np.random.default_rng(seed))
        assert np.allclose(np.linalg.norm(rotation, axis=-1), 1, atol=1e-6)
        assert np.isfinite(root).all()
        places = joint_positions(rotation, root, standing[2], skeleton)
        assert min(places[name][:, 1].min() for name in BODY) > -0.35
        assert np.abs(np.diff(root, axis=0)).max() < 0.15
        for side in ("left", "right"):
            hip, knee = (BODY.index(f"{side}_{name}") for name in ("hip", "knee"))
            bend = quaternion_to_matrix(quaternion_multiply(quaternion_conjugate(rotation[:, hip]), rotation[:, knee]))
            flexed = np.degrees(np.arctan2(bend[:, 2, 1], bend[:, 2, 2]))
            drawn = np.abs(root - standing[1]).max(axis=1) > 0.01  # other frames have the recorded knees
            if kind not in ("lying", "standing"):
                assert (flexed[drawn] > -2).all(), (kind, seed)


def test_a_seated_body_is_low_and_its_feet_stand(standing: Standing) -> None:
    seated = 0
    for seed in range(12):
        rotation, root = apply_posture(*standing, "chair", RATE, np.random.default_rng(seed))
        places = joint_positions(rotation, root, standing[2], default_skeleton())
        sits = root[:, 1] < 0.85 * np.median(standing[1][:, 1])
        if not sits.all():
            continue
        seated += 1
        for side in ("left", "right"):
            ankle = places[f"{side}_ankle"]
            assert np.ptp(ankle, axis=0).max() < 0.02  # the foot stands still
            assert ankle[:, 1].min() > 0.02 and ankle[:, 1].max() < 0.25
    assert seated >= 3


def test_knees_rest_on_the_floor(standing: Standing) -> None:
    heights = []
    for seed in range(12):
        rotation, root = apply_posture(*standing, "kneeling", RATE, np.random.default_rng(seed))
        places = joint_positions(rotation, root, standing[2], default_skeleton())
        if (root[:, 1] < 0.75 * np.median(standing[1][:, 1])).all():
            heights.append([np.median(places[f"{side}_knee"][:, 1]) for side in ("left", "right")])
    assert len(heights) >= 3
    assert np.abs(np.array(heights) - 0.06).max() < 0.1


def test_frames_outside_the_posture_stay_as_recorded(standing: Standing) -> None:
    drawn = (apply_posture(*standing, "crouch", RATE, np.random.default_rng(seed)) for seed in range(30))
    kept = ((rotation, (root == standing[1]).all(axis=1)) for rotation, root in drawn)
    rotation, upright = next((one, upright) for one, upright in kept if 0.1 < upright.mean() < 0.9)
    same = quaternion_multiply(quaternion_conjugate(rotation[upright]), standing[0][upright])
    legs = [BODY.index(f"{side}_{name}") for side in ("left", "right") for name in ("hip", "knee", "ankle")]
    assert np.abs(same[:, legs, 1:]).max() < 1e-5
