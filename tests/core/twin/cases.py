"""Motion, devices and people to compare the core with its twin on: made up, so that no recording is needed.

Draws stay away from ties, where a difference in the last bit decides: bones that turn by half a turn, a head that is
lost for long and moves with the output body, rates at which a memory may or may not advance.
"""

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import strategies as st

from bodysense.body.person import Person
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.observing.observation import Observation
from bodysense.tracking.tracker import TrackerSettings
from bodysense_lab.completion.data.signal_kinds import observed_set
from bodysense_lab.completion.kinds.lattice import random_edges

_JOINTS = ("pelvis", "spine3", *(f"{side}_{name}" for side in ("left", "right") for name in ("hip", "knee", "elbow")))
SETS = {**SENSOR_SETS, "inertial": SensorSet((), _JOINTS)}
DEVICES = (*SETS, "lattice")  # "lattice": any set of sensors, each of any kind
KNOWN = ("proportions", "height", "lengths", "nothing")
BODIES = sample_bodies("test", 8)


@dataclass(frozen=True)
class Case:
    """A device, a motion, and knowledge of the person."""

    device: str
    known: str  # one of `KNOWN`
    rate: float  # 1/s
    frames: int
    loss: float  # probability of each sensor to come or go in a frame
    noise: float  # m, of positions; small compared with bones of fingers
    gap: bool  # a second is missing
    seed: int
    settings: TrackerSettings

    @property
    def skeleton(self) -> Skeleton:
        """The body that moves."""
        return default_skeleton().with_offsets(BODIES[self.seed % len(BODIES)])


def cases(device: str, frames: int) -> st.SearchStrategy[Case]:
    """Draw cases of a device."""
    settings = st.builds(
        TrackerSettings,
        floor=st.sampled_from((0.0, 0.0, 0.31, -1.2)),
        hold_feet=st.sampled_from((True, True, False)),
        infer=st.sampled_from((True, True, True, False)),
        ease=st.sampled_from((0.25, 0.25, 0.1, 0.0)),
    )
    return st.builds(
        Case,
        device=st.just(device),
        known=st.sampled_from(KNOWN),
        rate=st.sampled_from((11.0, 24.0, 37.0, 72.0, 111.0, 144.0)),
        frames=st.just(frames),
        loss=st.sampled_from((0.0, 0.01, 0.03)),
        noise=st.sampled_from((0.0, 0.002)),
        gap=st.booleans(),
        seed=st.integers(0, 10**6),
        settings=settings,
    )


def motion(case: Case) -> Pose:
    """Somebody who swings all joints, crouches, turns and walks."""
    rng, skeleton = np.random.default_rng(case.seed), case.skeleton
    time = np.arange(case.frames) / case.rate
    phase = np.sin(2 * np.pi * (rng.uniform(0.1, 1.5, (52, 1)) * time[:, None, None] + rng.random((52, 1))))
    swung = quaternion_exp(rng.normal(size=(52, 3)) * 0.2 * phase)
    rotation = quaternion_multiply(standing_pose(skeleton).rotation, swung)
    turn = quaternion_exp(np.array([0.0, 1, 0]) * (rng.normal() * 3 + rng.normal() * time[:, None]))
    rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
    crouched = rng.uniform(0, 0.3) * (1 - np.cos(2 * np.pi * rng.uniform(0.1, 0.5) * time)) / 2
    root = rng.normal(size=(1, 3)) * [20, 0, 20] + time[:, None] * rng.normal(size=(1, 3)) * [0.7, 0, 0.7]
    root[:, 1] = skeleton.rest_offset[0, 1] - crouched + case.settings.floor
    return Pose(skeleton, root, rotation)


def observation_of(case: Case) -> Observation:
    """Return what the device tracks: with noise, and sensors that come and go."""
    rng = np.random.default_rng(case.seed + 1)
    sensors = observed_set(random_edges(1, rng)[0].more) if case.device == "lattice" else SETS[case.device]
    time = 100 + np.cumsum(rng.uniform(0.8, 1.2, case.frames)) / case.rate
    seen = observe(
        motion(case), time + np.where(case.gap & (np.arange(case.frames) > case.frames // 2), 1.5, 0), sensors
    )
    lost = np.cumsum(rng.random(seen.has_position.shape) < case.loss, axis=0) % 2 == 1
    head = [k for k, name in enumerate(seen.points) if name == "head"]
    lost[:, head] &= (np.arange(case.frames) % 10 < 3)[:, None]
    return replace(
        seen,
        position=seen.position + rng.normal(size=seen.position.shape) * case.noise,
        has_position=seen.has_position & ~lost,
        has_rotation=seen.has_rotation & ~(lost & (rng.random(lost.shape[1]) < 0.7)),
        accuracy=rng.uniform(0.0005, 0.02, seen.accuracy.shape),
    )


def person_of(case: Case) -> Person:
    """Return the person as far as known."""
    match case.known:
        case "proportions":
            return Person(case.skeleton)
        case "height":
            return Person(height=float(stature(case.skeleton.rest_offset)))
        case "lengths":
            return Person(lengths={("left_elbow", "left_wrist"): 0.26, ("left_hip", "left_knee"): 0.41})
        case _:
            return Person()
