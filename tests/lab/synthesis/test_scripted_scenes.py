"""Properties of scripted scenes that hold for every draw: feet, floor, joints, balance, accelerations."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense_lab.synthesis.scenes import KINDS, ScriptedScene, sequence

RATE = 30.0
FEET = ("left_foot", "right_foot")


def scene(kind: str, seed: int) -> ScriptedScene:
    return sequence(np.random.default_rng([seed, 77]), 300, RATE, kind=kind, margin=0.0)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", KINDS)
def test_planted_feet_do_not_slide_and_nothing_is_below_the_floor(kind: str, seed: int) -> None:
    motion = scene(kind, seed)
    position = np.asarray(forward_kinematics(motion.pose)[0])
    ball = position[:, motion.skeleton.indices(FEET)]
    planted = motion.planted[1:] & motion.planted[:-1]
    moved = np.linalg.norm(np.diff(ball, axis=0), axis=-1)
    assert planted.any()
    assert moved[planted].max() < 1e-3
    assert position[..., 1].min() > 0.0


def test_a_scene_is_made_of_its_generator_alone() -> None:
    one, other = (sequence(np.random.default_rng(5), 60, RATE) for _ in range(2))
    assert np.array_equal(one.rotation, other.rotation) and np.array_equal(one.root, other.root)
    assert not np.array_equal(one.root, sequence(np.random.default_rng(6), 60, RATE).root)
