"""The referee's verdict on this project's tracker."""

from __future__ import annotations

import numpy as np

from bodysense.body.person import Person
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.tracking.tracker import Tracker
from bodysense_conform.evaluate import find
from bodysense_conform.table import table

from .conftest import HANG, RATE, RELAXED, about, both, given_out, leg, planted, swung


def test_feet_of_a_seated_wearer_are_on_the_floor_from_head_and_hands() -> None:
    """Hands are in the lap: the network was not trained on seated bodies with stretched arms (docs/conform.md)."""
    skeleton, stand = default_skeleton().with_offsets(sample_bodies("test", 3)[2]), HANG | RELAXED
    lap = (
        stand
        | both(shoulder=about(y=-25.0, z=-65.0), elbow=about(y=-60.0))
        | leg("left", 88, 88)
        | leg("right", 88, 88)
    )
    rotation, steps = swung(
        skeleton,
        [
            ("stand", 3.0, [(0.0, stand), (1.0, stand)]),
            ("sit", 5.0, [(0.25, lap), (0.9, lap), (1.0, lap)]),
            ("remount", 1.0, [(0.0, stand), (1.0, stand)]),
            ("other", 1.0, [(0.0, stand), (1.0, stand)]),
        ],
    )
    pose = planted(skeleton, rotation)
    tracker = Tracker(Person(skeleton))
    seen = observe(pose, np.arange(len(rotation)) / RATE, THREE_POINT)
    found = tracker.step(seen, tracker.start())[0].pose
    subject = given_out(found, steps)
    sitting = [check for check in table().checks if check.group == "sit"]
    assert {check.id: find(check, subject).outcome for check in sitting} == {check.id: "pass" for check in sitting}
