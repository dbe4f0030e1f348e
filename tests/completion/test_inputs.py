"""Accelerations on their way to the network: each in its sensor's place, and absent where none is told."""

from dataclasses import replace

import numpy as np
from bodysense.completion.inputs import frames_of, frames_together

from bodysense.body.person import Person
from bodysense.observation import STRAPPED, Observation, observe

TURN = [1.0, 0.0, 0.0, 0.0]


def example() -> Observation:
    poses = {"head": ([0.0, 1.6, 0.0], TURN), "right_knee": (None, TURN), "neck": (None, TURN)}
    seen = observe(0.5, poses)
    felt = np.array([[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]])
    return replace(seen, acceleration=felt)


def test_accelerations_reach_the_sensors_that_are_heeded() -> None:
    frames = frames_of(example(), [Person()], batched=False)
    knee = STRAPPED.index("right_knee")
    assert frames.has_acceleration.shape == (1, 1, len(STRAPPED))
    assert np.flatnonzero(frames.has_acceleration[0, 0]).tolist() == [knee]
    assert frames.acceleration[0, 0, knee].tolist() == [4, 5, 6]
    assert np.abs(np.delete(frames.acceleration[0, 0], knee, axis=0)).max() == 0


def test_absent_accelerations_are_finite() -> None:
    hidden = example()
    assert hidden.acceleration is not None
    hidden = replace(hidden, acceleration=np.full_like(hidden.acceleration, np.nan))
    for observation in (hidden, replace(hidden, acceleration=None)):
        frames = frames_of(observation, [Person()], batched=False)
        assert not frames.has_acceleration.any() and not frames.acceleration.any()


def test_people_with_and_without_accelerations_go_together() -> None:
    told, without = example(), replace(example(), acceleration=None)
    frames = frames_together([without, told], [Person(), Person()])
    assert frames.has_acceleration.any(axis=-1).tolist() == [False, True]
