"""Inference of arms and hands from key-points: windows, look-ahead, streams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from importlib.resources import as_file, files
from typing import Any

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, arm_rotations
from bodysense.body.keypoints import ArmKeypoints, body_torso
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.arms import ArmFrames, ArmModel, Arms, ArmSettings, load_arms
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.papers.pahmt.camera_view import FRONT, sample_cameras, view, view_points
from bodysense_lab.papers.pahmt.keypoint_noise import DetectorNoise, detect


def filmed(clip: Clip, noise: bool = True) -> ArmKeypoints:
    """Return key-points of a clip as a detector finds them; NaN if missing."""
    points = view_points(clip.pose)[None]
    seen = view(points, clip.time, sample_cameras(points[:, 0], np.random.default_rng(0), FRONT))
    seen = detect(seen, DetectorNoise(missed=0.2), np.random.default_rng(1)) if noise else seen
    arm = np.where(seen.has_arm[0, ..., None, None], seen.arm[0], np.nan)
    hand = np.where(seen.has_hand[0, ..., None, None], seen.hand[0], np.nan)
    return ArmKeypoints(seen.time, arm, seen.has_arm[0], seen.torso[0], seen.has_torso[0], hand, seen.has_hand[0])


def streamed(estimator: Arms, keypoints: ArmKeypoints, sizes: list[int]) -> list[ArmFrames]:
    state, first, parts = estimator.start(), 0, []
    for size in sizes:
        part, state = estimator.step(keypoints[first : first + size], state)
        parts.append(part)
        first += size
    return [*parts, estimator.finish(state)]


@pytest.mark.parametrize(("settings", "rate"), [(ArmSettings(look_ahead=0.0), 24.0), (ArmSettings(0.4, 0.3), 55.0)])
def test_a_stream_equals_one_call(
    untrained_arms: ArmModel, waving_clip: Clip, settings: ArmSettings, rate: float
) -> None:
    estimator, keypoints = Arms(default_skeleton(), untrained_arms, settings), filmed(resample(waving_clip, rate))
    keypoints = keypoints[:60]
    whole = estimator.complete(keypoints)
    np.testing.assert_array_equal(whole.time, keypoints.time)
    parts = streamed(estimator, keypoints, [1, 2, 30, 1, 1, 25])
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), whole.time)
    assert whole.estimate.pose is not None
    for name in ("position", "occluded", "confidence"):
        pieces = [getattr(part.estimate, name) for part in parts]
        np.testing.assert_array_equal(np.concatenate(pieces), getattr(whole.estimate, name))


def test_frames_are_output_after_the_look_ahead(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    keypoints = filmed(waving_clip)[:40]
    for look_ahead in (0.0, 0.25):
        estimator = Arms(default_skeleton(), untrained_arms, ArmSettings(look_ahead))
        state = estimator.start()
        for t in range(40):
            part, state = estimator.step(keypoints[t : t + 1], state)
            ready_times = keypoints.time + look_ahead
            before = keypoints.time[t - 1] if t else -1.0
            due = keypoints.time[(ready_times <= keypoints.time[t] + 1e-6) & (ready_times > before + 1e-6)]
            np.testing.assert_array_equal(part.time, due)


def test_live_frames_equal_the_networks_output(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    """At the network's rate and without look-ahead, a frame's output is the last of the window that ends with it."""
    keypoints = filmed(waving_clip, noise=False)[:50]
    live = Arms(default_skeleton(), untrained_arms, ArmSettings(look_ahead=0.0, smoothing=1e-6)).complete(keypoints)
    for last in (31, 49):
        frames = keypoints[last - 31 : last + 1]
        window = {name: np.nan_to_num(getattr(frames, name))[None] for name in ("arm", "torso", "hand")}
        wanted = untrained_arms.network.run(window)["rotation"][0, -1]
        assert live.estimate.pose is not None
        assert np.degrees(geodesic_angle(arm_rotations(live.estimate.pose)[last], wanted)).max() < 0.01


class _AlternatingNetwork:
    """A network that turns all joints to one side, and with the next window to the other."""

    def __init__(self, card: Mapping[str, Any]) -> None:
        self.card, self.side = card, 1.0

    def run(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        self.side = -self.side
        turned = np.tile([np.cos(0.25), self.side * np.sin(0.25), 0.0, 0.0], (1, 32, len(ARM_JOINTS), 1))
        return {"rotation": turned}


def test_overlapping_windows_are_blended(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    """The output is between contradictory windows. Without look-ahead there is only one window for a frame."""
    keypoints, angles = filmed(waving_clip), []
    for look_ahead in (0.0, 0.4):
        contradictory = ArmModel(_AlternatingNetwork(untrained_arms.card))  # type: ignore[arg-type]
        estimator = Arms(default_skeleton(), contradictory, ArmSettings(look_ahead, stride=0.03))
        pose = estimator.complete(keypoints).estimate.pose
        assert pose is not None
        angles.append(geodesic_angle(arm_rotations(pose), np.array([1.0, 0, 0, 0])))
    np.testing.assert_allclose(angles[0], 0.5, atol=1e-9)
    assert angles[1][:75].max() < 0.15


def test_the_standing_body_is_rotated_as_the_torso(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    keypoints = filmed(waving_clip, noise=False)[:40]
    estimate = Arms(default_skeleton(), untrained_arms).complete(keypoints).estimate
    pose = estimate.pose
    assert pose is not None
    assert (
        np.degrees(geodesic_angle(body_torso(pose), keypoints.torso)).max() < 12
    )  # raised collars tilt the line of the shoulders
    np.testing.assert_allclose(estimate.position, forward_kinematics(pose)[0], atol=1e-12)
    names = default_skeleton().points
    assert (estimate.occluded[:, [names.index("left_elbow"), names.index("right_index_tip")]] == 0).all()
    assert (estimate.occluded[:, names.index("left_knee")] == 1).all()
    assert estimate.confidence[0, names.index("left_knee")] > estimate.confidence[0, names.index("left_wrist")] > 0


def test_a_gap_resets_the_state_and_keeps_all_frames(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    keypoints = filmed(waving_clip)[:30]
    later = replace(keypoints, time=keypoints.time + 9.0)
    parts = {one.name: [getattr(each, one.name) for each in (keypoints, later)] for one in fields(ArmKeypoints)}
    joined = ArmKeypoints(**{name: np.concatenate(values) for name, values in parts.items()})
    estimator = Arms(default_skeleton(), untrained_arms)
    both, alone = estimator.complete(joined), estimator.complete(keypoints)
    assert len(both) == 60
    np.testing.assert_array_equal(both.estimate.position[:30], alone.estimate.position)
    np.testing.assert_allclose(both.estimate.position[30:], alone.estimate.position, atol=1e-5)


def test_a_video_without_people_yields_finite_bodies(untrained_arms: ArmModel) -> None:
    empty = np.zeros((3, 2), dtype=bool)
    nothing = ArmKeypoints(
        *(np.arange(3) / 30, np.full((3, 2, 2, 3), np.nan), empty, np.full((3, 4), np.nan), empty[:, 0]),
        *(np.full((3, 2, 21, 2), np.nan), empty),
    )
    frames = Arms(default_skeleton(), untrained_arms).complete(nothing)
    assert len(frames) == 3 and np.isfinite(frames.estimate.position).all() and (frames.estimate.occluded == 1).all()


def test_one_frame_and_no_frame(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    estimator = Arms(default_skeleton(), untrained_arms)
    assert len(estimator.complete(filmed(waving_clip)[:1])) == 1
    rest = estimator.finish(estimator.start())
    assert len(rest) == 0 and rest.estimate.position.shape == (0, len(default_skeleton().points), 3)


def test_time_must_increase(untrained_arms: ArmModel, waving_clip: Clip) -> None:
    estimator, keypoints = Arms(default_skeleton(), untrained_arms), filmed(waving_clip)
    _, state = estimator.step(keypoints[5:6], estimator.start())
    with pytest.raises(
        BodysenseError, match=r"arms: a frame at 0 s came after one at 0\.166667 s; give frames in order"
    ):
        estimator.step(keypoints[:1], state)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"look_ahead": 0.7}, r"look-ahead 0\.7 s; give 0 to 0\.5"),
        ({"stride": 0.0}, "stride 0 s"),
        ({"longest_gap": 2.0}, "longest gap 2 s"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, float], message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        ArmSettings(**settings)


def test_other_network_files_are_refused() -> None:
    card = load_arms().card
    assert tuple(card["joints"]) == ARM_JOINTS and (card["frames"], card["rate"]) == (32, 30)
    with (
        as_file(files("bodysense.weights").joinpath("fingers.onnx")) as other,
        pytest.raises(BodysenseError, match=r"not a bodysense network of arms .*give the \.onnx that `bodysense train"),
    ):
        load_arms(other)
