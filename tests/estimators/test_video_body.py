from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.arms import SIDES
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import default_skeleton
from bodysense.capture.landmarks import BODY_LANDMARKS
from bodysense.capture.person import PersonLandmarks
from bodysense.errors import BodysenseError
from bodysense.estimators.arms import Arms, ArmSettings, load_arms
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.landmark_body import landmark_body
from bodysense.estimators.video_body import VideoBody, VideoFrames, VideoSettings, smoothed

SKELETON = default_skeleton()
PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")
MARKS = [BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES for part in PARTS]
POINTS = SKELETON.indices([f"{side}_{part}" for side in SIDES for part in PARTS])
TILT = np.radians(12.0)
BODY = landmark_body(SKELETON)


def video_body(look_ahead: float = 0.0, arms: Arms | None = None, tilt: float | None = None) -> VideoBody:
    return VideoBody(BODY, arms, 16 / 9, VideoSettings(look_ahead=look_ahead, tilt=tilt))


def walking(frames: int = 45) -> Pose:
    """Somebody who stands, waves and drifts to their left and toward the camera."""
    pose, time = standing_pose(SKELETON), np.arange(frames) / 30
    rotation = np.tile(pose.rotation, (frames, 1, 1))
    elbow = SKELETON.index("left_elbow")
    wave = quaternion_exp(np.stack([0 * time, -0.6 + 0.5 * np.sin(6 * time), 0 * time], axis=-1))
    rotation[:, elbow] = quaternion_multiply(rotation[:, elbow], wave)
    root = pose.root_position + np.stack([0.3 * time, 0 * time, 0.4 * time], axis=-1)
    return Pose(SKELETON, root, rotation)


def seen_by(pose: Pose, focal: float, tilt: float = TILT, noise: float = 0.0) -> PersonLandmarks:
    """Perfect landmarks of bodies in the room, seen from 1.4 m over the floor and 3 m away, looking down by `tilt`."""
    position = np.asarray(forward_kinematics(pose)[0])
    cosine, sine = np.cos(tilt), np.sin(tilt)
    axes = np.array([[1.0, 0, 0], [0, cosine, sine], [0, -sine, cosine]])  # room ← camera
    local = (position - [0.0, 1.4, 3.0]) @ axes
    count = len(position)
    world = np.tile(local[:, SKELETON.index("head")][:, None], (1, len(BODY_LANDMARKS), 1))
    world[:, BODY_LANDMARKS.index("nose")] += np.array([0.0, 0.0, 0.1]) @ axes
    for sign, side in zip((1, -1), SIDES, strict=True):
        world[:, BODY_LANDMARKS.index(f"{side}_ear"), 0] += 0.07 * sign
    world[:, MARKS] = local[:, POINTS]
    world += np.random.default_rng(0).normal(0, noise, world.shape) if noise else 0
    picture = focal * world[..., :2] / -world[..., 2:]
    hips = world[:, [BODY_LANDMARKS.index(f"{side}_hip") for side in SIDES]].mean(axis=1)
    return PersonLandmarks(
        time=np.arange(count) / 30,
        world=world - hips[:, None],
        picture=picture,
        visible=np.ones(world.shape[:2]),
        has_body=np.ones(count, dtype=bool),
        hand=np.full((count, 2, 21, 2), np.nan),
        hand_world=np.full((count, 2, 21, 3), np.nan),
        has_hand=np.zeros((count, 2), dtype=bool),
    )


def completed(body: VideoBody, person: PersonLandmarks, block: int) -> list[VideoFrames]:
    state, parts = body.start(), []
    for start in range(0, len(person), block):
        frames, state = body.step(person[start : start + block], state)
        parts.append(frames)
    return [*parts, body.finish(state)]


def together(parts: list[VideoFrames]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, roots, rotations."""
    return (
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.pose.root_position for part in parts]),
        np.concatenate([part.pose.rotation for part in parts]),
    )


@pytest.mark.parametrize("known", [True, False], ids=["tilt given", "tilt seen"])
def test_a_body_is_where_it_is(known: bool) -> None:
    pose, body = walking(), video_body(0.25, tilt=12.0 if known else None)
    person = seen_by(pose, body.focal)
    parts = completed(body, person, 1)
    _, root, rotation = together(parts)
    true = pose.root_position
    # The depth's smoothing lags behind a steady walk.
    np.testing.assert_allclose((root - root[0])[:, 0], (true - true[0])[:, 0], atol=0.05)
    np.testing.assert_allclose((root - root[0])[:, 2], (true - true[0])[:, 2], atol=0.15)
    np.testing.assert_allclose(root[:, 1], true[:, 1], atol=0.03)
    away = np.asarray(forward_kinematics(Pose(SKELETON, root, rotation))[0])[:, POINTS]
    wanted = np.asarray(forward_kinematics(pose)[0])[:, POINTS]
    assert np.linalg.norm((away - root[:, None]) - (wanted - true[:, None]), axis=-1).mean() < 0.03
    turned = np.degrees(geodesic_angle(rotation[:, 0], pose.rotation[:, 0]))
    assert turned.max() < 3
    # Seen from the camera that is given, it covers itself in the picture.
    position = np.concatenate([part.estimate.position for part in parts])
    place, axes = (np.concatenate([getattr(part.camera, name) for part in parts]) for name in ("position", "axes"))
    local = np.einsum("tpi,tij->tpj", position - place[:, None], axes)[:, POINTS]
    shown = body.focal * local[..., :2] / -local[..., 2:]
    assert np.abs(shown - person.picture[:, MARKS]).mean() < 0.02


@pytest.mark.parametrize("look_ahead", [0.0, 0.2])
@pytest.mark.parametrize("with_network", [False, True])
def test_one_call_is_as_many(small_arms: Path, look_ahead: float, with_network: bool) -> None:
    arms = None
    if with_network:
        arms = Arms(SKELETON, load_arms(small_arms), ArmSettings(look_ahead=look_ahead))
    body = video_body(look_ahead, arms)
    person = seen_by(walking(30), body.focal, noise=0.01)
    one, many = together(completed(body, person, 30)), together(completed(body, person, 1))
    for first, second in zip(one, many, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)
    np.testing.assert_array_equal(one[0], person.time)


def test_answers_come_as_late_as_is_said() -> None:
    body = video_body(0.1)
    state, person = body.start(), seen_by(walking(10), body.focal)
    for k in range(len(person)):
        frames, state = body.step(person[k : k + 1], state)
        np.testing.assert_allclose(frames.time, [person.time[k] - 0.1] if k >= 3 else [], atol=1e-9)
    assert len(body.finish(state)) == 3
    live = video_body(0.0)
    frames, state = live.step(person[:4], live.start())
    assert len(frames) == 4 and not len(live.finish(state))


def test_the_arms_are_the_networks(small_arms: Path) -> None:
    arms = Arms(SKELETON, load_arms(small_arms), ArmSettings(look_ahead=0.0))
    body = video_body(0.0, arms)
    person = seen_by(walking(12), body.focal)
    from bodysense.body.arms import arm_rotations
    from bodysense.capture.person import arm_keypoints

    frames, _ = body.step(person, body.start())
    wanted, _ = arms.step(arm_keypoints(person), arms.start())
    assert wanted.estimate.pose is not None
    np.testing.assert_allclose(arm_rotations(frames.pose), arm_rotations(wanted.estimate.pose), atol=1e-12)


def test_a_body_that_is_lost_stays_and_comes_back() -> None:
    body = video_body(0.0)
    person = seen_by(walking(60), body.focal)
    person.has_body[20:50] = False
    person.world[20:50] = np.nan
    _, root, rotation = together(completed(body, person, 1))
    assert np.isfinite(root).all() and np.isfinite(rotation).all()
    held = slice(20 + 6, 50)  # the smoothing's reach after the last frame that was seen
    assert np.ptp(rotation[held], axis=0).max() == 0
    before, after = (np.linalg.norm(root[k] - walking(60).root_position[k] - root[0]) for k in (19, 59))
    assert after < before + 2.5


def test_nobody_at_first_stands() -> None:
    body = video_body(0.0)
    person = seen_by(walking(4), body.focal)
    person.has_body[...] = False
    frames, _ = body.step(person, body.start())
    np.testing.assert_allclose(frames.pose.rotation[0], standing_pose(SKELETON).rotation, atol=1e-12)
    assert frames.pose.root_position[0, 1] == pytest.approx(standing_pose(SKELETON).root_position[1], abs=0.02)


def test_an_estimate_knows_what_was_seen() -> None:
    body = video_body(0.0)
    person = seen_by(walking(2), body.focal)
    person.visible[:, BODY_LANDMARKS.index("left_knee")] = 0.1
    person.has_hand[:, 0] = True
    person.hand_world[:, 0] = np.random.default_rng(0).normal(size=(21, 3))
    frames, _ = body.step(person, body.start())
    estimate: PointEstimate = frames.estimate
    seen = {name: float(estimate.occluded[0, SKELETON.index(name)]) for name in SKELETON.points}
    assert seen["left_knee"] == pytest.approx(0.9) and seen["right_knee"] == 0
    assert seen["left_index2"] == 0 and seen["right_index2"] == 1
    error = estimate.confidence[0, SKELETON.indices(["left_knee", "right_knee"])]
    assert error[0] > error[1]


def test_smoothing_keeps_what_is_straight_and_calms_what_trembles() -> None:
    person = seen_by(walking(31), 1.0)
    slope = np.linspace(0, 1, 31)[:, None, None]
    straight = replace(person, world=np.broadcast_to(slope, person.world.shape).copy())
    np.testing.assert_allclose(smoothed(straight, 15, 0.05, 0.2).world, 0.5, atol=1e-12)
    noise = np.random.default_rng(0).normal(size=person.world.shape)
    calm = np.stack([smoothed(replace(person, world=noise), k, 0.05, 0.0).world[0] for k in range(8, 23)])
    assert calm.std() < 0.6 * noise.std()


@pytest.mark.parametrize(("name", "value"), [("look_ahead", -0.1), ("look_ahead", 2.0), ("field_of_view", 0.0)])
def test_settings_that_cannot_be(name: str, value: float) -> None:
    with pytest.raises(BodysenseError, match=name.replace("_", "-")):
        VideoSettings(**{name: value})
