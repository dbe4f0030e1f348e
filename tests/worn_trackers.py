"""Trackers strapped to unseen bodies: calibration while standing, and refinement of their mounts by motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.observing.observation import Observation
from bodysense.tracking.calibration import calibrate
from bodysense.tracking.tracker import Tracker, TrackerState

RATE = 30
TRACKER_JOINTS = ("pelvis", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_elbow", "right_elbow")
BODIES = sample_bodies("test", 16)
BOW = {"pelvis": 60.0, "left_hip": -60.0, "right_hip": -60.0}  # degrees about x; the legs stay straight
SQUAT = {f"{side}_{part}": angle for side in ("left", "right") for part, angle in (("hip", -80.0), ("knee", 110.0))}
SQUAT |= {"left_ankle": -30.0, "right_ankle": -30.0}


def strapped(observation: Observation, mounts: Mapping[str, RigidTransform]) -> Observation:
    """Simulate trackers strapped at an offset from their joints, by the joint that carries each: T_joint_tracker."""
    position, rotation = observation.position.copy(), observation.rotation.copy()
    for joint, mount in mounts.items():
        k = observation.points.index(joint)
        turn = rotation[..., k, :]
        position[..., k, :] += quaternion_rotate(turn, np.broadcast_to(mount.translation, position[..., k, :].shape))
        rotation[..., k, :] = quaternion_multiply(turn, np.broadcast_to(mount.rotation, turn.shape))
    return replace(observation, position=position, rotation=rotation)


def posed_motion(skeleton: Skeleton, *goals: dict[str, float]) -> Pose:
    """Stand for a second, then go to each pose and back, in 4 s; the ankles stay where they are."""
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (RATE * (1 + 4 * len(goals)), 1, 1))
    depth = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(4 * RATE) / (4 * RATE))
    for k, goal in enumerate(goals):
        frames = slice(RATE * (1 + 4 * k), RATE * (5 + 4 * k))
        for name, angle in goal.items():
            joint = skeleton.index(name)
            turn = quaternion_exp(depth[:, None] * np.radians([angle, 0.0, 0.0]))
            rotation[frames, joint] = quaternion_multiply(rotation[frames, joint], turn)
    root = np.tile(pose.root_position, (len(rotation), 1))
    ankle = forward_kinematics(Pose(skeleton, root, rotation))[0][:, skeleton.index("left_ankle")]
    return Pose(skeleton, root + ankle[0] - ankle, rotation)


def calibrated_wearer(body: int, sensors: str, *goals: dict[str, float]) -> tuple[Observation, Person, Pose]:
    """Return the tracking, the calibrated person and the motion of an unseen body with trackers 8-14 cm off its joints.

    The body stands for one second, which calibrates it, and then moves.
    """
    pose = posed_motion(default_skeleton().with_offsets(BODIES[body]), *goals)
    observation = observe(pose, np.arange(len(pose.root_position)) / RATE, SENSOR_SETS[sensors])
    rng, mounts = np.random.default_rng(body), {}
    for name in observation.points:
        if name in TRACKER_JOINTS:
            away = rng.standard_normal(3)
            away *= rng.uniform(0.08, 0.14) / np.linalg.norm(away)
            mounts[name] = RigidTransform(away, rng.standard_normal(4))
    observation = strapped(observation, mounts)
    return observation, calibrate(observation[:RATE], Person()), pose


def tracked(observation: Observation, person: Person) -> TrackerState:
    """Return the state of the tracker after a whole observation."""
    tracker = Tracker(person)
    return tracker.step(observation, tracker.start())[1]


def errors(observation: Observation, pose: Pose, *people: Person) -> dict[str, list[float]]:
    """Return the distance (m) of each joint in the last frame from its place by each person's mounts."""
    truth = forward_kinematics(pose)[0][-1]
    found: dict[str, list[float]] = {}
    for k, name in enumerate(observation.points):
        if name in TRACKER_JOINTS:
            tracker = RigidTransform(observation.position[-1, k], observation.rotation[-1, k])
            joints = [(tracker @ person.mounts[name].inverse()).translation for person in people]
            found[name] = [float(np.linalg.norm(joint - truth[pose.skeleton.index(name)])) for joint in joints]
    return found


def errors_of_all_bodies(sensors: str, *goals: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the errors (16, 2) m of unseen bodies by joint: after calibration, and after refinement."""
    rows = []
    for body in range(len(BODIES)):
        observation, person, pose = calibrated_wearer(body, sensors, *goals)
        rows.append(errors(observation, pose, person, tracked(observation, person).person()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def numbers() -> dict[str, float]:
    """Return mean and largest errors in cm: calibrated, after two bows, after a bow and a squat with ten trackers."""
    bows, squats = errors_of_all_bodies("six_point", BOW, BOW), errors_of_all_bodies("ten_point", BOW, SQUAT)
    found = {}
    for part in ("pelvis", "ankle", "knee", "elbow"):
        for stage, after, column in (("calibrated", squats, 0), ("bows", bows, 1), ("squat", squats, 1)):
            apart = [errors[:, column] for name, errors in after.items() if name.endswith(part)]
            if apart:
                found |= {
                    f"{part}_{stage}_mean_cm": 100 * np.mean(apart),
                    f"{part}_{stage}_max_cm": 100 * np.max(apart),
                }
    return found
