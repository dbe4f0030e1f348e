"""Fitting of a joined body: tracked points are reached, and other joints keep their rotations."""

from __future__ import annotations

import numpy as np
import pytest
from body_poses import no_points, places_of

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reach
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.fingers import is_finger
from bodysense.takes.fitting import FADE_TIME, Trunk, fade_offsets, fit_limbs, fit_trunk

SECONDS = 1 / 30


def turned(pose: Pose, name: str, angle: float) -> Pose:
    """The pose with one joint turned further about its own z axis."""
    rotation, joint = np.array(pose.rotation), pose.skeleton.index(name)
    rotation[:, joint] = quaternion_multiply(rotation[:, joint], quaternion_exp(np.array([0.0, 0.0, angle])))
    return Pose(pose.skeleton, pose.root_position, rotation)


def test_a_spine_points_from_the_head_to_the_pelvis(pose: Pose) -> None:
    """In frames in which both are tracked; their rotations, and all other frames, are unchanged."""
    skeleton, measured = pose.skeleton, no_points(pose)
    pelvis, head = skeleton.index("pelvis"), skeleton.index("head")
    measured[10:30, [pelvis, head]] = True
    measured[40:50, pelvis] = True
    measured[50:60, [pelvis, skeleton.index("spine3"), head]] = True
    truth, wrong = places_of(pose)[0], turned(pose, "spine2", 0.2)
    before, worlds = places_of(wrong)
    wrong = Pose(skeleton, wrong.root_position + truth[:, head] - before[:, head], wrong.rotation)
    after, found = places_of(met := fit_trunk(wrong, truth, measured))
    off = np.linalg.norm(after[:, pelvis] - truth[:, pelvis], axis=-1)
    assert off[10:30].max() < 0.1 * off[:10].min() and off[:10].min() > 0.01
    np.testing.assert_allclose(after[10:30, head], truth[10:30, head], atol=1e-9)
    for joint in (pelvis, head):
        assert geodesic_angle(found[10:30, joint], worlds[10:30, joint]).max() < 1e-6
    rest = np.r_[0:10, 30 : len(truth)]
    np.testing.assert_array_equal(met.rotation[rest], wrong.rotation[rest])
    np.testing.assert_array_equal(met.root_position[rest], wrong.root_position[rest])


def test_a_fit_is_equal_if_places_are_known(pose: Pose) -> None:
    """Whole limbs are tracked for a while, middle joints longer than ends."""
    skeleton, measured = pose.skeleton, no_points(pose)
    measured[10:30, skeleton.indices(["left_elbow", "right_knee", "left_knee"])] = True
    measured[15:40, skeleton.indices(["left_wrist", "right_wrist", "right_ankle", "left_ankle"])] = True
    truth, wrong = places_of(pose)[0], turned(turned(pose, "left_elbow", 0.3), "right_hip", 0.05)
    places = forward_kinematics(wrong)
    bent, known = fit_limbs(wrong, truth, measured, SECONDS), fit_limbs(wrong, truth, measured, SECONDS, places)
    np.testing.assert_array_equal(known.rotation, bent.rotation)
    off = np.linalg.norm(places_of(bent)[0] - truth, axis=-1)
    assert off[15:30, skeleton.indices(["left_elbow", "left_wrist"])].max() < 1e-3


@pytest.mark.parametrize("end", ["left_wrist", "right_ankle"])
def test_tracked_ends_are_reached_and_other_limbs_are_unchanged(pose: Pose, end: str) -> None:
    skeleton, measured = pose.skeleton, no_points(pose)
    tip = skeleton.index(end)
    first = skeleton.parents[skeleton.parents[tip]]
    measured[20:40, tip] = True
    truth, wrong = places_of(pose)[0], turned(pose, skeleton.joints[first], 0.1)
    bent = fit_limbs(wrong, truth, measured, SECONDS)
    assert np.linalg.norm(places_of(bent)[0][20:40, tip] - truth[20:40, tip], axis=-1).max() < 1e-3
    assert np.linalg.norm(places_of(wrong)[0][20:40, tip] - truth[20:40, tip], axis=-1).min() > 0.01
    changed = (bent.rotation != wrong.rotation).any(axis=-1)
    count = round(FADE_TIME / SECONDS)
    assert not changed[: 20 - count].any() and not changed[40 + count :].any()
    assert set(np.flatnonzero(changed.any(axis=0)).tolist()) <= {tip, skeleton.parents[tip], first}


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("height", [0.004, 0.007, 0.01])
@pytest.mark.parametrize("stretch", [0.985, 0.99, 0.996])
def test_knees_of_nearly_straight_legs_do_not_jump_where_they_are_hidden(
    pose: Pose, stretch: float, height: float, backward: bool
) -> None:
    """The hips are too high; the knee is tracked in the first frames or in the last, the ankle in all."""
    skeleton, measured = pose.skeleton, no_points(pose)[:40]
    still = Pose(skeleton, np.repeat(pose.root_position[:1], 40, 0), np.repeat(pose.rotation[:1], 40, 0))
    hip, knee, ankle = skeleton.indices(["left_hip", "left_knee", "left_ankle"])
    longest = float(np.linalg.norm(skeleton.rest_offset[[knee, ankle]], axis=-1).sum())
    straight = places_of(still)[0][:, hip] + [0.0, -stretch * longest, 0.0]
    truth = places_of(still := reach(still, "left_ankle", straight))[0]
    wrong = Pose(skeleton, still.root_position + np.array([0.0, height, 0.0]), still.rotation)
    measured[:, ankle] = True
    measured[20:, knee] = True
    if not backward:
        measured = measured[::-1].copy()
    after = places_of(fit_limbs(wrong, truth, measured, SECONDS))[0]
    assert np.linalg.norm(np.diff(after[:, knee], axis=0), axis=-1).max() < 0.01
    missed = np.linalg.norm(after[:, ankle] - truth[:, ankle], axis=-1)
    beyond = max(stretch * longest + height - longest, 0.0)  # m that the leg is too short for
    assert missed.max() < height + 0.002
    assert (missed[:10] if backward else missed[-10:]).max() < beyond + 0.002


@pytest.mark.parametrize("gap", [slice(0, 20), slice(20, 60), slice(30, 33), slice(50, 90)])
def test_offsets_of_measured_frames_fade_into_others(gap: slice) -> None:
    """An offset is continuous at an edge, 0 in the middle of a long gap, and unchanged in measured frames."""
    offset = np.tile([0.03, -0.01, 0.02], (90, 1))
    measured = np.ones(90, dtype=bool)
    measured[gap] = False
    found = fade_offsets(offset, measured, SECONDS)
    np.testing.assert_array_equal(found[measured], offset[measured])
    assert np.linalg.norm(np.diff(found, axis=0), axis=-1).max() < 0.4 * np.linalg.norm(offset[0])
    assert (found * np.sign(offset) >= 0).all() and (np.abs(found) <= np.abs(offset) + 1e-12).all()
    if gap.stop - gap.start >= 20:
        assert not found[
            (gap.start + gap.stop) // 2 if gap.start and gap.stop < 90 else (0 if not gap.start else 89)
        ].any()
    assert not fade_offsets(offset, np.zeros(90, dtype=bool), SECONDS).any()


def test_a_straight_leg_does_not_jump_when_its_foot_is_seen(pose: Pose) -> None:
    """The true body is straight, and feet of the pose are 4 mm higher: knees move 5 cm forward in several frames."""
    straight = Pose(
        pose.skeleton, np.zeros_like(pose.root_position), np.tile([1.0, 0, 0, 0], (*pose.rotation.shape[:2], 1))
    )
    truth, tip = places_of(straight)[0], pose.skeleton.index("left_ankle")
    bent = reach(straight, "left_ankle", truth[:, tip] + [0.0, 0.004, 0.0])
    measured = no_points(pose)
    measured[30:60, tip] = True
    found = places_of(fit_limbs(bent, truth, measured, SECONDS))[0]
    knee = found[:, pose.skeleton.index("left_knee")]
    assert np.ptp(knee, axis=0).max() > 0.03
    assert np.linalg.norm(np.diff(knee, axis=0), axis=-1).max() < 0.015
    np.testing.assert_allclose(found[30:60, tip], truth[30:60, tip], atol=1e-3)


def test_a_limb_turns_gradually_to_a_middle_joint_seen_for_a_while(pose: Pose) -> None:
    """The wrist is always tracked, the elbow in frames 30 to 60; the arm swivels next to these."""
    wrist, elbow = (pose.skeleton.index(f"right_{part}") for part in ("wrist", "elbow"))
    truth, rotation = places_of(pose)[0], np.array(pose.rotation)
    shoulder = pose.skeleton.index("right_shoulder")
    rotation[:, shoulder] = quaternion_multiply(rotation[:, shoulder], quaternion_exp(np.array([0.8, 0.5, 0.0])))
    wrong, measured = Pose(pose.skeleton, pose.root_position, rotation), no_points(pose)
    measured[:, wrist] = True
    measured[30:60, elbow] = True
    found = places_of(fit_limbs(wrong, truth, measured, SECONDS))[0]
    without = places_of(fit_limbs(wrong, truth, measured & (np.arange(len(measured.T)) != elbow), SECONDS))[0]
    np.testing.assert_allclose(found[30:60, elbow], truth[30:60, elbow], atol=2e-3)
    np.testing.assert_allclose(found[:, wrist], truth[:, wrist], atol=2e-3)
    off, leap = found[:, elbow] - truth[:, elbow], np.linalg.norm(without[29, elbow] - truth[29, elbow])
    assert leap > 0.02 and np.linalg.norm(off[29] - off[30]) < 0.3 * leap
    np.testing.assert_allclose(found[:15, elbow], without[:15, elbow], atol=1e-9)


def test_a_stretched_limb_that_is_not_tracked_keeps_its_rotation(pose: Pose) -> None:
    """Fitting an untracked straight leg to its own position would bend it a little."""
    rotation = np.array(pose.rotation)
    knees = pose.skeleton.indices(["left_knee", "right_knee"])
    rotation[:, knees] = [1.0, 0.0, 0.0, 0.0]
    straight = Pose(pose.skeleton, pose.root_position, rotation)
    np.testing.assert_array_equal(
        fit_limbs(straight, places_of(straight)[0], no_points(pose), SECONDS).rotation, rotation
    )


def test_a_fit_without_fingers_keeps_them(pose: Pose) -> None:
    trunk = Trunk.of(pose.skeleton)
    bare = trunk.without_fingers(pose)
    position = places_of(pose)[0]
    np.testing.assert_allclose(places_of(bare)[0], position[:, trunk.points], atol=1e-12)
    assert set(pose.skeleton.joints) - set(bare.skeleton.joints) == {
        name for name in pose.skeleton.joints if is_finger(name)
    }
    np.testing.assert_array_equal(trunk.with_fingers(bare, pose).rotation, pose.rotation)
