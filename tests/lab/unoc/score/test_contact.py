"""Contact of a body with itself."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import Pose, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_log, shortest_arc
from bodysense_lab.papers.unoc.score.contact import self_contact


def turned(degrees: dict[str, tuple[float, float, float]]) -> Pose:
    """The default body's rest pose with some joints turned, by rotation vectors in degrees."""
    pose = rest_pose(default_skeleton())
    for name, vector in degrees.items():
        pose.rotation[pose.skeleton.index(name)] = quaternion_exp(np.radians(np.array(vector)))
    return pose


def both_sides(degrees: dict[str, tuple[float, float, float]]) -> dict[str, tuple[float, float, float]]:
    """Turns on the left side and, mirrored, on the right."""
    right = {name: (x, -y, -z) for name, (x, y, z) in degrees.items()}
    return {f"left_{name}": turn for name, turn in degrees.items()} | {f"right_{name}": t for name, t in right.items()}


def random_poses(count: int, seed: int, spread: float = 0.5) -> Pose:
    generator = np.random.default_rng(seed)
    vector = generator.normal(size=(count, 52, 3)) * spread
    return Pose(default_skeleton(), generator.normal(size=(count, 3)), quaternion_exp(vector))


# From the left shoulder to the middle of a thigh that points forward.
THIGH = tuple(np.degrees(quaternion_log(shortest_arc(np.array([1.0, 0, 0]), np.array([-0.06, -0.37, 0.39])))))

POSES = {  # degrees, and whether the body touches itself, and a hand something
    "T-pose": ({}, False, False),
    "arms raised forward": (both_sides({"shoulder": (0, -80, 0)}), False, False),
    "arms hanging well away": (both_sides({"shoulder": (0, 0, -55)}), False, False),
    "palms pressed together": (both_sides({"shoulder": (0, -70, -40), "elbow": (0, -49, 0)}), None, True),
    "right hand on left forearm": ({"left_shoulder": (0, -80, 0), "right_shoulder": (0, 127, 0)}, None, True),
    "hand on the raised thigh": ({"left_hip": (-90, 0, 0), "left_shoulder": THIGH}, None, True),
    "thighs together": ({"left_hip": (0, 0, -4), "right_hip": (0, 0, 4)}, False, False),  # both hang on the trunk
    "limbs half bent": (  # bones that meet are no contact
        both_sides({"shoulder": (0, 0, -50), "elbow": (0, -80, 0), "hip": (-50, 0, 10), "knee": (80, 0, 0)}),
        False,
        False,
    ),
    "legs crossed": ({"left_hip": (0, 0, -20), "right_hip": (0, 0, 20)}, True, False),
}


@pytest.mark.parametrize("name", POSES)
def test_poses_made_by_hand(name: str) -> None:
    degrees, body, hand = POSES[name]
    found = self_contact(turned(degrees))
    assert body is None or found.body == body
    assert found.hand == hand


def test_a_larger_margin_never_touches_less() -> None:
    pose = random_poses(400, seed=1)
    shares = []
    for less, more in ((0.0, 0.005), (0.005, 0.03)):
        one, two = self_contact(pose, less), self_contact(pose, more)
        assert not (one.body & ~two.body).any()
        assert not (one.hand & ~two.hand).any()
        shares += [one.body.mean(), one.hand.mean()]
    assert min(shares) > 0.02
    assert max(shares) < 0.98


def test_the_mirrored_body_touches_as_well() -> None:
    pose = random_poses(400, seed=2)
    swap = pose.skeleton.mirror[:52]
    mirrored = Pose(pose.skeleton, pose.root_position * [-1, 1, 1], pose.rotation[:, swap] * [1, 1, -1, -1])
    one, two = self_contact(pose), self_contact(mirrored)
    assert np.array_equal(one.body, two.body)
    assert np.array_equal(one.hand, two.hand)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2), (0,)])
def test_any_leading_axes(batch: tuple[int, ...]) -> None:
    flat = random_poses(int(np.prod(batch)), seed=3)
    pose = Pose(flat.skeleton, flat.root_position.reshape(*batch, 3), flat.rotation.reshape(*batch, 52, 4))
    found, expected = self_contact(pose), self_contact(flat)
    assert found.body.shape == found.hand.shape == batch
    assert np.array_equal(found.hand.reshape(-1), expected.hand)


def test_bodies_of_other_proportions() -> None:
    """Boxes of other shapes keep their number of capsules, so that the pairs still fit."""
    skeleton = default_skeleton()
    offset = skeleton.rest_offset.copy()
    offset[skeleton.indices(["left_middle1", "right_middle1", "left_foot", "right_foot"])] *= 1.5
    found = self_contact(rest_pose(skeleton.with_offsets(offset)))
    assert not found.body
    assert not found.hand


def test_another_tree_is_refused() -> None:
    other = Skeleton(("hips",), (), (-1,), np.array([[0, 1.0, 0]]))
    with pytest.raises(BodysenseError, match="need a point 'pelvis', which this skeleton lacks"):
        self_contact(rest_pose(other))
