"""Gloves on a body: wrists and fingers are the gloves', the rest is the body's, and nothing jumps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hand import FINGERTIPS, HAND_JOINTS, hand_skeleton
from bodysense.body.pose import forward_kinematics
from bodysense.body.rotation import geodesic_angle
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.errors import BodysenseError
from bodysense.estimators.carried import Carried
from bodysense.estimators.estimate import Estimator, PointEstimate
from bodysense.estimators.gloved import Gloved, GlovedSettings
from bodysense.estimators.gloves.hands import GloveModels, Hands
from bodysense.estimators.hold import Hold
from bodysense.estimators.ik_tracker import IkTracked, IkTracker
from bodysense.estimators.three_point import ThreePoint
from bodysense.estimators.three_point_answers import load_three_point
from bodysense.observation import Observation, chosen_points
from bodysense.occlusion import glove, headset_camera, three_point
from bodysense.occlusion.dropout import hide

SIDES = ("left", "right")


@pytest.fixture(scope="session")
def clip(waving_clip: Clip) -> Clip:
    """A second at 60 Hz."""
    clip = resample(waving_clip, 60.0)
    return replace(clip, pose=clip.pose[:60])


@pytest.fixture(scope="session")
def gloves(clip: Clip) -> Observation:
    return glove.observe(clip.pose, clip.time)


def make_hands(models: GloveModels, *sides: str) -> Hands:
    skeleton = default_skeleton()
    return Hands({side: hand_skeleton(skeleton, side) for side in sides or SIDES}, models)  # type: ignore[arg-type]


def together(one: Observation, other: Observation) -> Observation:
    """Two observations of the same moments as one."""
    joined = {
        name: np.concatenate([getattr(one, name), getattr(other, name)], axis=1)
        for name in ("position", "rotation", "has_position", "has_rotation", "accuracy")
    }
    return Observation(points=(*one.points, *other.points), time=one.time, **joined)


def place_of(skeleton: Skeleton, position: np.ndarray, side: str) -> np.ndarray:
    """(T, 21, 3) m: the points of a hand."""
    return position[:, skeleton.indices([f"{side}_{name}" for name in (*HAND_JOINTS, *FINGERTIPS)])]


def check_hands(estimator: Gloved, seen: Observation, metres: float, degrees: float = 0.5) -> None:
    """After the tracker wrists are where the gloves say, and fingers as they say."""
    answers, _ = estimator.hands.step(seen, estimator.hands.start())
    pose, estimate, _ = IkTracker(estimator).step(seen, IkTracker(estimator).start())
    skeleton, position = estimator.skeleton, np.asarray(forward_kinematics(pose)[0])
    for side, answer in answers.items():
        assert answer.pose is not None
        np.testing.assert_allclose(place_of(skeleton, estimate.position, side), answer.position, atol=1e-9)
        np.testing.assert_allclose(place_of(skeleton, position, side), answer.position, atol=metres)
        fingers = skeleton.indices([f"{side}_{name}" for name in HAND_JOINTS[1:]])
        assert np.degrees(geodesic_angle(pose.rotation[:, fingers], answer.pose.rotation[:, 1:])).max() < degrees


def test_gloves_alone(small_models: GloveModels, gloves: Observation) -> None:
    check_hands(Gloved(make_hands(small_models), Carried(default_skeleton())), gloves, 1e-4)


@pytest.mark.parametrize("side", SIDES)
def test_one_glove(small_models: GloveModels, gloves: Observation, side: str) -> None:
    one = chosen_points(gloves, [k for k, name in enumerate(gloves.points) if name.startswith(side)])
    check_hands(Gloved(make_hands(small_models, side), Carried(default_skeleton())), one, 1e-4)


def test_gloves_and_a_headset(
    small_models: GloveModels, small_three_point: Path, clip: Clip, gloves: Observation
) -> None:
    """The network was never trained: its body may stand out of reach, and the hands are right all the same."""
    head = three_point.observe(clip.pose, clip.time, three_point.HEAD_ONLY)
    body = ThreePoint(default_skeleton(), load_three_point(small_three_point))
    check_hands(Gloved(make_hands(small_models), body), together(head, gloves), 0.01, 4.0)


def test_the_body_is_told_of_the_wrists(
    small_models: GloveModels, small_three_point: Path, clip: Clip, gloves: Observation
) -> None:
    body = ThreePoint(default_skeleton(), load_three_point(small_three_point))
    head = three_point.observe(clip.pose, clip.time, three_point.HEAD_ONLY)
    hands = make_hands(small_models)
    estimate, _ = Gloved(hands, body).step(together(head, gloves), Gloved(hands, body).start())
    answers, _ = hands.step(gloves, hands.start())
    told = three_point.observe(clip.pose, clip.time)
    for side, answer in answers.items():
        assert answer.pose is not None
        point = told.points.index(f"{side}_wrist")
        told.position[:, point], told.rotation[:, point] = answer.position[:, 0], answer.pose.rotation[:, 0]
    alone, _ = body.step(told, body.start())
    legs = default_skeleton().indices(["left_knee", "right_ankle", "pelvis", "head"])
    np.testing.assert_allclose(estimate.position[:, legs], alone.position[:, legs], atol=1e-6)


def test_gloves_and_a_headset_s_cameras(small_models: GloveModels, clip: Clip, gloves: Observation) -> None:
    seen = together(headset_camera.observe(clip.pose, clip.time), gloves)
    body = IkTracked(IkTracker(Hold(default_skeleton())))
    check_hands(Gloved(make_hands(small_models), body), seen[:20], 0.01)


def test_one_call_equals_many(small_models: GloveModels, gloves: Observation) -> None:
    hidden = np.random.default_rng(0).random(gloves.has_position.shape) < 0.3
    hidden[20:50, :9] = True
    seen = hide(gloves, hidden)
    estimator = Gloved(make_hands(small_models), Carried(default_skeleton()))
    whole, _ = estimator.step(seen, estimator.start())
    state, places = estimator.start(), []
    for t in range(len(seen)):
        one, state = estimator.step(seen[t : t + 1], state)
        places.append(one.position)
    np.testing.assert_allclose(np.concatenate(places), whole.position, atol=1e-12)
    assert np.isfinite(whole.position).all() and np.isfinite(whole.confidence).all()


class Still:
    """A body that stands where it is told, and knows nothing of hands."""

    def __init__(self, clip: Clip) -> None:
        self.skeleton, self.pose = clip.pose.skeleton, clip.pose

    def start(self) -> int:
        return 0

    def step(self, observation: Observation, state: int) -> tuple[PointEstimate, int]:
        frames = slice(state, state + len(observation))
        pose = self.pose[frames]
        position = np.asarray(forward_kinematics(pose)[0])
        guess = np.ones(position.shape[:-1])
        return PointEstimate(self.skeleton, position, guess, 0.1 * guess, pose), frames.stop


def test_a_lost_hand_passes_to_the_body_without_a_jump(small_models: GloveModels, clip: Clip) -> None:
    clip = resample(replace(clip, pose=clip.pose[::6]), 60.0)  # a slower second
    standing = replace(clip, pose=clip.pose[np.zeros(240, dtype=int)])
    moved = replace(clip.pose, root_position=clip.pose.root_position + np.array([0.1, 0.0, 0.0]))
    seen = glove.observe(moved[np.zeros(240, dtype=int)], standing.time)
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    hidden[30:180, :9] = True
    estimator = Gloved(make_hands(small_models), Still(standing))
    estimate, _ = estimator.step(hide(seen, hidden), estimator.start())
    wrist = estimate.position[:, estimator.skeleton.index("left_wrist")]
    own = np.asarray(forward_kinematics(standing.pose)[0])[0, estimator.skeleton.index("left_wrist")]
    glove_has, _ = estimator.hands.step(seen, estimator.hands.start())
    np.testing.assert_allclose(wrist[:30], glove_has["left"].position[:30, 0], atol=1e-9)
    np.testing.assert_allclose(wrist[150], own, atol=1e-3)
    np.testing.assert_allclose(wrist[-1], glove_has["left"].position[-1, 0], atol=2e-3)
    # 10 cm from rest, half of it in 0.06 s: no step is near to all of it.
    assert 0.005 < np.linalg.norm(np.diff(wrist, axis=0), axis=-1).max() < 0.025


def test_extra_points_change_nothing(small_models: GloveModels, gloves: Observation) -> None:
    estimator = Gloved(make_hands(small_models, "left"), Carried(default_skeleton()))
    left = chosen_points(gloves, range(9))
    one, _ = estimator.step(left[:5], estimator.start())
    other, _ = estimator.step(gloves[:5], estimator.start())
    np.testing.assert_array_equal(one.position, other.position)


def test_what_is_refused(small_models: GloveModels, gloves: Observation) -> None:
    skeleton = default_skeleton()
    more = Hands({"left2": hand_skeleton(skeleton, "left")}, small_models)
    with pytest.raises(BodysenseError, match="'left2' is not of this body; it has 'left' and 'right'"):
        Gloved(more, Carried(skeleton))
    body: Estimator = Hold(skeleton)
    estimator = Gloved(make_hands(small_models), body)
    with pytest.raises(BodysenseError, match="completed without rotations; wrap it in an IkTracked"):
        estimator.step(gloves[:1], estimator.start())
    with pytest.raises(BodysenseError, match="lost is 0; it must be positive"):
        GlovedSettings(lost=0.0)
