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
KNUCKLES = tuple(f"left_{finger}1" for finger in ("index", "middle", "ring", "pinky"))
FOLLOWING = [(POSED, KNUCKLES)]
FOLLOWING += [(MORE, (name,)) for name in ("left_hip", "spine1", "neck", "right_collar", "left_foot")]


def test_they_move_no_other_joint() -> None:
    """The network read them, as it rarely did in training: other joints moved by up to 7 cm, and by 0.2 to 1 cm."""
    clip = packaged_performance()
    pose, time = clip.pose[:FRAMES], clip.time[:FRAMES]

    def joints(sensors: SensorSet) -> np.ndarray:
        tracker = Tracker(Person(pose.skeleton))
        return tracker.step(observe(pose, time, sensors), tracker.start())[0].points[:, :22]

    alone = {id(sensors): joints(sensors) for sensors, _ in FOLLOWING}
    for sensors, names in FOLLOWING:
        more = joints(replace(sensors, position=(*sensors.position, *names)))
        moved = np.linalg.norm(more - alone[id(sensors)], axis=-1)
        assert moved.mean() < 3e-4 and moved.max() < 0.015, (names, moved.mean(), moved.max())
