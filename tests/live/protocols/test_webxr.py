"""Conversion of devices to joints, against forward kinematics and SciPy, by the axes of the standards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.skeleton import default_body, default_skeleton
from bodysense.geometry.products import rotate
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.io.formats.protocol import ProtocolError, SignalFrame
from bodysense_live.protocols.webxr import Placement, point_mapping, to_observation

SKELETON = default_skeleton()
# Directions of −Z and another axis of WebXR's frames, if the wearer is in the T-pose and faces +Z.
AXES = {
    "headset": ("head", {"-z": (0, 0, 1), "y": (0, 1, 0)}, "between_eyes"),
    "left:wrist": ("left_wrist", {"-z": (1, 0, 0), "y": (0, 1, 0)}, None),  # to the fingertips, out of the back
    "right:wrist": ("right_wrist", {"-z": (-1, 0, 0), "y": (0, 1, 0)}, None),
    "left_controller": ("left_wrist", {"-z": (0, 0, 1), "-x": (0, 1, 0)}, "left_palm"),  # thumb, back of the hand
    "right_controller": ("right_wrist", {"-z": (0, 0, 1), "x": (0, 1, 0)}, "right_palm"),
}


def frame_of(axes: dict[str, tuple[int, int, int]]) -> Rotation:
    """Return world ← device from two of its axes."""
    unit = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}
    ours = [-unit[name[-1]] if name[0] == "-" else unit[name[-1]] for name in axes]
    found = Rotation.align_vectors(np.array(list(axes.values()), dtype=float), ours)
    assert found[1] < 1e-6
    return found[0]


def test_accuracies_are_those_of_the_signal_or_the_usual_ones() -> None:
    names = ["headset", "left:wrist", "left:index-finger-tip", "waist"]
    frame = SignalFrame(0, 0.0, np.arange(4), np.full(4, 3), np.zeros((4, 3)), np.tile([1.0, 0, 0, 0], (4, 1)))
    there = point_mapping(names, SKELETON)
    seen = to_observation(there, frame, np.ones(4, dtype=bool), Placement(), 0.0)
    np.testing.assert_array_equal(seen.accuracy, [[0.001, 0.01, 0.01, 0.01]])
    own = replace(frame, accuracy=np.array([0, 200, 0, 30], dtype=np.uint16))
    seen = to_observation(there, own, np.array([True, True, False, True]), Placement(), 0.0)
    np.testing.assert_allclose(seen.accuracy[seen.has_position], [0.001, 0.02, 0.003])


@pytest.mark.parametrize(("seed", "name"), list(enumerate(AXES)))
def test_a_device_gives_its_joint(seed: int, name: str) -> None:
    joint, axes, landmark = AXES[name]
    rng = np.random.default_rng(seed)
    pose = rest_pose(SKELETON)
    turn = Rotation.random(rng=np.random.default_rng(seed))
    pose.root_position[:] = rng.normal(size=3)
    pose.rotation[0] = turn.as_quat(scalar_first=True)
    position, rotation = forward_kinematics(pose)
    index = SKELETON.index(joint)
    place = position[index]
    if landmark is not None:
        offset = next(row["offset"] for row in default_body()["landmarks"] if row["name"] == landmark)
        place = place + quaternion_rotate(rotation[index], np.array(offset))
    device = (turn * frame_of(axes)).as_quat(scalar_first=True)
    frame = SignalFrame(0, 0.0, np.array([0]), np.array([3]), place[None], device[None])
    seen = to_observation(point_mapping([name], SKELETON), frame, np.ones(1, dtype=bool), Placement(), 0.5)
    assert seen.points == (joint,) and seen.has_position.all() and seen.has_rotation.all() and seen.time[0] == 0.5
    np.testing.assert_allclose(seen.position[0, 0], position[index], atol=1e-6)
    apart = (
        Rotation.from_quat(seen.rotation[0, 0], scalar_first=True)
        * Rotation.from_quat(rotation[index], scalar_first=True).inv()
    )
    assert apart.magnitude() < 1e-5


def test_joints_of_fingers_are_named_as_ours() -> None:
    ends = ("metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
    names = ["left:wrist", *(f"left:thumb-{end}" for end in ends if end != "phalanx-intermediate")]
    names += [f"left:{finger}-finger-{end}" for finger in ("index", "middle", "ring", "pinky") for end in ends]
    assert len(names) == 25
    found = point_mapping(names, SKELETON)
    hand = [
        name for name in SKELETON.points if name.startswith("left_") and SKELETON.wrist_of[SKELETON.index(name)] >= 0
    ]
    assert set(found.points) == {"left_wrist", *hand}
    assert (found.target == -1).sum() == 4  # metacarpals
    assert found.points[found.target[names.index("left:ring-finger-tip")]] == "left_ring_tip"
    assert found.points[found.target[names.index("left:thumb-metacarpal")]] == "left_thumb1"


def test_a_controller_and_a_tracked_hand_may_be_the_same_wrist() -> None:
    names = ["left_controller", "left:wrist"]
    found = point_mapping(names, SKELETON)
    turned = np.tile([1.0, 0, 0, 0], (2, 1))
    places = np.array([[0.0, 1, 0], [0.0, 2, 0]])
    both = SignalFrame(0, 0.0, np.arange(2), np.array([3, 3]), places, turned)
    visible = np.ones(2, dtype=bool)
    assert to_observation(found, both, visible, Placement(), 0.0).position[0, 0, 1] == 2
    one = SignalFrame(0, 0.0, np.array([0]), np.array([1]), places[:1], turned[:1])
    seen = to_observation(found, one, visible, Placement(), 0.0)
    np.testing.assert_array_equal(seen.position[0], places[:1])  # without a rotation the joint is at the device
    assert not seen.has_rotation.any()
    assert not to_observation(found, both, ~visible, Placement(), 0.0).has_position.any()


def test_trackers_are_strapped_and_joints_are_not() -> None:
    found = point_mapping(["hip", "chest", "left_foot", "left_glove_index_tip"], SKELETON)
    assert found.points == ("pelvis", "spine3", "left_foot", "left_glove_index_tip")
    np.testing.assert_array_equal(found.gives_rotation, [True, True, True, False])
    assert found.strapped == {"pelvis", "spine3"}
    assert not point_mapping(["hip", "pelvis"], SKELETON).strapped
    assert point_mapping(["left_ankle_tracker"], SKELETON).points == ("left_ankle",)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["heed"], "'heed' is unknown"),
        (["head", "head"], "named twice"),
        (["middle:wrist"], "begin it with"),
        (["left:index-finger-nail"], "not a joint of WebXR's hands"),
        (["left:index-tip"], "not a joint of WebXR's hands"),
        (["left:toe-finger-tip"], "not a joint of WebXR's hands"),
        ([f"p{k}" for k in range(129)], "at most 128"),
    ],
)
def test_unknown_points_are_refused(names: list[str], expected: str) -> None:
    with pytest.raises(ProtocolError, match=expected):
        point_mapping(names, SKELETON)


def test_a_placement_moves_the_world_as_documented() -> None:
    rng = np.random.default_rng(1)
    placement = Placement(0.7, (1.0, 2.0, 3.0))
    turn = Rotation.from_rotvec([0, 0.7, 0])
    points = rng.normal(size=(5, 3))
    np.testing.assert_allclose(placement.place(points), turn.apply(points) + np.array([1, 2, 3]))
    rotation = Rotation.random(5, rng=rng)
    expected = (turn * rotation).as_quat(scalar_first=True)
    found = placement.turn(rotation.as_quat(scalar_first=True))
    np.testing.assert_allclose(np.abs((found * expected).sum(axis=1)), 1)
    np.testing.assert_allclose(rotate(found, points), (turn * rotation).apply(points))
