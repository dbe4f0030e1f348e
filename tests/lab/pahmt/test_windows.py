"""Training windows of the networks of arms and hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from bodysense.body.arms import ARM_JOINTS, arm_skeleton
from bodysense.body.keypoints import arms_from_torso
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense_lab.data.augment import mirrored
from bodysense_lab.papers.pahmt.camera_view import FRONT, view_points
from bodysense_lab.papers.pahmt.options import VideoSimulation
from bodysense_lab.papers.pahmt.recordings import ArmRecordings, arm_positions, film, make_batch, read_arm_recordings

PLAIN = VideoSimulation(cameras=FRONT, keypoints="perfect", mirrored=False, begun=0.0)


@pytest.fixture(scope="module")
def recordings(waving_clip: Clip) -> ArmRecordings:
    """The waving clip with and without hands."""
    return read_arm_recordings([waving_clip, replace(waving_clip, name="bare", has_fingers=False)])


def test_recordings_are_the_motion(recordings: ArmRecordings, waving_clip: Clip) -> None:
    assert len(recordings) == 2 and recordings.minutes == pytest.approx(2 * waving_clip.seconds / 60)
    np.testing.assert_allclose(recordings.points[:90], view_points(waving_clip.pose), atol=1e-6)
    np.testing.assert_allclose(recordings.rotation[90:], arms_from_torso(waving_clip.pose), atol=1e-6)


def test_windows_are_of_clips_with_hands(recordings: ArmRecordings) -> None:
    assert len(recordings.windows()) == (90 - 32) // 5 + 1
    assert set(recordings.windows().clip) == {0} and set(recordings.windows(fingers=False).clip) == {1}
    assert len(recordings.windows(stride=1, fingers=None)) == 2 * 59
    with pytest.raises(BodysenseError, match="no clip of 32 frames at 30 Hz among 2"):
        replace(recordings, length=np.array([31, 31])).windows()


def test_an_augmented_clip_has_other_arms_and_the_same_legs(waving_clip: Clip) -> None:
    more = read_arm_recordings([waving_clip], bodies=3, rng=np.random.default_rng(0))
    assert len(more) == 3 and len(np.unique(more.points[::90, 0, 1, 0])) == 3
    apart = geodesic_angle(more.rotation.reshape(3, 90, -1, 4)[1:], more.rotation[:90])
    assert 0.02 < apart.mean() < 1.0


def test_windows_at_the_beginning_repeat_the_first_frame(recordings: ArmRecordings) -> None:
    windows = recordings.windows()
    keypoints, truth = film(recordings, windows, np.arange(8), replace(PLAIN, begun=1.0), np.random.default_rng(0))
    moves = np.asarray((np.abs(np.diff(keypoints.hand, axis=1)) > 0).any(axis=(2, 3, 4)))
    begun = moves.argmax(axis=1)
    assert begun.min() >= 1 and len(np.unique(begun)) > 2
    for row, first in enumerate(begun):
        assert moves[row, first:].all() and (truth[row, : first + 1] == truth[row, 0]).all()


def test_mirrored_windows_are_those_of_the_mirrored_clip(recordings: ArmRecordings, waving_clip: Clip) -> None:
    """Each mirrored window equals the window of the mirrored clip."""
    other = read_arm_recordings([mirrored(waving_clip)])
    windows, which = recordings.windows(), np.zeros(12, dtype=int)
    keypoints, truth = film(recordings, windows, which, replace(PLAIN, mirrored=True), np.random.default_rng(0))
    straight, right = (film(one, windows, which[:1], PLAIN, np.random.default_rng(0)) for one in (recordings, other))
    turned = np.abs(truth - straight[1]).max(axis=(1, 2, 3)) > 1e-6
    assert 0 < turned.sum() < 12
    for found, (seen, rotation) in ((turned, right), (~turned, straight)):
        np.testing.assert_allclose(keypoints.hand[found], np.tile(seen.hand, (found.sum(), 1, 1, 1, 1)), atol=1e-5)
        same = np.abs((truth[found] * rotation).sum(axis=-1))
        np.testing.assert_allclose(same, 1, atol=1e-5)


def test_batches_mark_known_joints_and_depend_on_the_seed_alone(recordings: ArmRecordings) -> None:
    windows = recordings.windows(fingers=None)
    first, again = (
        make_batch(recordings, windows, np.array([0, -1]), VideoSimulation(), np.random.default_rng(3))
        for _ in range(2)
    )
    assert first.known[0].all() and first.known[1].sum() == 6
    assert {ARM_JOINTS[k] for k in np.flatnonzero(first.known[1])} == {
        f"{side}_{part}" for side in ("left", "right") for part in ("collar", "shoulder", "elbow")
    }
    for one, two in zip(first.window, again.window, strict=True):
        assert torch.equal(one, two) and bool(torch.isfinite(one.float()).all())


@pytest.mark.parametrize("joints", [tuple(range(38)), (4, 5, 6, 25)])
def test_positions_are_those_of_the_arms_alone(joints: tuple[int, ...]) -> None:
    rng, skeleton = np.random.default_rng(0), arm_skeleton(default_skeleton())
    some = rng.standard_normal((2, 3, len(joints), 4))
    some /= np.linalg.norm(some, axis=-1, keepdims=True)
    pose = rest_pose(skeleton, (2, 3))
    pose.rotation[..., [1 + k for k in joints], :] = some
    wanted, _ = forward_kinematics(Pose(skeleton, np.zeros((2, 3, 3)), pose.rotation))
    np.testing.assert_allclose(arm_positions(torch.tensor(some), joints).numpy(), wanted, atol=1e-12)
