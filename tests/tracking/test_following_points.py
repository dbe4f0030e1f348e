"""Points whose position follows from the measured pose of their parent."""

from dataclasses import replace

import numpy as np

from bodysense.body.person import Person
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet, observe
from bodysense.tracking.tracker import Tracker

FRAMES = 120
POSED = SENSOR_SETS["three_point"]
MORE = replace(POSED, position=(*POSED.position, "pelvis", "spine3", "left_ankle"))
MORE = replace(MORE, rotation=MORE.position)
FOLLOWING = ("left_hip", "spine1", "neck", "right_collar", "left_foot")


def test_they_move_no_other_joint() -> None:
    """Where the network read them, other joints moved by up to 6 cm, and by 1 to 3 mm in the mean."""
    clip = packaged_performance()
    pose, time = clip.pose[:FRAMES], clip.time[:FRAMES]

    def joints(sensors: SensorSet) -> np.ndarray:
        tracker = Tracker(Person(pose.skeleton))
        return tracker.step(observe(pose, time, sensors), tracker.start())[0].points[:, :22]

    alone = joints(MORE)
    for name in FOLLOWING:
        moved = np.linalg.norm(joints(replace(MORE, position=(*MORE.position, name))) - alone, axis=-1)
        assert moved.mean() < 3e-4 and moved.max() < 0.015, (name, moved.mean(), moved.max())
