"""The commands, each on a motion of less than a second: what they write can be read, and says what it must."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from bodysense import __version__
from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.cli import main
from bodysense.io.bvh import read_bvh, write_bvh
from bodysense.io.clip import Clip
from bodysense.io.recording import read_recording, write_recording
from bodysense.io.resample import resample
from bodysense.lab.unoc.ik_tracker import load_model

WEIGHTS, DEMO = (Path(str(files(f"bodysense.{room}"))) for room in ("weights", "demo"))
needs_network = pytest.mark.skipif(
    not (WEIGHTS / "body_gru.onnx").is_file(),
    reason="the network is not packaged yet (bodysense/weights/body_gru.onnx)",
)
needs_performance = pytest.mark.skipif(
    not (DEMO / "performance.npz").is_file(),
    reason="the performance is not packaged yet (bodysense/demo/performance.npz)",
)


@pytest.mark.parametrize("ending", ["npz", "jsonl"])
def test_from_motion_to_signals_to_motion(tmp_path: Path, motion: Path, run, ending: str) -> None:
    seen, out = tmp_path / f"seen.{ending}", tmp_path / "out.bvh"
    assert f"wrote {seen}: 20 frames" in run("simulate", motion, "-o", seen)
    assert len(read_recording(seen).observation) == 20
    assert f"wrote {out}: 20 frames at" in run("track", seen, "--out", out)
    tracked, truth = read_bvh(out), read_bvh(motion)
    assert (len(tracked), tracked.frame_rate) == (20, 30.0)
    assert tracked.pose.skeleton.points == truth.pose.skeleton.points
    head = truth.pose.skeleton.index("head")
    found, wanted = (forward_kinematics(clip.pose)[0][:, head] for clip in (tracked, truth))
    assert np.linalg.norm(found - wanted, axis=-1).max() < 0.002


@pytest.mark.parametrize("device", ["headset_camera", "three_point", "head"])
def test_a_motion_is_tracked_in_one_go(tmp_path: Path, motion: Path, run, device: str) -> None:
    """With --device the recording is not written, and the result is the same."""
    run("simulate", motion, "--device", device, "-o", tmp_path / "seen.npz")
    run("track", tmp_path / "seen.npz", "-o", tmp_path / "two.bvh")
    run("track", motion, "--device", device, "-o", tmp_path / "one.bvh")
    one, two = (forward_kinematics(read_bvh(tmp_path / f"{name}.bvh").pose)[0] for name in ("one", "two"))
    np.testing.assert_allclose(one, two, atol=1e-4)


def test_the_wearer(tmp_path: Path, motion: Path, run) -> None:
    """A recording has its body; a height is told; what was inferred is said and kept in a file."""
    run("simulate", motion, "-o", tmp_path / "tall.npz", "--height", 1.9)
    recording = read_recording(tmp_path / "tall.npz")
    assert recording.skeleton.height == pytest.approx(1.9)
    assert "inferred" not in run("track", tmp_path / "tall.npz", "-o", tmp_path / "a.bvh")
    assert read_bvh(tmp_path / "a.bvh").pose.skeleton.height == pytest.approx(1.9, abs=1e-3)
    said = run("track", tmp_path / "tall.npz", "-o", tmp_path / "a.bvh", "--height", 1.75)
    assert "height 1.75 m told, other proportions inferred" in said
    write_recording(tmp_path / "unknown.npz", replace(recording, told=False))
    saved = ("--save-person", tmp_path / "me.json")
    said = run("track", tmp_path / "unknown.npz", "-o", tmp_path / "a.bvh", *saved)
    assert re.search(r"height \d\.\d\d m inferred", said) and "me.json" in said
    assert Person.load(tmp_path / "me.json").bone_deviation.any()
    run("track", tmp_path / "unknown.npz", "-o", tmp_path / "b.bvh", "--person", tmp_path / "me.json")


def test_noise_feet_and_floor(tmp_path: Path, motion: Path, run) -> None:
    for name, options in (("exact", ()), ("one", ("--noise",)), ("two", ("--noise", "--seed", 2))):
        run("simulate", motion, "--device", "six_point", "-o", tmp_path / f"{name}.npz", *options)
    places = [read_recording(tmp_path / f"{name}.npz").observation.position for name in ("exact", "one", "two")]
    assert 0 < np.abs(places[1] - places[0]).max() < 0.1 and np.abs(places[2] - places[1]).max() > 0
    given = ("track", motion, "--device", "three_point", "--noise", "-o", tmp_path / "a.bvh")
    run(*given, "--no-hold-feet", "--floor", -0.02)


def test_a_network_of_ones_own(tmp_path: Path, motion: Path, run) -> None:
    (tmp_path / "own.onnx").write_bytes((WEIGHTS / "completion.onnx").read_bytes())
    run("track", motion, "--device", "head", "-o", tmp_path / "a.bvh", "--model", tmp_path / "own.onnx")


def test_irregular_frames_come_out_regular(tmp_path: Path, motion: Path, run) -> None:
    """A device at about 60 Hz that loses frames: the result has a frame every 1/60 s."""
    run("simulate", motion, "-o", tmp_path / "seen.npz")
    recording = read_recording(tmp_path / "seen.npz")
    time = np.arange(26) / 60
    time = np.delete(time, [3, 4, 9, 15, 16, 20])
    write_recording(tmp_path / "odd.npz", replace(recording, observation=replace(recording.observation, time=time)))
    run("track", tmp_path / "odd.npz", "-o", tmp_path / "out.bvh")
    clip = read_bvh(tmp_path / "out.bvh")
    assert clip.frame_rate == pytest.approx(60) and len(clip) == 26


def test_one_frame_is_enough(tmp_path: Path, short_clip: Clip, run) -> None:
    write_bvh(tmp_path / "one.bvh", replace(short_clip, pose=short_clip.pose[:1]))
    run("track", tmp_path / "one.bvh", "--device", "headset_camera", "-o", tmp_path / "out.bvh")
    assert len(read_bvh(tmp_path / "out.bvh")) == 1


def test_samples_go_with_nothing_else(tmp_path: Path, motion: Path, small_vae: Path, refused) -> None:
    given = ("track", motion, "--device", "three_point", "-o", tmp_path / "out.bvh", "--model", small_vae)
    assert "leave --fingers synthesize out" in refused(*given, "--samples", 2, "--fingers", "synthesize")
    assert not list(tmp_path.glob("out*"))


def test_samples_of_one_signal(tmp_path: Path, motion: Path, small_vae: Path, run) -> None:
    run("simulate", motion, "--device", "three_point", "-o", tmp_path / "seen.npz")
    arguments = ("track", tmp_path / "seen.npz", "--model", small_vae, "--samples", 2)
    run(*arguments, "-o", tmp_path / "a.bvh")
    run(*arguments, "-o", tmp_path / "b.bvh")
    run(*arguments, "-o", tmp_path / "c.bvh", "--seed", 2)
    root = {path.stem: read_bvh(path).pose.root_position for path in tmp_path.glob("?_?.bvh")}
    np.testing.assert_array_equal(root["a_1"], root["b_1"])
    np.testing.assert_array_equal(root["a_2"], root["b_2"])
    assert np.abs(root["a_1"] - root["a_2"]).max() > 1e-4 and np.abs(root["a_1"] - root["c_1"]).max() > 1e-4


@pytest.fixture
def folder(tmp_path: Path, short_clip: Clip) -> Path:
    """Two people, one of them at 60 Hz."""
    for person, clip in (("anna", short_clip), ("ben", resample(short_clip, 60.0))):
        (tmp_path / "motion" / person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / person / "a.bvh", clip)
    write_bvh(tmp_path / "motion" / "ben" / "b.bvh", short_clip)
    return tmp_path / "motion"


@pytest.mark.slow
def test_the_shipped_predictor_alone(folder: Path, tmp_path: Path, small_network: Path, run) -> None:
    """UNOC's Table 2 without its networks: the predictor beside the last known position, in one process or two."""
    numbers = {}
    for jobs in (1, 2):
        out = tmp_path / f"{jobs}.json"
        given = (
            "--split",
            "all",
            "--model",
            small_network,
            "--jobs",
            jobs,
            "--json",
            out,
            "--out",
            tmp_path / str(jobs),
        )
        assert "last known" in run("evaluate", "unoc-table2", "--data", folder, *given)
        numbers[jobs] = json.loads(out.read_text())
    assert numbers[1] == pytest.approx(numbers[2]) and numbers[1]["clips"] == 3
    for who in ("tracker", "best", "last_known"):
        for key in ("body_occluded_rmsjpe_cm", "body_occluded_mpjpe_cm", "finger_occluded_rmsjpe_cm"):
            assert numbers[1][f"{who}_{key}"] > 0
        assert numbers[1][f"{who}_body_all_rmsjpe_cm"] < numbers[1][f"{who}_body_occluded_rmsjpe_cm"]


def test_data_info(folder: Path, tmp_path: Path, run) -> None:
    assert "people" in run("data", "info", folder, "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert (numbers["clips"], numbers["people"]) == (3, 2)
    assert numbers["minutes"] == pytest.approx((20 + 20 + 39 / 2) / 30 / 60, rel=1e-3)


def test_data_info_with_occlusion(folder: Path, tmp_path: Path, run) -> None:
    shown = run("data", "info", folder, "--occlusion", "--json", tmp_path / "a.json")
    assert "self-contact" in shown
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert 0 <= numbers["all_hand_hidden"] <= 1 and 0 <= numbers["all_self_contact"] <= 1


def test_data_sources(run) -> None:
    assert "AMASS" in run("data", "sources")


@needs_performance
@pytest.mark.parametrize(
    ("command", "keys"),
    [
        (("ik", "--frames", 10), {"p50_ms", "p95_ms", "p99_ms"}),
        (("ik", "--frames", 10, "--noise", 0.02), {"p50_ms", "p95_ms", "p99_ms"}),
        (("occlusion", "--frames", 200), {"frames_per_second"}),
        (("bvh", "--megabytes", 1), {"mb_per_second", "bare_parse_mb_per_second", "ratio"}),
        (("import", "--runs", 1), {"package_seconds", "seconds", "torch_imported"}),
    ],
    ids=lambda value: "_".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_benchmarks(tmp_path: Path, run, command: tuple[object, ...], keys: set[str]) -> None:
    run("bench", *command, "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert set(numbers) == keys
    assert all(value > 0 for key, value in numbers.items() if key != "torch_imported"), numbers
    assert numbers.get("torch_imported", 0) == 0


@pytest.mark.parametrize("sensors", ["three_point", "headset_camera"])
def test_benchmark_of_a_step(tmp_path: Path, run, sensors: str) -> None:
    run("bench", "step", "--frames", 8, "--sensors", sensors, "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert set(numbers) == {"p50_ms", "p99_ms", "graph_p50_ms", "batch16_ms", "batch16_p99_ms", "rss_mb", "file_mb"}
    assert 0 < numbers["p50_ms"] <= numbers["p99_ms"] and numbers["rss_mb"] > 10 and numbers["file_mb"] > 0.1


def test_demo_of_ones_own_motion(tmp_path: Path, motion: Path, run) -> None:
    said = run("demo", motion, "-o", tmp_path / "demo")
    assert "cm from head and hands" in said and "cm from headset cameras" in said
    names = sorted(path.name for path in (tmp_path / "demo").iterdir())
    assert names == ["demo.png", "demo.webp", "hands.bvh", "result.bvh", "truth.bvh"]
    truth, result = (read_bvh(tmp_path / "demo" / f"{name}.bvh") for name in ("truth", "result"))
    assert len(truth) == len(result) == 20


@pytest.mark.slow
def test_demo(tmp_path: Path, run) -> None:
    said = run("demo", "-o", tmp_path / "demo")
    assert "stranger" in said
    assert 100_000 < (tmp_path / "demo" / "demo.webp").stat().st_size < 1_500_000
    rows = [line.split() for line in said.splitlines() if "the " in line and line.startswith(("head", "headset"))]
    assert len(rows) == 4 and all(float(row[-1]) < float(row[-2]) for row in rows)  # better than doing nothing


@needs_network
def test_the_packaged_network_is_better_than_the_last_known_place(tmp_path: Path, run) -> None:
    (tmp_path / "motion").mkdir()
    (tmp_path / "motion" / "performance.npz").write_bytes((DEMO / "performance.npz").read_bytes())
    given = ("--split", "all", "--jobs", 1, "--json", tmp_path / "a.json", "--out", tmp_path)
    run("evaluate", "unoc-table2", "--data", tmp_path / "motion", *given)
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers["tracker_body_occluded_rmsjpe_cm"] < numbers["last_known_body_occluded_rmsjpe_cm"]


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], ["data", "--help"], ["bench", "step", "--help"]):
        with pytest.raises(SystemExit) as stopped:
            main(arguments)
        assert stopped.value.code == 0
    assert __version__ in capsys.readouterr().out


@needs_network
def test_card_puts_test_figures_into_the_network_and_beside_it(tmp_path: Path, run) -> None:
    network, figures = tmp_path / "copy.onnx", tmp_path / "figures.json"
    network.write_bytes((WEIGHTS / "body_gru.onnx").read_bytes())
    key = "body_occluded_rmsjpe_cm"
    figures.write_text(json.dumps({f"tracker_{key}": 5.0, f"last_known_{key}": 10.0}))
    assert "wrote" in run("train", "card", network, "--figures", figures)
    assert load_model(network).card["test"][f"tracker_{key}"] == 5.0
    assert "| body | occluded | 10.0 | 5.0 |" in network.with_suffix(".md").read_text()
