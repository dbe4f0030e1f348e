"""Properties of scripted scenes that hold for every draw: feet, floor, joints, balance, speeds, steps and phases."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.shape import SHORTEST, TALLEST, stature
from bodysense.body.skeleton import BODY
from bodysense.geometry.rotation import quaternion_log
from bodysense_lab.completion.score.sight.sight import backward_knees, knee_flexion
from bodysense_lab.synthesis.scenes import KINDS, ScriptedScene, sequence

RATE, FRAMES = 30.0, 300
SIDES = ("left", "right")
SEEDS = (0, 1, 2)
each = pytest.mark.parametrize("kind", KINDS)
# Largest rotation of a joint relative to its parent, degrees. Hips and shoulders turn about three axes.
LIMITS = {"hip": 160, "knee": 155, "ankle": 80, "foot": 80, "spine1": 25, "spine2": 25, "spine3": 25, "neck": 40,
          "head": 50, "collar": 30, "shoulder": 175, "elbow": 150, "wrist": 120}  # fmt: skip


class Case:
    """A scene and its positions."""

    def __init__(self, kind: str, seed: int) -> None:
        self.motion: ScriptedScene = sequence(np.random.default_rng([seed, 77]), FRAMES, RATE, kind=kind, margin=0.0)
        self.position = np.asarray(forward_kinematics(self.motion.pose)[0])

    def points(self, *names: str) -> np.ndarray:
        """Return the positions (T, N, 3) m of points."""
        return self.position[:, self.motion.skeleton.indices(names)]

    def pair(self, name: str) -> np.ndarray:
        """Return the positions (T, 2, 3) m of a point of both sides."""
        return self.points(*(f"{side}_{name}" for side in SIDES))

    @property
    def still(self) -> np.ndarray:
        """Frames (T,), bool, in which both feet are planted and the pelvis is slow."""
        speed = np.linalg.norm(np.gradient(self.position[:, 0], axis=0), axis=-1) * RATE
        return self.motion.planted.all(axis=1) & (speed < 0.1)


@cache
def cases(kind: str) -> tuple[Case, ...]:
    return tuple(Case(kind, seed) for seed in SEEDS)


@each
def test_planted_feet_do_not_slide_and_nothing_is_below_the_floor(kind: str) -> None:
    for case in cases(kind):
        planted = case.motion.planted[1:] & case.motion.planted[:-1]
        moved = np.linalg.norm(np.diff(case.pair("foot"), axis=0), axis=-1)
        assert planted.any() and moved[planted].max() < 1e-3  # m a frame
        assert case.position[..., 1].min() > 0.0


@each
def test_joints_stay_within_human_limits_and_no_hinge_bends_backward(kind: str) -> None:
    for case in cases(kind):
        rotation = np.asarray(case.motion.pose.rotation)[:, : len(BODY)]
        angle = np.degrees(np.linalg.norm(np.asarray(quaternion_log(rotation)), axis=-1)).max(axis=0)
        for name, most in zip(BODY[1:], angle[1:], strict=True):
            assert most < LIMITS[name.rpartition("_")[2]], name
        ankles = rotation[:, [BODY.index(f"{side}_ankle") for side in SIDES]]
        flexed = np.degrees(2 * np.arctan2(ankles[..., 1] * np.sign(ankles[..., 0]), np.abs(ankles[..., 0])))
        assert flexed[case.motion.planted].min() > -50 and flexed[case.motion.planted].max() < 55
        knees = rotation[:, [BODY.index(f"{side}_knee") for side in SIDES]]
        assert not backward_knees(knees).any()
        assert np.degrees(2 * np.abs(knees[..., 2:])).max() < 0.5  # hinges: they turn about one axis alone


@each
def test_accelerations_are_those_of_people(kind: str) -> None:
    for case in cases(kind):
        size = np.linalg.norm(np.diff(case.position[:, : len(BODY)], 2, axis=0), axis=-1) * RATE**2
        assert size[:, BODY.index("head")].max() < 20  # m/s²
        assert size[:, BODY.index("pelvis")].max() < 25
        assert size.max() < 120


@each
def test_who_stands_still_is_balanced_on_straight_legs(kind: str) -> None:
    for case in cases(kind):
        upright = case.still & case.motion.in_phase("standing")
        if not upright.any() or kind in ("lean_on_wall", "lean_on_a_table"):
            continue
        weight = 0.55 * case.points("spine1")[:, 0] + 0.45 * case.points("spine3")[:, 0]
        feet = np.concatenate([case.pair("ankle"), case.pair("toe")], axis=1)
        low, high = (edge(feet, axis=1) - shift for edge, shift in ((np.min, 0.06), (np.max, -0.06)))
        inside = ((weight > low) & (weight < high))[:, [0, 2]].all(axis=1)
        assert inside[upright].mean() > 0.95
        bent = knee_flexion(case.pair("hip"), case.pair("knee"), case.pair("ankle")).min(axis=1)
        assert np.median(bent[upright]) < 10 or kind == "foot_forward"  # degrees, of the straighter leg


@each
def test_feet_are_where_the_steps_say(kind: str) -> None:
    """Every move of a foot by more than 3 cm is a step or a raised leg."""
    for case in cases(kind):
        ball = case.pair("foot")
        for side in range(2):
            standing = np.flatnonzero(case.motion.planted[:, side])
            for first, second in pairwise(standing):
                apart = np.linalg.norm(ball[second, side] - ball[first, side])
                stepped = any(
                    one.side == side and one.begin * RATE < second and one.end * RATE > first
                    for one in case.motion.steps
                )
                assert apart < 0.03 or stepped


def test_phases_look_like_their_names() -> None:
    heights: dict[str, list[float]] = {name: [] for name in ("standing", "bowing", "kneeling", "seated")}
    for kind in ("stand", "bow", "kneel_on_one", "kneel_on_both", "sit", "at_a_table"):
        for case in cases(kind):
            rest = case.motion.rest_offset[0, 1]
            for name, found in heights.items():
                frames = case.motion.in_phase(name)  # type: ignore[arg-type]
                if frames.any():
                    found.append(float(case.position[frames, 0, 1].mean() / rest))
                if frames.any() and name == "kneeling":
                    knees = case.pair("knee")[frames][..., 1].min(axis=1)
                    assert np.quantile(knees, 0.9) < 0.08  # m over the floor
                if frames.any() and name == "bowing":
                    trunk = case.points("neck")[frames, 0] - case.points("pelvis")[frames, 0]
                    lean = np.degrees(np.arctan2(np.hypot(trunk[:, 0], trunk[:, 2]), trunk[:, 1]))
                    assert lean.mean() > 25
    assert min(heights["standing"]) > 0.93 and min(heights["bowing"]) > 0.85
    assert max(heights["kneeling"]) < 0.7 and max(heights["seated"]) < 0.8


def test_turns_are_as_fast_as_they_should_be() -> None:
    fastest = []
    for seed in range(12):
        yaw = Case("turn", seed).points("left_hip", "right_hip")
        across = yaw[:, 0] - yaw[:, 1]
        angle = np.unwrap(np.arctan2(across[:, 0], across[:, 2]))
        fastest.append(np.degrees(np.abs(np.gradient(angle))).max() * RATE)
    assert min(fastest) > 15 and 120 < max(fastest) < 400 and len({round(one) for one in fastest}) > 8


def test_a_scene_is_made_of_its_generator_alone_and_has_the_wanted_body() -> None:
    one, other = (sequence(np.random.default_rng(5), 60, RATE) for _ in range(2))
    assert np.array_equal(one.rotation, other.rotation) and np.array_equal(one.root, other.root)
    assert not np.array_equal(one.root, sequence(np.random.default_rng(6), 60, RATE).root)
    assert np.array_equal(sequence(np.random.default_rng(7), 30, RATE, rest_offset=one.rest_offset).rest_offset,
                          one.rest_offset)  # fmt: skip
    tall = [float(stature(sequence(np.random.default_rng(k), 2, RATE).rest_offset)) for k in range(40)]
    assert SHORTEST <= min(tall) < 1.62 and 1.78 < max(tall) <= TALLEST


@pytest.mark.parametrize("rate", [10.0, 72.0, 144.0])
def test_a_rate_changes_the_frames_and_not_the_motion(rate: float) -> None:
    """The scene of a generator is one motion in time: at other rates the body is in the same places."""
    slow = sequence(np.random.default_rng(11), 60, 10.0, kind="step_aside")
    fast = sequence(np.random.default_rng(11), round(6 * rate), rate, kind="step_aside")
    same = np.arange(60) * round(rate / 10) if rate >= 72 and rate % 10 == 0 else None
    feet = np.asarray(forward_kinematics(fast.pose)[0])
    assert np.isfinite(feet).all() and len(fast) == round(6 * rate)
    assert [one.side for one in fast.steps] == [one.side for one in slow.steps]
    assert same is None or np.allclose(fast.root[same], slow.root, atol=0.02)
