"""Motion refines the mounts of trackers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worn_trackers import BOW, RATE, SQUAT, calibrated_wearer, errors, errors_of_all_bodies, tracked

from bodysense.body.person import Person
from bodysense.geometry.rigid import RigidTransform
from bodysense.tracking.tracker import Tracker, TrackerSettings


def test_bows_with_straight_legs_locate_the_hips() -> None:
    found = errors_of_all_bodies("six_point", BOW, BOW)
    before, after = found["pelvis"].T
    assert after.mean() < 0.6 * before.mean()
    assert np.percentile(after, 90) < 0.03
    assert (after < before + 0.003).all()
    assert max(found["left_ankle"].max(), found["right_ankle"].max()) < 0.03


def test_more_trackers_refine_all_mounts() -> None:
    found = errors_of_all_bodies("ten_point", BOW, SQUAT)
    for name, apart in found.items():
        before, after = apart.T
        assert after.max() < 0.03, name
        assert after.mean() < 0.8 * before.mean(), name


def test_bent_legs_make_no_mount_worse() -> None:
    for body in range(4):
        observation, person, pose = calibrated_wearer(body, "six_point", SQUAT)
        for before, after in errors(observation, pose, person, tracked(observation, person).person()).values():
            assert after < before + 0.003


def test_refinement_causes_no_jump() -> None:
    """The refinement moves the pelvis by less than 3 mm a frame."""
    observation, person, pose = calibrated_wearer(3, "ten_point", BOW, SQUAT)
    pelvis = pose.skeleton.index("pelvis")
    refined, plain = (
        tracker.step(observation, tracker.start())[0].points[:, pelvis]
        for tracker in (Tracker(person), Tracker(person, settings=TrackerSettings(infer=False)))
    )
    assert np.linalg.norm(np.diff(refined - plain, axis=0), axis=-1).max() < 3e-3
    assert np.linalg.norm(refined[-1] - plain[-1]) > 2e-3


@pytest.mark.parametrize("kind", ["wild", "still"])
def test_tracking_errors_hardly_change_mounts(kind: str) -> None:
    observation, person, _ = calibrated_wearer(2, "ten_point", BOW)
    rng = np.random.default_rng(5)
    position = observation.position.copy()
    if kind == "wild":
        position[RATE:] += rng.uniform(-5, 5, size=position[RATE:].shape)
    else:
        position[RATE:] = position[:1]
    after = tracked(replace(observation, position=position), person).person()
    for name, mount in person.mounts.items():
        assert np.abs(after.mounts[name].translation - mount.translation).max() <= 0.05 + 1e-9


def test_learned_mounts_are_kept_in_the_persons_file(tmp_path: Path) -> None:
    observation, person, pose = calibrated_wearer(1, "ten_point", BOW, SQUAT)
    state = tracked(observation, person)
    state.person().save(tmp_path / "me.json")
    again = Person.load(tmp_path / "me.json")
    assert np.allclose(again.mounts["pelvis"].translation, state.person().mounts["pelvis"].translation)
    before, after = errors(observation, pose, person, again)["pelvis"]
    assert after < before
    assert again.mounts.keys() == person.mounts.keys()


def test_unchanged_mounts_keep_their_refinement() -> None:
    observation, person, _ = calibrated_wearer(1, "ten_point", BOW)
    state = tracked(observation, person)
    learned = state.person().mounts["pelvis"].translation
    same = state.with_people([Person(height=1.7, mounts=person.mounts)])
    assert np.array_equal(same.person().mounts["pelvis"].translation, learned)
    assert not np.array_equal(learned, person.mounts["pelvis"].translation)
    other = {"pelvis": RigidTransform(np.array([0.0, 0.1, 0.0]))}
    anew = state.with_people([Person(mounts=other)])
    assert np.array_equal(anew.person().mounts["pelvis"].translation, other["pelvis"].translation)
    assert not state.with_people([Person()]).person().mounts


def test_mounts_of_inertial_sensors_are_unchanged() -> None:
    mounts = {"left_knee_imu": RigidTransform(rotation=np.array([0.0, 1.0, 0.0, 0.0]))}
    assert (
        tracked(calibrated_wearer(1, "six_point", BOW)[0], Person(mounts=mounts)).person().mounts.keys()
        == mounts.keys()
    )
