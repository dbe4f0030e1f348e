"""Motion and devices to compare the core with its twin on: made up, so that no recording is needed."""

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe, random_edges
from bodysense.observation import Observation
from bodysense.tracker import TrackerSettings

DEVICES = (*SENSOR_SETS, "lattice")  # "lattice": any set of sensors, each of any kind
KNOWN = ("proportions", "height", "lengths", "nothing")
RATES = (24.0, 37.0, 72.0, 111.0)  # 1/s; memories advance 65 times a second, of which no rate is a multiple


@dataclass(frozen=True)
class Case:
    """What is tracked of somebody, and what is known of them."""

    device: str
    known: str
    rate: float  # 1/s
    frames: int
    loss: float  # probability of each sensor to come or go in a frame
    noise: float  # m, of positions
    seed: int
    settings: TrackerSettings = TrackerSettings()


def body_of(seed: int):
    """The skeleton of somebody."""
    return default_skeleton().with_offsets(sample_bodies("test", 8)[seed % 8])


def motion(case: Case) -> Pose:
    """Somebody who swings all joints, leans, crouches, turns and walks."""
    rng, skeleton = np.random.default_rng(case.seed), body_of(case.seed)
    time = np.arange(case.frames) / case.rate
    swing = rng.normal(size=(52, 3)) * np.where(np.arange(52) < 22, 0.25, 0.3)[:, None]
    phase = np.sin(2 * np.pi * (rng.uniform(0.1, 1.5, (52, 1)) * time[:, None, None] + rng.random((52, 1))))
    rotation = quaternion_multiply(standing_pose(skeleton).rotation, quaternion_exp(swing * phase))
    turn = quaternion_exp(np.array([0.0, 1, 0]) * (rng.normal() * 3 + rng.normal() * time[:, None]))
    rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
    hip = skeleton.rest_offset[0, 1] - rng.uniform(0, 0.3) * (1 - np.cos(2 * np.pi * rng.uniform(0.1, 0.5) * time)) / 2
    root = rng.normal(size=(1, 3)) * [20, 0, 20] + time[:, None] * rng.normal(size=(1, 3)) * [0.7, 0, 0.7]
    root[:, 1] = hip
    return Pose(skeleton, root, rotation)


def observation_of(case: Case) -> Observation:
    """What the device tracks: with noise, and sensors that come and go."""
    rng = np.random.default_rng(case.seed + 1)
    sensors = random_edges(1, rng)[0].more if case.device == "lattice" else SENSOR_SETS[case.device]
    time = 100 + np.arange(case.frames) / case.rate
    seen = observe(motion(case), time, sensors)
    lost = np.cumsum(rng.random(seen.has_position.shape) < case.loss, axis=0) % 2 == 1
    moved = seen.position + rng.normal(size=seen.position.shape) * case.noise
    return replace(
        seen,
        position=moved,
        has_position=seen.has_position & ~lost,
        has_rotation=seen.has_rotation & ~(lost & (rng.random(lost.shape[1]) < 0.7)),
        accuracy=rng.uniform(0.0005, 0.02, seen.accuracy.shape),
    )


def person_of(case: Case) -> Person:
    """What is known of them."""
    skeleton = body_of(case.seed)
    match case.known:
        case "proportions":
            return Person(skeleton)
        case "height":
            return Person(height=float(stature(skeleton.rest_offset)))
        case "lengths":
            return Person(lengths={("left_elbow", "left_wrist"): 0.26, ("left_hip", "left_knee"): 0.41})
        case _:
            return Person()
