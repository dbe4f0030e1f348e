"""Arms follow their lines in the picture with any network, and a rolled camera is levelled."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bodysense.body.arms import SIDES
from bodysense.body.pose import Pose, rest_pose
from bodysense.devices.video.camera_level import remove_roll
from bodysense.devices.video.device import POINTS, VideoFrames
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate

from ..conftest import SKELETON, observed, seen_by, together, walking

BONES = tuple((f"{side}_{start}", f"{side}_{end}") for side in SIDES for start, end in (("shoulder", "elbow"),))


def swinging(frames: int, rate: float, size: float) -> Pose:
    """Return a body with straight arms held out that swing up and down by `size` rad at `rate` Hz."""
    pose, time = rest_pose(SKELETON), np.arange(frames) / 30
    rotation = np.tile(pose.rotation, (frames, 1, 1))
    for sign, side in zip((1, -1), SIDES, strict=True):
        turn = np.zeros((frames, 3))
        turn[:, 2] = sign * size * np.sin(2 * np.pi * rate * time)
        place = SKELETON.index(f"{side}_shoulder")
        rotation[:, place] = quaternion_multiply(np.asarray(quaternion_exp(turn)), rotation[:, place])
    root = np.tile(walking(1).root_position, (frames, 1))
    return Pose(SKELETON, root, rotation)


def lines(parts: list[VideoFrames], person: PersonLandmarks, focal: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the slopes (T, 2) rad of upper arms in the picture, as observed and by the landmarks."""
    seen = together(parts)
    axes = np.concatenate([part.camera.axes for part in parts])
    drawn, marked = [], []
    for start, end in BONES:
        bone = SKELETON.rest_offset[SKELETON.index(end)]
        world = quaternion_rotate(seen.rotation[:, POINTS.index(start)], np.tile(bone, (len(seen), 1)))
        local = np.einsum("tj,tji->ti", np.asarray(world), axes)
        first, last = (person.picture[:, BODY_LANDMARKS.index(name)] for name in (start, end))
        across = local[:, :2] + (first + last) / 2 * local[:, 2:] / focal
        sign = 1 if start.startswith("left") else -1
        drawn.append(np.arctan2(across[:, 1], sign * across[:, 0]))
        marked.append(np.arctan2((last - first)[:, 1], sign * (last - first)[:, 0]))
    return np.stack(drawn, axis=-1), np.stack(marked, axis=-1)


@pytest.mark.parametrize("look_ahead", [0.0, 0.25])
def test_arms_held_out_follow_their_landmarks(make_device: Any, look_ahead: float) -> None:
    device = make_device(look_ahead)
    person = seen_by(swinging(30, 1.0, 0.0), device.focal)
    drawn, marked = lines(observed(device, person, 1), person, device.focal)
    assert np.degrees(np.abs(drawn - marked)).max() < 8


@pytest.mark.parametrize("look_ahead", [0.0, 0.25])
def test_fast_arms_do_not_lag(make_device: Any, look_ahead: float) -> None:
    device, rate = make_device(look_ahead), 1.6
    person = seen_by(swinging(60, rate, 0.6), device.focal)
    drawn, marked = lines(observed(device, person, 1), person, device.focal)
    turn = np.exp(-2j * np.pi * rate * person.time[10:50])[:, None]
    ours, true = ((values[10:50] * turn).sum(axis=0) for values in (drawn, marked))
    frames = -np.angle(ours / true) / (2 * np.pi * rate) * 30
    assert np.abs(frames).max() < 1.0
    assert (np.abs(ours / true) > 0.8).all()  # amplitudes are kept


def test_still_arms_do_not_tremble(make_device: Any) -> None:
    """Landmarks have noise of 5 mm."""
    device = make_device(0.25)
    person = seen_by(swinging(40, 1.0, 0.0), device.focal)
    rng = np.random.default_rng(0)
    person = replace(person, picture=person.picture + rng.normal(0, 0.005 / 3 * device.focal, person.picture.shape))
    drawn, marked = lines(observed(device, person, 1), person, device.focal)
    assert np.diff(drawn, 2, axis=0).std() < 0.4 * np.diff(marked, 2, axis=0).std()


@pytest.mark.parametrize(("roll", "known"), [(-20.0, True), (35.0, False)], ids=["given", "seen"])
def test_a_rolled_camera_is_levelled(make_device: Any, roll: float, known: bool) -> None:
    device = make_device(0.2)
    level = seen_by(walking(20), device.focal)
    person = remove_roll(level, -np.radians(roll))
    with_roll = replace(device, settings=replace(device.settings, roll=roll if known else None))
    parts = observed(with_roll, person, 1)
    wanted, seen = together(observed(device, level, 1)), together(parts)
    assert (seen.has_position == wanted.has_position).all()
    at = seen.has_position
    np.testing.assert_allclose(seen.position[at], wanted.position[at], atol=1e-6 if known else 0.03)
    # The output camera projects the body onto the rolled landmarks.
    place, axes = (np.concatenate([getattr(part.camera, name) for part in parts]) for name in ("position", "axes"))
    local = np.einsum("tpi,tij->tpj", seen.position - place[:, None], axes)
    for name in ("left_knee", "right_ankle"):
        where = local[:, POINTS.index(name)]
        projected = device.focal * where[:, :2] / -where[:, 2:]
        assert np.abs(projected - person.picture[:, BODY_LANDMARKS.index(name)]).mean() < 0.02
