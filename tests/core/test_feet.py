"""Feet: on the floor while the body bows or kneels, never under it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import SensorSet
from bodysense_lab.completion.score.rare_poses import rare_pose

from .scripted import body_of, bowing, feet, over_rest, tracked

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
    pose = rare_pose(body_of(height), name)
    points = tracked(pose, THREE_AND_KNEES if knees else "three_point").points
    assert feet(pose.skeleton, points)[..., 1].min() > -1e-4


@pytest.mark.parametrize("height", HEIGHTS)
def test_shins_of_knees_on_the_floor_are_on_the_floor(height: float) -> None:
    pose = rare_pose(body_of(height), "kneeling_on_both")
    skeleton, points = pose.skeleton, tracked(pose, THREE_AND_KNEES).points
    knees = np.asarray(forward_kinematics(pose)[0])[:, skeleton.indices(["left_knee", "right_knee"]), 1].max(axis=1)
    low = feet(skeleton, points)[..., 1].reshape(-1, 3, 2).min(axis=1)[knees < 0.1]
    assert len(low) > 30 and low[10:].max() < 0.05
