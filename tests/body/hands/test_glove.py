"""The glove: nine markers, three of them rigid; they move with the hand, scale with it, and mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import (
    ALIGNMENT,
    MARKERS,
    Glove,
    default_glove,
    glove_points,
    hand_size,
    marker_positions,
    side_of,
    standard_marker,
    template,
)
from bodysense.body.hands.hand import glove_hands, glove_marker, hand_skeleton, limits, rotations_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError

HAND = hand_skeleton(default_skeleton(), "left")
# Markers of the paper's release, in its order: y toward the wrist, x into the palm, z toward the thumb.
RELEASED_BACK = np.array([[-0.0059, -0.0796, -0.0325], [-0.0300, 0.0, 0.0], [-0.0155, -0.0869, 0.0319]])


def posed(count: int, seed: int, hand=HAND) -> Pose:
    rng = np.random.default_rng(seed)
    turn = Rotation.random(count, rng).as_quat(scalar_first=True)
    rotation = np.concatenate([turn[:, None], rotations_of(rng.uniform(*limits(), (count, 26)))], axis=1)
    return Pose(hand, rng.normal(size=(count, 3)), rotation)


def distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)


def test_the_back_of_the_hand_is_the_releases_template() -> None:
    flat = template(default_glove(), HAND)
    assert flat.shape == (len(MARKERS), 3) == (9, 3)
    np.testing.assert_allclose(distances(flat[list(ALIGNMENT)]), distances(RELEASED_BACK), atol=1e-12)
    assert (flat[list(ALIGNMENT), 1] > 0).all(), "on the back, not in the palm"
    assert flat[2, 2] > 0 > flat[0, 2], "index toward the thumb, little finger away from it"
    assert flat[3:7, 0].min() > flat[[0, 2], 0].max(), "fingertips beyond the knuckles"


def test_alignment_markers_are_rigid_whatever_the_fingers_do() -> None:
    markers = marker_positions(default_glove(), posed(20, 0))
    flat = template(default_glove(), HAND)
    back = list(ALIGNMENT)
    np.testing.assert_allclose(
        distances(markers[:, back]), np.broadcast_to(distances(flat[back]), (20, 3, 3)), atol=1e-12
    )


def test_markers_of_fingers_are_where_kinematics_puts_them() -> None:
    pose = posed(5, 1)
    points = forward_kinematics(pose)[0]
    for marker, point in (("index_tip", "index_tip"), ("thumb_middle", "thumb2"), ("thumb_tip", "thumb_tip")):
        found = marker_positions(default_glove(), pose)[:, MARKERS.index(marker)]
        np.testing.assert_allclose(found, points[:, HAND.index(point)], atol=1e-12)


def test_markers_move_rigidly_with_the_wrist() -> None:
    """Against SciPy: the flat hand's markers, turned and shifted."""
    flat = template(default_glove(), HAND)
    turn = Rotation.random(None, np.random.default_rng(3))
    rotation = np.tile([1.0, 0, 0, 0], (16, 1))
    rotation[0] = turn.as_quat(scalar_first=True)
    root = np.array([0.3, -1.0, 2.0])
    found = marker_positions(default_glove(), Pose(HAND, root, rotation))
    np.testing.assert_allclose(found, turn.apply(flat) + root, atol=1e-12)


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_glove_grows_with_the_hand(factor: float) -> None:
    larger = HAND.with_offsets(HAND.rest_offset * factor)
    assert hand_size(larger) == pytest.approx(factor * hand_size(HAND))
    np.testing.assert_allclose(template(default_glove(), larger), factor * template(default_glove(), HAND), atol=1e-12)


@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_offsets_of_ones_own(batch: tuple[int, ...]) -> None:
    pose = posed(6, 4)[:1]
    one = Pose(
        HAND, np.broadcast_to(pose.root_position[0], (*batch, 3)), np.broadcast_to(pose.rotation[0], (*batch, 16, 4))
    )
    glove = default_glove()
    assert marker_positions(glove, one).shape == (*batch, 9, 3)
    moved = marker_positions(glove, one, np.broadcast_to(glove.offset + np.array([0.01, 0, 0]), (*batch, 9, 3)))
    far = np.linalg.norm(moved - marker_positions(glove, one), axis=-1)
    np.testing.assert_allclose(far, 0.01, atol=1e-12)


def test_a_glove_that_does_not_fit_together_is_refused() -> None:
    with pytest.raises(BodysenseError, match="9 markers need as many points, joints and offsets"):
        replace(default_glove(), offset=np.zeros((8, 3)))
    with pytest.raises(BodysenseError, match="2 markers"):
        Glove(("a", "b"), ("wrist",), ("wrist", "wrist"), np.zeros((2, 3)), 0.2)


def test_names_of_markers() -> None:
    assert glove_points("left")[:2] == ("left_glove_pinky_base", "left_glove_wrist")
    points = ("head", *glove_points("right2"), *glove_points("left"), "right_wrist")
    assert glove_hands(points) == ("right2", "left") and side_of("right2") == "right"
    assert [glove_marker(point) for point in glove_points("left")] == [("left", marker) for marker in MARKERS]
    assert glove_marker("left_index_tip") is None and standard_marker("left_glove_elbow") is None
    assert glove_marker("left_glove_elbow") == ("left", "elbow"), "of another set"
    assert glove_marker("hand_glove_elbow") is None and glove_marker("left_glove_") is None
    with pytest.raises(BodysenseError, match="'middle' is neither left nor right"):
        glove_points("middle")
