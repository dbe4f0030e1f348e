"""Feet of a body whose network predicts one pose: they come to the floor, unless the body jumps."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY, Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_to_matrix
from bodysense.observing.observation import Observation
from bodysense.tracking.core import Model
from bodysense.tracking.model import CompletionModel, packaged_model
from bodysense.tracking.tracker import Tracker, TrackerSettings

RATE = 30
BODIES = [default_skeleton().with_offsets(offset) for offset in sample_bodies("test", 4)]
CURLED = {"pelvis": -20.0, "spine2": 40.0, "neck": -20.0, "left_hip": 20.0, "right_hip": 20.0}  # degrees about x


def bent_legs(hip: float, knee: float, ankle: float) -> dict[str, float]:
    """Return rotations of both legs about x, degrees."""
    parts = {"hip": hip, "knee": knee, "ankle": ankle}
    return {f"{side}_{part}": angle for side in ("left", "right") for part, angle in parts.items()}


def network(skeleton: Skeleton, degrees: dict[str, float], contact: float) -> CompletionModel:
    """A network that always predicts a standing pose with some joints turned about x, and one logit of contact."""
    pose = standing_pose(skeleton)
    rotation = np.array(pose.rotation)
    for name, angle in degrees.items():
        joint = skeleton.index(name)
        rotation[joint] = quaternion_multiply(rotation[joint], quaternion_exp(np.radians([angle, 0.0, 0.0])))
    world = quaternion_to_matrix(np.asarray(forward_kinematics(replace(pose, rotation=rotation))[1]))
    source = packaged_model().source
    data = bytearray(source.read_bytes())
    first = 8 + int.from_bytes(data[:8], "little")
    table = json.loads(data[8:first])
    for name, values in {
        "body.turn_branch.2.weight": 0.0,
        "body.turn_branch.2.bias": 0.0,
        "body.standing": world[: len(BODY), :, :2].reshape(len(BODY), 6),
        "body.judge_branch.2.weight.step": 0.0,
        "body.judge_branch.2.bias": np.where(np.arange(29) < 4, contact, 0.0),
    }.items():
        kind = {"F16": np.float16, "F32": np.float32}[table[name]["dtype"]]
        begin, end = (first + k for k in table[name]["data_offsets"])
        data[begin:end] = np.broadcast_to(values, table[name]["shape"]).astype(kind).tobytes()
    return CompletionModel(Model(bytes(data), "constant"), {}, source)


def balls(skeleton: Skeleton, predicts: CompletionModel, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights (T, 2) m of the balls of the feet over rest, as predicted and as output; `head` (T,) is relative to rest.

    Only the head is tracked, which looks ahead.
    """
    rest = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[:, 1]
    position = np.zeros((len(head), 1, 3))
    position[:, 0, 1] = head * rest[skeleton.index("head")]
    rotation, seen = np.tile([1.0, 0.0, 0.0, 0.0], (len(head), 1, 1)), np.ones((len(head), 1), dtype=bool)
    time, feet = np.arange(len(head)) / RATE, skeleton.indices(["left_foot", "right_foot"])
    observation = Observation(("head",), position, rotation, seen, seen, np.full(seen.shape, 1e-3), time)
    free, held = (
        (tracker := Tracker(Person(skeleton), predicts, TrackerSettings(hold_feet=hold))).step(
            observation, tracker.start()
        )[0]
        for hold in (False, True)
    )
    return free.points[:, feet, 1] - rest[feet], held.points[:, feet, 1] - rest[feet]


@pytest.mark.parametrize("skeleton", BODIES)
def test_a_standing_body_does_not_hover(skeleton: Skeleton) -> None:
    """Legs that are predicted bent, without a sign of contact, are straightened down to the floor."""
    free, held = balls(skeleton, network(skeleton, bent_legs(-30, 60, -30), -9.0), np.ones(2 * RATE))
    assert free[-1].min() > 0.1 and held[-1].max() < 0.025 and held[-1].min() > -1e-3


@pytest.mark.parametrize("skeleton", BODIES)
def test_feet_of_a_jumping_body_stay_in_the_air(skeleton: Skeleton) -> None:
    """The head rises at 1.2 m/s from a crouch to 20 % over its standing height, with the legs tucked."""
    head = np.r_[np.full(10, 0.7), np.linspace(0.7, 1.2, 20)]
    free, held = balls(skeleton, network(skeleton, bent_legs(-90, 120, -30), -9.0), head)
    high = free.min(axis=-1) > 0.02
    assert high.sum() >= 15 and free.max() > 0.5
    assert np.abs(held - free)[high].max() < 0.01


@pytest.mark.parametrize("skeleton", BODIES)
def test_a_pelvis_is_lowered_if_straight_legs_do_not_reach_the_floor(skeleton: Skeleton) -> None:
    """A curled prediction of the spine lifts pelvis and straight legs; the spine is straightened."""
    free, held = balls(skeleton, network(skeleton, CURLED, 9.0), np.ones(2 * RATE))
    assert free[-1].min() > 0.04 and held[-1].max() < 0.03
