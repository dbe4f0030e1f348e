"""The core equals its slow twin, whatever is tracked, of whomever, at any rate."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bodysense.geometry.rotation import geodesic_angle
from bodysense.tracking.tracker import Tracker, TrackerState

from .twin.cases import DEVICES, Case, cases, observation_of, person_of
from .twin.limbs import LIMBS
from .twin.points import BODY, JOINTS, NECK, SPINE1, SPINE2, SPINE3
from .twin.step import Twin
from .twin.vectors import STRAIGHT, Tie

DISTANCE, ANGLE = 1e-4, 0.01  # m, degrees
FINGER_ANGLE = 0.05  # degrees: fingers are predicted from the turn of the wrist, rounded to 16 bits
STATE = 1e-3  # of a recurrent layer's states: another of 127 steps, times a weight
MEMORY_HEADER = 140  # numbers of a memory before those of the recurrent layers


def hidden_of(state: TrackerState, twin: Twin) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the memory of the core's recurrent layers, in the twin's form."""
    body, hands = twin.memory.hidden, twin.memory.hands
    floats = MEMORY_HEADER + sum(layer.size for layer in body) + hands.size
    memory = state.memory[0].tobytes()[-(-floats * 4 // 64) * -64 :]  # at the end, in whole lines of the cache
    values = np.frombuffer(memory, np.float32)[MEMORY_HEADER:floats].astype(float)
    of_body, of_hands = np.split(values, [sum(layer.size for layer in body)])
    layers = of_body.reshape(2, len(body), -1).transpose(1, 2, 0)
    return list(layers), of_hands.reshape(2, -1).T


def check(case: Case) -> None:
    """Step both, and compare them in each frame.

    Products round features to 16 bits and states to 8, where differences in the last bit grow to that rounding. So that
    they stay small, what the recurrent layers remember is compared in each frame, and the twin uses the core's then.
    Comparison ends at a tie, which hardly any draw has.
    """
    observation, person = observation_of(case), person_of(case)
    tracker, twin = Tracker(person, settings=case.settings), Twin(person, case.settings)
    state = tracker.start()
    for t in range(case.frames):
        estimate, state = tracker.step(observation[t : t + 1], state)
        try:
            own = twin.step(observation, t, hidden_of(state, twin))
        except Tie:
            assume(t > case.frames // 4)
            return
        body, hands = hidden_of(state, twin)
        what = f"frame {t} of {case}"
        for mine, layer in zip([*twin.memory.hidden, twin.memory.hands], [*body, hands], strict=True):
            np.testing.assert_allclose(mine, layer, rtol=0, atol=STATE, err_msg=what)
        twin.memory.hidden, twin.memory.hands = body, hands
        angle = np.degrees(geodesic_angle(own.rotation, estimate.pose.rotation[0]))
        beyond = angle - most_angles(estimate.points[0])
        assert beyond.max() <= 0, (what, most_turned(estimate.pose.skeleton.points, angle))
        for name in ("points", "confidence", "bound", "rest_offset", "contact"):
            values = getattr(estimate, name)[0]
            np.testing.assert_allclose(getattr(own, name), values, rtol=0, atol=DISTANCE, err_msg=f"{name} of {what}")
        np.testing.assert_array_equal(own.measured, estimate.measured[0], err_msg=what)


def most_angles(point: np.ndarray) -> np.ndarray:
    """Return how much each joint (52,) may be turned differently, degrees, by places (65, 3) m."""
    most = np.where(np.arange(JOINTS) < BODY, ANGLE, FINGER_ANGLE)
    chains = [(limb.start, limb.middle, limb.end) for limb in LIMBS.values()]
    for chain in (*chains, (NECK, SPINE2, SPINE1), (SPINE3, SPINE2, SPINE1)):
        start, middle, end = point[list(chain)]
        longest = np.linalg.norm(middle - start) + np.linalg.norm(end - middle)
        # Stretched to a share s of its length, a limb or spine turns by 1 / sqrt(1 - s²) as much as places differ.
        share = min(np.linalg.norm(end - start) / longest, STRAIGHT)
        most[list(chain)] = np.maximum(most[list(chain)], ANGLE / np.sqrt(1 - share**2))
    return most


def most_turned(points: tuple[str, ...], angle: np.ndarray) -> str:
    """The joint that is turned differently, and by how much."""
    return f"{points[int(angle.argmax())]}: {angle.max():.4f}°"


@pytest.mark.parametrize("device", DEVICES)
@given(data=st.data())
@settings(max_examples=2, derandomize=True)
def test_core_equals_its_twin(device: str, data: st.DataObject) -> None:
    check(data.draw(cases(device, 7)))


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
@given(data=st.data())
@settings(max_examples=6, derandomize=True)
def test_core_equals_its_twin_for_longer(device: str, data: st.DataObject) -> None:
    check(data.draw(cases(device, 50)))
