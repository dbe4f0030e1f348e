"""Straightened legs: feet keep their positions, knees straighten, and squats are unchanged."""

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense_lab.completion.data.postures.limbs import hips_of, limb_of
from bodysense_lab.completion.data.postures.postures import apply_posture
from bodysense_lab.completion.data.postures.straight_legs import straightened

Motion = tuple[np.ndarray, np.ndarray, np.ndarray, float]


@pytest.fixture(scope="module")
def walking() -> Motion:
    """Return world rotations, pelvis path, offsets and rate of a walk with bent standing legs."""
    clip = packaged_performance()
    pose = clip.pose[: round(4 * clip.frame_rate)]
    rotation = np.asarray(forward_kinematics(pose)[1])[:, : len(BODY)]
    return rotation, np.asarray(pose.root_position), pose.skeleton.rest_offset, clip.frame_rate


def legs(rotation: np.ndarray, root: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ankles (T, 2, 3) m and flexion of the knees (T, 2), degrees."""
    matrix = quaternion_to_matrix(rotation)
    hips, ankles, bent = root[:, None] + hips_of(matrix[:, 0], offset), [], []
    for k, side in enumerate(("left", "right")):
        limb = limb_of("leg", side, offset)
        upper, lower = matrix[:, limb.first] @ limb.upper, matrix[:, limb.second] @ limb.lower
        ankles.append(hips[:, k] + upper + lower)
        cosine = (upper * lower).sum(axis=-1) / np.linalg.norm(limb.upper) / np.linalg.norm(limb.lower)
        bent.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(ankles, axis=1), np.stack(bent, axis=1)


def test_standing_legs_straighten_over_feet_that_stay(walking: Motion) -> None:
    rotation, root, offset, rate = walking
    after, raised = straightened(rotation, root, offset, 1.0, rate)
    (ankles, bent), (ankles_after, bent_after) = legs(rotation, root, offset), legs(after, raised, offset)
    rise = (raised - root)[:, 1]
    assert 0.001 < rise.max() <= 0.05 and (rise >= 0).all()
    assert np.abs((raised - root)[:, [0, 2]]).max() == 0
    np.testing.assert_allclose(ankles_after, ankles, atol=2e-3)
    raised_frames = rise > 0.002
    assert np.median(bent_after.min(axis=1)[raised_frames]) < np.median(bent.min(axis=1)[raised_frames]) - 2
    others = [k for k, name in enumerate(BODY) if name.rpartition("_")[2] not in ("hip", "knee")]
    turned = quaternion_to_matrix(after[:, others]) - quaternion_to_matrix(rotation[:, others])
    assert np.abs(turned).max() < 1e-6


def test_a_share_of_straightening_raises_by_that_share(walking: Motion) -> None:
    rotation, root, offset, rate = walking
    whole, half = (straightened(rotation, root, offset, share, rate)[1] - root for share in (1.0, 0.5))
    np.testing.assert_allclose(half, whole / 2, atol=1e-12)


def test_the_pelvis_rises_smoothly(walking: Motion) -> None:
    rotation, root, offset, rate = walking
    rise = (straightened(rotation, root, offset, 1.0, rate)[1] - root)[:, 1]
    assert np.abs(np.diff(rise)).max() * rate < 0.4  # m/s


@pytest.mark.parametrize("kind", ["chair", "crouch", "kneeling"])
def test_legs_far_from_straight_are_unchanged(walking: Motion, kind: str) -> None:
    rotation, root, offset, rate = walking
    for seed in range(6):
        seated, path = apply_posture(rotation, root, offset, kind, rate, np.random.default_rng(seed))
        if path[:, 1].max() > 0.7 * offset[0, 1]:
            continue
        after, raised = straightened(seated, path, offset, 1.0, rate)
        assert np.abs(raised - path).max() < 0.012
        assert np.abs(quaternion_to_matrix(after) - quaternion_to_matrix(seated)).max() < 0.2
