"""A body that its hands carry: both hands are reached, feet do not sink, and it faces ahead of its hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.carried import Carried, CarriedSettings
from bodysense.observation import Observation

WRISTS = ("left_wrist", "right_wrist")


def hands_at(position: np.ndarray, rotation: np.ndarray, rate: float = 60.0) -> Observation:
    """Both wrists (T, 2, 3), (T, 2, 4), NaN where hidden."""
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    accuracy, time = np.full(seen.shape, 0.001), np.arange(len(position)) / rate
    return Observation(WRISTS, position, rotation, seen, seen, accuracy, time)


def held_before(place: np.ndarray, yaw: float = 0.0, apart: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Hands (2, 3), (2, 4) side by side about a place (3,), fingers ahead, of somebody who faces `yaw` about +Y."""
    turn = quaternion_exp(np.array([0.0, yaw, 0.0]))
    left = quaternion_exp(np.array([0.0, -np.pi / 2, 0.0]))  # a left hand's fingers point to +X at rest
    right = quaternion_exp(np.array([0.0, np.pi / 2, 0.0]))
    across = np.array([np.cos(yaw), 0.0, -np.sin(yaw)]) * apart / 2
    return np.stack([place + across, place - across]), quaternion_multiply(turn, np.stack([left, right]))


@given(
    yaw=st.floats(-3.0, 3.0),
    height=st.floats(0.2, 2.2),
    x=st.floats(-5, 5),
    apart=st.floats(0.0, 0.8),
    scale=st.floats(1.4, 2.0),
)
@settings(max_examples=12, deadline=None)
def test_hands_are_reached_and_faced(yaw: float, height: float, x: float, apart: float, scale: float) -> None:
    body = Carried(default_skeleton().scaled(scale))
    place, turn = held_before(np.array([x, height, 1.0]), yaw, apart)
    estimate, _ = body.step(hands_at(place[None], turn[None]), body.start())
    assert estimate.pose is not None
    position, world = forward_kinematics(estimate.pose)
    wrists = body.skeleton.indices(WRISTS)
    np.testing.assert_allclose(position[0, wrists], place, atol=2e-3)
    assert geodesic_angle(world[0, wrists], turn).max() < 1e-6
    np.testing.assert_allclose(estimate.position, position, atol=1e-9)
    hips = position[0, body.skeleton.indices(["left_hip", "right_hip"])]
    facing = np.cross(hips[0] - hips[1], [0.0, 1.0, 0.0])
    assert facing @ [np.sin(yaw), 0, np.cos(yaw)] > 0.999 * np.linalg.norm(facing)
    assert position[0, :, 1].min() > -0.25  # only what is bent to reach the floor may be under it


def test_it_stands_until_it_must_move() -> None:
    body = Carried(default_skeleton())
    standing = forward_kinematics(standing_pose(body.skeleton))[0]
    place, turn = held_before(np.array([0.0, 1.1, 0.0]))
    estimate, _ = body.step(hands_at(place[None], turn[None]), body.start())
    legs = body.skeleton.indices(["left_ankle", "right_ankle", "pelvis", "head"])
    np.testing.assert_allclose(
        estimate.position[0, legs, 1] - estimate.position[0, :, 1].min(),
        standing[legs, 1] - standing[:, 1].min(),
        atol=1e-3,
    )


def test_nothing_jumps() -> None:
    """Hands that turn and travel: no point of the body moves faster than hands and heading make it."""
    t = np.arange(240) / 60
    body = Carried(default_skeleton())
    rows = [held_before(np.array([0.5 * np.sin(s), 1.0 + 0.5 * np.sin(2 * s), 0.3 * s]), 0.8 * s) for s in t]
    place, turn = (np.stack(values) for values in zip(*rows, strict=True))
    estimate, _ = body.step(hands_at(place, turn), body.start())
    step = np.linalg.norm(np.diff(estimate.position, axis=0), axis=-1)
    assert step.max() < 0.06  # 3.6 m/s at 60 Hz


def test_hidden_hands_stay_with_the_body() -> None:
    place, turn = held_before(np.array([0.0, 1.1, 0.0]))
    position, rotation = np.stack([place] * 10), np.stack([turn] * 10)
    position[4:, 1], rotation[4:, 1] = np.nan, np.nan
    position[7:], rotation[7:] = np.nan, np.nan
    body = Carried(default_skeleton())
    estimate, _ = body.step(hands_at(position, rotation), body.start())
    np.testing.assert_allclose(estimate.position[-1], estimate.position[0], atol=0.02)
    assert np.isfinite(estimate.position).all()
    assert (estimate.occluded[7:] == 1).all()


def test_nothing_seen_yet_and_gaps() -> None:
    body = Carried(default_skeleton())
    nothing = np.full((2, 2, 3), np.nan), np.full((2, 2, 4), np.nan)
    estimate, state = body.step(hands_at(*nothing), body.start())
    standing = forward_kinematics(standing_pose(body.skeleton))[0]
    height = estimate.position[..., 1] - estimate.position[..., 1].min(axis=1, keepdims=True)
    np.testing.assert_allclose(height[0], standing[:, 1] - standing[:, 1].min(), atol=1e-9)
    place, turn = held_before(np.array([3.0, 1.1, 0.0]))
    seen = hands_at(place[None], turn[None])
    late = replace(seen, time=np.array([5.0]))
    fresh, _ = body.step(late, body.start())
    after, state = body.step(late, state)
    np.testing.assert_array_equal(after.position, fresh.position)
    with pytest.raises(BodysenseError, match="give frames in order of time"):
        body.step(late, state)
    with pytest.raises(BodysenseError, match="reach is 0; it must be positive"):
        CarriedSettings(reach=0.0)
