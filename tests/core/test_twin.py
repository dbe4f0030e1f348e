"""The core's features, networks and expected errors equal their slow twin, whatever is tracked, of whomever."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense.tracking.tracker import Tracker, TrackerState

from .twin.cases import DEVICES, Case, cases, observation_of, person_of
from .twin.points import HAND_JOINTS
from .twin.step import Twin
from .twin.vectors import Tie

DISTANCE = 1e-4  # m
CONTACT = 1e-4  # probability
# Between two advances of the memory the core keeps no states of its lower layer, so that the twin's own are rounded to
# bytes, of which one may be the next of 127 steps: these tolerances are then wider.
BETWEEN_ADVANCES, BOUND_SHARE = 10, 1e-3  # times the tolerance, and a share of a value, of bounds of metres
FINGER_AXIS = 1e-3  # of a rotation matrix: products round what they read to 16 bits
STATE = 5e-4  # of a recurrent layer's states
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
    observation, tracker = observation_of(case), Tracker(person_of(case), settings=case.settings)
    twin, state = Twin(case.settings), tracker.start()
    for t in range(case.frames):
        estimate, state = tracker.step(observation[t : t + 1], state)
        try:
            own = twin.step(observation, t, state.person(), estimate, hidden_of(state, twin))
        except Tie:
            assume(t > case.frames // 4)
            return
        body, hands = hidden_of(state, twin)
        what = f"frame {t} of {case}"
        for mine, layer in zip([*twin.memory.hidden, twin.memory.hands], [*body, hands], strict=True):
            np.testing.assert_allclose(mine, layer, rtol=0, atol=STATE, err_msg=what)
        twin.memory.hidden, twin.memory.hands = body, hands
        for name, most in (("confidence", DISTANCE), ("bound", DISTANCE), ("contact", CONTACT)):
            values = getattr(estimate, name)[0]
            share, off = (0.0, most) if twin.memory.advances else (BOUND_SHARE, most * BETWEEN_ADVANCES)
            np.testing.assert_allclose(getattr(own, name), values, rtol=share, atol=off, err_msg=f"{name} of {what}")
        fingers = quaternion_to_matrix(estimate.pose.rotation[0, np.concatenate(HAND_JOINTS)])
        np.testing.assert_allclose(own.fingers, fingers, rtol=0, atol=FINGER_AXIS, err_msg=f"fingers of {what}")


@pytest.mark.parametrize("device", DEVICES)
@given(data=st.data())
@settings(max_examples=3, derandomize=True)  # 63 draws of all devices
def test_core_equals_its_twin(device: str, data: st.DataObject) -> None:
    check(data.draw(cases(device, 7)))


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
@given(data=st.data())
@settings(max_examples=4, derandomize=True)
def test_core_equals_its_twin_for_longer(device: str, data: st.DataObject) -> None:
    check(data.draw(cases(device, 50)))
