"""Recordings completed with past and future: measured points, no jumps, windows, people, reversed time."""

from __future__ import annotations

import threading
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.device import simulate
from bodysense.devices.simulated.noise import hide
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.formats import bvh
from bodysense.observing import guard
from bodysense.observing.observation import Observation
from bodysense.observing.points import concatenated_frames
from bodysense.takes import two_way
from bodysense.takes.track import track
from bodysense.takes.two_way import TwoWayTracker, crossfade, reverse_time
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.model import packaged_model
from bodysense.tracking.tracker import Tracker, TrackerSettings

SECONDS = 1 / 30


@pytest.fixture(scope="module")
def seen(waving_clip: Clip) -> Observation:
    return simulate(waving_clip, "six_point")


@pytest.fixture(scope="module")
def person(waving_clip: Clip) -> Person:
    return Person(waving_clip.pose.skeleton)


def complete(person: Person, seen: Observation, settings: TrackerSettings = TrackerSettings()) -> Estimate:
    return TwoWayTracker(person, None, settings).complete(seen, SECONDS)


def lost(seen: Observation, name: str, first: int, end: int) -> Observation:
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    hidden[first:end, seen.points.index(name)] = True
    return hide(seen, hidden)


def test_measured_points_are_reached(seen: Observation, person: Person) -> None:
    """Points are as near as in the causal result; the spine is not always long enough to reach from head to pelvis."""
    places = person.skeleton.indices(seen.points)
    causal, _ = (tracker := Tracker(person)).step(seen, tracker.start())
    off, alone = (
        np.linalg.norm(one.points[:, places] - seen.position, axis=-1) for one in (complete(person, seen), causal)
    )
    assert (off.mean(axis=0) < alone.mean(axis=0) + 0.001).all()
    assert off[:, :3].max() < 2e-3


def test_bones_keep_their_lengths_and_points_are_of_the_pose(seen: Observation, person: Person) -> None:
    estimate = complete(person, lost(seen, "left_wrist", 20, 60))
    np.testing.assert_allclose(np.asarray(forward_kinematics(estimate.pose)[0]), estimate.points, atol=1e-9)
    np.testing.assert_array_equal(estimate.pose.skeleton.rest_offset, person.skeleton.rest_offset)
    np.testing.assert_allclose(np.linalg.norm(estimate.pose.rotation, axis=-1), 1, atol=1e-9)


@pytest.mark.parametrize("frames", [1, 3, 15, 45])
def test_a_found_wrist_does_not_jump(seen: Observation, person: Person, waving_clip: Clip, frames: int) -> None:
    first = 25
    gap = lost(seen, "left_wrist", first, first + frames)
    wrist = person.skeleton.index("left_wrist")
    truth = np.linalg.norm(np.diff(np.asarray(forward_kinematics(waving_clip.pose)[0])[:, wrist], axis=0), axis=-1)
    path = np.linalg.norm(np.diff(complete(person, gap).points[:, wrist], axis=0), axis=-1)
    edges = [first - 1, first, first + frames - 1, min(first + frames, len(path) - 1)]
    assert (path[edges] < truth.max() + 0.05).all()


def test_bridged_frames_are_not_measured(seen: Observation, person: Person, waving_clip: Clip) -> None:
    """A wrist that is lost for a tenth of a second is near its true position, and reported as hidden."""
    wrist = person.skeleton.index("left_wrist")
    estimate = complete(person, lost(seen, "left_wrist", 30, 33))
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])[:, wrist]
    assert not estimate.measured[30:33, wrist].any() and estimate.measured[[29, 33], wrist].all()
    assert np.linalg.norm(estimate.points[30:33, wrist] - truth[30:33], axis=-1).max() < 0.02


def test_tracked_rotations_are_kept(person: Person, waving_clip: Clip) -> None:
    """Sensors of rotation alone on the shins, and controllers."""
    shins = simulate(waving_clip, "three_point_imu_feet")
    estimate = complete(person, shins)
    turned = np.asarray(forward_kinematics(estimate.pose)[1])
    for name in ("head", "left_wrist", "right_wrist", "left_knee", "right_knee"):
        off = geodesic_angle(turned[:, person.skeleton.index(name)], shins.rotation[:, shins.points.index(name)])
        assert np.degrees(off).max() < 0.5, name


def test_later_frames_improve_the_estimate(seen: Observation, person: Person) -> None:
    """Before a wrist is first seen, the causal result cannot know its position; the two-way result leads to it."""
    late = lost(seen, "left_wrist", 0, 40)
    wrist = person.skeleton.index("left_wrist")
    causal, _ = (tracker := Tracker(person)).step(late, tracker.start())
    wanted = seen.position[39, seen.points.index("left_wrist")]
    both = complete(person, late)
    off, alone = (np.linalg.norm(one.points[39, wrist] - wanted) for one in (both, causal))
    assert off < 0.06 and off < alone


def test_windows_join_into_one_motion(seen: Observation, person: Person, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = complete(person, seen)
    for name, value in (("WINDOW", 1.0), ("BESIDE", 0.6), ("FADE", 0.4)):
        monkeypatch.setattr(two_way, name, value)
    done: list[int] = []
    parts = TwoWayTracker(person, None, TrackerSettings()).complete(seen, SECONDS, done.append)
    assert len(parts.contact) == len(seen) == sum(done) and len(done) > 1
    assert np.linalg.norm(parts.points - whole.points, axis=-1)[:, : len(person.skeleton.joints)].mean() < 0.02
    step, usual = (np.linalg.norm(np.diff(one.points, axis=0), axis=-1).max() for one in (parts, whole))
    assert step < usual + 0.02


def test_a_recording_with_a_pause_is_split(seen: Observation, person: Person) -> None:
    """A pause of more than a second resets the motion in both directions."""
    time = seen.time + np.where(np.arange(len(seen)) < 45, 0.0, 10.0)
    paused = complete(person, replace(seen, time=time))
    first, second = (complete(person, seen[part]) for part in (slice(0, 45), slice(45, None)))
    np.testing.assert_allclose(paused.points[:45], first.points, atol=1e-6)
    np.testing.assert_allclose(paused.points[45:], second.points, atol=1e-6)


def test_both_passes_run_at_the_same_time(seen: Observation, person: Person, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each waits for the other in the middle of its work; the estimate is that of passes one after the other."""
    alone, step, both = complete(person, seen), Tracker.step, threading.Barrier(2, timeout=60)

    def waiting(tracker: Tracker, *given: Any) -> Any:
        both.wait()
        return step(tracker, *given)

    monkeypatch.setattr(Tracker, "step", waiting)
    together = complete(person, seen)
    tracker = TwoWayTracker(person, None, TrackerSettings())
    monkeypatch.undo()
    forward, _ = tracker.tracker.step(seen, tracker.tracker.start())
    joined = tracker.joined(forward, tracker.backward(seen), tracker.turned(seen), SECONDS)
    for name in ("points", "confidence", "bound", "contact"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(together, name), getattr(joined, name))


def test_each_direction_has_a_network(seen: Observation, person: Person) -> None:
    ways, own = TwoWayTracker(person, None, TrackerSettings()), packaged_model()
    alone = TwoWayTracker(person, own, TrackerSettings())
    reverse = reverse_time(seen)
    for tracker, model in ((ways, packaged_model(backward=True)), (alone, own)):
        expected, _ = (one := Tracker(person, model, tracker.tracker.settings)).step(reverse, one.start())
        np.testing.assert_array_equal(tracker.backward(seen).points[::-1], expected.points)
    assert np.abs(ways.backward(seen).points - alone.backward(seen).points).max() > 0.01


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames(seen: Observation, person: Person, frames: int) -> None:
    assert np.isfinite(complete(person, seen[:frames]).points).all()


def test_reversed_twice_is_unchanged(seen: Observation) -> None:
    rng = np.random.default_rng(1)
    felt = replace(seen, acceleration=rng.normal(size=seen.position.shape))
    back = reverse_time(reverse_time(felt))
    for name in ("position", "rotation", "has_position", "time", "acceleration"):
        np.testing.assert_array_equal(getattr(back, name), getattr(felt, name))
    once = reverse_time(felt)
    assert (np.diff(once.time) > 0).all() and once.acceleration is not None
    np.testing.assert_array_equal(once.acceleration[0], felt.acceleration[-1])  # type: ignore[index]


def test_the_person_is_inferred_before_both_passes(waving_clip: Clip) -> None:
    """An unknown body has one size in all frames: the one inferred after the last frame."""
    tall = waving_clip.pose.skeleton.scaled(1.9)
    clip = Clip("tall", Pose(tall, waving_clip.pose.root_position * 1.1, waving_clip.pose.rotation), 30.0)
    seen = simulate(clip, "six_point")
    found = TwoWayTracker(Person(), None, TrackerSettings()).inferred_person(seen)
    estimate = complete(found, seen)
    assert (estimate.rest_offset == estimate.rest_offset[0]).all()
    np.testing.assert_allclose(estimate.rest_offset[0], found.skeleton.rest_offset, atol=1e-6)
    likeliest = default_skeleton().height
    assert abs(found.skeleton.height - tall.height) < abs(likeliest - tall.height)


def test_a_longer_take_needs_no_more_memory_than_its_result(
    seen: Observation, person: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory is needed for windows; each frame adds 4.3 kB of estimate, 0.1 kB of points, and 0.8 kB of GLB."""
    monkeypatch.setattr(two_way, "WINDOW", 2.0)
    monkeypatch.setattr(two_way, "BESIDE", 1.0)
    monkeypatch.setattr(bvh, "_BLOCK", 64)  # frames

    def peaks(frames: int) -> np.ndarray:
        long = concatenated_frames([seen] * -(-frames // len(seen)))[:frames]
        long = replace(long, time=np.arange(frames) * SECONDS)
        tracemalloc.start()
        take = track(long, person=person)
        found = [tracemalloc.get_traced_memory()[1]]
        for name in ("long.bvh", "long.glb"):
            tracemalloc.reset_peak()
            take.save(tmp_path / name)
            found.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        return np.array(found)

    peaks(90)  # loads the networks
    per_frame = (peaks(480) - peaks(180)) / 300  # both with more than two blocks of a BVH file
    assert (per_frame < [5000, 5000, 6000]).all()


def test_a_crossfade_leads_from_one_body_to_the_other(seen: Observation, person: Person) -> None:
    """The windows agree in practice, so the direction of the fade shows only with two different bodies."""
    after = complete(person, seen[:12])
    turn = quaternion_exp(np.array([0.0, 0.6, 0.0]))
    pose = replace(
        after.pose,
        root_position=np.asarray(after.pose.root_position) + np.array([0.5, 0.0, 0.0]),
        rotation=quaternion_multiply(np.asarray(after.pose.rotation), turn),
    )
    frames = 7
    faded = crossfade(replace(after, pose=pose), after, frames)
    root = np.asarray(faded.pose.root_position - after.pose.root_position)[:, 0]
    angle = geodesic_angle(np.asarray(faded.pose.rotation), np.asarray(after.pose.rotation)).max(axis=1)
    for share in (root / 0.5, angle / 0.6):
        assert share[0] > 0.9 and share[frames - 1] < 0.1
        assert share[frames // 2] == pytest.approx(0.5, abs=0.02)
        assert (np.diff(share[:frames]) < 0).all() and np.abs(share[frames:]).max() < 1e-6
    position = np.asarray(forward_kinematics(faded.pose)[0])
    np.testing.assert_allclose(faded.points[:frames], position[:frames], atol=1e-6)


@pytest.mark.parametrize("causal", [False, True])
def test_worlds_of_takes_are_not_watched(waving_clip: Clip, monkeypatch: pytest.MonkeyPatch, causal: bool) -> None:
    """The guard's notices are for live input; its looks would take a sixth of the time of a short take."""

    def look(*_: object) -> list[tuple[str, str]]:
        raise AssertionError("a take was watched")

    monkeypatch.setattr(guard, "_doubts", look)
    assert len(track(waving_clip, device="three_point", height=1.75, causal=causal).time) == len(waving_clip)
