"""Input that no tracker gives: each is refused in one line, by the core and by its Python face."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.observing.observation import Observation
from bodysense.tracking import core
from bodysense.tracking.model import packaged_model
from bodysense.tracking.tracker import Tracker, TrackerSettings, step_together

MOST_PEOPLE = 4096  # BS_MOST_PEOPLE


@pytest.fixture(scope="module")
def frame() -> Observation:
    """One frame of head, hands and shins, whose accelerations are measured."""
    clip = performance_of_unseen_body()
    return observe(clip.pose, clip.time, SENSOR_SETS["three_point_imu_feet"])[30:31]


@pytest.mark.parametrize("people", [-1, 0, MOST_PEOPLE + 1])
def test_impossible_numbers_of_people(people: int) -> None:
    model, refused = packaged_model().core, ctypes.c_int()
    settings = ctypes.byref(TrackerSettings().struct)
    assert core.library().bs_scratch_size(model.pointer, people) == 0
    result = core.library().bs_step(model.pointer, settings, people, None, None, None, None, 0, ctypes.byref(refused))
    assert "people" in core.message(result)


@pytest.mark.slow
def test_as_many_people_as_there_may_be(frame: Observation) -> None:
    tracker = Tracker(Person())
    state = tracker.start()
    together = step_together([(tracker, frame, state)] * MOST_PEOPLE)
    alone, _ = tracker.step(frame, state)
    assert all((one.points == alone.points).all() for one, _ in together)


def test_nobody() -> None:
    for nobody in (lambda: step_together([]), lambda: Tracker([])):
        with pytest.raises(BodysenseError, match="give at least one"):
            nobody()


@pytest.mark.parametrize("value", [np.nan, 1e30, -1e30])
@pytest.mark.parametrize("field", ["position", "rotation", "accuracy", "time", "acceleration"])
def test_values_that_nothing_has(frame: Observation, field: str, value: float) -> None:
    values = np.full_like(getattr(frame, field), value)
    tracker = Tracker()
    if field == "acceleration" or (field, value) == ("accuracy", 1e30):  # absent, with the largest accuracy value
        estimate, _ = tracker.step(replace(frame, **{field: values}), tracker.start())
        assert np.isfinite(estimate.points).all() and np.isfinite(estimate.confidence).all()
    elif field == "time" and np.isfinite(value):
        assert np.isfinite(tracker.step(replace(frame, time=values), tracker.start())[0].points).all()
    else:
        with pytest.raises(BodysenseError) as refused:
            tracker.step(replace(frame, **{field: values}), tracker.start())
        assert "\n" not in str(refused.value)
        assert (field if field == "time" else "'head'") in str(refused.value)


def test_a_library_of_another_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core, "VERSION", core.VERSION + 1)
    core.library.cache_clear()
    try:
        with pytest.raises(BodysenseError, match=r"has version 1, wanted 2; install bodysense again"):
            core.library()
    finally:
        core.library.cache_clear()
