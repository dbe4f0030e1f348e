"""Forward kinematics against Pinocchio and a plain loop, on NumPy and PyTorch."""

from __future__ import annotations

from collections.abc import Callable

# Pinocchio takes its names from a C++ module.
# pyright: reportAttributeAccessIssue=false
import numpy as np
import pinocchio
import pytest
import torch
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics, local_rotation, rest_pose, tree_kinematics, world_rotation
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_exp,
    quaternion_to_matrix,
)

BODY = default_skeleton()
SHAPES = [(), (3, 1, 2), (0,), (300,)]


def random_pose(shape: tuple[int, ...] = (), seed: int = 0, skeleton: Skeleton = BODY) -> Pose:
    rng = np.random.default_rng(seed)
    turn = quaternion_exp(rng.normal(size=(*shape, len(skeleton.joints), 3)))
    return Pose(skeleton, rng.normal(size=(*shape, 3)), turn)


def as_torch(pose: Pose, dtype: torch.dtype = torch.float64) -> Pose:
    return Pose(pose.skeleton, torch.tensor(pose.root_position, dtype=dtype), torch.tensor(pose.rotation, dtype=dtype))


def loop(pose: Pose, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (P, 3) and matrices (J, 3, 3) of one pose, joint by joint."""
    skeleton = pose.skeleton
    local = quaternion_to_matrix(pose.rotation)
    matrix, position = np.zeros_like(local), np.zeros((len(skeleton.points), 3))
    for point, parent in enumerate(skeleton.parents):
        position[point] = pose.root_position if parent < 0 else position[parent] + matrix[parent] @ offset[point]
        if point < len(skeleton.joints):
            matrix[point] = local[point] if parent < 0 else matrix[parent] @ local[point]
    return position, matrix


@pytest.mark.parametrize("shape", SHAPES)
def test_forward_kinematics_equals_the_plain_loop(shape: tuple[int, ...]) -> None:
    pose = random_pose(shape)
    position, rotation = forward_kinematics(pose)
    assert position.shape == (*shape, len(BODY.points), 3)
    assert rotation.shape == (*shape, len(BODY.joints), 4)
    for index in np.ndindex(shape):
        expected, matrix = loop(pose[index], BODY.rest_offset)
        np.testing.assert_allclose(position[index], expected, atol=1e-12)
        np.testing.assert_allclose(quaternion_to_matrix(rotation[index]), matrix, atol=1e-12)


def test_frames_do_not_depend_on_others_and_products_are_those_of_quaternions() -> None:
    pose = random_pose((300,), seed=2)
    position, rotation = forward_kinematics(pose)
    for frames in (slice(0, 1), slice(120, 140), slice(299, 300)):
        alone = forward_kinematics(pose[frames])
        np.testing.assert_array_equal(alone[0], position[frames])
        np.testing.assert_array_equal(alone[1], rotation[frames])
    for joint in range(len(BODY.joints)):
        np.testing.assert_array_equal(world_rotation(pose, joint), rotation[:, joint])


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3)])
@pytest.mark.parametrize("axes", [(-1, -2), (-2, -1)])
def test_any_order_in_memory_gives_the_same_and_stays_as_it_is(shape: tuple[int, ...], axes: tuple[int, int]) -> None:
    pose = random_pose(shape, seed=4)
    laid = np.moveaxis(np.ascontiguousarray(np.moveaxis(pose.rotation, (-2, -1), axes)), axes, (-2, -1))
    given = Pose(BODY, pose.root_position, laid)
    for found, wanted in zip(forward_kinematics(given), forward_kinematics(pose), strict=True):
        np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(laid, random_pose(shape, seed=4).rotation)


@pytest.mark.parametrize("laid", [np.asfortranarray, lambda offset: np.repeat(offset, 2, axis=1)[:, ::2]])
@pytest.mark.parametrize(
    "skeleton_of", [BODY.with_offsets, lambda offset: Skeleton(BODY.joints, BODY.end_sites, BODY.parents, offset)]
)
def test_offsets_in_any_order_in_memory_give_the_same(
    laid: Callable[[np.ndarray], np.ndarray], skeleton_of: Callable[[np.ndarray], Skeleton]
) -> None:
    offset = np.random.default_rng(5).normal(size=BODY.rest_offset.shape)
    pose = random_pose((2,), seed=5, skeleton=skeleton_of(laid(offset)))
    np.testing.assert_allclose(forward_kinematics(pose)[0][1], loop(pose[1], offset)[0], atol=1e-12)


def test_forward_kinematics_equals_pinocchio() -> None:
    pose = random_pose()
    model = pinocchio.Model()
    joints: list[int] = []
    for index, name in enumerate(BODY.joints):
        place = pinocchio.SE3(np.eye(3), BODY.rest_offset[index] if index else np.zeros(3))
        kind = pinocchio.JointModelSpherical() if index else pinocchio.JointModelFreeFlyer()
        joints.append(model.addJoint(joints[BODY.parents[index]] if index else 0, kind, place, name))
    data = model.createData()
    q = pinocchio.neutral(model)
    q[:3] = pose.root_position
    for index, joint in enumerate(joints):
        first = model.joints[joint].idx_q + (0 if index else 3)
        q[first : first + 4] = pose.rotation[index][[1, 2, 3, 0]]
    pinocchio.forwardKinematics(model, data, q)
    position, rotation = forward_kinematics(pose)
    for index, joint in enumerate(joints):
        np.testing.assert_allclose(position[index], data.oMi[joint].translation, atol=1e-12)
        np.testing.assert_allclose(quaternion_to_matrix(rotation[index]), data.oMi[joint].rotation, atol=1e-12)


def test_bodies_of_many_sizes_share_a_batch() -> None:
    pose = random_pose((4,))
    offset = BODY.rest_offset * np.array([0.5, 1.0, 1.5, 2.0])[:, None, None]
    position, _ = forward_kinematics(pose, offset)
    for k in range(4):
        np.testing.assert_allclose(position[k], loop(pose[k], offset[k])[0], atol=1e-12)
    in_torch, _ = forward_kinematics(as_torch(pose), torch.tensor(offset))
    np.testing.assert_allclose(in_torch.numpy(), position, atol=1e-12)


def test_rest_pose_stands_at_the_offsets() -> None:
    position, rotation = forward_kinematics(rest_pose(BODY))
    np.testing.assert_allclose(position, BODY.path @ BODY.rest_offset + BODY.rest_offset[0], atol=1e-12)
    assert (rotation == [1, 0, 0, 0]).all()
    batch = rest_pose(BODY, (2, 3))
    assert batch.root_position.shape == (2, 3, 3)
    assert batch.rotation.shape == (2, 3, 52, 4)
    batch.root_position[0, 0] += 1
    np.testing.assert_array_equal(batch.root_position[1, 1], BODY.rest_offset[0])


@pytest.mark.parametrize("shape", SHAPES)
def test_local_rotations_come_back_from_world_rotations(shape: tuple[int, ...]) -> None:
    pose = random_pose(shape)
    _, rotation = forward_kinematics(pose)
    assert geodesic_angle(local_rotation(BODY, rotation), pose.rotation).max(initial=0) < 1e-7
    in_torch = local_rotation(BODY, torch.tensor(rotation)).numpy()
    np.testing.assert_allclose(in_torch, local_rotation(BODY, rotation), atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 2e-5)])
def test_pytorch_gives_what_numpy_gives(shape: tuple[int, ...], dtype: torch.dtype, tolerance: float) -> None:
    pose = random_pose(shape)
    position, rotation = forward_kinematics(pose)
    found, turned = forward_kinematics(as_torch(pose, dtype))
    assert found.dtype == turned.dtype == dtype
    np.testing.assert_allclose(found.numpy(), position, rtol=0, atol=tolerance)
    np.testing.assert_allclose(turned.numpy(), rotation, rtol=0, atol=tolerance)


def test_gradients_agree_with_differences() -> None:
    skeleton = Skeleton(("a", "b", "c"), ("d", "e"), (-1, 0, 1, 1, 2), np.random.default_rng(0).normal(size=(5, 3)))
    pose = as_torch(random_pose((2,), skeleton=skeleton))
    offset = torch.tensor(skeleton.rest_offset, requires_grad=True)

    def points(root: torch.Tensor, rotation: torch.Tensor, offset: torch.Tensor) -> torch.Tensor:
        return forward_kinematics(Pose(skeleton, root, rotation), offset)[0]

    arguments = (pose.root_position.requires_grad_(), pose.rotation.requires_grad_(), offset)
    assert torch.autograd.gradcheck(points, arguments)


def test_skeleton_of_one_joint() -> None:
    skeleton = Skeleton(("root",), (), (-1,), np.zeros((1, 3)))
    pose = random_pose((2,), skeleton=skeleton)
    position, rotation = forward_kinematics(pose)
    np.testing.assert_array_equal(position[:, 0], pose.root_position)
    np.testing.assert_array_equal(rotation, pose.rotation)
    assert forward_kinematics(as_torch(pose))[0].shape == (2, 1, 3)


def test_indexing_takes_frames() -> None:
    pose = random_pose((5,))
    assert pose[2].rotation.shape == (52, 4)
    np.testing.assert_array_equal(pose[1:3].root_position, pose.root_position[1:3])


def test_kinematics_of_any_tree_equal_a_walk_along_its_bones() -> None:
    """Trees of random shape with end sites, whose root's offset is not used; SciPy turns the bones."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        joints, sites, frames = (int(rng.integers(low, 9)) for low in (1, 0, 1))
        parents = [-1, *(int(rng.integers(0, k)) for k in range(1, joints))]
        parents += rng.integers(0, joints, sites).tolist()
        offset, root = rng.standard_normal((joints + sites, 3)), rng.standard_normal((frames, 3))
        turns = Rotation.random(frames * joints, rng=rng).as_quat(scalar_first=True).reshape(frames, joints, 4)
        position, world = tree_kinematics(parents, offset, root, turns)
        for frame in range(frames):
            turned, place = [], [root[frame]]
            for joint in range(joints):
                own = Rotation.from_quat(turns[frame, joint], scalar_first=True)
                turned.append(own if joint == 0 else turned[parents[joint]] * own)
            for point in range(1, joints + sites):
                place.append(place[parents[point]] + turned[parents[point]].apply(offset[point]))
            np.testing.assert_allclose(position[frame], place, atol=1e-12)
            same = [
                (Rotation.from_quat(world[frame, k], scalar_first=True) * turned[k].inv()).magnitude()
                for k in range(joints)
            ]
            assert max(same) < 1e-7


def test_kinematics_of_a_tree_refuse_shapes_that_are_not_its_own() -> None:
    one = np.array([[1.0, 0.0, 0.0, 0.0]])
    for parents, offset, rotation in (
        ((-1,), np.zeros((2, 3)), one),
        ((-1,), np.zeros((1, 3)), np.repeat(one, 2, axis=0)),
    ):
        with pytest.raises(ValueError, match="are not those of 1 points"):
            tree_kinematics(parents, offset, np.zeros(3), rotation)
