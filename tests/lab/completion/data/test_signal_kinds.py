"""Random kinds of signals: the whole space is drawn, and the tracker answers every member of it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import INERTIAL_SETS, SensorSet
from bodysense.tracking.tracker import Tracker
from bodysense_lab.completion.data.points import INPUT_POINTS, KNUCKLES
from bodysense_lab.completion.data.signal_kinds import (
    FAMILIES,
    TEST_SIGNALS,
    TRAINING_SIGNALS,
    SignalRanges,
    draw_signal,
    observed_set,
    signal_masks,
)

RANGES = {"training": TRAINING_SIGNALS, "test": TEST_SIGNALS}


@pytest.mark.parametrize("name", RANGES)
def test_every_point_has_every_quantity(name: str) -> None:
    rng, ranges = np.random.default_rng(1), RANGES[name]
    assert sum(ranges.shares.values()) == pytest.approx(1.0) and set(ranges.shares) == set(FAMILIES)
    drawn = [draw_signal(rng, ranges) for _ in range(1500)]
    seen: Counter[tuple[str, bool, bool]] = Counter()
    for one in drawn:
        assert one.points and set(one.position) <= set(INPUT_POINTS) and set(one.rotation) <= set(BODY)
        seen.update((point, point in one.position, point in one.rotation) for point in INPUT_POINTS)
    for point in INPUT_POINTS:
        quantities = [(True, False), (False, False)] + [(True, True), (False, True)] * (point in BODY)
        assert all(seen[point, *quantity] > 5 for quantity in quantities), point
    assert {one.acceleration for one in drawn} == {True, False}
    assert {len(one.points) for one in drawn if not one.rotation} >= {1, 2, 3}


def test_named_sets_and_one_position_alone_are_members() -> None:
    rng = np.random.default_rng(2)
    drawn = {draw_signal(rng, TEST_SIGNALS) for _ in range(4000)}
    assert set(INERTIAL_SETS.values()) <= drawn
    alone = {one.position[0] for one in drawn if len(one.position) == 1 and not one.rotation}
    assert alone == set(INPUT_POINTS)


def test_training_and_test_have_other_ranges() -> None:
    assert TRAINING_SIGNALS.density != TEST_SIGNALS.density and TRAINING_SIGNALS.shares != TEST_SIGNALS.shares


def test_masks_are_those_of_the_set() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        one = draw_signal(rng, TEST_SIGNALS)
        position, rotation = signal_masks(one)
        assert [INPUT_POINTS[k] for k in np.flatnonzero(position)] == sorted(one.position, key=INPUT_POINTS.index)
        implied = {name.replace("knuckles", "wrist") for name in KNUCKLES if name in one.position} & set(one.position)
        assert {BODY[k] for k in np.flatnonzero(rotation)} == {*one.rotation, *implied}


def test_knuckles_are_observed_as_finger_joints() -> None:
    told = observed_set(SensorSet(("head", "left_knuckles"), ("head",), acceleration=False))
    joints = tuple(f"left_{name}1" for name in ("index", "middle", "ring", "pinky"))
    assert told == SensorSet(("head", *joints), ("head",), acceleration=False)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_tracker_answers_every_kind(family: str) -> None:
    """Estimates are finite and the bones keep their lengths, whatever is known."""
    clip = packaged_performance()
    pose, rng = clip.pose[:12], np.random.default_rng(4)
    ranges = SignalRanges({family: 1.0}, TEST_SIGNALS.density, TEST_SIGNALS.head, TEST_SIGNALS.acceleration)  # type: ignore[dict-item]
    for _ in range(6):
        sensors = draw_signal(rng, ranges)
        seen = observe(pose, clip.time[:12], observed_set(sensors))
        tracker = Tracker()
        estimate, _ = tracker.step(seen, tracker.start())
        assert np.isfinite(estimate.points).all() and np.isfinite(estimate.confidence).all(), sensors
        if not sensors.acceleration:
            assert seen.acceleration is None
