"""Height, arm span and mounts are calibrated from one second of standing."""

from dataclasses import replace

import numpy as np
import pytest
from worn_trackers import strapped

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, rest_pose, standing_pose
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.observing.observation import Observation
from bodysense.tracking.calibration import assign_trackers, calibrate

FRAMES = 30


def standing(body: int, arms_out: bool = False, name: str = "six_point") -> tuple[Observation, Pose]:
    """An unseen body that stands still, turned by 1 rad and away from the origin, and its tracked points."""
    skeleton = default_skeleton().with_offsets(sample_bodies("test", body + 1)[body])
    pose = rest_pose(skeleton) if arms_out else standing_pose(skeleton)
    turn = quaternion_exp(np.array([0.0, 1.0, 0.0]))
    rotation = pose.rotation.copy()
    rotation[0] = quaternion_multiply(turn, rotation[0])
    root = pose.root_position + np.array([2.0, 0.0, -1.0])
    pose = Pose(skeleton, np.tile(root, (FRAMES, 1)), np.tile(rotation, (FRAMES, 1, 1)))
    return observe(pose, np.arange(FRAMES) / FRAMES, SENSOR_SETS[name]), pose


@pytest.mark.parametrize("body", range(3))
def test_height_is_measured_to_the_spread_of_necks(body: int) -> None:
    observation, pose = standing(body)
    person = calibrate(observation, Person())
    assert abs(stature(person.skeleton.rest_offset) - stature(pose.skeleton.rest_offset)) < 0.04


def test_height_is_measured_from_the_floor() -> None:
    observation, _ = standing(1)
    raised = replace(observation, position=observation.position + np.array([0.0, 0.3, 0.0]))
    on_floor, on_platform = calibrate(observation, Person()), calibrate(raised, Person(), floor=0.3)
    assert on_platform.skeleton.height == pytest.approx(on_floor.skeleton.height)


def test_arms_out_measure_the_arm_span() -> None:
    observation, pose = standing(2, arms_out=True, name="three_point")
    wrists = pose.skeleton.indices(["left_wrist", "right_wrist"])

    def span(skeleton) -> float:
        place = skeleton.path @ skeleton.rest_offset
        return float(np.linalg.norm(place[wrists[0]] - place[wrists[1]]))

    person = calibrate(observation, Person(), "arms out")
    assert abs(span(person.skeleton) - span(pose.skeleton)) < 0.02


def test_trackers_strapped_beside_their_joints_are_found() -> None:
    apart: dict[str, list[float]] = {"pelvis": [], "left_ankle": [], "right_ankle": []}
    for body in range(12):
        observation, pose = standing(body)
        rng = np.random.default_rng(body)
        mounts = {}
        for name in apart:
            away = rng.standard_normal(3)
            away *= rng.uniform(0.08, 0.14) / np.linalg.norm(away)
            mounts[name] = RigidTransform(away, rng.standard_normal(4))
        tracked = strapped(observation, mounts)
        person = calibrate(tracked, Person())
        truth = forward_kinematics(pose)[0][0]
        for name, errors in apart.items():
            k = observation.points.index(name)
            joint = RigidTransform(tracked.position[0, k], tracked.rotation[0, k]) @ person.mounts[name].inverse()
            errors.append(float(np.linalg.norm(joint.translation - truth[pose.skeleton.index(name)])))
    # Standing still does not tell how a height is shared between legs and torso, which leaves hips 2 cm unsure.
    assert max(apart["left_ankle"] + apart["right_ankle"]) < 0.03
    assert np.percentile(apart["pelvis"], 75) < 0.03 and max(apart["pelvis"]) < 0.045


@pytest.mark.parametrize("body", range(2))
def test_trackers_are_assigned_by_position(body: int) -> None:
    observation, _ = standing(body, name="ten_point")
    rng = np.random.default_rng(body)
    held = {"head", "left_wrist", "right_wrist"}
    tracked = [name for name in observation.points if name not in held]
    rng.shuffle(tracked)
    names = {joint: f"tracker_{k + 1}" for k, joint in enumerate(tracked)}
    mounts = {}
    for joint in tracked:
        away = rng.standard_normal(3)
        mounts[joint] = RigidTransform(rng.uniform(0.05, 0.09) * away / np.linalg.norm(away), rng.standard_normal(4))
    seen = strapped(observation, mounts)
    seen = replace(seen, points=tuple(names.get(name, name) for name in seen.points))
    assert assign_trackers(seen, list(names.values()), Person()) == {name: joint for joint, name in names.items()}
    some = [name for joint, name in names.items() if joint not in ("left_knee", "spine3")]
    assert assign_trackers(seen, some, Person()).keys() == set(some)


def test_a_tracker_far_from_the_body_is_not_assigned() -> None:
    observation, _ = standing(0)
    points = tuple("tracker_1" if name == "pelvis" else name for name in observation.points)
    position = observation.position.copy()
    position[:, points.index("tracker_1")] += np.array([0.0, 0.0, 1.0])
    aside = replace(observation, points=points, position=position)
    assert assign_trackers(aside, ["tracker_1"], Person()) == {}
    blind = replace(aside, has_position=np.zeros_like(aside.has_position))
    assert assign_trackers(blind, ["tracker_1"], Person()) == {}


def test_calibration_refuses_motion_and_a_missing_headset() -> None:
    observation, _ = standing(0)
    restless = observation.position.copy()
    restless[:, observation.points.index("head"), 0] += np.linspace(0, 0.3, FRAMES)
    with pytest.raises(BodysenseError, match="stand still"):
        calibrate(replace(observation, position=restless), Person())
    with pytest.raises(BodysenseError, match="stand for a second"):
        calibrate(observation[:2], Person())
