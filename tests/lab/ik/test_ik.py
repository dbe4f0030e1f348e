"""Inverse kinematics against other solvers of the same problem, and its behaviour on hard targets."""

# Pinocchio takes its names from a C++ module.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest

from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.posture import posture
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.clip import Clip
from bodysense.sources.reading import read
from bodysense_lab.papers.ik.ik import IkSettings, IkState, InverseKinematics, solve_sequence

from .bodies import BODY, EXACT, IK, ONE_STEP, bent, distance, points, random_pose

# Against other solvers


def pinocchio_solution(target: np.ndarray, weight: np.ndarray, start: Pose) -> np.ndarray:
    """Points (P, 3) by Levenberg-Marquardt on Pinocchio's kinematics and Jacobians, of the position cost alone."""
    model = pinocchio.Model()
    joints, frames = [], []
    for index, name in enumerate(BODY.points):
        parent = BODY.parents[index]
        place = pinocchio.SE3(np.eye(3), BODY.rest_offset[index] if index else np.zeros(3))
        if index < len(BODY.joints):
            kind = pinocchio.JointModelSpherical() if index else pinocchio.JointModelFreeFlyer()
            joints.append(model.addJoint(joints[parent] if index else 0, kind, place, name))
            holder, place = joints[index], pinocchio.SE3.Identity()
        else:
            holder = joints[parent]
        frames.append(model.addFrame(pinocchio.Frame(name, holder, place, pinocchio.FrameType.OP_FRAME)))
    data = model.createData()
    q = pinocchio.neutral(model)
    q[:3] = start.root_position
    for index, joint in enumerate(joints):
        first = model.joints[joint].idx_q + (0 if index else 3)
        q[first : first + 4] = start.rotation[index][[1, 2, 3, 0]]
    root = np.sqrt(weight)[:, None]

    def error(q: np.ndarray) -> np.ndarray:
        pinocchio.framesForwardKinematics(model, data, q)
        return root * (np.array([data.oMf[frame].translation for frame in frames]) - target)

    damping, now = 1e-6, error(q)
    for _ in range(300):
        error(q)
        pinocchio.computeJointJacobians(model, data, q)
        frame_of = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        rows = [pinocchio.getFrameJacobian(model, data, frame, frame_of)[:3] for frame in frames]
        jacobian = (np.array(rows) * root[:, :, None]).reshape(-1, model.nv)
        step = np.linalg.solve(jacobian.T @ jacobian + damping * np.eye(model.nv), -jacobian.T @ now.ravel())
        trial = pinocchio.integrate(model, q, step)
        found = error(trial)
        if (found**2).sum() <= (now**2).sum():
            done = (now**2).sum() - (found**2).sum() < 1e-10
            q, now, damping = trial, found, max(damping / 3, 1e-9)
            if done:
                break
        else:
            damping *= 4
    error(q)
    return np.array([data.oMf[frame].translation for frame in frames])


@pytest.mark.parametrize(("seed", "noise"), [(0, 0.0), (1, 0.003)])
def test_same_points_as_pinocchio(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    truth = random_pose(rng)
    target = points(truth) + rng.normal(0, noise, (len(BODY.points), 3))
    weight = rng.uniform(0.2, 1, len(BODY.points))
    _, state = EXACT.solve(target, weight)
    assert distance(state.position, pinocchio_solution(target, weight, truth)) < 1e-3


# Results


def test_state_holds_the_points_of_the_pose() -> None:
    rng = np.random.default_rng(0)
    pose, state = IK.solve(points(random_pose(rng)) + rng.normal(0, 0.02, (len(BODY.points), 3)))
    position, rotation = forward_kinematics(pose)
    np.testing.assert_allclose(state.position, position, atol=1e-12)
    assert geodesic_angle(state.body.world_rotation, rotation).max() < 1e-7
    assert (pose.rotation[:, 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(pose.rotation, axis=1), 1, atol=1e-12)
    bones = np.linalg.norm(position[1:] - position[list(BODY.parents[1:])], axis=1)
    np.testing.assert_allclose(bones, BODY.bone_length[1:], atol=1e-12)


@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_reachable_targets_are_reached_from_any_start(spread: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(6):
        target = points(random_pose(rng, spread))
        _, state = IK.solve(target)
        assert distance(state.position, target) < 1e-3
        _, state = EXACT.solve(target)
        assert distance(state.position, target) < 1e-4  # what the pull toward the relaxed posture costs


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0.6, 0.0, 0.8)])
@pytest.mark.parametrize("degrees", [90, 180])
def test_any_first_heading_is_found(axis: tuple[float, ...], degrees: float) -> None:
    turn = quaternion_exp(np.array(axis) * np.radians(degrees))
    target = quaternion_rotate(turn, points(bent(left_elbow=(0, -60, 0), right_knee=(70, 0, 0))))
    pose, state = IK.solve(target)
    assert distance(state.position, target) < 1e-3
    assert geodesic_angle(pose.rotation[0], turn) < 0.02


def test_body_that_turned_about_between_frames_is_found() -> None:
    hasty = InverseKinematics(BODY, IkSettings(max_iterations=4))
    pose = bent(left_elbow=(0, -60, 0))
    _, state = hasty.solve(points(pose))
    for axis in np.eye(3):
        target = quaternion_rotate(quaternion_exp(np.pi * axis), points(pose)) + np.array([3, 0, 0])
        _, after = hasty.solve(target, state=state)
        assert distance(after.position, target) < 1e-3


@pytest.mark.parametrize("scale", [0.5, 1.3, 5.0])
def test_out_of_reach_targets_give_the_nearest_body(scale: float) -> None:
    rng = np.random.default_rng(2)
    target = scale * points(random_pose(rng))
    _, state = IK.solve(target)
    _, best = EXACT.solve(target)
    assert state.cost <= best.cost * 1.01 + 1e-6


def test_targets_in_one_place_give_a_body_around_it() -> None:
    pose, state = IK.solve(np.tile([1.0, 2.0, 3.0], (len(BODY.points), 1)))
    assert np.isfinite(pose.rotation).all()
    assert np.linalg.norm(state.position.mean(axis=0) - [1, 2, 3]) < 0.1


def test_noisy_motion_is_followed_to_its_minimum() -> None:
    rng = np.random.default_rng(3)
    start, end = random_pose(rng, 0.2), random_pose(rng, 0.2)
    turn = quaternion_log(start.rotation), quaternion_log(end.rotation)
    state = None
    for t in np.linspace(0, 1, 25):
        rotation = quaternion_exp((1 - t) * turn[0] + t * turn[1])
        target = points(Pose(BODY, start.root_position, rotation)) + rng.normal(0, 0.005, (len(BODY.points), 3))
        _, state = IK.solve(target, state=state)
        _, fresh = EXACT.solve(target)
        assert state.cost <= fresh.cost * 1.01 + 1e-6


def test_one_step_is_enough_from_a_near_frame() -> None:
    rng = np.random.default_rng(4)
    pose = random_pose(rng)
    _, state = EXACT.solve(points(pose))
    near = Pose(
        BODY, pose.root_position + 0.02, quaternion_multiply(pose.rotation, quaternion_exp(np.full((52, 3), 0.001)))
    )
    _, after = ONE_STEP.solve(points(near), state=state)
    assert distance(after.position, points(near)) < 1e-3


def test_symmetric_targets_give_a_symmetric_body() -> None:
    rng = np.random.default_rng(5)
    flip = np.array([-1, 1, 1])
    even = BODY.with_offsets((BODY.rest_offset + BODY.rest_offset[BODY.mirror] * flip) / 2)
    ik = InverseKinematics(even)
    target = points(random_pose(rng, 0.3, even)) + rng.normal(0, 0.01, (len(BODY.points), 3))
    _, state = ik.solve(target)
    _, mirrored = ik.solve(target[BODY.mirror] * flip)
    assert distance(mirrored.position, state.position[BODY.mirror] * flip) < 1e-6


# Hidden points


def test_hidden_points_leave_joints_relaxed() -> None:
    weight = np.ones(len(BODY.points))
    hidden = BODY.indices(
        [name for name in BODY.points if any(f in name for f in ("index", "middle", "ring", "pinky"))]
    )
    weight[hidden] = 0
    target = points(bent(left_elbow=(0, -60, 0)))
    target[hidden] = np.nan
    pose, state = EXACT.solve(target, weight)
    assert distance(state.position[weight > 0], target[weight > 0]) < 1e-3
    relaxed = quaternion_exp(posture(BODY).relaxed)
    fingers = BODY.indices([name for name in BODY.joints if "index" in name or "ring" in name])
    assert np.degrees(geodesic_angle(pose.rotation[fingers], relaxed[fingers])).max() < 1


def test_points_of_weight_zero_are_ignored_whatever_they_hold() -> None:
    rng = np.random.default_rng(7)
    target = points(random_pose(rng))
    weight = (rng.uniform(size=len(target)) < 0.7).astype(float)
    results = []
    for junk in (np.nan, np.inf, 1e6):
        spoiled = np.where(weight[:, None] > 0, target, junk)
        results.append(IK.solve(spoiled, weight)[1].position)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_the_body_is_unchanged_without_visible_points() -> None:
    nothing = np.full((len(BODY.points), 3), np.nan)
    _, state = EXACT.solve(points(random_pose(np.random.default_rng(8), 0.2)))
    _, after = IK.solve(nothing, np.zeros(len(BODY.points)), state=state)
    assert np.isfinite(after.position).all()
    assert distance(after.position[:1], state.position[:1]) < 1e-3
    pose, _ = IK.solve(nothing, np.zeros(len(BODY.points)))
    np.testing.assert_allclose(pose.root_position, BODY.rest_offset[0])

    relaxed = quaternion_exp(posture(BODY).relaxed)
    relaxed[0] = quaternion_exp(np.array([0.4, 2.0, -0.3]))
    _, state = EXACT.solve(points(Pose(BODY, np.zeros(3), relaxed)))
    _, after = EXACT.solve(nothing, np.zeros(len(BODY.points)), state=state)
    assert geodesic_angle(after.body.world_rotation[0], relaxed[0]) < 1e-3


@pytest.mark.parametrize("seen", [["head"], ["head", "left_wrist", "right_wrist"], ["pelvis", "left_toe"]])
def test_few_points_are_reached(seen: list[str]) -> None:
    weight = np.zeros(len(BODY.points))
    weight[BODY.indices(seen)] = 1
    target = points(bent(left_elbow=(0, -60, 0), left_hip=(-40, 0, 0))) + np.array([1, 0.1, 2])
    _, state = IK.solve(target, weight)
    assert distance(state.position[weight > 0], target[weight > 0]) < 1e-3


# Any skeleton


def test_other_trees_are_solved() -> None:
    rng = np.random.default_rng(10)
    parents = (-1, 0, 0, 1, 1, 4, 5, 6, 2, 2, 3, 5, 7, 8, 9, 9, 0)
    joints = ("root", "a", "b", "c", "a1", "a2", "a3", "a4", "b1", "b2", "bare")
    sites = ("a2_side", "a4_tip", "b1_tip", "b2_left", "b2_right", "root_site")
    tree = Skeleton(joints, sites, parents, rng.normal(0, 0.2, (len(parents), 3)))
    for skeleton in (tree, Skeleton(("root",), (), (-1,), np.zeros((1, 3))), tree.with_offsets(np.zeros((17, 3)))):
        truth = points(random_pose(rng, 0.8, skeleton))
        _, state = InverseKinematics(skeleton).solve(truth)
        assert distance(state.position, truth) < 1e-3


# State and sequences


def test_sequence_equals_single_frames_and_keeps_states() -> None:
    rng = np.random.default_rng(11)
    target = points(random_pose(rng)) + rng.normal(0, 0.01, (6, len(BODY.points), 3))
    weight = rng.uniform(0.1, 1, (6, len(BODY.points)))
    whole = solve_sequence(IK, target, weight)
    state: IkState | None = None
    for t in range(6):
        before = None if state is None else state.body.world_rotation.copy()
        pose, after = IK.solve(target[t], weight[t], state=state)
        again, _ = IK.solve(target[t], weight[t], state=state)
        np.testing.assert_array_equal(pose.rotation, again.rotation)
        np.testing.assert_array_equal(pose.rotation, whole.rotation[t])
        np.testing.assert_array_equal(pose.root_position, whole.root_position[t])
        if state is not None:
            np.testing.assert_array_equal(state.body.world_rotation, before)
        state = after


def test_no_frames_give_no_poses() -> None:
    pose = solve_sequence(IK, np.zeros((0, len(BODY.points), 3)))
    assert pose.root_position.shape == (0, 3)
    assert pose.rotation.shape == (0, len(BODY.joints), 4)


# Errors


def test_errors_name_value_and_fix() -> None:
    target = points(bent())
    weight = np.ones(len(BODY.points))
    with pytest.raises(BodysenseError, match=r"target has shape \(3, 3\); it must be \(65, 3\)"):
        IK.solve(target[:3])
    with pytest.raises(BodysenseError, match=r"weights of target have shape \(3,\); they must be \(65,\)"):
        IK.solve(target, weight[:3])
    for bad in (-1.0, np.nan, np.inf):
        weight[BODY.index("left_hip")] = bad
        with pytest.raises(BodysenseError, match=rf"target of 'left_hip' has weight {bad:g}; .*0 to ignore"):
            IK.solve(target, weight)
    target[BODY.index("head")] = np.nan
    with pytest.raises(BodysenseError, match="target of 'head' is not finite; give it weight 0"):
        IK.solve(target)
    with pytest.raises(BodysenseError, match=r"rotation_target has shape \(2, 4\); it must be \(52, 4\)"):
        IK.solve(points(bent()), None, np.zeros((2, 4)))
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (52, 1))
    turn[BODY.index("head")] *= 0.5
    with pytest.raises(BodysenseError, match=r"rotation_target of 'head' has length 0\.5; give a unit quaternion"):
        IK.solve(points(bent()), None, turn)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"max_iterations": 0}, "max_iterations is 0; it must be at least 1"),
        ({"tolerance": -1.0}, "tolerance is -1; it must be positive"),
        ({"posture_weight": 0.0}, "posture_weight is 0; it must be positive"),
        ({"damping": np.nan}, "damping is nan; it must be positive"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, float], text: str) -> None:
    with pytest.raises(BodysenseError, match=text):
        InverseKinematics(BODY, IkSettings(**settings))  # type: ignore[arg-type]


# Real motion


def test_every_frame_of_recorded_motion_converges(motion_data: Path) -> None:
    files = sorted(motion_data.glob("rocketbox/*.bvh"))[:: 286 // 6]
    flips = 0
    for path in files:
        clip = read(path)
        assert isinstance(clip, Clip)
        target, rotation = forward_kinematics(clip.pose)
        skeleton = clip.pose.skeleton
        ik = InverseKinematics(skeleton)
        state, before = None, None
        for t in range(min(len(target), 150)):
            pose, state = ik.solve(target[t], state=state)
            assert state.cost < 1e-6, (path.name, t)
            assert distance(state.position, target[t]) < 1e-3
            if before is not None:
                turned = geodesic_angle(pose.rotation, before)
                really = geodesic_angle(*local_rotation(skeleton, rotation[t - 1 : t + 1]))
                flips += int((turned > 3 * really + 0.4).sum())
            before = pose.rotation
    assert flips == 0
