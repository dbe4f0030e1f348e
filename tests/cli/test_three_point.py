"""Three points on the command line: simulated, recorded, tracked, timed, scored, trained."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.capture.recording import read_recording, write_recording
from bodysense.data.bvh import read_bvh, write_bvh
from bodysense.data.clip import Clip
from bodysense.occlusion.dropout import hide


@pytest.fixture
def recorded(tmp_path: Path, motion: Path, run) -> Path:
    """Headset and controllers."""
    run("simulate", motion, "--device", "three-point", "-o", tmp_path / "seen.npz")
    return tmp_path / "seen.npz"


def test_a_headset_alone(tmp_path: Path, motion: Path, small_three_point: Path, run) -> None:
    run("simulate", motion, "--device", "head-only", "-o", tmp_path / "head.npz")
    seen = read_recording(tmp_path / "head.npz").observation
    np.testing.assert_array_equal(seen.has_position, np.tile([True, False, False], (20, 1)))
    run("track", tmp_path / "head.npz", "-o", tmp_path / "two.bvh", "--model", small_three_point)
    run("track", motion, "--device", "head-only", "-o", tmp_path / "one.bvh", "--model", small_three_point)
    truth, one, two = (read_bvh(path).pose for path in (motion, tmp_path / "one.bvh", tmp_path / "two.bvh"))
    place = [forward_kinematics(pose)[0][:, truth.skeleton.index("head")] for pose in (truth, one, two)]
    np.testing.assert_allclose(place[1], place[0], atol=1e-3)
    np.testing.assert_allclose(place[2], place[0], atol=1e-3)


def test_a_wearer_says_how_tall_they_are(tmp_path: Path, recorded: Path, small_three_point: Path, run, refused) -> None:
    heights = {}
    for name, given in (("none", ()), ("tall", ("--height", 1.9)), ("seen", ("--height", "headset"))):
        run("track", recorded, "-o", tmp_path / f"{name}.bvh", "--model", small_three_point, *given)
        heights[name] = read_bvh(tmp_path / f"{name}.bvh").pose.skeleton.height
    assert heights["tall"] == pytest.approx(1.9, abs=1e-3)
    assert heights["seen"] == pytest.approx(heights["none"], rel=0.05)
    arguments = ("track", tmp_path / "none.bvh", "-o", tmp_path / "a.bvh", "--height", "headset")
    assert "--height headset is for recordings of head and wrists" in refused(*arguments, "--device", "three-point")


def test_what_cannot_be_completed(tmp_path: Path, recorded: Path, small_three_point: Path, refused) -> None:
    out = tmp_path / "out.bvh"
    arguments = ("track", recorded, "-o", out, "--model", small_three_point)
    assert "are completed without smoothing" in refused(*arguments, "--half-life", 0.1)
    recording = read_recording(recorded)
    hidden = np.tile([True, False, False], (20, 1))
    write_recording(recorded, replace(recording, observation=hide(recording.observation, hidden)))
    assert "'head' is tracked in none of its frames" in refused(*arguments)
    assert "the headset was tracked in no frame" in refused(*arguments, "--height", "headset")
    # Not tracked is what the mask says, whatever number stands there.
    filled = replace(recording.observation, has_position=recording.observation.has_position & ~hidden)
    write_recording(recorded, replace(recording, observation=filled))
    assert "'head' is tracked in none of its frames" in refused(*arguments)
    deep = replace(recording.observation, position=recording.observation.position - [0.0, 2.0, 0.0])
    write_recording(recorded, replace(recording, observation=deep))
    assert "below the floor, which is y = 0" in refused(*arguments)
    assert not out.exists()


def test_samples_go_with_nothing_else(tmp_path: Path, recorded: Path, small_vae: Path, refused) -> None:
    out = tmp_path / "out.bvh"
    arguments = ("track", recorded, "-o", out, "--model", small_vae, "--samples", 2)
    assert "leave --fingers synthesize out" in refused(*arguments, "--fingers", "synthesize")
    assert "leave --half-life out" in refused(*arguments, "--half-life", 0.1)
    recording = read_recording(recorded)
    headless = hide(recording.observation, np.tile([True, False, False], (20, 1)))
    write_recording(recorded, replace(recording, observation=headless))
    assert "'head' is tracked in none of its frames" in refused(*arguments)


def test_samples_of_one_signal(tmp_path: Path, recorded: Path, small_vae: Path, run) -> None:
    arguments = ("track", recorded, "--model", small_vae, "--samples", 2)
    run(*arguments, "-o", tmp_path / "a.bvh")
    run(*arguments, "-o", tmp_path / "b.bvh")
    run(*arguments, "-o", tmp_path / "c.bvh", "--seed", 2)
    pose = {path.stem: read_bvh(path).pose for path in tmp_path.glob("*.bvh")}
    root = {name: pose[name].root_position for name in ("a_1", "a_2", "b_1", "b_2", "c_1", "c_2")}
    np.testing.assert_array_equal(root["a_1"], root["b_1"])
    np.testing.assert_array_equal(root["a_2"], root["b_2"])
    assert np.abs(root["a_1"] - root["a_2"]).max() > 1e-4 and np.abs(root["a_1"] - root["c_1"]).max() > 1e-4


def test_it_is_timed(tmp_path: Path, small_three_point: Path, run) -> None:
    run("bench", "three-point", "--frames", 5, "--model", small_three_point, "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert {"p50_ms", "p99_ms", "tracker_p50_ms"} <= set(numbers) and numbers["p50_ms"] > 0


def test_it_is_scored(tmp_path: Path, short_clip: Clip, small_three_point: Path, run) -> None:
    (tmp_path / "motion" / "anna").mkdir(parents=True)
    write_bvh(tmp_path / "motion" / "anna" / "a.bvh", short_clip)
    common = ("--split", "all", "--jobs", 1, "--out", tmp_path / "tables", "--json", tmp_path / "a.json")
    shown = run("evaluate", "three-point", "--data", tmp_path / "motion", "--model", small_three_point, *common)
    assert "AvatarPoser" in shown and "bodysense, head only" in shown
    assert json.loads((tmp_path / "a.json").read_text())["best_mpjpe_cm"] > 0
    assert (tmp_path / "tables" / "three-point.csv").is_file() and (tmp_path / "tables" / "three-point.png").is_file()


@pytest.mark.slow
def test_a_run_from_motion_to_network(tmp_path: Path, motion_data: Path, run) -> None:
    """Real motion, a handful of steps; what is written is loaded and completes a body."""
    out = tmp_path / "a.onnx"
    sizes = ("--steps", 4, "--passes", 2, "--lanes", 4, "--chunk", 6, "--clips", 3, "--hidden", 16, "--threads", 1)
    run("train", "three-point", "--data", motion_data, "-o", out, *sizes)
    run("bench", "three-point", "--frames", 5, "--model", out)
    assert out.with_suffix(".ckpt").is_file() and len(out.with_suffix(".jsonl").read_text().splitlines()) == 1


def test_training_refuses_at_once(tmp_path: Path, refused) -> None:
    arguments = ("train", "three-point", "--data", tmp_path)
    assert "give a name that ends so" in refused(*arguments, "-o", tmp_path / "a.pt")
    assert "--steps 0: give at least 1" in refused(*arguments, "-o", tmp_path / "a.onnx", "--steps", 0)
    assert "--chunk 1: velocities are learned from 2 frames" in refused(
        *arguments, "-o", tmp_path / "a.onnx", "--chunk", 1
    )
    assert "create it or choose another" in refused(*arguments, "-o", tmp_path / "no" / "a.onnx")
