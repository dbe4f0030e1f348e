"""Video device: landmarks in, points of a body in the room out, after the look-ahead."""

from __future__ import annotations

import pickle
import weakref
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, HAND_POINTS, SIDES
from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.devices.video.camera_level import remove_roll
from bodysense.devices.video.device import POINTS, VideoDevice, VideoSettings
from bodysense.devices.video.landmark_smoothing import smooth_frame
from bodysense.devices.video.landmarks import BODY_LANDMARKS, Bodies, HandLandmarks, Landmarker
from bodysense.devices.video.person import PersonState, arm_keypoints, follow
from bodysense.devices.video.pictures import Picture, VideoBrokenError
from bodysense.devices.video.watching import WatchedFrames, watch
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.observing.observation import LANDMARK_ACCURACY
from bodysense.tracking.model import CompletionModel
from bodysense.tracking.tracker import Tracker, TrackerSettings

from ..conftest import FIELDS, SKELETON, observed, seen_by, together, walking

RATE = 30.0


@pytest.mark.parametrize("known", [True, False], ids=["tilt given", "tilt seen"])
def test_points_are_at_their_true_positions(make_device: Any, known: bool) -> None:
    device = make_device(0.25, tilt=12.0 if known else None)
    pose = walking()
    person = seen_by(pose, device.focal)
    parts = observed(device, person, 1)
    seen = together(parts)
    true = np.asarray(forward_kinematics(pose)[0])[:, SKELETON.indices(POINTS)]
    assert set(np.array(POINTS)[seen.has_position.all(axis=0)]) == {
        "head",
        *(f"{side}_{part}" for side in SIDES for part in ("shoulder", "knee", "ankle", "foot", "toe")),
    }
    at = seen.has_position[0]
    relative = seen.position[:, at] - seen.position[:1, at].mean(axis=1, keepdims=True)
    wanted = true[:, at] - true[:1, at].mean(axis=1, keepdims=True)
    # The depth's smoothing lags behind a steady walk.
    assert np.abs(relative - wanted)[..., 0].mean() < 0.05 and np.abs(relative - wanted)[..., 2].mean() < 0.15
    np.testing.assert_allclose(seen.position[:, at, 1], true[:, at, 1], atol=0.06)
    soles = [k for k, name in enumerate(POINTS) if "ankle" in name or "toe" in name]
    np.testing.assert_allclose(seen.position[:, soles, 1], true[:, soles, 1], atol=0.03)
    head = POINTS.index("head")
    truth = np.asarray(forward_kinematics(pose)[1])[:, SKELETON.index("head")]
    assert np.degrees(geodesic_angle(seen.rotation[:, head], truth)).max() < 6  # a face's lines are not quite level
    # The output camera projects points onto their landmarks.
    place, axes = (np.concatenate([getattr(part.camera, name) for part in parts]) for name in ("position", "axes"))
    local = np.einsum("tpi,tij->tpj", seen.position - place[:, None], axes)
    for side in SIDES:
        for part in ("shoulder", "knee", "ankle"):
            where = local[:, POINTS.index(f"{side}_{part}")]
            projected = device.focal * where[:, :2] / -where[:, 2:]
            assert np.abs(projected - person.picture[:, BODY_LANDMARKS.index(f"{side}_{part}")]).mean() < 0.02


@pytest.mark.parametrize(("look_ahead", "roll"), [(0.0, 0.0), (0.2, 15.0)])
def test_one_call_equals_many(make_device: Any, look_ahead: float, roll: float) -> None:
    device = make_device(look_ahead)
    person = remove_roll(seen_by(walking(20), device.focal, noise=0.01), np.radians(roll))
    one, many = together(observed(device, person, 20)), together(observed(device, person, 1))
    for name in FIELDS:
        np.testing.assert_allclose(getattr(one, name), getattr(many, name), atol=1e-9)
    np.testing.assert_array_equal(one.time, person.time)


def test_frames_are_output_after_the_look_ahead(make_device: Any) -> None:
    device = make_device(0.1)
    state, person = device.start(), seen_by(walking(10), device.focal)
    for k in range(len(person)):
        frames, state = device.step(person[k : k + 1], state)
        np.testing.assert_allclose(frames.time, [person.time[k] - 0.1] if k >= 3 else [], atol=1e-9)
    assert len(device.finish(state)) == 3
    live = make_device(0.0)
    frames, state = live.step(person[:4], live.start())
    assert len(frames) == 4 and not len(live.finish(state))


def test_the_tracker_keeps_observed_arms(make_device: Any, completion: CompletionModel) -> None:
    """Fingers equal the network's; the tracker bends nearly straight arms by some degrees."""
    device = make_device()
    person = seen_by(walking(12), device.focal)
    person.has_hand[...] = True
    person.hand[...] = 0.01 * np.random.default_rng(0).normal(size=person.hand.shape)
    person.hand_world[...] = 0.01 * np.random.default_rng(1).normal(size=person.hand_world.shape)
    seen = together(observed(device, person, 12))
    assert seen.has_rotation[:, [POINTS.index(name) for name in ARM_JOINTS]].all()
    tracker = Tracker(Person(SKELETON), network=completion, settings=TrackerSettings(infer=False))
    estimate, _ = tracker.step(seen, tracker.start())
    wanted, _ = device.arms.step(arm_keypoints(person), device.arms.start())
    assert wanted.estimate.pose is not None
    fingers = SKELETON.indices([name for name in ARM_JOINTS if name[-1].isdigit()])
    predicted = wanted.estimate.pose.rotation[:, fingers]
    assert np.degrees(geodesic_angle(estimate.pose.rotation[:, fingers], predicted)).max() < 0.5
    arms = [name for name in ARM_JOINTS if not name[-1].isdigit()]
    projected = np.asarray(forward_kinematics(estimate.pose)[1])[:, SKELETON.indices(arms)]
    assert np.degrees(geodesic_angle(projected, seen.rotation[:, [POINTS.index(name) for name in arms]])).max() < 8.0


def test_a_lost_body_is_not_observed(make_device: Any) -> None:
    device = make_device()
    person = seen_by(walking(30), device.focal)
    person.has_body[10:22] = False
    person.world[10:22] = np.nan
    seen = together(observed(device, person, 1))
    any_of = np.any(seen.has_position | seen.has_rotation, axis=1)
    assert any_of[:10].all() and any_of[22:].all()
    assert not any_of[10 + 6 : 22].any()  # frames within the smoothing's reach are still observed
    person.has_body[...] = False
    assert not together(observed(device, person, 1)).has_position.any()


def test_unseen_points_are_not_observed_and_uncertain_ones_are_less_accurate(make_device: Any) -> None:
    device = make_device()
    person = seen_by(walking(2), device.focal)
    for name, visible in (("left_knee", 0.1), ("right_ankle", 0.6), ("right_wrist", 0.2)):
        person.visible[:, BODY_LANDMARKS.index(name)] = visible
    person.has_hand[:, 0] = True
    person.hand[:, 0] = person.hand_world[:, 0, :, :2] = 0.01
    person.hand_world[:, 0] = np.random.default_rng(0).normal(size=(21, 3))
    seen = together(observed(device, person, 1))

    def has(mask: np.ndarray, name: str) -> bool:
        return bool(mask[0, POINTS.index(name)])

    assert not has(seen.has_position, "left_knee") and not has(seen.has_position, "left_ankle")
    assert has(seen.has_position, "right_knee") and has(seen.has_position, "right_ankle")
    accuracy = seen.accuracy[0, [POINTS.index(name) for name in ("right_knee", "right_ankle")]]
    np.testing.assert_allclose(accuracy, [LANDMARK_ACCURACY, LANDMARK_ACCURACY / 0.6])
    assert has(seen.has_rotation, "left_index2") and has(seen.has_rotation, "left_wrist")
    assert not has(seen.has_rotation, "right_index2") and not has(seen.has_rotation, "right_elbow")
    for part in ("knee", "ankle", "toe"):
        for side in SIDES:
            person.visible[:, BODY_LANDMARKS.index(f"{side}_{part}")] = 0.1
    unsure = together(observed(device, person, 1))
    assert unsure.accuracy[0, POINTS.index("head")] > 2 * LANDMARK_ACCURACY


def test_smoothing_keeps_lines_and_reduces_noise() -> None:
    person = seen_by(walking(31), 1.0)
    slope = np.linspace(0, 1, 31)[:, None, None]
    straight = replace(person, world=np.broadcast_to(slope, person.world.shape).copy())
    np.testing.assert_allclose(smooth_frame(straight, 15, 0.05, 0.2).world, 0.5, atol=1e-12)
    noise = np.random.default_rng(0).normal(size=person.world.shape)
    smooth = np.stack([smooth_frame(replace(person, world=noise), k, 0.05, 0.0).world[0] for k in range(8, 23)])
    assert smooth.std() < 0.6 * noise.std()


@pytest.mark.parametrize(("name", "value"), [("look_ahead", -0.1), ("look_ahead", 2.0), ("field_of_view", 0.0)])
def test_bad_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(BodysenseError, match=name.replace("_", "-")):
        VideoSettings(**{name: value})


class Standing:
    """A landmarker that finds the same person in every picture, and their hands if `has_hands(time)`."""

    def __init__(self, has_hands: Any = lambda time: True) -> None:
        pose = standing_pose(SKELETON)
        points = pose.root_position + SKELETON.path @ SKELETON.rest_offset
        names = [name if name in SKELETON.points else "head" for name in BODY_LANDMARKS]
        world = points[SKELETON.indices(names)] - pose.root_position
        # A face has a depth, in contrast to the rest of a T-pose.
        world[BODY_LANDMARKS.index("nose"), 2] += 0.1
        for sign, side in zip((1, -1), SIDES, strict=True):
            world[BODY_LANDMARKS.index(f"{side}_ear"), 0] += 0.07 * sign
        self.world, self.has_hands = world, has_hands
        hands = [[f"{side}_{name}" for name in HAND_POINTS] for side in SIDES]
        self.hands = np.stack([points[SKELETON.indices(hand)] for hand in hands])
        self.hands = self.hands - self.hands.mean(axis=1, keepdims=True)

    def find(self, picture: Picture) -> tuple[Bodies, HandLandmarks]:
        places = self.world[None, :, :2] / 3
        bodies = Bodies(self.world[None], places, np.ones((1, len(BODY_LANDMARKS))))
        world = self.hands if self.has_hands(picture.time) else self.hands[:0]
        wrists = places[0, [BODY_LANDMARKS.index(f"{side}_wrist") for side in SIDES][: len(world)]]
        at = wrists[:, None] + (world - world[:, :1])[..., :2] / 3
        return bodies, HandLandmarks(world, at, np.array([0.9, 0.1])[: len(world)])


def pictures(count: int) -> Iterator[Picture]:
    for k in range(count):
        yield Picture(k / RATE, np.zeros((8, 12, 3), np.uint8))


def watched(source: Iterator[Picture], landmarker: Standing, device: VideoDevice) -> Iterator[WatchedFrames]:
    return watch(source, cast(Landmarker, landmarker), lambda aspect: replace(device, aspect=aspect))


@pytest.mark.parametrize("ahead", [0.0, 0.1])
def test_every_picture_is_output_once_after_the_look_ahead(make_device: Any, ahead: float) -> None:
    newest, times = -1.0, []

    def seen() -> Iterator[Picture]:
        nonlocal newest
        for picture in pictures(20):
            newest = picture.time
            yield picture

    for done in watched(seen(), Standing(), make_device(ahead)):
        assert done.frames.time.tolist() == [picture.time for picture in done.pictures]
        if newest < 19 / RATE:
            assert all(time == pytest.approx(newest - ahead) for time in done.frames.time)
        times += done.frames.time.tolist()
    np.testing.assert_allclose(times, np.arange(20) / RATE)


def test_waiting_frames_precede_the_error_of_a_broken_video(make_device: Any) -> None:
    def broken() -> Iterator[Picture]:
        yield from pictures(9)
        raise VideoBrokenError("it breaks off")

    times = []
    with pytest.raises(VideoBrokenError, match="it breaks off"):
        for done in watched(broken(), Standing(), make_device(0.1)):
            times += done.frames.time.tolist()
    assert len(times) == 9


def test_a_hand_that_was_away_for_three_seconds_is_observed_again(make_device: Any) -> None:
    away = Standing(lambda time: not 1.0 <= time < 4.0)
    parts = list(watched(pictures(135), away, make_device(0.1)))
    seen = together([done.frames for done in parts])
    np.testing.assert_allclose(seen.time, np.arange(135) / RATE)
    finger = seen.has_rotation[:, POINTS.index("left_index2")]
    inside = (seen.time > 1.2) & (seen.time < 3.8)  # smoothing reaches over a few frames
    assert not finger[inside].any() and finger[(seen.time < 1.0) | (seen.time >= 4.0)].all()


def test_memory_does_not_grow_with_the_video(make_device: Any) -> None:
    """Pictures are released, and the state is as large after three seconds as after two."""
    alive, most = weakref.WeakSet[Picture](), 0

    def counted() -> Iterator[Picture]:
        for picture in pictures(60):
            alive.add(picture)
            yield picture

    for _ in watched(counted(), Standing(), make_device(0.1)):
        most = max(most, len(alive))
    assert most <= 6  # three that wait, those just output, and the next

    device = make_device(0.1)
    landmarker, state, person_state, sizes = Standing(), device.start(), PersonState(), []
    for picture in pictures(90):
        person, person_state = follow(picture, *landmarker.find(picture), person_state)
        _, state = device.step(person, state)
        sizes.append(len(pickle.dumps((state, person_state))))
    assert max(sizes[60:]) <= max(sizes[30:60])
