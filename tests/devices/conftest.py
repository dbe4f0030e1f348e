"""People in front of a camera, and the device that observes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, SIDES
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.arms import ArmModel, Arms, ArmSettings
from bodysense.devices.video.device import POINTS, VideoDevice, VideoFrames, VideoSettings
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense.weights.network import Network

SKELETON = default_skeleton()
PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")
MARKS = [BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES for part in PARTS]
PLACES = SKELETON.indices([f"{side}_{part}" for side in SIDES for part in PARTS])
TILT = np.radians(12.0)
FIELDS = ("position", "rotation", "has_position", "has_rotation", "accuracy", "time")


class UntrainedArms:
    """A network of arms with random weights; a frame's rotations depend on its key-points only."""

    def __init__(self) -> None:
        self.card = {"joints": ARM_JOINTS, "frames": 32, "rate": 30, "validation": {"overall_m": 0.05, "hands_m": 0.02}}
        self.weight = np.random.default_rng(0).normal(scale=0.3, size=(100, 3 * len(ARM_JOINTS)))

    def run(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        frames = np.concatenate([inputs[name].reshape(32, -1) for name in ("arm", "torso", "hand")], axis=1)
        turn = 0.3 * np.tanh(frames @ self.weight)
        return {"rotation": np.asarray(quaternion_exp(turn.reshape(1, 32, -1, 3)))}


@pytest.fixture(scope="session")
def untrained_arms() -> ArmModel:
    return ArmModel(cast(Network, UntrainedArms()))


@pytest.fixture(scope="session")
def make_device(untrained_arms: ArmModel) -> Any:
    def make(look_ahead: float = 0.0, tilt: float | None = None) -> VideoDevice:
        arms = Arms(SKELETON, untrained_arms, ArmSettings(look_ahead=look_ahead))
        return VideoDevice(SKELETON, arms, 16 / 9, VideoSettings(look_ahead=look_ahead, tilt=tilt))

    return make


def walking(frames: int = 45) -> Pose:
    """Return a standing person who waves and drifts to their left and toward the camera."""
    pose, time = standing_pose(SKELETON), np.arange(frames) / 30
    rotation = np.tile(pose.rotation, (frames, 1, 1))
    elbow = SKELETON.index("left_elbow")
    wave = quaternion_exp(np.stack([0 * time, -0.6 + 0.5 * np.sin(6 * time), 0 * time], axis=-1))
    rotation[:, elbow] = quaternion_multiply(rotation[:, elbow], wave)
    root = pose.root_position + np.stack([0.3 * time, 0 * time, 0.4 * time], axis=-1)
    return Pose(SKELETON, root, rotation)


def seen_by(pose: Pose, focal: float, tilt: float = TILT, noise: float = 0.0) -> PersonLandmarks:
    """Return exact landmarks of bodies, seen whole by a camera 1.4 m over the floor, tilted by `tilt` rad."""
    position = np.asarray(forward_kinematics(pose)[0])
    cosine, sine = np.cos(tilt), np.sin(tilt)
    axes = np.array([[1.0, 0, 0], [0, cosine, sine], [0, -sine, cosine]])  # room ← camera
    local = (position - [0.0, 1.4, 4.6]) @ axes
    count = len(position)
    world = np.tile(local[:, SKELETON.index("head")][:, None], (1, len(BODY_LANDMARKS), 1))
    world[:, BODY_LANDMARKS.index("nose")] += np.array([0.0, 0.0, 0.1]) @ axes
    for sign, side in zip((1, -1), SIDES, strict=True):
        world[:, BODY_LANDMARKS.index(f"{side}_ear"), 0] += 0.07 * sign
    world[:, MARKS] = local[:, PLACES]
    world += np.random.default_rng(0).normal(0, noise, world.shape) if noise else 0
    picture = focal * world[..., :2] / -world[..., 2:]
    hips = world[:, [BODY_LANDMARKS.index(f"{side}_hip") for side in SIDES]].mean(axis=1)
    return PersonLandmarks(
        time=np.arange(count) / 30,
        world=world - hips[:, None],
        picture=picture,
        visible=np.ones(world.shape[:2]),
        has_body=np.ones(count, dtype=bool),
        hand=np.full((count, 2, 21, 2), np.nan),
        hand_world=np.full((count, 2, 21, 3), np.nan),
        has_hand=np.zeros((count, 2), dtype=bool),
    )


def observed(device: VideoDevice, person: PersonLandmarks, block: int) -> list[VideoFrames]:
    state, parts = device.start(), []
    for start in range(0, len(person), block):
        frames, state = device.step(person[start : start + block], state)
        parts.append(frames)
    return [*parts, device.finish(state)]


def together(parts: list[VideoFrames]) -> Observation:
    joined = {name: np.concatenate([getattr(part.observation, name) for part in parts]) for name in FIELDS}
    return check_observation(Observation(points=POINTS, **joined))
