"""The flesh of a hand, and how deep hands stand in each other."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.capsules import fit_primitives
from bodysense.body.hands.hand import FINGERS, hand_skeleton, limits, rotations_of
from bodysense.body.hands.hand_capsules import (
    GIVE,
    NAMES,
    capsule_axes,
    hand_capsules,
    mutual_depth,
    own_depth,
    own_pairs,
)
from bodysense.body.pose import Pose, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton


def hand() -> Skeleton:
    return hand_skeleton(default_skeleton(), "left")


def random_poses(skeleton: Skeleton, count: int, seed: int, spread: float = 0.03) -> Pose:
    rng = np.random.default_rng(seed)
    low, high = limits()
    wrist = rng.normal(size=(count, 1, 4))
    wrist /= np.linalg.norm(wrist, axis=-1, keepdims=True)
    finger = rotations_of(rng.uniform(0.5 * low, 0.7 * high, size=(count, 26)))
    return Pose(skeleton, rng.normal(scale=spread, size=(count, 3)), np.concatenate([wrist, finger], axis=1))


def sampled_distance(start: np.ndarray, along: np.ndarray, other: np.ndarray, other_along: np.ndarray) -> float:
    """The oracle: the nearest of many points on two segments (3,)."""
    share = np.linspace(0, 1, 81)[:, None]
    return float(np.linalg.norm((start + share * along)[:, None] - (other + share * other_along), axis=-1).min())


def test_segments_are_as_thick_as_the_bodys() -> None:
    capsules, body = hand_capsules(hand()), fit_primitives(default_skeleton())
    for name, radius, end in zip(capsules.names[:15], capsules.radius, capsules.end, strict=False):
        place = body.names.index(f"left_{name}")
        assert radius == pytest.approx(body.radius[place])
        if name != "thumb3":  # the body's own leaves the bone there
            np.testing.assert_allclose(end, body.end[place], atol=1e-3)


@pytest.mark.parametrize("finger", FINGERS)
def test_a_finger_ends_at_its_tip(finger: str) -> None:
    skeleton, capsules = hand(), hand_capsules(hand())
    place = NAMES.index(f"{finger}3")
    reached = np.linalg.norm(capsules.end[place]) + capsules.radius[place]
    assert reached == pytest.approx(skeleton.bone_length[skeleton.index(f"{finger}_tip")])


def test_a_larger_hand_is_the_same_hand() -> None:
    skeleton = hand()
    one, two = hand_capsules(skeleton), hand_capsules(skeleton.with_offsets(1.3 * skeleton.rest_offset))
    for field in ("start", "end", "radius"):
        np.testing.assert_allclose(getattr(two, field), 1.3 * getattr(one, field), atol=1e-12)


def test_a_flat_hand_stands_nowhere_in_itself() -> None:
    assert own_depth(rest_pose(hand())).max() < 0


def test_depth_in_itself_is_what_samples_say() -> None:
    skeleton = hand()
    poses, (first, second) = random_poses(skeleton, 12, seed=1), own_pairs()
    depth, (start, along) = own_depth(poses), capsule_axes(poses)
    radius = hand_capsules(skeleton).radius
    assert depth.shape == (12, len(first)) and (depth > 0).any() and (depth < 0).any()
    for frame in range(12):
        for pair in np.argsort(depth[frame])[-6:]:
            a, b = first[pair], second[pair]
            distance = sampled_distance(start[frame, a], along[frame, a], start[frame, b], along[frame, b])
            expected = (1 - GIVE) * (radius[a] + radius[b]) - distance
            assert expected - 1e-9 <= depth[frame, pair] <= expected + 1e-3


def test_depth_of_two_hands_is_what_samples_say() -> None:
    small, large = hand(), hand().with_offsets(1.1 * hand().rest_offset)
    left, right = random_poses(small, 6, seed=2), random_poses(large, 6, seed=3)
    depth = mutual_depth(left, right)
    start, along = capsule_axes(left)
    other, other_along = (part * [-1, 1, 1] for part in capsule_axes(right))
    assert depth.shape == (6, len(NAMES), len(NAMES)) and (depth > 0).any()
    for frame, a, b in np.argwhere(depth > np.quantile(depth, 0.98)):
        distance = sampled_distance(start[frame, a], along[frame, a], other[frame, b], other_along[frame, b])
        expected = (1 - GIVE) * (hand_capsules(small).radius[a] + hand_capsules(large).radius[b]) - distance
        assert expected - 1e-9 <= depth[frame, a, b] <= expected + 1e-3


def test_it_is_the_same_whichever_hand_comes_first() -> None:
    left, right = random_poses(hand(), 5, seed=4), random_poses(hand(), 5, seed=5)
    np.testing.assert_allclose(mutual_depth(left, right), mutual_depth(right, left).swapaxes(-1, -2), atol=1e-12)


def test_batch_axes_lead() -> None:
    poses = random_poses(hand(), 6, seed=6)
    folded = Pose(poses.skeleton, poses.root_position.reshape(2, 3, 3), poses.rotation.reshape(2, 3, 16, 4))
    np.testing.assert_array_equal(own_depth(folded).reshape(6, -1), own_depth(poses))
    assert own_depth(poses[0]).shape == own_pairs()[0].shape
