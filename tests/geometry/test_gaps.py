"""Filling gaps: known values stay, nothing jumps, and the ends of a gap are met."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.geometry.gaps import Trust, fill, interpolate, interpolate_positions, runs
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
)

RATE = 60.0


def swing(frames: int, seed: int) -> np.ndarray:
    """A joint (T, 4) that swings smoothly, up to about 3 rad/s."""
    rng, time = np.random.default_rng(seed), np.arange(frames)[:, None] / RATE
    waves = sum(rng.normal(scale=0.4, size=3) * np.sin(time * rng.uniform(1, 5) + rng.uniform(0, 6)) for _ in range(3))
    return np.asarray(quaternion_canonical(quaternion_exp(waves)))


def speed(rotation: np.ndarray) -> np.ndarray:
    return np.asarray(geodesic_angle(rotation[:-1], rotation[1:])) * RATE


@given(st.integers(2, 90), st.lists(st.tuples(st.integers(0, 89), st.integers(1, 60)), max_size=4), st.booleans())
def test_known_frames_are_bit_identical(frames: int, gaps: list[tuple[int, int]], guessing: bool) -> None:
    rotation, missing = swing(frames, 1), np.zeros(frames, dtype=bool)
    for first, count in gaps:
        missing[first : first + count] = True
    spoilt = np.where(missing[:, None], [0.0, 1.0, 0.0, 0.0], rotation)
    found = fill(spoilt, missing, 1 / RATE, swing(frames, 2) if guessing else None)
    np.testing.assert_array_equal(found[~missing], rotation[~missing])
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-9)


def turn_vectors(rotation: np.ndarray) -> np.ndarray:
    """Angular velocities (T - 1, 3), rad/s, in the joint's own axes."""
    steps = quaternion_multiply(quaternion_conjugate(rotation[:-1]), rotation[1:])
    return np.asarray(quaternion_log(steps)) * RATE


@given(st.integers(0, 10_000), st.integers(3, 60), st.integers(1, 117), st.booleans())
@settings(max_examples=40, deadline=None)
def test_position_and_speed_are_continuous_at_both_edges(seed: int, first: int, count: int, guessing: bool) -> None:
    """At the edges a gap moves on as the known frames do, whatever the guess says inside.

    Between two frames of 1/60 s the true motion changes its velocity by up to `usual`; a filled gap by three times that
    and what a turn from one side of the gap to the other needs.
    """
    truth = swing(180, seed)
    missing = np.zeros(180, dtype=bool)
    missing[first : first + count] = True
    spoilt = np.where(missing[:, None], [0.0, 0.0, 1.0, 0.0], truth)
    found = fill(spoilt, missing, 1 / RATE, swing(180, seed + 1) if guessing else None, Trust(1.0, 0.4, 0.4))
    usual = np.linalg.norm(np.diff(turn_vectors(truth), axis=0), axis=-1).max()
    change = np.linalg.norm(np.diff(turn_vectors(found), axis=0), axis=-1)
    whole = float(geodesic_angle(truth[first - 1], truth[first + count]))
    needed = 6 * whole / ((count + 1) / RATE) ** 2 / RATE
    edges = [first - 2, first - 1, first + count - 2, first + count - 1]
    assert change[edges].max() < 3 * usual + needed + 0.1
    assert np.linalg.norm(turn_vectors(found)[[first - 1, first + count - 1]], axis=-1).max() < (
        1.5 * speed(truth).max() + 1.5 * whole * RATE / (count + 1) + 0.2
    )


def test_a_short_gap_continues_the_motion() -> None:
    truth = swing(90, 3)
    missing = np.zeros(90, dtype=bool)
    missing[40:44] = True
    spoilt = np.where(missing[:, None], [0.0, 0.0, 1.0, 0.0], truth)
    assert geodesic_angle(fill(spoilt, missing, 1 / RATE), truth).max() < np.deg2rad(0.5)


def test_an_accelerating_joint_keeps_its_speed_at_both_edges_of_a_gap() -> None:
    """From 0.5 to 4 rad/s: the speed on each side goes on into the gap, not the mean speed between the sides."""
    time = np.arange(90)[:, None] / RATE
    truth = np.asarray(quaternion_exp((0.5 * time + 1.2 * time**2) * [0.0, 0.6, 0.8]))
    missing = np.zeros(90, dtype=bool)
    missing[30:60] = True
    found = speed(fill(np.where(missing[:, None], [0.0, 0.0, 1.0, 0.0], truth), missing, 1 / RATE))
    wanted = speed(truth)
    for inside, beside in ((29, 28), (59, 60)):
        assert abs(found[inside] - wanted[beside]) < 0.15 * wanted[beside]


def test_the_guess_counts_far_from_both_sides() -> None:
    truth = swing(1500, 6)
    missing = np.zeros(1500, dtype=bool)
    missing[150:1350] = True
    middle = slice(700, 800)
    with_guess, without = (
        geodesic_angle(fill(truth, missing, 1 / RATE, guess), truth)[middle].mean() for guess in (truth, None)
    )
    assert with_guess < 0.15 * without


def test_a_gap_with_one_known_side_or_none() -> None:
    truth, guess = swing(60, 4), swing(60, 5)
    missing = np.zeros(60, dtype=bool)
    missing[:50] = True
    found = fill(truth, missing, 1 / RATE, guess)
    assert speed(found).max() < 6
    missing[:] = True
    assert geodesic_angle(fill(truth, missing, 1 / RATE, guess), guess).max() < 1e-7
    np.testing.assert_array_equal(fill(truth, missing, 1 / RATE), truth)


def test_a_gap_of_one_frame_is_the_cubic_through_its_neighbours() -> None:
    """Whatever a guess says."""
    time = (np.arange(21)[:, None] - 10) / 10
    truth = np.asarray(quaternion_exp((time + 0.3 * time**3) * [0.0, 0.6, 0.8]))
    missing = np.zeros(21, dtype=bool)
    missing[8] = True
    found = fill(np.where(missing[:, None], [0.0, 0.0, 1.0, 0.0], truth), missing, 1 / RATE, swing(21, 1))
    assert geodesic_angle(found, truth).max() < 1e-4


def test_joints_interpolated_together_equal_each_alone() -> None:
    joints = np.stack([swing(60, seed) for seed in range(3)], axis=1)
    together = interpolate(joints, 20, 50, 24.0)
    for k in range(3):
        np.testing.assert_allclose(together[:, k], interpolate(joints[:, k], 20, 50, 24.0), atol=1e-12)


@given(st.integers(0, 10_000), st.integers(3, 56), st.booleans())
def test_a_known_frame_between_two_gaps_tells_no_speed(seed: int, alone: int, guessing: bool) -> None:
    """Each of both gaps is filled as if it were alone."""
    rotation, missing = swing(60, seed), np.ones(60, dtype=bool)
    missing[[0, 1, alone, 58, 59]] = False
    guess = swing(60, seed + 1) if guessing else None
    whole = fill(rotation, missing, 1 / RATE, guess)
    for part in (slice(alone + 1), slice(alone, 60)):
        filled = fill(rotation[part], missing[part], 1 / RATE, guess[part] if guess is not None else None)
        np.testing.assert_allclose(whole[part], filled, atol=1e-12)


def test_positions_are_interpolated_as_rotations_about_one_axis() -> None:
    angle = np.cumsum(np.random.default_rng(2).normal(scale=0.02, size=60))
    place, rotation = angle[:, None] * [1.0, 0.0, 0.0], np.asarray(quaternion_exp(angle[:, None] * [1.0, 0.0, 0.0]))
    turned = np.asarray(quaternion_log(interpolate(rotation, 20, 50, 24.0)))
    np.testing.assert_allclose(interpolate_positions(place, 20, 50, 24.0), turned, atol=1e-9)


def test_an_expected_deviation_is_added_to_the_interpolation() -> None:
    truth, missing = swing(90, 3), np.zeros(90, dtype=bool)
    missing[30:60] = True
    plain = fill(truth, missing, 1 / RATE)
    more = np.where(missing[:, None], [0.1, 0.0, 0.0], 0.0)
    found = fill(truth, missing, 1 / RATE, deviation=more)
    turned = quaternion_log(quaternion_multiply(quaternion_conjugate(plain), found))
    np.testing.assert_allclose(turned, more, atol=1e-9)


def test_trust_grows_with_the_distance_from_known_frames() -> None:
    away, trust = np.array([0.0, 0.2, 1e3]), Trust(0.8, 0.2, 0.5)
    np.testing.assert_allclose(trust.weight(away, True), [0.0, 0.4, 0.8], atol=1e-6)
    np.testing.assert_allclose(trust.weight(np.array([0.0, 0.5, 1e3]), False), [0.0, 0.5, 1.0], atol=1e-6)


def test_runs() -> None:
    assert runs(np.array([1, 1, 0, 0, 1, 0, 1], dtype=bool)) == [(0, 2), (4, 5), (6, 7)]
    assert runs(np.zeros(3, dtype=bool)) == []
