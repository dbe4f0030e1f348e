"""How trackers are worn is refined where motion tells, and only there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rigid import RigidTransform
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.completion.calibration import calibrated
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe, strapped
from bodysense.observation import Observation
from bodysense.tracker import Tracker, TrackerSettings, TrackerState

RATE = 30
WORN = ("pelvis", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_elbow", "right_elbow")
BODIES = sample_bodies("test", 16)
BOW = {"pelvis": 60.0, "left_hip": -60.0, "right_hip": -60.0}  # degrees about x; the legs stay straight
SQUAT = {f"{side}_{part}": angle for side in ("left", "right") for part, angle in (("hip", -80.0), ("knee", 110.0))}
SQUAT |= {"left_ankle": -30.0, "right_ankle": -30.0}


def moved(skeleton: Skeleton, *goals: dict[str, float]) -> Pose:
    """Stand for a second, then go to each pose and back, in 4 s; the ankles stay where they are."""
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (RATE * (1 + 4 * len(goals)), 1, 1))
    depth = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(4 * RATE) / (4 * RATE))
    for k, goal in enumerate(goals):
        frames = slice(RATE * (1 + 4 * k), RATE * (5 + 4 * k))
        for name, angle in goal.items():
            joint = skeleton.index(name)
            turn = quaternion_exp(depth[:, None] * np.radians([angle, 0.0, 0.0]))
            rotation[frames, joint] = quaternion_multiply(rotation[frames, joint], turn)
    root = np.tile(pose.root_position, (len(rotation), 1))
    ankle = forward_kinematics(Pose(skeleton, root, rotation))[0][:, skeleton.index("left_ankle")]
    return Pose(skeleton, root + ankle[0] - ankle, rotation)


def worn(body: int, sensors: str, *goals: dict[str, float]) -> tuple[Observation, Person, Pose]:
    """An unseen body with trackers 8-14 cm off, calibrated in the first second, that moves then."""
    pose = moved(default_skeleton().with_offsets(BODIES[body]), *goals)
    observation = observe(pose, np.arange(len(pose.root_position)) / RATE, SENSOR_SETS[sensors])
    rng, mounts = np.random.default_rng(body), {}
    for name in observation.points:
        if name in WORN:
            away = rng.standard_normal(3)
            away *= rng.uniform(0.08, 0.14) / np.linalg.norm(away)
            mounts[name] = RigidTransform(away, rng.standard_normal(4))
    observation = strapped(observation, mounts)
    return observation, calibrated(observation[:RATE], Person()), pose


def tracked(observation: Observation, person: Person) -> TrackerState:
    """The state after a whole observation."""
    tracker = Tracker(person)
    return tracker.step(observation, tracker.start())[1]


def errors(observation: Observation, pose: Pose, *people: Person) -> dict[str, list[float]]:
    """Distance (m), by joint, from where it is in the last frame to where each person's mounts put it."""
    truth = forward_kinematics(pose)[0][-1]
    found: dict[str, list[float]] = {}
    for k, name in enumerate(observation.points):
        if name in WORN:
            tracker = RigidTransform(observation.position[-1, k], observation.rotation[-1, k])
            joints = [(tracker @ person.mounts[name].inverse()).translation for person in people]
            found[name] = [float(np.linalg.norm(joint - truth[pose.skeleton.index(name)])) for joint in joints]
    return found


def of_bodies(count: int, sensors: str, *goals: dict[str, float]) -> dict[str, np.ndarray]:
    """(B, 2) m by joint, of unseen bodies: as calibrated, and as refined."""
    rows = []
    for body in range(count):
        observation, person, pose = worn(body, sensors, *goals)
        rows.append(errors(observation, pose, person, tracked(observation, person).person()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_bows_with_straight_legs_tell_where_the_hips_are() -> None:
    found = of_bodies(16, "six_point", BOW, BOW)
    before, after = found["pelvis"].T
    assert after.mean() < 0.6 * before.mean()
    assert np.percentile(after, 90) < 0.03
    assert (after < before + 0.003).all()
    assert max(found["left_ankle"].max(), found["right_ankle"].max()) < 0.03


def test_more_trackers_tell_more() -> None:
    found = of_bodies(6, "ten_point", BOW, SQUAT)
    for name, apart in found.items():
        before, after = apart.T
        assert after.max() < 0.03, name
        assert after.mean() < 0.8 * before.mean(), name


def test_bent_legs_tell_nothing() -> None:
    for body in range(2):
        observation, person, pose = worn(body, "six_point", SQUAT)
        for before, after in errors(observation, pose, person, tracked(observation, person).person()).values():
            assert after < before + 0.003


def test_nothing_jumps() -> None:
    """Less than 1 mm a frame: what the refinement adds to the pelvis, which is output where it is measured."""
    observation, person, pose = worn(3, "ten_point", BOW, SQUAT)
    pelvis = pose.skeleton.index("pelvis")
    refined, plain = (
        tracker.step(observation, tracker.start())[0].points[:, pelvis]
        for tracker in (Tracker(person), Tracker(person, settings=TrackerSettings(infer=False)))
    )
    assert np.linalg.norm(np.diff(refined - plain, axis=0), axis=-1).max() < 3e-3
    assert np.linalg.norm(refined[-1] - plain[-1]) > 2e-3


@pytest.mark.parametrize("kind", ["wild", "still"])
def test_errors_of_tracking_do_no_harm(kind: str) -> None:
    observation, person, _ = worn(2, "ten_point", BOW)
    rng = np.random.default_rng(5)
    position = observation.position.copy()
    if kind == "wild":
        position[RATE:] += rng.uniform(-5, 5, size=position[RATE:].shape)
    else:
        position[RATE:] = position[:1]
    after = tracked(replace(observation, position=position), person).person()
    for name, mount in person.mounts.items():
        assert np.abs(after.mounts[name].translation - mount.translation).max() <= 0.05 + 1e-9


def test_what_was_learned_is_kept_in_the_persons_file(tmp_path: Path) -> None:
    observation, person, pose = worn(1, "ten_point", BOW, SQUAT)
    state = tracked(observation, person)
    state.person().save(tmp_path / "me.json")
    again = Person.load(tmp_path / "me.json")
    assert np.allclose(again.mounts["pelvis"].translation, state.person().mounts["pelvis"].translation)
    before, after = errors(observation, pose, person, again)["pelvis"]
    assert after < before
    assert again.mounts.keys() == person.mounts.keys()


def test_known_mounts_are_kept_and_new_ones_begin_anew() -> None:
    observation, person, _ = worn(1, "ten_point", BOW)
    state = tracked(observation, person)
    learned = state.person().mounts["pelvis"].translation
    same = state.with_people([Person(height=1.7, mounts=person.mounts)])
    assert np.array_equal(same.person().mounts["pelvis"].translation, learned)
    assert not np.array_equal(learned, person.mounts["pelvis"].translation)
    other = {"pelvis": RigidTransform(np.array([0.0, 0.1, 0.0]))}
    anew = state.with_people([Person(mounts=other)])
    assert np.array_equal(anew.person().mounts["pelvis"].translation, other["pelvis"].translation)
    assert not state.with_people([Person()]).person().mounts


def test_an_inertial_sensor_s_mount_is_left_to_the_device() -> None:
    mounts = {"left_knee_imu": RigidTransform(rotation=np.array([0.0, 1.0, 0.0, 0.0]))}
    assert tracked(worn(1, "six_point", BOW)[0], Person(mounts=mounts)).person().mounts.keys() == mounts.keys()
