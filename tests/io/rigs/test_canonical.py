"""Canonical form: positions are unchanged, and the identity is our T-pose, whatever the file's rest pose."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig_files import joints_in
from turned_joints import about, both

from bodysense.body.pose import Pose, forward_kinematics, local_rotation, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.fingers import is_finger, relaxed_rotation
from bodysense.io.rigs.canonical import canonical as canonical_of
from bodysense.io.rigs.canonical import complete_skeleton

MIXAMO = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
    **{f"{side}_{ours}": f"{side.capitalize()}{theirs}" for side in ("left", "right") for ours, theirs in (
        ("hip", "UpLeg"), ("knee", "Leg"), ("ankle", "Foot"), ("foot", "ToeBase"), ("collar", "Shoulder"),
        ("shoulder", "Arm"), ("elbow", "ForeArm"), ("wrist", "Hand"),
        *((f"{finger}{k}", f"Hand{finger.capitalize()}{k}")
          for finger in ("thumb", "index", "middle", "ring", "pinky") for k in (1, 2, 3)))},
}  # fmt: skip


def canonical(source: Clip) -> Clip:
    """The canonical form of a clip whose joints are recognised."""
    return canonical_of(source, joints_in(source))


RESTS: dict[str, dict[str, np.ndarray]] = {
    "T-pose": {},
    "A-pose": both("shoulder", "Z", -45),
    "arms down": both("shoulder", "Z", -88),
    "N-pose, legs apart": both("shoulder", "Z", -80) | both("hip", "Z", 20),
    "bent elbows and knees": both("elbow", "Y", -60) | both("knee", "X", 50) | both("shoulder", "Z", -30),
    "facing back": {"pelvis": about("Y", 180)},
    "facing left, arms down": {"pelvis": about("Y", 90)} | both("shoulder", "Z", -70),
    "lying": {"pelvis": about("X", -90)},
    "curled fingers": {f"{s}_{f}{k}": about("Z", -30 if s == "left" else 30)
                       for s in ("left", "right") for f in ("index", "middle", "ring", "pinky") for k in (1, 2, 3)},
}  # fmt: skip


def world_error(a: Clip, b: Clip, names: Mapping[str, str] | None = None) -> float:
    """Largest distance between our points in canonical clip `b` and the same in `a`."""
    names = names or {}
    position_a, position_b = forward_kinematics(a.pose)[0], forward_kinematics(b.pose)[0]
    points = [p for p in default_skeleton().points if names.get(p, p) in a.pose.skeleton.points]
    there = a.pose.skeleton.indices([names.get(p, p) for p in points])
    return float(
        np.linalg.norm(position_a[:, there] - position_b[:, default_skeleton().indices(points)], axis=-1).max()
    )


@pytest.mark.parametrize("names", [{}, MIXAMO], ids=["smpl", "mixamo"])
@pytest.mark.parametrize("rest", RESTS)
def test_positions_stay_and_rotations_come_back(make_clip, reframe, rest: str, names: dict[str, str]) -> None:
    clip = make_clip(spread=0.7)
    source = reframe(clip, RESTS[rest], names)
    if rest != "T-pose":
        assert geodesic_angle(source.pose.rotation, clip.pose.rotation).max() > 0.2
    result = canonical(source)
    assert result.pose.skeleton.joints == default_skeleton().joints
    assert world_error(source, result, names) < 1e-9
    assert geodesic_angle(result.pose.rotation, clip.pose.rotation).max() < 1e-6
    np.testing.assert_allclose(result.pose.skeleton.rest_offset[1:], clip.pose.skeleton.rest_offset[1:], atol=1e-9)
    assert result.has_fingers


def test_a_body_in_a_t_pose_of_its_own_keeps_its_directions(make_clip) -> None:
    """Nothing is bent to the default's directions: other proportions pass through, and rotations bit by bit."""
    clip = make_clip()
    rng = np.random.default_rng(1)
    scale = rng.uniform(0.85, 1.2, size=(65, 1))
    tilt = rng.normal(scale=0.05, size=(65, 3)) * clip.pose.skeleton.bone_length[:, None]
    offset = clip.pose.skeleton.rest_offset * scale + tilt
    body = clip.pose.skeleton.with_offsets(offset)
    source = Clip("tall", Pose(body, clip.pose.root_position, clip.pose.rotation), 30.0)
    result = canonical(source)
    np.testing.assert_allclose(result.pose.skeleton.rest_offset[1:], offset[1:], atol=1e-12)
    assert geodesic_angle(result.pose.rotation, clip.pose.rotation).max() < 1e-7
    assert world_error(source, result) < 1e-9


def test_the_rest_pose_becomes_a_t_pose_with_straight_limbs(make_clip, reframe) -> None:
    skeleton = canonical(reframe(make_clip(), RESTS["N-pose, legs apart"], MIXAMO)).pose.skeleton
    position, _ = forward_kinematics(rest_pose(skeleton))
    arm = position[skeleton.index("left_middle_tip")] - position[skeleton.index("left_shoulder")]
    leg = position[skeleton.index("right_ankle")] - position[skeleton.index("right_hip")]
    np.testing.assert_allclose(arm / np.linalg.norm(arm), [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(leg / np.linalg.norm(leg), [0, -1, 0], atol=1e-6)
    assert 0 < position[:, 1].min() < 0.05  # it stands on the ground


def without(clip: Clip, gone: set[str]) -> Clip:
    """The clip on a skeleton that lacks some joints, which did not turn; their children hang on the next above."""
    old = clip.pose.skeleton
    keep = [k for k, name in enumerate(old.points) if name not in gone]
    offset, parents = old.rest_offset.copy(), []
    for k in keep:
        parent = old.parents[k]
        while parent >= 0 and old.points[parent] in gone:
            offset[k] = offset[k] + old.rest_offset[parent]
            parent = old.parents[parent]
        parents.append(keep.index(parent) if parent >= 0 else -1)
    joints = [k for k in keep if k < len(old.joints)]
    names = [old.points[k] for k in keep]
    skeleton = Skeleton(tuple(names[: len(joints)]), tuple(names[len(joints) :]), tuple(parents), offset[keep])
    return Clip(clip.name, Pose(skeleton, clip.pose.root_position, clip.pose.rotation[:, joints]), clip.frame_rate)


FINGERS = {joint for joint in default_skeleton().points if is_finger(joint) or joint.endswith("_tip")}


@pytest.mark.parametrize("gone", [
    FINGERS,
    {"left_collar", "right_collar"},
    {"spine2"}, {"spine2", "spine3"}, {"neck"},
    {"left_foot", "right_foot", "left_toe", "right_toe"},
    FINGERS | {"spine2", "left_collar", "right_collar", "left_foot", "right_foot", "left_toe", "right_toe", "head_top"},
    {p for p in default_skeleton().points if "ring" in p or "pinky" in p},
], ids=["fingers", "collars", "spine2", "spine2 and 3", "neck", "feet", "all of them", "two fingers"])  # fmt: skip
def test_missing_joints_are_the_defaults_scaled_and_still(make_clip, gone: set[str]) -> None:
    clip = make_clip()
    for joint in gone & set(default_skeleton().joints):
        clip.pose.rotation[:, default_skeleton().index(joint)] = [1, 0, 0, 0]
    scaled = default_skeleton().scaled(1.2 * default_skeleton().height)
    source = without(Clip("a", Pose(scaled, clip.pose.root_position, clip.pose.rotation), 30.0), gone)
    result = canonical(source)
    assert world_error(source, result) < 1e-9
    assert result.has_fingers == (not gone >= FINGERS)
    np.testing.assert_allclose(result.pose.skeleton.bone_length, scaled.bone_length, atol=1e-9)
    for joint in gone & set(default_skeleton().joints):
        still = relaxed_rotation(joint) if is_finger(joint) else np.array([1.0, 0, 0, 0])
        assert geodesic_angle(result.pose.rotation[:, default_skeleton().index(joint)], still).max() < 1e-7


def inserted(clip: Clip, name: str, above: str, turn: np.ndarray, share: float) -> Clip:
    """The clip with one more joint on the way to `above`, at `share` of its bone, that turns by `turn` (T, 4)."""
    old = clip.pose.skeleton
    at, parent = old.index(above), old.parents[old.index(above)]
    shift = [k + (k >= at) for k in range(len(old.points))]
    parents = [-1 if p < 0 else shift[p] for p in old.parents]
    parents[at] = at
    parents.insert(at, shift[parent])
    offset = np.insert(old.rest_offset, at, share * old.rest_offset[at], axis=0)
    offset[at + 1] = (1 - share) * old.rest_offset[at]
    joints = [*old.joints[:at], name, *old.joints[at:]]
    rotation = np.insert(clip.pose.rotation, at, turn, axis=1)
    skeleton = Skeleton(tuple(joints), old.end_sites, tuple(parents), offset)
    return Clip(clip.name, Pose(skeleton, clip.pose.root_position, rotation), clip.frame_rate)


def bend(frames: int, degrees: float) -> np.ndarray:
    return quaternion_exp(np.linspace(0, 1, frames)[:, None] * np.deg2rad([degrees, 0.3 * degrees, 0]))


def test_a_skipped_joint_that_does_not_move_changes_nothing(make_clip) -> None:
    clip = make_clip()
    still = np.tile([1.0, 0, 0, 0], (len(clip), 1))
    source = inserted(inserted(clip, "LowerBack", "spine1", still, 0.0), "Twist", "left_wrist", still, 0.5)
    result = canonical(source)
    assert world_error(source, result) < 1e-9
    assert geodesic_angle(result.pose.rotation, clip.pose.rotation).max() < 1e-6


def test_a_skipped_twist_changes_no_position(make_clip) -> None:
    clip = make_clip()
    twist = quaternion_exp(np.linspace(0, 1.2, len(clip))[:, None] * np.array([1.0, 0, 0]))
    source = inserted(clip, "ForearmTwist", "left_wrist", twist, 0.5)
    assert world_error(source, canonical(source)) < 1e-9


def test_a_skipped_joint_that_bends_a_bone_leaves_its_change_of_length(make_clip) -> None:
    clip = make_clip(spread=0.2)
    source = inserted(clip, "Neck1", "head", bend(len(clip), 30), 0.5)
    bone = default_skeleton().bone_length[default_skeleton().index("head")]
    assert 1e-4 < world_error(source, canonical(source)) < bone * (1 - np.cos(np.deg2rad(16)))


def test_what_a_lower_back_bends_is_taken_over_by_spine1(make_clip) -> None:
    clip = make_clip(spread=0.2)
    source = inserted(clip, "LowerBack", "spine1", bend(len(clip), 18), 0.0)
    result = canonical(source)
    ours = default_skeleton()
    distance = np.linalg.norm(
        forward_kinematics(source.pose)[0][:, source.pose.skeleton.indices(ours.points)]
        - forward_kinematics(result.pose)[0],
        axis=-1,
    ).max(axis=0)
    assert 0.01 < distance[ours.index("spine1")] < 0.03
    upper = [ours.index(p) for p in ("spine3", "head", "left_wrist", "right_middle_tip")]
    assert distance[upper].max() < distance[ours.index("spine1")] / 2
    assert distance[ours.indices(["pelvis", "left_ankle", "right_toe"])].max() < 1e-9
    same = [k for k, p in enumerate(ours.joints) if p not in ("spine1", "spine2")]
    there = source.pose.skeleton.indices(ours.joints)
    world_source, world = forward_kinematics(source.pose)[1][:, there], forward_kinematics(result.pose)[1]
    assert geodesic_angle(world_source[:, same], world[:, same]).max() < 1e-6


def test_missing_joints_go_with_a_parent_that_was_turned(make_clip) -> None:
    clip = make_clip(spread=0.2)
    clip.pose.rotation[:, default_skeleton().index("spine2")] = [1, 0, 0, 0]
    result = canonical(without(inserted(clip, "LowerBack", "spine1", bend(len(clip), 18), 0.0), {"spine2"}))
    assert (
        geodesic_angle(result.pose.rotation[:, default_skeleton().index("spine2")], np.array([1.0, 0, 0, 0])).max()
        < 1e-7
    )


# --- a rest pose that says nothing: every bone along its own X axis ---


def along_x(clip: Clip) -> Clip:
    """The clip on frames as LaFAN1 has them: each joint's X axis along its bone."""
    from bodysense.geometry.rotation import shortest_arc

    ours = default_skeleton()
    frame = np.tile([1.0, 0, 0, 0], (len(ours.joints), 1))
    for joint in range(len(ours.joints)):
        child = next((k for k in range(1, len(ours.points)) if ours.parents[k] == joint), None)
        frame[joint] = (
            frame[ours.parents[joint]]
            if child is None
            else shortest_arc(np.array([1.0, 0, 0]), ours.rest_offset[child])
        )
    frame[0] = shortest_arc(np.array([1.0, 0, 0]), np.array([0.0, 1, 0]))
    frame[0] = quaternion_multiply(frame[0], about("X", 90))  # X up, Y forward, Z left
    from bodysense.geometry.rotation import quaternion_conjugate, quaternion_rotate

    parents = np.array(ours.parents)
    offset = ours.rest_offset.copy()
    offset[1:] = quaternion_rotate(quaternion_conjugate(frame[parents[1:]]), ours.rest_offset[1:])
    world = quaternion_multiply(forward_kinematics(clip.pose)[1], frame)
    source = Skeleton(ours.joints, ours.end_sites, ours.parents, offset)
    return Clip(clip.name, Pose(source, clip.pose.root_position, local_rotation(source, world)), clip.frame_rate)


def test_a_frame_in_t_pose_stands_in_for_a_rest_pose_that_says_nothing(make_clip) -> None:
    clip = make_clip()
    clip.pose.rotation[3] = [1, 0, 0, 0]
    clip.pose.rotation[3, 0] = about("Y", 70)  # facing anywhere
    source = along_x(clip)
    assert abs(source.pose.skeleton.rest_offset[default_skeleton().index("left_knee"), 0]) > 0.4
    result = canonical_of(source, joints_in(source), must_stand=True)
    assert world_error(source, result) < 1e-9
    assert geodesic_angle(result.pose.rotation, clip.pose.rotation).max() < 1e-6


def test_joints_may_be_named_by_hand(make_clip, reframe) -> None:
    clip = make_clip()
    source = reframe(clip, {}, {"left_knee": "Gelenk 7"})
    table = {name: name for name in default_skeleton().points if name != "left_knee"}
    assert world_error(source, canonical(source)) < 1e-9  # its place tells that it is a knee
    assert world_error(source, canonical_of(source, table | {"Gelenk 7": "left_knee"})) < 1e-9
    with pytest.raises(BodysenseError, match=r"unknown joint 'left_kne'; this skeleton has left_knee"):
        canonical_of(source, table | {"Gelenk 7": "left_kne"})


def test_completing_a_skeleton_scales_the_rest() -> None:
    ours = default_skeleton()
    whole = complete_skeleton({})
    np.testing.assert_allclose(whole.rest_offset, ours.rest_offset, atol=1e-12)
    known = {name: 1.1 * ours.rest_offset[ours.index(name)] for name in ("left_knee", "left_ankle", "left_elbow")}
    taller = complete_skeleton(known | {"left_middle1": 0.8 * ours.rest_offset[ours.index("left_middle1")]})
    index = ours.index
    np.testing.assert_allclose(
        taller.bone_length[index("right_wrist")], ours.bone_length[index("right_wrist")] * 1.06, rtol=0.03
    )
    np.testing.assert_allclose(taller.rest_offset[index("left_index2")], 0.8 * ours.rest_offset[index("left_index2")])
    np.testing.assert_allclose(
        taller.rest_offset[index("left_thumb_tip")], 0.8 * ours.rest_offset[index("left_thumb_tip")]
    )


# --- real files ---


def test_real_bvh_files_pass_through_unbent(motion_data) -> None:
    from bodysense.io.formats.bvh import read_bvh

    source = read_bvh(motion_data / "rocketbox" / "f_sit_chair_idle_dust.bvh")
    result = canonical(source)
    position, there = forward_kinematics(result.pose)[0], forward_kinematics(source.pose)[0]
    ours, theirs = result.pose.skeleton.index, source.pose.skeleton.index

    def distance(our: str, their: str) -> float:
        return float(np.linalg.norm(position[:, ours(our)] - there[:, theirs(their)], axis=-1).max())

    assert (
        max(distance("left_ankle", "LeftFoot"), distance("pelvis", "Hips"), distance("right_toe", "RightToeBase_end"))
        < 1e-9
    )
    assert (
        max(
            distance("left_wrist", "LeftHand"),
            distance("head", "Head"),
            distance("left_thumb_tip", "LeftHandThumb3_end"),
        )
        < 0.018
    )
    np.testing.assert_allclose(
        result.pose.skeleton.rest_offset[ours("left_index1")],
        source.pose.skeleton.rest_offset[theirs("LeftHandIndex1")],
    )
    assert result.has_fingers


@given(st.integers(0, 10**6))
def test_any_skeleton_of_known_names_is_refused_or_finite(seed: int) -> None:
    """Trees and offsets at random, many of them zero or in one line."""
    rng = np.random.default_rng(seed)
    names = [name for name in default_skeleton().joints if name == "pelvis" or rng.random() < rng.choice([0.98, 1.0])]
    parents = (-1, *(int(rng.integers(0, k)) for k in range(1, len(names))))
    offset = rng.normal(scale=0.2, size=(len(names), 3))
    offset[rng.random(len(names)) < rng.choice([0.0, 0.3, 1.0])] = 0
    offset[:, rng.random(3) < 0.2] = 0
    rotation = quaternion_exp(rng.normal(size=(3, len(names), 3)))
    pose = Pose(Skeleton(tuple(names), (), parents, offset), rng.normal(size=(3, 3)), rotation)
    try:
        result = canonical(Clip("random", pose, 30.0)).pose
    except BodysenseError as error:
        assert str(error).startswith("random: ")
    else:
        np.testing.assert_allclose(np.linalg.norm(result.rotation, axis=-1), 1)
        assert np.isfinite(result.root_position).all()
