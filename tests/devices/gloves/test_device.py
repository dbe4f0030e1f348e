"""Glove device: markers in, observed hands out, which the tracker's body keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, glove_points, marker_positions
from bodysense.body.hands.hand import FINGERTIPS, HAND_JOINTS, hand_skeleton
from bodysense.body.hands.hand_family import body_with_hand, draw_hand
from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import packaged_performance
from bodysense.devices.gloves.device import (
    SIDES,
    GloveDevice,
    glove_device,
    gloved_sides,
)
from bodysense.devices.gloves.hands import GloveModels, Hands, load_glove_models
from bodysense.devices.simulated import glove
from bodysense.devices.simulated.noise import hide
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import OPTICAL_ACCURACY, Observation, accuracy_like
from bodysense.observing.points import chosen_points
from bodysense.tracking.model import CompletionModel
from bodysense.tracking.tracker import Tracker
from bodysense_lab.synthesis.hands import synthesize_hand

SKELETON = default_skeleton()
FIELDS = ("position", "rotation", "has_position", "has_rotation", "accuracy")


@pytest.fixture(scope="session")
def clip(waving_clip: Clip) -> Clip:
    """A waving body, one second at 60 Hz."""
    clip = resample(waving_clip, 60.0)
    return replace(clip, pose=clip.pose[:60])


@pytest.fixture(scope="session")
def gloves(clip: Clip) -> Observation:
    return glove.observe(clip.pose, clip.time)


@pytest.fixture(scope="session")
def head(clip: Clip) -> Observation:
    return observe(clip.pose, clip.time, SENSOR_SETS["head"])


def together(one: Observation, other: Observation) -> Observation:
    """Return two observations of the same times as one."""
    joined = {name: np.concatenate([getattr(one, name), getattr(other, name)], axis=1) for name in FIELDS}
    return Observation(points=(*one.points, *other.points), time=one.time, **joined)


def observed(device: GloveDevice, seen: Observation) -> Observation:
    found, _ = device.step(seen, device.start())
    return check_observation(found)


def test_markers_become_points_of_hands(small_models: GloveModels, gloves: Observation, head: Observation) -> None:
    device = glove_device(SKELETON, models=small_models)
    found = observed(device, together(head, gloves))
    assert found.points == ("head", *device.points)
    assert found.has_position.all() and set(device.points) <= set(SKELETON.points)
    assert found.has_rotation[:, [name in SKELETON.joints for name in found.points]].all()
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(found, field)[:, 0], getattr(head, field)[:, 0])
    answers, _ = device.hands.step(gloves, device.hands.start())
    for side in SIDES:
        answer, place = answers[side], [found.points.index(f"{side}_{name}") for name in (*HAND_JOINTS, *FINGERTIPS)]
        np.testing.assert_array_equal(found.position[:, place], answer.position)
        assert answer.pose is not None
        np.testing.assert_array_equal(found.rotation[:, place[0]], answer.pose.rotation[:, 0])


@pytest.mark.parametrize(("sides", "with_head"), [(SIDES, True), (("right",), False)], ids=["both", "alone"])
def test_the_tracker_keeps_the_hand_of_a_glove(
    small_models: GloveModels,
    completion: CompletionModel,
    gloves: Observation,
    head: Observation,
    with_head: bool,
    sides: tuple,
) -> None:
    """Two wrists of untrained networks may be out of reach, but their rotations are kept."""
    seen = chosen_points(gloves, [k for k, name in enumerate(gloves.points) if name.startswith(sides)])
    device = glove_device(SKELETON, sides, small_models)
    found = observed(device, together(head, seen) if with_head else seen)
    tracker = Tracker(Person(SKELETON), network=completion)
    estimate, _ = tracker.step(found, tracker.start())
    joints = [name for name in device.points if name in SKELETON.joints]
    world = np.asarray(forward_kinematics(estimate.pose)[1])[:, SKELETON.indices(joints)]
    turned = geodesic_angle(world, found.rotation[:, [found.points.index(name) for name in joints]])
    assert np.degrees(turned).max() < 0.5
    if not with_head:
        wrists = [f"{side}_wrist" for side in sides]
        off = estimate.points[:, SKELETON.indices(wrists)] - found.position[:, [found.points.index(w) for w in wrists]]
        assert np.linalg.norm(off, axis=-1).max() < 0.005


def test_one_call_equals_many(small_models: GloveModels, gloves: Observation) -> None:
    hidden = np.random.default_rng(0).random(gloves.has_position.shape) < 0.3
    hidden[20:50, :9] = True
    seen, device = hide(gloves, hidden), glove_device(SKELETON, models=small_models)
    whole, state = observed(device, seen), device.start()
    for t in range(len(seen)):
        one, state = device.step(seen[t : t + 1], state)
        for field in (*FIELDS, "time"):
            np.testing.assert_allclose(getattr(one, field)[0], getattr(whole, field)[t], atol=1e-12)


def test_a_hidden_hand_is_not_observed_and_hidden_markers_are_less_accurate(
    small_models: GloveModels, gloves: Observation
) -> None:
    hidden = np.zeros(gloves.has_position.shape, dtype=bool)
    hidden[20:50, :9] = True  # all of the left
    hidden[10:60, 9 + 5] = True  # the tip of the right index finger
    found = observed(glove_device(SKELETON, models=small_models), hide(gloves, hidden))
    left, right = (found.has_position[:, found.points.index(f"{side}_wrist")] for side in SIDES)
    assert right.all() and left[:20].all() and left[50:].all()
    assert left[20:24].all() and not left[28:50].any()  # a moment is bridged
    accuracy = found.accuracy[:, found.points.index("right_index_tip")]
    assert (np.diff(accuracy[10:60]) > 0).all() and accuracy[59] > 5 * accuracy[9]
    assert found.accuracy[5, found.points.index("left_wrist")] == OPTICAL_ACCURACY


def test_a_lost_hand_is_completed_without_a_jump(small_models: GloveModels, completion: CompletionModel) -> None:
    clip = resample(replace(packaged_performance(), pose=packaged_performance().pose[50:110]), 60.0)
    gloves = glove.observe(clip.pose, clip.time)
    head = observe(clip.pose, clip.time, SENSOR_SETS["head"])
    hidden = np.zeros(gloves.has_position.shape, dtype=bool)
    hidden[40:, :9] = True
    skeleton = clip.pose.skeleton
    found = observed(glove_device(skeleton, models=small_models), together(head, hide(gloves, hidden)))
    assert not found.has_position[50:, found.points.index("left_wrist")].any()
    tracker = Tracker(Person(skeleton), network=completion)
    estimate, _ = tracker.step(found, tracker.start())
    left = skeleton.indices(["left_elbow", "left_wrist"])
    steps = np.linalg.norm(np.diff(estimate.points[:, left], axis=0), axis=-1)
    true = np.linalg.norm(np.diff(np.asarray(forward_kinematics(clip.pose)[0])[:, left], axis=0), axis=-1)
    assert (steps - true)[30:].max() < 0.05


def test_a_standing_head_is_assumed_for_gloves_alone(
    small_models: GloveModels, completion: CompletionModel, clip: Clip, gloves: Observation, head: Observation
) -> None:
    device = glove_device(SKELETON, models=small_models)
    found = observed(device, gloves)
    place = found.points.index("head")
    assert found.has_position[:, place].all() and found.has_rotation[:, place].all()
    assert found.accuracy[0, place] > 0.2  # the head is marked as a guess
    assert np.linalg.norm(found.position[:, place] - head.position[:, 0], axis=-1).max() < 0.5
    assert np.linalg.norm(np.diff(found.position[:, place], axis=0), axis=-1).max() < 0.03
    tracker = Tracker(Person(SKELETON), network=completion)
    estimate, _ = tracker.step(found, tracker.start())
    high = SKELETON.indices(["head", "pelvis", "left_ankle"])
    np.testing.assert_allclose(
        estimate.points[-1, high, 1], head.position[-1, 0, 1] * np.array([1, 0.6, 0.07]), atol=0.2
    )
    hidden = hide(gloves, np.ones(gloves.has_position.shape, dtype=bool))
    assert not observed(device, hidden).has_position.any()
    assert "head" not in observed(replace(device, wearer=None), gloves).points
    assert observed(device, together(head, gloves)).accuracy[0, 0] == head.accuracy[0, 0]


def test_another_device_is_used_while_the_glove_is_lost(small_models: GloveModels, gloves: Observation) -> None:
    controller = chosen_points(gloves, [0])
    controller = replace(controller, points=("left_wrist",), accuracy=np.full((len(gloves), 1), 0.02))
    hidden = np.zeros(gloves.has_position.shape, dtype=bool)
    hidden[30:, :9] = True
    found = observed(glove_device(SKELETON, models=small_models), together(controller, hide(gloves, hidden)))
    assert found.points.count("left_wrist") == 1
    assert found.accuracy[20, 0] == OPTICAL_ACCURACY and found.accuracy[59, 0] == 0.02
    np.testing.assert_array_equal(found.position[59, 0], controller.position[59, 0])


def test_accuracy_matches_the_error() -> None:
    """The errors of synthesised hands with randomly hidden markers are about the expected ones."""
    rng = np.random.default_rng(8)
    body = body_with_hand(SKELETON, "left", draw_hand(rng))  # the default hand would count as unknown
    hand = hand_skeleton(body, "left")
    device = replace(glove_device(body, ("left",), load_glove_models()), wearer=None)
    expected, errors = [], []
    for _ in range(2):
        motion = synthesize_hand(hand, 8.0, rng)
        markers = np.array(marker_positions(default_glove(), motion.pose))
        hidden = np.zeros(markers.shape[:2], dtype=bool)
        for marker in range(9):
            begin = int(rng.exponential(90))
            while begin < len(hidden):
                end = begin + int(np.exp(rng.uniform(np.log(3), np.log(180))))
                hidden[begin:end, marker] = True
                begin = end + int(rng.exponential(90))
        seen = Observation(
            points=glove_points("left"),
            position=np.where(hidden[..., None], np.nan, markers),
            rotation=np.full((*hidden.shape, 4), np.nan),
            has_position=~hidden,
            has_rotation=np.zeros_like(hidden),
            accuracy=accuracy_like(hidden, OPTICAL_ACCURACY),
            time=np.arange(len(hidden)) / 60,
        )
        found = observed(device, seen)
        known = found.has_position
        expected.append(found.accuracy[known])
        errors.append(np.linalg.norm(found.position - forward_kinematics(motion.pose)[0], axis=-1)[known])
    accuracy, error = np.concatenate(expected), np.concatenate(errors)
    for low, high in ((0.004, 0.01), (0.01, 0.02), (0.02, 0.05)):
        some = (accuracy >= low) & (accuracy < high)
        assert 0.5 < error[some].mean() / accuracy[some].mean() < 2
    assert np.corrcoef(accuracy, error)[0, 1] > 0.3


def test_unknown_hands_and_wrong_times_are_refused(small_models: GloveModels, gloves: Observation) -> None:
    more = Hands({"left2": hand_skeleton(SKELETON, "left")}, small_models)
    with pytest.raises(BodysenseError, match="'left2' is not of this body; it has 'left' and 'right'"):
        GloveDevice(more)
    assert gloved_sides(gloves.points) == SIDES
    with pytest.raises(BodysenseError, match="the gloves are 'left2'; name the body's hands"):
        gloved_sides(glove_points("left2"))
    device = glove_device(SKELETON, models=small_models)
    _, state = device.step(gloves[:2], device.start())
    with pytest.raises(BodysenseError, match="in order of time"):
        device.step(gloves[:1], state)
