"""Labels of passive markers: points without names, in any order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.optimize import linear_sum_assignment

from bodysense.body.hands.glove import glove_points
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.labels.assignment import assignment
from bodysense.devices.gloves.labels.labelling import Labeller
from bodysense.devices.simulated.glove import observe
from bodysense.devices.simulated.noise import hide
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.markers.raw_markers import points_alone
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points
from bodysense_lab.papers.two_hands.score.limits import label_accuracy


@pytest.fixture(scope="module")
def hands(waving_clip: Clip) -> Mapping[str, Skeleton]:
    skeleton = waving_clip.pose.skeleton
    return {"left": hand_skeleton(skeleton, "left"), "right": hand_skeleton(skeleton, "right")}


@pytest.fixture(scope="module")
def gloves(waving_clip: Clip) -> Observation:
    """Gloves of a waving body, one and a half seconds at 120 Hz, a usual rate of optical capture."""
    clip = resample(waving_clip, 120.0)
    return observe(clip.pose, clip.time)[:180]


@given(
    cost=hnp.arrays(
        float,
        st.tuples(st.integers(1, 7), st.integers(0, 6)).map(lambda size: (size[0], size[0] + size[1])),
        elements=st.sampled_from([0.0, 1.0, 2.0, 3.5]) | st.floats(-5, 5),
    )
)
def test_assignments_have_the_least_cost(cost: np.ndarray) -> None:
    chosen = assignment(cost)
    assert len(set(chosen.tolist())) == len(cost)
    rows, columns = linear_sum_assignment(cost)
    assert cost[np.arange(len(cost)), chosen].sum() == pytest.approx(cost[rows, columns].sum(), abs=1e-9)


def test_impossible_assignments_are_minus_one() -> None:
    cost = np.array([[1.0, np.inf, np.inf], [np.inf, np.inf, np.inf], [2.0, np.inf, 5.0]])
    np.testing.assert_array_equal(assignment(cost), [0, -1, 2])
    assert assignment(np.zeros((0, 3))).shape == (0,)


def shuffled(gloves: Observation, rng: np.random.Generator) -> Observation:
    """Return the points of every frame in random order, with arbitrary names."""
    order = rng.permuted(np.tile(np.arange(len(gloves.points)), (len(gloves), 1)), axis=1)
    position = np.take_along_axis(gloves.position, order[..., None], axis=1)
    return points_alone(tuple(f"point {k}" for k in range(len(gloves.points))), position, gloves.time)


def test_points_of_both_gloves_are_labelled(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    labeller = Labeller(hands)
    found, _ = labeller.step(shuffled(gloves, np.random.default_rng(0)), labeller.start())
    assert found.points == gloves.points
    np.testing.assert_array_equal(found.position, gloves.position)


def test_one_call_equals_many(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    labeller, points = Labeller(hands), shuffled(gloves, np.random.default_rng(1))[:20]
    whole, _ = labeller.step(points, labeller.start())
    state, rows = labeller.start(), []
    for t in range(len(points)):
        frame, state = labeller.step(points[t : t + 1], state)
        rows.append(frame.position)
    np.testing.assert_array_equal(np.concatenate(rows), whole.position)


def test_one_hand_is_labelled_among_other_points(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    left = chosen_points(gloves, range(9))
    score = label_accuracy(left, {"left": hands["left"]}, np.random.default_rng(2), ghosts=3)
    assert score.right > 0.98 and score.wrong < 0.02 and score.markers == left.has_position.sum()


def test_labels_are_repaired_after_occlusion(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    hidden = np.zeros(gloves.has_position.shape, dtype=bool)
    hidden[20:30, :9] = True  # a whole hand
    hidden[40:55, [9, 14]] = True  # two markers of the other
    seen = hide(gloves, hidden)
    score = label_accuracy(seen, hands, np.random.default_rng(3))
    assert score.right > 0.98 and score.wrong < 0.01


def test_swapped_hands_are_corrected(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    labeller, points = Labeller(hands), shuffled(gloves, np.random.default_rng(5))
    _, state = labeller.step(points[:60], labeller.start())
    mirror = np.array([-1.0, 1.0, 1.0])
    wrong = [
        hand._replace(place=hand.place * mirror, velocity=hand.velocity * mirror) for hand in reversed(state.hands)
    ]
    found, _ = labeller.step(points[60:120], state._replace(hands=tuple(wrong)))
    np.testing.assert_array_equal(found.position[30:], gloves.position[90:120])


def test_larger_hands_are_labelled(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    larger = replace(gloves, position=gloves.position * 1.15)
    assert label_accuracy(larger, hands, np.random.default_rng(4)).right > 0.98


@given(seed=st.integers(0, 1000), count=st.integers(0, 25))
@settings(max_examples=25)
def test_every_label_is_used_at_most_once(hands: Mapping[str, Skeleton], seed: int, count: int) -> None:
    rng, labeller = np.random.default_rng(seed), Labeller(hands)
    state = labeller.start()
    for t in range(3):
        labels, state = labeller.label(rng.normal(scale=0.1, size=(count, 3)), t / 60, state)
        given = labels[labels >= 0]
        assert labels.shape == (count,) and len(set(given.tolist())) == len(given)
        assert (given < 2 * len(glove_points("left"))).all()


def test_wrong_times_and_empty_recordings_are_refused(gloves: Observation, hands: Mapping[str, Skeleton]) -> None:
    labeller = Labeller(hands)
    _, state = labeller.step(gloves[:2], labeller.start())
    with pytest.raises(BodysenseError, match="give frames in order of time"):
        labeller.step(gloves[1:2], state)
    nothing = hide(gloves, np.ones(gloves.has_position.shape, dtype=bool))
    with pytest.raises(BodysenseError, match="nothing to label"):
        label_accuracy(nothing, hands, np.random.default_rng(0))
