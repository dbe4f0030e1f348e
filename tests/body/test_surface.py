"""The drawn surface: fitted to skeletons, and carried by their joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics, rest_pose, standing_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.body.surface import fit_surface, nearest_points
from bodysense.errors import BodysenseError


def bodies() -> list[Skeleton]:
    """Return the default body, small and large ones, one with long arms, and one with wide hips and short legs."""
    one = default_skeleton()
    offset = one.rest_offset.copy()
    offset[[k for k, name in enumerate(one.points) if name.endswith(("_elbow", "_wrist"))]] *= 1.3
    wide = one.rest_offset.copy()
    wide[[k for k, name in enumerate(one.points) if name.endswith("_hip")]] *= 1.4
    wide[[k for k, name in enumerate(one.points) if name.endswith(("_knee", "_ankle"))]] *= 0.8
    return [one, one.scaled(1.2), one.scaled(2.0), one.with_offsets(offset), one.with_offsets(wide)]


@pytest.mark.parametrize("skeleton", bodies())
def test_every_joint_is_within_the_surface(skeleton: Skeleton) -> None:
    """Joints of the limbs are in the middle of the vertices around them, however long the bones are."""
    surface = fit_surface(skeleton)
    rest = skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0]
    near = nearest_points(skeleton)
    scale = skeleton.extent / default_skeleton().extent
    for name in ("left_knee", "right_elbow", "left_wrist", "right_ankle", "neck"):
        k = skeleton.index(name)
        around = surface.mesh.position[near == k]
        away = np.linalg.norm(around - rest[k], axis=1)
        assert np.quantile(away, 0.05) < 0.08 * scale, name
    crown = surface.mesh.position[:, 1].max()
    assert crown == pytest.approx(rest[skeleton.index("head_top"), 1], abs=0.08 * scale)  # with the hair
    reach = np.ptp(surface.mesh.position[:, 0])
    assert reach == pytest.approx(np.ptp(rest[:, 0]), abs=0.05 * scale)


def test_a_posed_surface_follows_its_joints() -> None:
    """At rest it is as fitted; a vertex of one joint alone moves as that joint does, by SciPy's rotations."""
    skeleton = default_skeleton()
    surface = fit_surface(skeleton)
    still = rest_pose(skeleton)
    (mesh,) = surface.placed(Pose(skeleton, still.root_position[None], still.rotation[None]))
    np.testing.assert_allclose(mesh.position, surface.mesh.position, atol=1e-5)
    turn = Rotation.from_rotvec(np.random.default_rng(3).normal(scale=0.4, size=(len(skeleton.joints), 3)))
    pose = Pose(skeleton, np.array([[0.3, 1.1, -2.0]]), turn.as_quat()[None][..., [3, 0, 1, 2]])
    (mesh,) = surface.placed(pose)
    position, rotation = (np.asarray(part)[0] for part in forward_kinematics(pose))
    rest = skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0]
    alone = np.flatnonzero(surface.weight.max(axis=1) == 1)
    joint = surface.joint[alone, surface.weight[alone].argmax(axis=1)]
    assert len(set(joint.tolist())) > 15
    turned = Rotation.from_quat(rotation[joint][:, [1, 2, 3, 0]])
    expected = turned.apply(surface.mesh.position[alone] - rest[joint]) + position[joint]
    np.testing.assert_allclose(mesh.position[alone], expected, atol=1e-5)
    np.testing.assert_allclose(mesh.normal[alone], turned.apply(surface.mesh.normal[alone]), atol=1e-4)


def test_soles_are_the_lowest_part_of_a_standing_body() -> None:
    skeleton = default_skeleton()
    standing = standing_pose(skeleton)
    pose = Pose(skeleton, standing.root_position[None], standing.rotation[None])
    surface = fit_surface(skeleton)
    (whole,), (soles,) = surface.placed(pose), surface.soles.placed(pose)
    assert 50 < len(soles.position) < 0.2 * len(whole.position)
    assert soles.position[:, 1].min() == pytest.approx(whole.position[:, 1].min(), abs=1e-6)


def test_another_tree_is_refused() -> None:
    skeleton = default_skeleton()
    other = replace(skeleton, joints=(*skeleton.joints[:-1], "tail"))
    with pytest.raises(BodysenseError, match="only a skeleton with the default's points and parents"):
        fit_surface(other)
