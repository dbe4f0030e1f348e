"""Inertial sensors of gloves: flexion of fingers with hidden markers, and correction of drift by seen ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.hands.glove import marker_positions, standard_marker
from bodysense.body.hands.hand import FINGERS, FREEDOMS, HAND_JOINTS, angles_of, mirrored_rotations, own_axes
from bodysense.body.hands.hand_family import GlovedHand, draw_hand, transfer_pose
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.gloves import inertial
from bodysense.devices.gloves.hands import GloveModels, Hands, HandsSettings
from bodysense.devices.simulated.glove_imu import observe_fingers
from bodysense.devices.simulated.noise import hide
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply
from bodysense.observing.observation import Observation
from bodysense.observing.points import joined_points
from bodysense_lab.synthesis.motion import HandMotion

FLEXIONS = [k for k, row in enumerate(FREEDOMS) if row.angle == "flexion"]
ALONE = HandsSettings(rejection=None)
UP = np.array([0.0, 1.0, 0.0])


def flexions(pose: Pose, axes: np.ndarray | None = None) -> np.ndarray:
    """Return flexion (T, 15) rad by the hand model's angles, as a reference for `inertial.sensor_flexion`."""
    local = np.asarray(pose.rotation)[..., 1:, :]
    if axes is not None:
        local = np.asarray(quaternion_multiply(quaternion_multiply(quaternion_conjugate(axes), local), axes))
    return np.asarray(angles_of(local))[..., FLEXIONS]


def turned_sensors(sensors: Observation, heading: np.ndarray, strap: np.ndarray) -> Observation:
    """Return sensors (T, P) with errors of heading (P,) rad and of straps, rotation vectors (P, 3) rad."""
    rotation = quaternion_multiply(quaternion_exp(heading[:, None] * UP), sensors.rotation)
    return replace(sensors, rotation=np.asarray(quaternion_multiply(rotation, quaternion_exp(strap))))


class KnownAngles:
    """A joint network that predicts the true angles (T, 26) until a frame, and repeats those of that frame after it."""

    def __init__(self, angles: np.ndarray, until: int) -> None:
        self.angles, self.until, self.frame = angles, until, -1

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        self.frame += 1
        return np.repeat(self.angles[min(self.frame, self.until)][None], len(markers), axis=0)


class FlatHand:
    """A marker network that predicts a flat hand."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.zeros_like(markers)


@pytest.fixture(scope="module")
def drawn() -> GlovedHand:
    return draw_hand(np.random.default_rng(8))


@pytest.fixture(scope="module")
def moving(motion: HandMotion, drawn: GlovedHand) -> Pose:
    """Six seconds at 60 Hz of a drawn hand, which has its own joint axes."""
    return transfer_pose(motion.pose[:360], drawn)


@pytest.fixture(scope="module")
def markers_of_drawn(moving: Pose, drawn: GlovedHand) -> np.ndarray:
    return np.asarray(marker_positions(drawn.glove, moving))


def solver(hand: GlovedHand, models: GloveModels, *names: str) -> Hands:
    named = names or ("left",)
    return Hands(
        dict.fromkeys(named, hand.skeleton),
        models,
        ALONE,
        gloves=dict.fromkeys(named, hand.glove),
        axes=np.stack([hand.axes] * len(named)),
    )


def solved_hands(hands: Hands, seen: Observation) -> dict[str, PointEstimate]:
    return hands.step(seen, hands.start())[0]


def flexion_of(answer: PointEstimate, axes: np.ndarray) -> np.ndarray:
    """Return flexion (T, 15) rad of an estimate of a left hand."""
    assert answer.pose is not None
    return flexions(answer.pose, axes)


def fingers_hidden(seen: Observation, start: int) -> Observation:
    """Hide the markers of all fingers from frame `start` on."""
    of_finger = np.array([bool((m := standard_marker(p)) and m[1].startswith(FINGERS)) for p in seen.points])
    back = np.array([bool((m := standard_marker(p)) and m[1].endswith("_base")) for p in seen.points])
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    hidden[start:, of_finger & ~back] = True
    return hide(seen, hidden)


def test_exact_sensors_of_a_right_hand_measure_the_true_flexion(moving: Pose, drawn: GlovedHand) -> None:
    sensors = observe_fingers({"right": moving}, np.arange(360) / 60)
    rotation = mirrored_rotations(sensors.rotation, "right").reshape(-1, 1, len(HAND_JOINTS), 4)
    sensed = inertial.sensor_flexion(rotation, own_axes(drawn.axes[None]))
    np.testing.assert_allclose(sensed.flexion[:, 0], flexions(moving, drawn.axes), atol=1e-9)


def test_fingers_with_hidden_markers_have_the_flexion_of_exact_sensors(
    moving: Pose, drawn: GlovedHand, markers_of_drawn: np.ndarray, observe_gloves: Callable, small_models: GloveModels
) -> None:
    nothing = observe_gloves(left=np.full_like(markers_of_drawn, np.nan))
    seen = joined_points(nothing, observe_fingers({"left": moving}, nothing.time))
    flexion = flexion_of(solved_hands(solver(drawn, small_models), seen)["left"], drawn.axes)
    np.testing.assert_allclose(flexion[120:], flexions(moving, drawn.axes)[120:], atol=1e-4)


def test_two_seconds_of_seen_markers_correct_drift(
    moving: Pose, drawn: GlovedHand, markers_of_drawn: np.ndarray, observe_gloves: Callable, motion: HandMotion
) -> None:
    """Headings have errors of 10° and straps of 3°."""
    rng, truth = np.random.default_rng(4), flexions(moving, drawn.axes)
    seen = observe_gloves(left=markers_of_drawn)
    exact = observe_fingers({"left": moving}, seen.time)
    wrong = turned_sensors(
        exact, np.radians(10) * rng.standard_normal(16), np.radians(3) * rng.standard_normal((16, 3))
    )
    angles = np.asarray(angles_of(motion.pose.rotation[:, 1:]))
    errors = {}
    for start in (1, 120):
        hands = solver(drawn, GloveModels(FlatHand(), KnownAngles(angles, start)))
        flexion = flexion_of(solved_hands(hands, joined_points(fingers_hidden(seen, start), wrong))["left"], drawn.axes)
        errors[start] = np.degrees(np.abs(flexion - truth)[130:].mean())
    assert errors[120] < 3.0
    assert errors[1] > 1.7 * errors[120]


def test_a_hand_without_sensors_is_unchanged(
    moving: Pose, drawn: GlovedHand, markers_of_drawn: np.ndarray, observe_gloves: Callable, small_models: GloveModels
) -> None:
    seen = fingers_hidden(observe_gloves(left=markers_of_drawn, right=markers_of_drawn), 60)
    hands = solver(drawn, small_models, "left", "right")
    without, sensors = solved_hands(hands, seen), observe_fingers({"left": moving}, seen.time)
    left_alone = solved_hands(hands, joined_points(seen, sensors))
    assert np.abs(left_alone["left"].position - without["left"].position).max() > 0.01
    np.testing.assert_array_equal(left_alone["right"].position, without["right"].position)
    np.testing.assert_array_equal(left_alone["right"].confidence, without["right"].confidence)
    # Joints with a position, as from the cameras of a headset, are not sensors.
    with_positions = replace(
        sensors, position=np.zeros((*sensors.has_position.shape, 3)), has_position=np.ones_like(sensors.has_position)
    )
    tracked = solved_hands(hands, joined_points(seen, with_positions))
    np.testing.assert_array_equal(tracked["left"].position, without["left"].position)


def test_joints_whose_sensors_stop_return_to_the_solved_pose_without_a_jump(
    moving: Pose, drawn: GlovedHand, markers_of_drawn: np.ndarray, observe_gloves: Callable, small_models: GloveModels
) -> None:
    still = Pose(
        moving.skeleton, np.tile(moving.root_position[:1], (360, 1)), np.tile(moving.rotation[:1], (360, 1, 1))
    )
    seen = fingers_hidden(observe_gloves(left=np.tile(markers_of_drawn[:1], (360, 1, 1))), 60)
    sensors = observe_fingers({"left": still}, seen.time)
    # Fingers bend by 0.6 rad while their markers are hidden; only the sensors measure it.
    bent = turned_sensors(sensors, np.zeros(16), np.zeros((16, 3)))
    bend = np.zeros((360, 16, 3))
    bend[90:, :, 2] = -0.6 * np.array([0.0, *([0.2, 0.6, 1.0] * 5)])
    bent = replace(bent, rotation=np.asarray(quaternion_multiply(bent.rotation, quaternion_exp(bend))))
    stopped = np.zeros(bent.has_rotation.shape, dtype=bool)
    stopped[200:] = True
    hands = solver(drawn, small_models)
    solved = flexion_of(solved_hands(hands, seen)["left"], drawn.axes)
    flexion = flexion_of(solved_hands(hands, joined_points(seen, hide(bent, stopped)))["left"], drawn.axes)
    assert np.abs(flexion - solved)[195].max() > 0.15
    np.testing.assert_allclose(flexion[320:], solved[320:], atol=1e-3)
    before, after = np.abs(flexion[199] - solved[199]).max(), np.abs(np.diff(flexion - solved, axis=0))[199:].max()
    assert after < 0.2 * before


def test_hidden_times_of_joints_follow_their_markers(hand: Skeleton) -> None:
    from bodysense.body.hands.glove import MARKERS, default_glove
    from bodysense.devices.gloves.fingers import hand_shape

    shape = hand_shape([hand], [default_glove()])
    hidden = np.zeros((1, len(MARKERS)))
    hidden[0, [MARKERS.index("thumb_tip"), MARKERS.index("ring_tip")]] = 0.5
    lost = dict(zip(HAND_JOINTS[1:], inertial.joints_hidden(hidden, shape)[0], strict=True))
    assert {name for name, seconds in lost.items() if seconds} == {"thumb2", "thumb3", "ring1", "ring2", "ring3"}
    hidden[0, MARKERS.index("thumb_middle")] = 0.2
    assert inertial.joints_hidden(hidden, shape)[0, 0] == 0.2


def test_fingers_with_sensors_have_smaller_expected_errors(
    moving: Pose, drawn: GlovedHand, markers_of_drawn: np.ndarray, observe_gloves: Callable, small_models: GloveModels
) -> None:
    seen = fingers_hidden(observe_gloves(left=markers_of_drawn), 60)
    hands, tips = solver(drawn, small_models), slice(16, 21)
    without = solved_hands(hands, seen)["left"].confidence[300, tips]
    with_them = solved_hands(hands, joined_points(seen, observe_fingers({"left": moving}, seen.time)))[
        "left"
    ].confidence[300, tips]
    assert (with_them < 0.6 * without).all()
