"""The tracker as tables run it: a batch is what each person gets alone, and every step is timed."""

from __future__ import annotations

import numpy as np

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense_lab.completion.scenes import TrackedScene, person_of, stacked
from bodysense_lab.completion.tracking import step_times, track_batch


def test_a_batch_is_what_each_gets_alone(scenes: list[TrackedScene]) -> None:
    some = [scene.beginning(frames) for scene, frames in zip(scenes[1::2], (20, 12, 8), strict=True)]
    seen = [scene.observe(SENSOR_SETS["headset_camera"]) for scene in some]
    people = [person_of("height", scene.skeleton) for scene in some]
    together = track_batch(people, stacked(seen))
    assert together.position.shape == (3, 20, 65, 3) and together.rotation.shape == (3, 20, 52, 4)
    for index, (person, one) in enumerate(zip(people, seen, strict=True)):
        alone = track_batch([person], stacked([one])).of_person(0, len(one))
        same = together.of_person(index, len(one))
        for name in ("position", "rotation", "confidence", "contact"):
            assert getattr(same, name).shape[0] == len(one)
            np.testing.assert_allclose(getattr(same, name), getattr(alone, name), atol=1e-4, err_msg=name)
    assert (together.confidence > 0).all()


def test_steps_are_timed(scenes: list[TrackedScene]) -> None:
    scene = scenes[0].beginning(40)
    taken = step_times(person_of("own", scene.skeleton), scene.observe(SENSOR_SETS["head"]))
    assert len(taken) == 20 and (taken > 0).all()
