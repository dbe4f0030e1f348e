"""Measures of visible faults have known values for constructed motions and are zero for the truth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.geometry.rotation import quaternion_exp
from bodysense_lab.completion.score.sight import sight

RATE = 30.0
UP, AHEAD = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def motions(seed: int, frames: int = 60, points: int = 4) -> np.ndarray:
    """Return smooth random paths of points (T, P, 3) m."""
    rng = np.random.default_rng(seed)
    speed = np.cumsum(rng.normal(0, 0.01, (frames, points, 3)), axis=0)
    return np.cumsum(speed, axis=0)


def stepping(lifts: list[tuple[float, float]], seconds: float = 4.0, length: float = 0.5) -> np.ndarray:
    """Return two ankles (T, 2, 3) m at 10 cm height; the left one moves ahead in each of the spans, s."""
    time = np.arange(round(seconds * RATE)) / RATE
    feet = np.zeros((len(time), 2, 3))
    feet[..., 0] = [0.1, -0.1]
    feet[..., 1] = 0.1
    for start, end in lifts:
        feet[:, 0, 2] += length * np.clip((time - start) / (end - start), 0, 1)
    return feet


@given(st.integers(0, 1000))
def test_the_truth_has_no_faults(seed: int) -> None:
    truth = motions(seed)
    tracked = np.random.default_rng(seed).uniform(size=truth.shape[:2]) < 0.5
    assert not sight.jump_frames(truth, truth, 0.05).any()
    assert not sight.frozen_points(truth, truth, tracked, RATE).any()
    assert not sight.floating_frames(truth[:, :2], truth[:, :2], -1.0).any()
    assert sight.false_steps(truth[:, :2], truth[:, :2], RATE) == 0
    assert sight.missed_steps(truth[:, :2], truth[:, :2], RATE)[0] == 0
    facing = np.tile([1.0, 0.0, 0.0, 0.0], (len(truth), 1))
    assert not sight.wrong_feet(truth[:, :2], truth[:, :2], facing)[1].any()
    curve = sight.transition_jerks(truth, [10, 20], RATE).mean(axis=0)
    assert sight.peak_jerk_ratio(curve, curve) == 1 and sight.area_under_jerk(curve, curve) == 0


@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(-5, 5), st.floats(-5, 5))
def test_measures_do_not_depend_on_the_place_in_the_world(seed: int, turn: float, x: float, z: float) -> None:
    truth, output = motions(seed), motions(seed + 1)
    facing = np.tile([1.0, 0.0, 0.0, 0.0], (len(truth), 1))
    about = quaternion_exp(np.array([0.0, turn, 0.0]))
    matrix = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    tracked = np.random.default_rng(seed).uniform(size=truth.shape[:2]) < 0.5

    def figures(output: np.ndarray, truth: np.ndarray, facing: np.ndarray) -> list[float]:
        return [
            sight.frozen_points(output, truth, tracked, RATE).sum(),
            sight.false_steps(output[:, :2], truth[:, :2], RATE),
            *sight.missed_steps(output[:, :2], truth[:, :2], RATE),
            *(mask.sum() for mask in sight.wrong_feet(output[:, :2], truth[:, :2], facing)),
            sight.walking_frames(truth[:, 0], RATE).sum(),
            sight.reentry_speeds(output, tracked, RATE).sum(),
            sight.transition_jerks(output, [10], RATE).sum(),
        ]

    def transformed(values: np.ndarray) -> np.ndarray:
        return values @ matrix.T + [x, 0.0, z]

    there = figures(transformed(output), transformed(truth), np.tile(about, (len(truth), 1)))
    assert there == pytest.approx(figures(output, truth, facing), rel=1e-6)


def test_a_change_is_counted_in_its_frame_and_the_next() -> None:
    tracked = np.ones((10, 3), dtype=bool)
    tracked[4:, 1] = False
    np.testing.assert_array_equal(np.flatnonzero(sight.changed_frames(tracked)), [4])
    np.testing.assert_array_equal(np.flatnonzero(sight.near_change(tracked)), [4, 5])
    tracked[4:, 2], tracked[7:, 1] = False, True
    np.testing.assert_array_equal(np.flatnonzero(sight.near_change(tracked)), [4, 5, 7, 8])


def test_still_points_with_moving_truth_are_frozen() -> None:
    """One of two hidden points is still in 3 of 9 fast frames; slow and tracked points do not count."""
    truth = np.arange(10)[:, None, None] / RATE * np.array([2.0, 2.0, 0.9, 2.0])[:, None] * AHEAD
    output = truth.copy()
    output[4:7, 0] = output[3, 0]  # then a leap
    output[4:7, 2:] = output[3, 2:]
    tracked = np.zeros((10, 4), dtype=bool)
    tracked[:, 3] = True
    frozen = sight.frozen_points(output, truth, tracked, RATE)
    assert (frozen.sum(), len(frozen)) == (3, 18)
    creeping = truth[3, :1] + 0.26 * (truth[:, :1] - truth[3, :1])
    assert not sight.frozen_points(creeping, truth[:, :1], tracked[:, :1], RATE).any()


def test_feet_float_above_rest_height_and_truth() -> None:
    balls = np.zeros((4, 2, 3))
    balls[..., 1] = 0.02  # their rest height
    output = balls.copy()
    output[1, :, 1] += 0.029
    output[2, :, 1] += 0.031
    output[3, 0, 1] += 0.2  # one foot is lifted
    np.testing.assert_array_equal(sight.floating_frames(output, balls, 0.02), [False, False, True, False])
    high = balls + 0.02 * UP  # recorded feet do not always touch the floor
    np.testing.assert_array_equal(sight.floating_frames(output, high, 0.02), np.zeros(4, dtype=bool))


def test_a_low_and_still_foot_rests() -> None:
    balls = np.zeros((30, 2, 3))
    balls[..., 1] = 0.02

    def share(balls: np.ndarray) -> float:
        return float(sight.resting_frames(balls, 0.02, RATE).mean())

    assert share(balls) == 1.0
    assert share(balls + 0.3 * UP) == 0.0  # jumps
    gliding = balls + np.arange(30)[:, None, None] * 0.02 * AHEAD
    assert share(gliding) == 0.0
    gliding[:, 1] = balls[:, 1]
    assert share(gliding) == 1.0  # one foot swings


def test_a_standing_body_is_upright_and_a_seated_one_is_not() -> None:
    pelvis = np.tile([0.0, 0.95, 0.0], (30, 1))
    assert sight.upright_frames(pelvis, 1.0).all()
    assert not sight.upright_frames(pelvis - 0.3 * UP, 1.0).any()


@pytest.mark.parametrize("angle", [0.0, 12.0, 90.0, 150.0])
def test_knee_flexion_is_the_angle_between_thigh_and_shin(angle: float) -> None:
    bend = np.radians(angle)
    hip, knee = np.array([0.0, 0.9, 0.0]), np.array([0.0, 0.5, 0.0])
    ankle = knee - 0.4 * np.array([0.0, np.cos(bend), np.sin(bend)])
    assert sight.knee_flexion(hip, knee, ankle) == pytest.approx(angle, abs=1e-5)


@given(st.floats(-170, 170), st.sampled_from([1.0, -1.0]))
def test_knees_bend_backward_about_the_negative_axis(angle: float, sign: float) -> None:
    turned = sign * quaternion_exp(np.radians(angle) * np.array([1.0, 0.0, 0.0]))
    assert bool(sight.backward_knees(turned)) == (angle < -sight.BACKWARD)


def test_wrong_feet_are_counted_in_strides() -> None:
    truth = np.zeros((6, 2, 3))
    truth[:, 0, 2] = [0.3, 0.3, -0.3, 0.1, 0.3, -0.3]
    output = truth.copy()
    output[[1, 2, 3], 0, 2] *= -1  # the fourth has no stride
    facing = np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))
    stride, wrong = sight.wrong_feet(output, truth, facing)
    np.testing.assert_array_equal(stride, [True, True, True, False, True, True])
    np.testing.assert_array_equal(wrong, [False, True, True, False, False, False])


@pytest.mark.parametrize(("speed", "walks"), [(0.2, False), (0.4, True), (1.2, True)])
def test_a_pelvis_walks_by_its_speed_along_the_floor(speed: float, walks: bool) -> None:
    time = np.arange(60) / RATE
    pelvis = np.stack([0.6 * speed * time, 1 + 0.5 * np.sin(9 * time), 0.8 * speed * time], axis=-1)
    assert (sight.walking_frames(pelvis, RATE) == walks).all()


def test_a_foot_steps_while_both_stand() -> None:
    standing = stepping([])
    assert sight.false_steps(stepping([(1.0, 1.3)], length=0.09), standing, RATE) == 1
    assert sight.false_steps(stepping([(1.0, 1.3)], length=0.07), standing, RATE) == 0
    assert sight.false_steps(stepping([(1.0, 1.3), (2.0, 2.3)], length=0.09), standing, RATE) == 2
    stepped = stepping([(1.0, 1.5)])
    assert sight.false_steps(stepped, stepped, RATE) == 0
    assert sight.false_steps(stepping([(1.2, 1.7)]), stepped, RATE) == 0  # only late
    slid = standing + (0.03 * np.arange(len(standing)) / RATE)[:, None, None] * AHEAD
    assert sight.false_steps(standing, slid, RATE) == 0  # the truth slides, the output does not


def test_missed_steps_are_counted() -> None:
    truth = stepping([(0.5, 1.0), (2.0, 2.5)])
    assert sight.missed_steps(truth, truth, RATE) == (0, 2)
    assert sight.missed_steps(stepping([(0.5, 1.0)]), truth, RATE) == (1, 2)
    assert sight.missed_steps(stepping([]), truth, RATE) == (2, 2)
    assert sight.missed_steps(stepping([(0.6, 1.1), (2.1, 2.6)]), truth, RATE) == (0, 2)  # late
    assert sight.missed_steps(stepping([]), stepping([(0.5, 1.0)], length=0.15), RATE) == (0, 0)  # no step


def test_reentry_speed_is_the_greatest_within_the_ease() -> None:
    position, tracked = np.zeros((40, 2, 3)), np.ones((40, 2), dtype=bool)
    tracked[10:20, 0] = False
    position[20:, 0, 0] += 0.3  # as the point returns
    position[35:, 0, 0] += 9.0  # long after
    position[15:, 1, 0] += 5.0  # a point that never was lost
    assert sight.reentry_speeds(position, tracked, RATE) == pytest.approx([0.3 * RATE])
    eased = np.zeros((40, 2, 3))
    eased[:, 0, 0] = np.interp(np.arange(40), [19, 25], [0, 0.3])
    assert sight.reentry_speeds(eased, tracked, RATE) == pytest.approx([0.05 * RATE])
    assert sight.reentry_speeds(position, np.ones_like(tracked), RATE).size == 0


def test_points_are_long_seen_after_0_3_s_without_a_gap() -> None:
    tracked = np.ones((30, 1), dtype=bool)
    tracked[[3, 20]] = False
    np.testing.assert_array_equal(np.flatnonzero(sight.long_seen(tracked, RATE)), np.arange(13, 20))


def test_short_losses_count_as_returns_only() -> None:
    tracked = np.ones(120, dtype=bool)
    tracked[20:30], tracked[60:80] = False, False
    assert sight.transition_frames(tracked, RATE) == {"loss": [60], "return": [30, 80]}
    tracked[112:] = False  # its half second is not in the take
    assert sight.transition_frames(tracked, RATE)["loss"] == [60]


def test_jerk_of_a_leap_at_the_moment_is_known() -> None:
    """A step of s metres has third differences s, −2s and s, in its frame and the two after it."""
    position = np.zeros((60, 3, 3))
    position[30:, 1, 0] = 0.1
    curve = sight.transition_jerks(position, [30], RATE)[0]
    assert curve[:4] == pytest.approx(np.array([0.1, 0.2, 0.1, 0.0]) * RATE**3)
    assert sight.transition_jerks(position, [31], RATE)[0][:2] == pytest.approx(np.array([0.2, 0.1]) * RATE**3)
    truth = np.full_like(curve, 0.05 * RATE**3)
    assert sight.peak_jerk_ratio(curve, truth) == pytest.approx(4.0)
    assert sight.area_under_jerk(curve, truth) == pytest.approx((0.05 + 0.15 + 0.05 + 12 * 0.05) * RATE**3)
