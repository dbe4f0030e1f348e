"""How trackers are worn is refined where motion tells, and only there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bodysense.completion.inputs import frames_of
from bodysense.completion.mounts import WORN, Mounts, mounts_of

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rigid import RigidTransform
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.completion.calibration import calibrated
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe, strapped
from bodysense.observation import Observation
from bodysense.tracker import Tracker

RATE = 30
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
    """A stranger with trackers 8-14 cm off, calibrated in the first second, who moves then."""
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


def refined(observation: Observation, person: Person) -> list[Mounts]:
    """The mounts after every frame."""
    frames, mounts = frames_of(observation, (person,), batched=False), [mounts_of((person,))]
    for t in range(len(frames)):
        mounts.append(mounts[-1].updated(frames[t], np.array([1 / RATE])))
    return mounts[1:]


def errors(observation: Observation, person: Person, mounts: Mounts, pose: Pose) -> dict[str, tuple[float, float]]:
    """m, by joint: how far it is from where it is, as calibrated and as refined."""
    last = frames_of(observation[-1:], (person,), batched=False)[0]
    worn = mounts.worn[0]
    assert worn is not None
    believed = Mounts(mounts.people, (replace(worn, correction=worn.believed),))
    truth = forward_kinematics(pose)[0][-1]
    places = {name: pose.skeleton.index(name) for name in person.mounts if name in WORN}
    after = believed.applied(last)
    return {
        name: (
            float(np.linalg.norm(last.position[0, k] - truth[k])),
            float(np.linalg.norm(after.position[0, k] - truth[k])),
        )
        for name, k in places.items()
    }


def of_all(sensors: str, *goals: dict[str, float]) -> dict[str, np.ndarray]:
    """(16, 2) m by joint, of strangers."""
    rows = []
    for body in range(len(BODIES)):
        observation, person, pose = worn(body, sensors, *goals)
        rows.append(errors(observation, person, refined(observation, person)[-1], pose))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_bows_with_straight_legs_tell_where_the_hips_are() -> None:
    found = of_all("six_point", BOW, BOW)
    before, after = found["pelvis"].T
    assert after.mean() < 0.6 * before.mean()
    assert np.percentile(after, 90) < 0.03
    assert (after < before + 0.003).all()
    assert max(found["left_ankle"].max(), found["right_ankle"].max()) < 0.03


def test_more_trackers_tell_more() -> None:
    found = of_all("ten_point", BOW, SQUAT)
    for name, apart in found.items():
        before, after = apart.T
        assert after.max() < 0.03, name
        assert after.mean() < 0.8 * before.mean(), name


def test_bent_legs_tell_nothing() -> None:
    for body in range(4):
        observation, person, pose = worn(body, "six_point", SQUAT)
        for before, after in errors(observation, person, refined(observation, person)[-1], pose).values():
            assert after < before + 0.003


def test_nothing_jumps() -> None:
    observation, person, _ = worn(3, "ten_point", BOW, SQUAT)
    shown = np.array([one.correction for mounts in refined(observation, person) if (one := mounts.worn[0])])
    assert np.linalg.norm(np.diff(shown, axis=0), axis=-1).max() < 1e-3
    assert np.abs(shown[-1]).max() > 2e-3


def test_who_wears_no_tracker_costs_nothing() -> None:
    pose = moved(default_skeleton(), SQUAT)
    observation = observe(pose, np.arange(len(pose.root_position)) / RATE, SENSOR_SETS["ten_point"])
    frames, mounts = frames_of(observation, (Person(),), batched=False), mounts_of((Person(),))
    frame = frames[0]
    assert mounts.updated(frame, np.array([1.0])) is mounts
    assert mounts.applied(frame) is frame


@pytest.mark.parametrize("kind", ["wild", "still"])
def test_errors_of_tracking_do_no_harm(kind: str) -> None:
    observation, person, _ = worn(2, "ten_point", BOW)
    rng = np.random.default_rng(5)
    position = observation.position.copy()
    if kind == "wild":
        position[RATE:] += rng.uniform(-5, 5, size=position[RATE:].shape)
    else:
        position[RATE:] = position[:1]
    after = refined(replace(observation, position=position), person)[-1].worn[0]
    assert after is not None
    assert np.isfinite(after.mean).all()
    assert np.abs(after.believed).max() <= 0.05
    assert (np.linalg.eigvalsh(after.covariance) > -1e-12).all()


def test_what_was_learned_is_kept_in_the_persons_file(tmp_path: Path) -> None:
    observation, person, pose = worn(1, "ten_point", BOW, SQUAT)
    tracker = Tracker(person)
    _, state = tracker.step(observation, tracker.start())
    state.person().save(tmp_path / "me.json")
    again = Person.load(tmp_path / "me.json")
    k = observation.points.index("pelvis")
    tracked = RigidTransform(observation.position[-1, k], observation.rotation[-1, k])
    truth = forward_kinematics(pose)[0][-1, pose.skeleton.index("pelvis")]
    assert np.allclose(again.mounts["pelvis"].translation, state.person().mounts["pelvis"].translation)
    apart = [np.linalg.norm((tracked @ one.mounts["pelvis"].inverse()).translation - truth) for one in (person, again)]
    assert apart[1] < apart[0]
    assert again.mounts.keys() == person.mounts.keys()


def test_told_mounts_are_kept_and_new_ones_begin_anew() -> None:
    observation, person, _ = worn(1, "ten_point", BOW)
    mounts = refined(observation, person)[-1]
    same = mounts.told((Person(height=1.7, mounts=person.mounts),))
    assert same.worn[0] is mounts.worn[0]
    other = mounts.told((Person(mounts={"pelvis": RigidTransform(np.array([0.0, 0.1, 0.0]))}),)).worn[0]
    assert other is not None and not other.believed.any()
    assert mounts.told((Person(),)).worn[0] is None
