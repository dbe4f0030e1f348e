"""Persons that the core refuses."""

import ctypes

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.tracking import core
from bodysense.tracking.model import packaged_model
from bodysense.tracking.tracker import Tracker


@pytest.mark.parametrize("far", [3.0, -1e30])
def test_a_tracker_is_worn_on_the_body(far: float) -> None:
    mounts = {"left_ankle": RigidTransform(np.array([0.0, far, 0.0]), np.array([1.0, 0, 0, 0]))}
    with pytest.raises(BodysenseError, match="mounts; give metres"):
        Tracker(Person(mounts=mounts)).start()


def test_lengths_that_no_person_has() -> None:
    person = core.person_struct(Person())
    person.lengths, person.length[0] = 1, core.Length(1, 4, 5.0, 0.001)  # a thigh of 5 m
    before = bytes(person)
    result = core.library().bs_person_likeliest(packaged_model().core.pointer, ctypes.byref(person))
    assert "no person has these" in core.message(result) and bytes(person) == before
