"""The hand: 26 angles, their limits, the mirror, and a hand cut from a body against the body's own kinematics."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.hands.hand import (
    FINGERS,
    FINGERTIPS,
    FREEDOMS,
    HAND_JOINTS,
    Side,
    angles_of,
    hand_pose,
    hand_skeleton,
    joint_angles,
    joint_bases,
    joint_rotations,
    limits,
    mirrored_rotations,
    mirrored_vectors,
    own_axes,
    rotations_of,
)
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_canonical

BODY = default_skeleton()
HAND = hand_skeleton(BODY, "left")
SIDES: tuple[Side, ...] = ("left", "right")


def random_angles(rng: np.random.Generator, *batch: int) -> np.ndarray:
    low, high = limits()
    return rng.uniform(low, high, (*batch, len(FREEDOMS)))


def random_pose(rng: np.random.Generator, count: int = 7) -> Pose:
    turns = Rotation.random(count * len(BODY.joints), rng).as_quat(scalar_first=True)
    return Pose(BODY, rng.normal(size=(count, 3)), turns.reshape(count, -1, 4))


def test_there_are_26_degrees_of_freedom() -> None:
    joints = Counter(row.joint for row in FREEDOMS)
    assert len(FREEDOMS) == len({(row.joint, row.angle) for row in FREEDOMS}) == 26
    assert [joints[f"{finger}1"] for finger in FINGERS] == [3] * 5
    assert joints["thumb2"] == 2 and {row.angle for row in FREEDOMS if row.joint == "thumb2"} == {
        "flexion",
        "abduction",
    }
    hinges = [row for row in FREEDOMS if row.joint[-1] in "23" and row.joint != "thumb2"]
    assert len(hinges) == 9 and {row.angle for row in hinges} == {"flexion"}
    low, high = limits()
    assert (low < 0).all() and (high > 0).all(), "a flat hand is possible"


@pytest.mark.parametrize("batch", [(), (1,), (4, 3)])
def test_angles_and_rotations_are_the_same_thing(batch: tuple[int, ...]) -> None:
    angles = random_angles(np.random.default_rng(0), *batch)
    rotations = rotations_of(angles)
    assert rotations.shape == (*batch, 15, 4)
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1, atol=1e-12)
    np.testing.assert_allclose(angles_of(rotations), angles, atol=1e-9)
    np.testing.assert_allclose(angles_of(-rotations), angles, atol=1e-9)


def test_every_joint_turns_as_its_formula_says() -> None:
    """R = B · Rz(−flexion) · Ry(abduction) · Rx(twist) · Bᵀ, by SciPy."""
    angles = random_angles(np.random.default_rng(1))
    by_joint = {joint: dict.fromkeys(("flexion", "abduction", "twist"), 0.0) for joint in HAND_JOINTS[1:]}
    for row, angle in zip(FREEDOMS, angles, strict=True):
        by_joint[row.joint][row.angle] = float(angle)
    for joint, basis, found in zip(HAND_JOINTS[1:], joint_bases(), rotations_of(angles), strict=True):
        own, about = by_joint[joint], Rotation.from_quat(basis, scalar_first=True)
        turn = Rotation.from_euler("ZYX", [-own["flexion"], own["abduction"], own["twist"]])
        assert (about * turn * about.inv() * Rotation.from_quat(found, scalar_first=True).inv()).magnitude() < 1e-9


def test_angles_are_found_about_turned_axes_whatever_else_a_joint_does() -> None:
    turn, rotation = Rotation.random(45, np.random.default_rng(6)), Rotation.random(45, np.random.default_rng(7))
    about = turn * Rotation.from_quat(np.tile(joint_bases(), (3, 1)), scalar_first=True)
    expected = (about.inv() * rotation * about).as_euler("ZYX").reshape(3, 15, 3) * [-1, 1, 1]
    axes = own_axes(turn.as_quat(scalar_first=True).reshape(3, 15, 4))
    found = joint_angles(rotation.as_quat(scalar_first=True).reshape(3, 15, 4), axes)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    back = Rotation.from_quat(joint_rotations(found, axes).reshape(-1, 4), scalar_first=True)
    assert (back * rotation.inv()).magnitude().max() < 1e-9


def test_gradients_pass_through_the_angles() -> None:
    torch = pytest.importorskip("torch")
    angles = torch.tensor(random_angles(np.random.default_rng(2), 3), requires_grad=True)
    turned = angles_of(rotations_of(angles))
    (slope,) = torch.autograd.grad(turned.sum(), angles)
    np.testing.assert_allclose(slope.numpy(), 1.0, atol=1e-6)


@pytest.mark.parametrize("finger", FINGERS[1:])
def test_flexed_fingers_go_toward_the_palm_and_spread_ones_beside(finger: str) -> None:
    rest = HAND.path @ HAND.rest_offset
    tip = HAND.index(f"{finger}_tip")

    def moved(angle: str, degrees: float) -> np.ndarray:
        angles = np.zeros(26)
        angles[[(row.joint, row.angle) for row in FREEDOMS].index((f"{finger}1", angle))] = np.radians(degrees)
        rotation = np.concatenate([[[1.0, 0, 0, 0]], rotations_of(angles)])
        return forward_kinematics(Pose(HAND, np.zeros(3), rotation))[0][tip] - rest[tip]

    assert moved("flexion", 60)[1] < -0.02 and moved("flexion", -20)[1] > 0.005
    assert moved("abduction", 15)[2] < -0.005, "away from the thumb"
    assert np.abs(moved("twist", 20)).max() < 0.02


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_stands_where_the_body_has_it(side: Side) -> None:
    """Forward kinematics of the hand, mirrored back, against that of the body."""
    pose = random_pose(np.random.default_rng(3))
    position, world = forward_kinematics(pose)
    own = hand_pose(pose, side)
    found, turned = forward_kinematics(own)
    points = BODY.indices([f"{side}_{name}" for name in (*HAND_JOINTS, *FINGERTIPS)])
    # The hand's skeleton is the body's own, mirrored: bones of the two sides of the default body need not agree.
    np.testing.assert_allclose(mirrored_vectors(found, side), position[:, points], atol=1e-9)
    difference = geodesic_angle(mirrored_rotations(turned, side), world[:, points[: len(HAND_JOINTS)]])
    np.testing.assert_allclose(difference, 0, atol=1e-6)


def test_the_mirror_reverses_a_rotation_as_a_reflection_does() -> None:
    rng = np.random.default_rng(5)
    turn = Rotation.random(20, rng)
    quaternion = quaternion_canonical(turn.as_quat(scalar_first=True))
    flip = np.diag([-1.0, 1, 1])
    expected = flip @ turn.as_matrix() @ flip
    found = Rotation.from_quat(mirrored_rotations(quaternion, "right"), scalar_first=True).as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-12)
    vectors = rng.normal(size=(20, 3))
    np.testing.assert_array_equal(mirrored_vectors(mirrored_vectors(vectors, "right"), "right"), vectors)
    np.testing.assert_array_equal(mirrored_vectors(vectors, "left"), vectors)
    np.testing.assert_array_equal(mirrored_rotations(quaternion, "left"), quaternion)


def test_what_is_no_hand_is_refused() -> None:
    with pytest.raises(BodysenseError, match="'middle'; it is 'left' or 'right'"):
        hand_skeleton(BODY, "middle")  # type: ignore[arg-type]
    keep = [index for index, name in enumerate(BODY.joints) if "pinky" not in name]
    where = {old: new for new, old in enumerate(keep)}
    bare = Skeleton(
        tuple(BODY.joints[k] for k in keep),
        (),
        tuple(where.get(BODY.parents[k], -1) for k in keep),
        BODY.rest_offset[keep],
    )
    with pytest.raises(BodysenseError, match="left_pinky1"):
        hand_skeleton(bare, "left")
    swapped = list(BODY.parents)
    swapped[BODY.index("left_index1")] = BODY.index("left_elbow")
    with pytest.raises(BodysenseError, match="the parent of left_index1 is 'left_elbow'"):
        hand_skeleton(replace(BODY, parents=tuple(swapped)), "left")
