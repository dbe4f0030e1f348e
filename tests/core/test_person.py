"""Persons that the core refuses."""

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.rigid import RigidTransform
from bodysense.errors import BodysenseError
from bodysense.tracker import Tracker


@pytest.mark.parametrize("far", [3.0, -1e30])
def test_a_tracker_is_worn_on_the_body(far: float) -> None:
    mounts = {"left_ankle": RigidTransform(np.array([0.0, far, 0.0]), np.array([1.0, 0, 0, 0]))}
    with pytest.raises(BodysenseError, match="mounts; give metres"):
        Tracker(Person(mounts=mounts)).start()
