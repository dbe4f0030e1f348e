"""The family of hands: what zeros and draws are, whom it holds, and how motion is carried over."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.glove import MARKERS, hand_size, marker_positions
from bodysense.body.hands.hand import HAND_JOINTS, hand_skeleton
from bodysense.body.hands.hand_family import (
    COUNT,
    body_with_hand,
    draw_hand,
    draw_parameters,
    hand_arrays,
    hand_from_arrays,
    hand_of,
    plain_hand,
    shapes_of,
    transfer_pose,
)
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.shape import shape_space
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense_lab.synthesis.hands import synthesize_hand


def test_many_shapes_are_single_ones() -> None:
    rng = np.random.default_rng(1)
    parameters = np.stack([draw_parameters(rng) for _ in range(3)])
    many = shapes_of(parameters)
    for k in range(3):
        for one, several in zip(shapes_of(parameters[k]), many, strict=True):
            np.testing.assert_allclose(one, several[k], atol=1e-12)


def test_hands_differ_as_adults_do_and_markers_stay_near() -> None:
    rng = np.random.default_rng(2)
    hands = [draw_hand(rng) for _ in range(200)]
    size = np.array([hand_size(hand.skeleton) for hand in hands])
    assert size.min() > 0.14 and size.max() < 0.26 and 0.18 < size.mean() < 0.21
    tips = [MARKERS.index(name) for name in MARKERS if name.endswith("tip")]
    away = np.array([np.linalg.norm(hand.glove.offset[tips], axis=-1) for hand in hands])
    assert np.percentile(away, 90) < 0.012


@pytest.mark.parametrize("who", ["an avatar", "adults"])
def test_the_family_holds_hands_that_it_was_not_made_of(who: str) -> None:
    rng = np.random.default_rng(3)
    drawn = shapes_of(np.stack([draw_parameters(rng) for _ in range(2000)])).rest
    if who == "an avatar":
        bodies = [packaged_performance().pose.skeleton]
    else:
        space = shape_space()
        bodies = [space.skeleton_of(np.clip(rng.standard_normal(space.size), -2.5, 2.5)) for _ in range(20)]
    lengths = np.linalg.norm(drawn, axis=-1)[:, 1:]
    share = lengths / lengths.sum(axis=1, keepdims=True)
    for body in bodies:
        one = hand_skeleton(body, "left").bone_length[1:]
        assert (abs(one / one.sum() - share.mean(axis=0)) < 3.5 * share.std(axis=0)).all()


def test_motion_is_carried_over_to_the_same_hand_as_it_is_and_keeps_bones_of_another() -> None:
    rng = np.random.default_rng(4)
    hand = hand_skeleton(default_skeleton(), "left")
    pose = synthesize_hand(hand, 0.5, rng).pose
    same = transfer_pose(pose, plain_hand(hand))
    np.testing.assert_allclose(same.rotation, pose.rotation, atol=1e-9)
    other = draw_hand(rng)
    points, _ = forward_kinematics(transfer_pose(pose, other))
    parents = np.array(other.skeleton.parents[1:])
    between = np.linalg.norm(np.asarray(points)[:, 1:] - np.asarray(points)[:, parents], axis=-1)
    np.testing.assert_allclose(between, np.tile(other.skeleton.bone_length[1:], (len(between), 1)), atol=1e-9)


def test_rows_make_the_hand_again() -> None:
    hand = draw_hand(np.random.default_rng(5))
    rows = hand_arrays(hand)
    again = hand_from_arrays(rows["points"], rows["axes"], rows["markers"])
    rest = np.zeros((len(HAND_JOINTS), 4))
    rest[:, 0] = 1.0
    for one in (hand, again):
        np.testing.assert_allclose(one.skeleton.rest_offset, hand.skeleton.rest_offset)
    flat = [np.asarray(marker_positions(one.glove, Pose(one.skeleton, np.zeros(3), rest))) for one in (hand, again)]
    np.testing.assert_allclose(flat[0], flat[1], atol=1e-12)
    with pytest.raises(BodysenseError, match="points are"):
        hand_from_arrays(np.zeros((3, 3)), np.zeros((15, 4)), np.zeros((9, 3)))
    with pytest.raises(BodysenseError, match="give metres"):
        hand_from_arrays(100 * hand.skeleton.rest_offset, hand.axes, hand.glove.offset)


def test_a_body_gets_a_hand() -> None:
    body, hand = default_skeleton(), hand_of(np.zeros(COUNT))
    for side in ("left", "right"):
        changed = body_with_hand(body, side, hand)
        np.testing.assert_allclose(hand_skeleton(changed, side).rest_offset, hand.skeleton.rest_offset)
    assert _same_but_hand(body, body_with_hand(body, "left", hand))


def _same_but_hand(one: Skeleton, other: Skeleton) -> bool:
    kept = [k for k, name in enumerate(one.points) if not name.startswith("left_") or name == "left_wrist"]
    return bool(np.array_equal(one.rest_offset[kept], other.rest_offset[kept]))
