from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense_lab.papers.pahmt.camera_view import view_points
from bodysense_lab.rendering.character import FIGURES
from bodysense_lab.rendering.take import GESTURES, RenderedTake, gesture, plan_gestures

WRISTS = {  # time in s, and position of the left wrist from its shoulder at that time, in arm lengths
    "t_pose": (2.2, (1.0, 0.0, 0.0)),
    "arms_up": (2.1, (0.22, 0.97, 0.0)),
    "arms_ahead": (2.0, (0.0, 0.0, 1.0)),
    "punches": (0.8, (0.22, 0.03, 0.97)),  # from a chest turned to the right
    "waves": (1.2, (0.11, 0.09, 0.48)),
    "waves_at_desk": (0.9, (0.16, 0.37, 0.50)),
    "moving_camera": (3.6, (0.22, 0.97, 0.0)),
}


@pytest.mark.parametrize("name", GESTURES)
def test_wrists_are_at_the_scripted_positions(name: str) -> None:
    clip = gesture(name)
    assert clip.category == name and clip.has_fingers and np.isfinite(clip.pose.rotation).all()
    places = clip.pose.skeleton.indices(["left_shoulder", "left_elbow", "left_wrist"])
    shoulder, elbow, wrist = np.moveaxis(np.asarray(forward_kinematics(clip.pose)[0])[:, places], 1, 0)
    length = np.linalg.norm(elbow - shoulder, axis=-1) + np.linalg.norm(wrist - elbow, axis=-1)
    time, wanted = WRISTS[name]
    frame = round(time * clip.frame_rate)
    reach = (wrist - shoulder)[frame] / length[frame]
    assert np.linalg.norm(np.abs(reach) - np.abs(wanted)) < 0.25


@pytest.fixture(scope="module")
def planned() -> list[RenderedTake]:
    return [take for take, _ in plan_gestures(np.random.default_rng(1))]


def seen(take: RenderedTake, points: list[str]) -> np.ndarray:
    """Return the positions (T, P, 2) of points of the body in the pictures."""
    position = np.asarray(forward_kinematics(take.pose)[0])[:, take.pose.skeleton.indices(points)]
    local = (position - take.camera.position[..., None, :]) @ take.camera.axes
    return np.asarray(take.camera.focal) * local[..., :2] / -local[..., 2:]


def test_every_figure_makes_every_gesture(planned: list[RenderedTake]) -> None:
    assert [(take.category, take.figure) for take in planned] == [(name, who) for name in GESTURES for who in FIGURES]
    assert {take.category for take in planned if take.moves} == {"moving_camera"}


def test_a_webcam_sees_the_upper_body_and_a_hand_before_the_face(planned: list[RenderedTake]) -> None:
    for take in (one for one in planned if one.category == "waves_at_desk"):
        head, wrist = np.moveaxis(seen(take, ["head", "left_wrist"]), 1, 0)
        assert (np.abs(head[:, 1]) < 0.5).all() and (seen(take, ["left_knee", "right_knee"])[..., 1] < -0.5).all()
        frame = round(0.9 * 30)  # the hand is before the face
        hand = seen(take, ["left_middle1"])[frame, 0]
        assert np.linalg.norm(hand - head[frame]) < 0.25 < np.linalg.norm(wrist[0] - head[0])


def test_a_moving_camera_moves_from_the_first_picture_on(planned: list[RenderedTake]) -> None:
    for take in (one for one in planned if one.moves):
        step = np.linalg.norm(np.diff(take.camera.position, axis=0), axis=-1)
        assert step.min() > 0.003 and np.ptp(step) < 1e-6, "m a picture"
        np.testing.assert_allclose(np.linalg.det(take.camera.axes), 1.0)
        keypoints = take.keypoints()
        assert len(keypoints) == len(take.time) and keypoints.arm.shape == (len(take.time), 2, 2, 3)
        assert keypoints.has_arm.mean() > 0.9
        # Each picture equals that of a still camera at the same place.
        for frame in (0, 70):
            camera, points = take.camera_at(frame), view_points(take.pose[frame])
            upper = (points[:, 1] - points[:, 0]) @ camera.axes
            there = upper / np.linalg.norm(upper, axis=-1, keepdims=True)
            np.testing.assert_allclose(keypoints.arm[frame, :, 0], there, atol=1e-6)
