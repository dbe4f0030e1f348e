"""Feet: on the floor while the body bows or kneels, never under it; they step or stand, and do not glide."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from people.posed import scripted_pose

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import SensorSet

from .scripted import RATE, body_of, bowing, carried, feet, over_rest, tracked

THREE = ("head", "left_wrist", "right_wrist")
THREE_AND_KNEES = SensorSet((*THREE, "left_knee", "right_knee"), THREE)
HEIGHTS = (1.55, 1.7, 1.85)


@pytest.mark.parametrize("height", HEIGHTS)
def test_feet_of_a_bowing_body_stay_on_the_floor(height: float) -> None:
    pose = bowing(body_of(height), 95)
    high = over_rest(pose.skeleton, tracked(pose, "three_point").points).min(axis=1)
    assert high.max() < 0.05 and (high > 0.03).mean() < 0.1


@given(
    name=st.sampled_from(("kneeling_on_one", "kneeling_on_both", "lunge", "crouch", "plank")),
    height=st.floats(1.5, 1.95),
    knees=st.booleans(),
)
@settings(max_examples=12, derandomize=True)
def test_no_foot_is_under_the_floor(name: str, height: float, knees: bool) -> None:
    pose = scripted_pose(body_of(height), name)
    points = tracked(pose, THREE_AND_KNEES if knees else "three_point").points
    assert feet(pose.skeleton, points)[..., 1].min() > -1e-4


@pytest.mark.parametrize("height", HEIGHTS)
def test_shins_of_knees_on_the_floor_are_on_the_floor(height: float) -> None:
    pose = scripted_pose(body_of(height), "kneeling_on_both")
    skeleton, points = pose.skeleton, tracked(pose, THREE_AND_KNEES).points
    knees = np.asarray(forward_kinematics(pose)[0])[:, skeleton.indices(["left_knee", "right_knee"]), 1].max(axis=1)
    low = feet(skeleton, points)[..., 1].reshape(-1, 3, 2).min(axis=1)[knees < 0.1]
    assert len(low) > 30 and low[10:].max() < 0.05


def _motion(seconds: float, most: float) -> np.ndarray:
    """From 0 to `most` between 2 s and the end, at every frame."""
    return most * np.clip((np.arange(round((seconds + 3) * RATE)) / RATE - 2) / seconds, 0, 1)


@pytest.mark.parametrize("device", ["three_point", "head"])
@pytest.mark.parametrize("height", HEIGHTS)
@pytest.mark.parametrize(("degrees", "aside"), [(180.0, 0.0), (-180.0, 0.0), (0.0, 0.5)])
def test_feet_of_a_body_that_is_carried_off_step(height: float, device: str, degrees: float, aside: float) -> None:
    pose = carried(body_of(height), _motion(5.0, degrees), _motion(5.0, aside))
    points = feet(pose.skeleton, tracked(pose, device).points)
    balls, rest = points[:, 2:4], np.asarray(forward_kinematics(pose)[0])[0, pose.skeleton.index("left_foot"), 1]
    speed = np.linalg.norm(np.diff(balls[..., [0, 2]], axis=0), axis=-1) * RATE
    low = balls[..., 1] < rest + 0.015
    glides = (speed > 0.1) & low[1:] & low[:-1]
    assert glides[60:210].any(axis=1).mean() < 0.08
    raised = np.diff((balls[30:, :, 1] > rest + 0.02).astype(int), axis=0) > 0
    assert raised.any()
    assert np.abs(speed).max() < 2.0


@given(
    height=st.floats(1.5, 1.95),
    sway=st.floats(0.0, 0.03),
    period=st.floats(1.5, 6.0),
    device=st.sampled_from(("three_point", "head")),
)
@settings(max_examples=10, derandomize=True)
def test_a_person_who_sways_does_not_step(height: float, sway: float, period: float, device: str) -> None:
    time = np.arange(240) / RATE
    pose = carried(body_of(height), 0 * time, sway * np.sin(2 * np.pi * time / period) * np.minimum(time / 2, 1))
    ankles = feet(pose.skeleton, tracked(pose, device).points)[60:, :2]
    assert np.linalg.norm(ankles - ankles[0], axis=-1).max() < 0.08
