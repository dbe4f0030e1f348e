"""The tracker as tables run it: a batch equals each person alone, and steps are timed."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense_lab.completion.score.scenes import TrackedScene, person_of
from bodysense_lab.completion.score.tracking import PeopleTracker, TakeTracker, step_times, track_people


def test_other_people_in_a_batch_change_no_bit(scenes: list[TrackedScene]) -> None:
    some = [scene.beginning(frames) for scene, frames in zip(scenes[1::2], (12, 20, 8), strict=True)]
    seen = [scene.observe(SENSOR_SETS["headset_camera"]) for scene in some]
    people = [person_of("height", scene.skeleton) for scene in some]
    together = track_people(people, seen)
    assert together[1].position.shape == (20, 65, 3) and together[1].rotation.shape == (20, 52, 4)
    for person, one, same in zip(people, seen, together, strict=True):
        (alone,) = track_people([person], [one])
        for name in ("position", "rotation", "confidence", "bound", "contact"):
            np.testing.assert_array_equal(getattr(same, name), getattr(alone, name), err_msg=name)
        assert (same.confidence > 0).all()


def test_steps_are_timed(scenes: list[TrackedScene]) -> None:
    scene = scenes[0].beginning(40)
    taken = step_times(person_of("own", scene.skeleton), scene.observe(SENSOR_SETS["head"]))
    assert len(taken) == 20 and (taken > 0).all()


def test_workers_in_another_folder_find_networks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    one, two = Path("one.safetensors"), Path("two.safetensors")
    sent = [
        pickle.dumps(work) for work in (PeopleTracker(one), PeopleTracker(None), TakeTracker(one, joining_model=two))
    ]
    monkeypatch.chdir("/")
    whole = tmp_path / one
    expected = [PeopleTracker(whole), PeopleTracker(None), TakeTracker(whole, None, tmp_path / two)]
    assert [pickle.loads(work) for work in sent] == expected
