"""The primitives: read, fitted to other skeletons, placed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.capsules import Primitives, fit_primitives, pose_primitives
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.errors import BodysenseError


def stretched(factors: dict[str, float]) -> Skeleton:
    """The default skeleton with some offsets stretched."""
    skeleton = default_skeleton()
    offset = skeleton.rest_offset.copy()
    for name, factor in factors.items():
        offset[skeleton.index(name)] *= factor
    return skeleton.with_offsets(offset)


def far_end(primitives: Primitives, name: str) -> np.ndarray:
    return primitives.end[primitives.names.index(name)]


def test_the_default_body_keeps_what_its_file_says() -> None:
    primitives = fit_primitives(default_skeleton())
    rows = {row["name"]: row for row in default_body()["primitives"]}
    assert set(primitives.names) == set(rows)
    capsules = len(primitives.radius)
    for n, name in enumerate(primitives.names):
        assert primitives.skeleton.joints[primitives.joint[n]] == rows[name]["joint"]
        if n < capsules:
            np.testing.assert_allclose(primitives.start[n], rows[name]["start"], atol=1e-12)
            np.testing.assert_allclose(primitives.end[n], rows[name]["end"], atol=1e-12)
            assert primitives.radius[n] == pytest.approx(rows[name]["radius"])
        else:
            np.testing.assert_allclose(primitives.center[n - capsules], rows[name]["center"], atol=1e-12)
            np.testing.assert_allclose(primitives.half_size[n - capsules], rows[name]["half_size"], atol=1e-12)
    nose = next(row for row in default_body()["landmarks"] if row["name"] == "nose")
    np.testing.assert_allclose(primitives.nose, nose["offset"], atol=1e-12)


def test_a_scaled_body_is_the_same_body_scaled() -> None:
    skeleton = default_skeleton()
    one, two = fit_primitives(skeleton), fit_primitives(skeleton.scaled(1.5 * skeleton.height))
    for field in ("start", "end", "radius", "center", "half_size", "nose"):
        np.testing.assert_allclose(getattr(two, field), 1.5 * getattr(one, field), atol=1e-12)


def test_a_capsule_that_ends_in_a_joint_does_so_on_any_skeleton() -> None:
    skeleton = stretched({"left_index2": 1.4, "left_shoulder": 1.2, "left_foot": 0.8, "left_thumb2": 0.7})
    primitives = fit_primitives(skeleton)
    for capsule, joint in (
        ("left_index1", "left_index2"),
        ("left_thumb1", "left_thumb2"),
        ("left_collar", "left_shoulder"),
        ("left_instep", "left_foot"),
    ):
        offset = skeleton.rest_offset[skeleton.index(joint)]
        np.testing.assert_allclose(far_end(primitives, capsule), offset, atol=2e-4)


def test_a_limb_stretches_with_its_bone_and_keeps_its_thickness() -> None:
    skeleton = stretched({"left_elbow": 1.3})  # the height stays
    default, longer = fit_primitives(default_skeleton()), fit_primitives(skeleton)
    k = default.names.index("left_upper_arm_lower")
    length = default_skeleton().bone_length[skeleton.index("left_elbow")]
    np.testing.assert_allclose(longer.end[k] - default.end[k], [0.3 * length, 0, 0], atol=1e-3)
    np.testing.assert_allclose(longer.start[k] - default.start[k], [0.15 * length, 0, 0], atol=1e-3)
    np.testing.assert_allclose(longer.radius, default.radius)
    others = [n for n, name in enumerate(default.names[: len(default.radius)]) if "left_upper_arm" not in name]
    np.testing.assert_allclose(longer.start[others], default.start[others], atol=1e-12)


def test_the_trunk_does_not_follow_the_joints_of_the_spine() -> None:
    """Flesh stays between hips and shoulders when only the spine runs deeper in the body."""
    skeleton = default_skeleton()
    offset = skeleton.rest_offset.copy()
    back = np.array([0.0, 0.0, -0.03])
    offset[skeleton.index("spine2")] += back
    offset[skeleton.index("neck")] -= back
    offset[skeleton.indices(["left_collar", "right_collar"])] -= back
    moved = skeleton.with_offsets(offset)
    for name in ("pelvis_lower", "pelvis", "abdomen", "waist", "chest", "chest_upper"):
        worlds = []
        for body in (skeleton, moved):
            position, rotation = forward_kinematics(rest_pose(body))
            primitives = fit_primitives(body)
            worlds.append(pose_primitives(primitives, position, rotation).end[primitives.names.index(name)])
        np.testing.assert_allclose(worlds[0], worlds[1], atol=1e-9)


def test_the_trunk_reaches_as_far_out_as_the_shoulders_ask() -> None:
    skeleton = default_skeleton()
    offset = skeleton.rest_offset.copy()
    narrow = skeleton.indices(["left_collar", "right_collar", "left_shoulder", "right_shoulder"])
    offset[narrow, 0] *= 0.8
    default, narrower = fit_primitives(skeleton), fit_primitives(skeleton.with_offsets(offset))
    k = default.names.index("chest_upper")
    reach, narrow_reach = (body.end[k, 0] + body.radius[k] for body in (default, narrower))
    assert 0.75 * reach < narrow_reach < 0.9 * reach
    np.testing.assert_allclose(narrower.radius, default.radius)


def test_the_head_hangs_from_its_crown() -> None:
    """Moving the head joint down the neck leaves head and nose where they are."""
    skeleton = default_skeleton()
    offset = skeleton.rest_offset.copy()
    offset[skeleton.index("head"), 1] -= 0.06
    offset[skeleton.index("head_top"), 1] += 0.06
    default, lower = fit_primitives(skeleton), fit_primitives(skeleton.with_offsets(offset))
    np.testing.assert_allclose(lower.nose, default.nose + np.array([0, 0.06, 0]), atol=1e-12)
    np.testing.assert_allclose(far_end(lower, "face"), far_end(default, "face") + np.array([0, 0.06, 0]), atol=1e-12)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_place_agrees_with_scipy(batch: tuple[int, ...]) -> None:
    generator = np.random.default_rng(3)
    skeleton = default_skeleton()
    rotation = generator.normal(size=(*batch, len(skeleton.joints), 4))
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    pose = Pose(skeleton, generator.normal(size=(*batch, 3)), rotation)
    position, world = forward_kinematics(pose)
    primitives = fit_primitives(skeleton)
    placed = pose_primitives(primitives, position, world)
    assert placed.start.shape == (*batch, len(primitives.radius), 3)
    assert placed.middle.shape == (*batch, len(primitives.names), 3)
    for n, local in enumerate(primitives.end):
        j = primitives.joint[n]
        turn = Rotation.from_quat(world[..., j, :].reshape(-1, 4), scalar_first=True)
        expected = turn.apply(local).reshape(*batch, 3) + position[..., j, :]
        np.testing.assert_allclose(placed.end[..., n, :], expected, atol=1e-12)
    for b, j in enumerate(primitives.joint[len(primitives.radius) :]):
        turn = Rotation.from_quat(world[..., j, :].reshape(-1, 4), scalar_first=True)
        np.testing.assert_allclose(placed.axes[..., b, :, :], turn.as_matrix().reshape(*batch, 3, 3), atol=1e-12)
        expected = turn.apply(primitives.center[b]).reshape(*batch, 3) + position[..., j, :]
        np.testing.assert_allclose(placed.center[..., b, :], expected, atol=1e-12)


def test_attached_primitives() -> None:
    primitives = fit_primitives(default_skeleton())

    def attached(point: str) -> set[str]:
        column = primitives.attached[:, primitives.skeleton.index(point)]
        return {name for name, is_attached in zip(primitives.names, column, strict=True) if is_attached}

    arm = {f"left_{part}_{half}" for part in ("upper_arm", "forearm") for half in ("upper", "lower")}
    assert attached("left_elbow") == arm
    assert attached("left_hip") == {"pelvis", "pelvis_lower", "left_thigh_upper", "left_thigh_lower"}
    assert attached("left_toe") == {"left_toes"}
    assert attached("left_index_tip") == {"left_index3"}


def test_another_tree_is_refused_with_its_first_difference() -> None:
    default = default_skeleton()
    fewer = Skeleton(default.joints, default.end_sites[:-1], default.parents[:-1], default.rest_offset[:-1])
    with pytest.raises(
        BodysenseError, match="need a point 'right_thumb_tip', which this skeleton lacks; bring it into"
    ):
        fit_primitives(fewer)
    offset = np.concatenate([default.rest_offset, [[0, 0, -0.1]]])
    more = Skeleton(default.joints, (*default.end_sites, "tail"), (*default.parents, 0), offset)
    with pytest.raises(BodysenseError, match="know no point 'tail', which this skeleton has; bring it into"):
        fit_primitives(more)
    sites = (default.end_sites[1], default.end_sites[0], *default.end_sites[2:])
    with pytest.raises(BodysenseError, match="expect 'head_top' as point 52, but this skeleton has 'left_toe'; bring"):
        fit_primitives(replace(default, end_sites=sites))
    hip = default.index("left_hip")
    parents = [*default.parents]
    parents[default.index("right_hip")] = hip
    with pytest.raises(
        BodysenseError, match=r"the parent of 'right_hip' is 'left_hip', but .* expect 'pelvis'; bring it into"
    ):
        fit_primitives(replace(default, parents=tuple(parents)))
