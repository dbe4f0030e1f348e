"""Points whose position follows from the measured pose of their parent."""

from dataclasses import replace

import numpy as np

from bodysense.body.person import Person
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.tracking.tracker import Tracker

FRAMES = 120
POSED = SENSOR_SETS["three_point"]
MORE = replace(POSED, position=(*POSED.position, "pelvis", "spine3", "left_ankle"))
MORE = replace(MORE, rotation=MORE.position)
FOLLOWING = ("left_hip", "spine1", "neck", "right_collar", "left_foot")


SIDES = ("left", "right")
PARTS = ("pelvis", "spine1", "spine3", "neck", *(f"{side}_{part}" for side in SIDES for part in ("collar", "ankle")))
ANY = ("spine1", "spine2", "spine3", "neck", *(f"{side}_{k}" for side in SIDES for k in ("hip", "collar", "shoulder")))


def joints(sensors: SensorSet) -> np.ndarray:
    """Positions (T, 22, 3) of a known body's joints, m."""
    clip = packaged_performance()
    pose, tracker = clip.pose[:FRAMES], Tracker(Person(clip.pose.skeleton))
    return tracker.step(observe(pose, clip.time[:FRAMES], sensors), tracker.start())[0].points[:, :22]


def moved_by(name: str, sensors: SensorSet, alone: np.ndarray) -> np.ndarray:
    """Distances (T, 22) by which joints move if a position is tracked, too, m."""
    more = replace(sensors, position=(*sensors.position, name))
    return np.linalg.norm(joints(more) - alone, axis=-1)


def test_they_move_no_other_joint() -> None:
    """Where the network read them, other joints moved by up to 6 cm, and by 1 to 3 mm in the mean."""
    alone = joints(MORE)
    for name in FOLLOWING:
        moved = moved_by(name, MORE, alone)
        assert moved.mean() < 3e-4 and moved.max() < 0.015, (name, moved.mean(), moved.max())


def test_with_any_poses_they_move_others_little() -> None:
    """The fit of trunk and arms meets spines and shoulders, by which others move by half a millimetre."""
    rng, skeleton = np.random.default_rng(46), default_skeleton()
    for _ in range(6):
        posed = (*POSED.position, *(name for name in PARTS if rng.uniform() < 0.4))
        sensors = SensorSet(posed, posed)
        parent = {name: skeleton.points[skeleton.parents[skeleton.index(name)]] for name in ANY}
        following = [name for name in ANY if name not in posed and parent[name] in posed]
        alone = joints(sensors)
        for name in rng.permutation(following)[:2]:
            moved = moved_by(str(name), sensors, alone)
            assert moved.mean() < 1e-3 and moved.max() < 0.015, (posed, name, moved.mean(), moved.max())
