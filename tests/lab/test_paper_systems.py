"""Systems of papers on a recording: each runs with packaged weights, or names the command that trains them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense import demo
from bodysense.body.arms import ARM_JOINTS, arm_rotations
from bodysense.body.keypoints import ArmKeypoints
from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import BODY
from bodysense.cli import main
from bodysense.devices.simulated.device import simulate
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording
from bodysense.observing.observation import Observation
from bodysense.quality.metrics import joint_error
from bodysense.sources.open import MotionSource, RecordingSource, VideoSource
from bodysense.takes.track import track
from bodysense_lab.papers.hmd_vae.body_vae import BodyVaeEstimator, load_body_vae
from bodysense_lab.papers.hmd_vae.export import write_vae_onnx
from bodysense_lab.papers.hmd_vae.network import BodyVae
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig
from bodysense_lab.papers.pahmt import system as pahmt
from bodysense_lab.papers.paper_options import Method, PaperOptions, Variant
from bodysense_lab.papers.paper_systems import SYSTEMS
from bodysense_lab.papers.two_hands.system import calibrate
from bodysense_lab.papers.unoc.ik_tracker import IkTracker
from bodysense_lab.papers.unoc.learned import Learned, load_model

MASKS = ("has_torso", "has_arm", "has_hand")


def completed(clip: Clip, method: Method, options: PaperOptions = PaperOptions()) -> Clip:
    return SYSTEMS[method](MotionSource(clip.name, given=clip), options)


def points(clip: Clip) -> np.ndarray:
    return np.asarray(forward_kinematics(clip.pose)[0])


def test_unoc_predicts_then_applies_inverse_kinematics_and_smoothing(short_clip: Clip) -> None:
    seen = simulate(short_clip, "headset_camera")
    tracker = IkTracker(Learned(load_model(), short_clip.pose.skeleton))
    pose, _, _ = tracker.step(seen, tracker.start())
    found = completed(short_clip, "unoc")
    np.testing.assert_allclose(points(found), forward_kinematics(pose)[0], atol=1e-9)
    head = short_clip.pose.skeleton.index("head")
    assert joint_error(points(found), points(short_clip))[:, head].max() < 2.0  # cm


def test_unoc_completes_a_recording(short_clip: Clip) -> None:
    recording = Recording(simulate(short_clip, "three_point"), short_clip.pose.skeleton)
    found = SYSTEMS["unoc"](RecordingSource("recording", recording), PaperOptions())
    assert len(found) == len(short_clip)


def test_hmd_vae_returns_the_body_of_the_decoder(short_clip: Clip) -> None:
    estimator = BodyVaeEstimator(short_clip.pose.skeleton, load_body_vae())
    estimate, _ = estimator.step(simulate(short_clip, "three_point"), estimator.start())
    assert estimate.pose is not None
    found = completed(short_clip, "hmd_vae", PaperOptions(variant="4"))
    assert geodesic_angle(found.pose.rotation, np.asarray(estimate.pose.rotation)).max() < 1e-6


@pytest.mark.slow
def test_model_0_encodes_whole_bodies(short_clip: Clip, tmp_path: Path) -> None:
    torch.manual_seed(3)
    file = tmp_path / "zero.onnx"
    write_vae_onnx(BodyVae(BodyVaeConfig(model=0, latent=4, width=16)).eval(), file, {"expected_error": [0.05] * 22})
    clip = replace(short_clip, pose=short_clip.pose[:3])
    found = completed(clip, "hmd_vae", PaperOptions(networks=file))
    head = clip.pose.skeleton.index("head")
    np.testing.assert_allclose(points(found)[:, head], points(clip)[:, head], atol=1e-4)
    assert (
        joint_error(points(found), points(clip))[:, clip.pose.skeleton.indices(BODY)].max() > 5.0
    )  # cm: not the input
    recording = Recording(simulate(clip, "three_point"), clip.pose.skeleton)
    with pytest.raises(BodysenseError, match="model 0 reads whole bodies; give a motion"):
        SYSTEMS["hmd_vae"](RecordingSource("seen.npz", recording), PaperOptions(networks=file))
    with pytest.raises(BodysenseError, match="leave --device out"):
        completed(clip, "hmd_vae", PaperOptions(networks=file, device="three_point"))
    with pytest.raises(BodysenseError, match="is a model 0"):
        completed(clip, "hmd_vae", PaperOptions(networks=file, variant="2"))


def test_pahmt_rotates_arms_and_hands_of_a_standing_body(waving_clip: Clip) -> None:
    found = completed(waving_clip, "pahmt", PaperOptions(variant="cnn"))
    assert len(found) == len(waving_clip)
    standing = standing_pose(waving_clip.pose.skeleton)
    legs = waving_clip.pose.skeleton.indices(["left_hip", "left_knee", "right_hip", "right_knee"])
    assert geodesic_angle(found.pose.rotation[:, legs], standing.rotation[None, legs]).max() < 1e-6
    true = arm_rotations(waving_clip.pose)
    swung = [ARM_JOINTS.index(f"{side}_{part}") for side in ("left", "right") for part in ("shoulder", "elbow")]
    error = geodesic_angle(arm_rotations(found.pose), true)[:, swung].mean()
    still = geodesic_angle(arm_rotations(standing)[None], true)[:, swung].mean()
    assert error < still


def test_the_camera_follows_a_person_who_walks_and_turns() -> None:
    seen = pahmt.seen_from_front(demo.packaged_performance())
    assert seen.has_torso.mean() > 0.99 and seen.has_arm.mean() > 0.95


def test_frames_without_a_person_are_not_written(
    waving_clip: Clip, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Frames before a person comes and after they leave are cut, the share is printed, and an empty film is refused."""
    seen, times = pahmt.seen_from_front(waving_clip), len(waving_clip)
    there = (np.arange(times) >= 10) & (np.arange(times) < times - 5)
    masks = {name: getattr(seen, name) & there[(...,) + (None,) * (getattr(seen, name).ndim - 1)] for name in MASKS}
    monkeypatch.setattr(pahmt, "filmed", lambda name, landmarkers: replace(seen, **masks))
    found = SYSTEMS["pahmt"](VideoSource("film.mp4"), PaperOptions(variant="cnn"))
    printed = capsys.readouterr().out
    assert len(found) == times - 15
    assert f"seen in {there.mean():.0%} of {times} frames" in printed and f"frames 10 to {times - 6}" in printed
    monkeypatch.setattr(
        pahmt, "filmed", lambda name, landmarkers: replace(seen, **{name: 0 * masks[name] > 0 for name in MASKS})
    )
    with pytest.raises(BodysenseError, match=r"film\.mp4: no person is seen"):
        SYSTEMS["pahmt"](VideoSource("film.mp4"), PaperOptions(variant="cnn"))


def test_pahmt_reads_the_given_video(waving_clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    watched: list[str] = []

    def film(name: str, landmarkers: Path | None) -> ArmKeypoints:
        watched.append(name)
        assert landmarkers == Path("here")
        return pahmt.seen_from_front(waving_clip)

    monkeypatch.setattr(pahmt, "filmed", film)
    found = SYSTEMS["pahmt"](VideoSource("film.mp4"), PaperOptions(variant="cnn", height=1.6, landmarkers=Path("here")))
    assert watched == ["film.mp4"] and len(found) == len(waving_clip)
    np.testing.assert_array_equal(found.pose.skeleton.rest_offset, Person(height=1.6).skeleton.rest_offset)


@pytest.mark.slow
def test_pahmt_runs_with_trained_weights(short_clip: Clip, small_arms: Path) -> None:
    assert len(completed(short_clip, "pahmt", PaperOptions(networks=small_arms))) == len(short_clip)
    with pytest.raises(BodysenseError, match="is a pahmt; give --variant pahmt"):
        completed(short_clip, "pahmt", PaperOptions(networks=small_arms, variant="cnn"))


@pytest.mark.parametrize("form", ["paper", "shipped"])
def test_two_hands_reads_nine_markers(short_clip: Clip, form: Variant) -> None:
    found = completed(short_clip, "two_hands", PaperOptions(variant=form))
    skeleton = short_clip.pose.skeleton
    fingers = np.flatnonzero(skeleton.wrist_of >= 0)
    wrists = skeleton.wrist_of[fingers]
    offset, true = (points(clip)[:, fingers] - points(clip)[:, wrists] for clip in (found, short_clip))
    assert np.linalg.norm(offset - true, axis=-1).mean() < 0.01
    recording = Recording(simulate(short_clip, "three_point"), skeleton)
    with pytest.raises(BodysenseError, match="give a take of them"):
        SYSTEMS["two_hands"](RecordingSource("seen.npz", recording), PaperOptions(variant="shipped"))


def test_a_flat_hand_calibration_makes_the_calibrated_pose_flat(
    gloves: Observation, short_clip: Clip, tmp_path: Path
) -> None:
    opened = RecordingSource("flat", Recording(gloves[:1], short_clip.pose.skeleton))
    options = PaperOptions(variant="shipped")
    assert calibrate(opened, tmp_path / "flat.npz", options) == ("left", "right")
    options = replace(options, calibration=tmp_path / "flat.npz")
    before = SYSTEMS["two_hands"](opened, replace(options, calibration=None))
    after = SYSTEMS["two_hands"](opened, options)
    joints = np.flatnonzero(short_clip.pose.skeleton.wrist_of[: len(short_clip.pose.skeleton.joints)] >= 0)
    flat = np.array([1.0, 0.0, 0.0, 0.0])
    bent, straight = (geodesic_angle(clip.pose.rotation[:, joints], flat).mean() for clip in (before, after))
    assert straight < bent
    bare = MotionSource("bare", given=replace(short_clip, has_fingers=False))
    with pytest.raises(BodysenseError, match="bare: its fingers are not recorded, so that its hands are relaxed"):
        calibrate(bare, tmp_path / "bare.npz", options)
    np.savez(tmp_path / "left.npz", left=np.zeros((15, 4)))
    with pytest.raises(BodysenseError, match="no flat-hand calibration of the right hand"):
        SYSTEMS["two_hands"](opened, replace(options, calibration=tmp_path / "left.npz"))


def test_completion_equals_the_tracker(short_clip: Clip) -> None:
    found = completed(short_clip, "completion", PaperOptions(device="three_point"))
    np.testing.assert_array_equal(points(found), points(track(short_clip, device="three_point").clip))


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ("--method pahmt", "bodysense train arms --data DIR --model pahmt -o pahmt.onnx"),
        ("--method pahmt --variant ahmt", "bodysense train arms --data DIR --model ahmt -o ahmt.onnx"),
        ("--method hmd_vae --variant 1", "bodysense train hmd-vae --data DIR --model 1 -o model1.onnx"),
        (
            "--method hmd_vae --variant 3",
            "--model 0 -o zero.pt, then bodysense train hmd-vae --data DIR --model 3 --decoder zero.pt -o model3.onnx",
        ),
        ("--method hmd_vae --variant cnn", "valid are 0, 1, 2, 3, 4"),
        ("--method unoc --variant paper", "bodysense train body-gru --data DIR --form paper -o body.onnx"),
        ("--method unoc --calibration flat.npz", "for --method two_hands, not for unoc"),
        ("--method unoc --landmarkers here", "for --method pahmt, not for unoc"),
        ("--method completion --variant 2", "has no such variant; leave it out"),
    ],
)
def test_errors_name_the_fix(motion: Path, capsys: pytest.CaptureFixture[str], words: str, command: str) -> None:
    assert main(["papers", "track", str(motion), "-o", str(motion.with_name("out.bvh")), *words.split()]) == 2
    assert command in capsys.readouterr().err


def test_the_command_writes_a_motion(
    motion: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(motion.parent)
    ran: list[Callable[[], int]] = [
        lambda: main(["papers", "track", "motion.bvh", "--method", "unoc", "-o", "unoc.bvh"]),
        lambda: main(["papers", "calibrate-hands", "motion.bvh", "--variant", "shipped", "-o", "flat.npz"]),
    ]
    assert [run() for run in ran] == [0, 0]
    assert "wrote unoc.bvh: 20 frames by unoc" in capsys.readouterr().out
    assert Path("flat.npz").is_file()
