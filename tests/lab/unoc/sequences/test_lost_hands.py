"""Tracking that fails for a while: hands are lost whole, at the rate asked for, and what is lost is NaN."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.noise import hide
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense_lab.papers.unoc.sequences.lost_hands import LONGEST, SHORTEST, hide_hands

SKELETON = default_skeleton()
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
HANDS = {
    side: [
        p
        for p, name in enumerate(SKELETON.points)
        if name.startswith(tuple(f"{side}_{part}" for part in (*FINGERS, "wrist")))
    ]
    for side in ("left", "right")
}
OTHERS = [p for p in range(len(SKELETON.points)) if p not in HANDS["left"] + HANDS["right"]]


def everything_seen(seconds: float, rate: float = 10.0, points: tuple[str, ...] = SKELETON.points) -> Observation:
    shape = (round(seconds * rate), len(points))
    rotation = np.zeros((*shape, 4))
    rotation[..., 0] = 1
    seen = np.ones(shape, dtype=bool)
    return Observation(
        points=points,
        position=np.ones((*shape, 3)),
        rotation=rotation,
        has_position=seen,
        has_rotation=seen.copy(),
        accuracy=np.full(shape, 0.001),
        time=5.0 + np.arange(shape[0]) / rate,
    )


@pytest.mark.parametrize("batch", [(), (3, 1, 2)])
def test_hidden_points_are_nan_and_untracked(batch: tuple[int, ...]) -> None:
    observation = everything_seen(1.0)
    names = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    fields = {name: getattr(observation, name) for name in names}
    many = replace(
        observation, **{name: np.broadcast_to(value, (*batch, *value.shape)) for name, value in fields.items()}
    )
    hidden = np.random.default_rng(0).uniform(size=many.has_position.shape) < 0.3
    result = check_observation(hide(many, hidden))
    assert not result.has_position[hidden].any() and not result.has_rotation[hidden].any()
    assert np.isnan(result.position[hidden]).all() and np.isnan(result.rotation[hidden]).all()
    np.testing.assert_array_equal(result.position[~hidden], many.position[~hidden])
    assert result.has_position[~hidden].all() and result.has_rotation[~hidden].all()
    assert many.has_position.all(), "what was given stays as it was"


def test_hidden_points_stay_hidden() -> None:
    observation = everything_seen(60.0)
    observation.has_position[:, 3] = False
    observation.position[:, 3] = np.nan
    result = hide_hands(observation, 30.0, np.random.default_rng(0))
    assert not result.has_position[:, 3].any() and result.has_rotation[:, 3].all()


def test_each_hand_is_lost_whole_and_by_itself() -> None:
    result = check_observation(hide_hands(everything_seen(120.0), 10.0, np.random.default_rng(1)))
    lost = {side: ~result.has_position[:, hand] for side, hand in HANDS.items()}
    for hand in lost.values():
        assert hand.any() and not hand.all()
        assert (hand.all(axis=1) == hand.any(axis=1)).all(), "wrist, fingers and tips together"
    assert (lost["left"][:, 0] != lost["right"][:, 0]).any()
    assert result.has_position[:, OTHERS].all()
    np.testing.assert_array_equal(result.has_position, result.has_rotation)
    assert len(HANDS["left"]) == 21


def test_the_rate_and_the_lengths_of_the_spans() -> None:
    """Two hours at six losses a minute: their number to 10 %, their lengths between the shortest and the longest."""
    seconds, rate = 7200.0, 20.0
    wrists = everything_seen(seconds, rate, ("left_wrist", "right_wrist"))
    result = hide_hands(wrists, 6.0, np.random.default_rng(2))
    for hand in (0, 1):
        lost = np.concatenate([[False], ~result.has_position[:, hand], [False]])
        begins, ends = np.flatnonzero(lost[1:] & ~lost[:-1]), np.flatnonzero(lost[:-1] & ~lost[1:])
        lengths = (ends - begins) / rate
        # A loss during another one joins it; as they fall at random, that befalls a known share.
        mean = (LONGEST - SHORTEST) / np.log(LONGEST / SHORTEST)
        expected = 720 * np.exp(-6 / 60 * mean)
        assert len(lengths) == pytest.approx(expected, rel=0.1)
        assert lost.mean() == pytest.approx(1 - np.exp(-6 / 60 * mean), rel=0.1)
        assert lengths.min() >= SHORTEST - 1 / rate and np.median(lengths) < 1.3
        assert np.mean(lengths <= LONGEST + 1 / rate) > 0.9


def test_no_losses() -> None:
    observation = everything_seen(10.0)
    result = hide_hands(observation, 0.0, np.random.default_rng(0))
    np.testing.assert_array_equal(result.position, observation.position)
    one = everything_seen(0.1)
    assert hide_hands(one, 600.0, np.random.default_rng(0)).has_position.all(), "one frame has no duration"


def test_points_without_hands() -> None:
    """A headset alone has no hand to lose."""
    alone = everything_seen(60.0, points=("head",))
    assert hide_hands(alone, 60.0, np.random.default_rng(0)).has_position.all()
