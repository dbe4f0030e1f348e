"""Commands on motions of less than a second: outputs are readable and have the right content."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.cli import main
from bodysense.demo import packaged_performance
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.io.formats.recording import read_recording, write_recording


@pytest.mark.parametrize("ending", ["npz", "jsonl"])
def test_simulate_and_track_a_motion(tmp_path: Path, motion: Path, run, ending: str) -> None:
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


def test_a_motion_is_tracked_in_one_command(tmp_path: Path, motion: Path, run) -> None:
    """The result of track --device equals that of simulate and track."""
    run("simulate", motion, "--device", "headset_camera", "-o", tmp_path / "seen.npz")
    run("track", tmp_path / "seen.npz", "-o", tmp_path / "two.bvh")
    run("track", motion, "--device", "headset_camera", "-o", tmp_path / "one.bvh")
    one, two = (forward_kinematics(read_bvh(tmp_path / f"{name}.bvh").pose)[0] for name in ("one", "two"))
    np.testing.assert_allclose(one, two, atol=1e-4)


def test_a_motion_is_converted(tmp_path: Path, motion: Path, run, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["convert", str(motion), "-o", str(tmp_path / "out.glb"), "--rig", "unreal", "--rate", "60"]) == 0
    output = capsys.readouterr()
    assert "wrote " in output.out and "39 frames at 60 Hz on unreal" in output.out
    assert "WARNING: limbs are held still" in output.err  # the short clip's legs never move
    whole = packaged_performance()
    write_bvh(tmp_path / "whole.bvh", replace(whole, pose=whole.pose[:20]))
    output = run("track", tmp_path / "whole.bvh", "-o", tmp_path / "same.bvh")
    assert "nothing is missing in this motion: it is unchanged" in output
    assert (tmp_path / "same.bvh").read_bytes() == (tmp_path / "whole.bvh").read_bytes()


def test_options_of_the_wearer(tmp_path: Path, motion: Path, run) -> None:
    """The body is that of the recording, of a given height, or inferred; it is printed and saved."""
    run("simulate", motion, "-o", tmp_path / "tall.npz", "--height", 1.9)
    recording = read_recording(tmp_path / "tall.npz")
    assert recording.skeleton.height == pytest.approx(1.9)
    assert "inferred" not in run("track", tmp_path / "tall.npz", "-o", tmp_path / "a.bvh")
    assert read_bvh(tmp_path / "a.bvh").pose.skeleton.height == pytest.approx(1.9, abs=1e-3)
    output = run("track", tmp_path / "tall.npz", "-o", tmp_path / "a.bvh", "--height", 1.75)
    assert "height 1.75 m known, other proportions inferred" in output
    write_recording(tmp_path / "unknown.npz", replace(recording, known=False))
    saved = ("--save-person", tmp_path / "me.json")
    output = run("track", tmp_path / "unknown.npz", "-o", tmp_path / "a.bvh", *saved)
    assert re.search(r"height \d\.\d\d m inferred", output) and "me.json" in output
    assert Person.load(tmp_path / "me.json").bone_deviation.any()
    run("track", tmp_path / "unknown.npz", "-o", tmp_path / "b.bvh", "--person", tmp_path / "me.json")


def test_noise_feet_and_floor(tmp_path: Path, motion: Path, run) -> None:
    for name, options in (("exact", ()), ("one", ("--noise",)), ("two", ("--noise", "--seed", 2))):
        run("simulate", motion, "--device", "six_point", "-o", tmp_path / f"{name}.npz", *options)
    places = [read_recording(tmp_path / f"{name}.npz").observation.position for name in ("exact", "one", "two")]
    assert 0 < np.abs(places[1] - places[0]).max() < 0.1 and np.abs(places[2] - places[1]).max() > 0
    given = ("track", motion, "--device", "three_point", "--noise", "-o", tmp_path / "a.bvh")
    run(*given, "--no-hold-feet", "--floor", -0.02)


def test_a_network_file_is_used(tmp_path: Path, motion: Path, run) -> None:
    weights = (files("bodysense.weights") / "completion.safetensors").read_bytes()
    same, other = tmp_path / "same.safetensors", tmp_path / "other.safetensors"
    same.write_bytes(weights)
    tables = 8 + int.from_bytes(weights[:8], "little")
    half = tables + (len(weights) - tables) // 2
    other.write_bytes(weights[:half] + bytes(4096) + weights[half + 4096 :])  # 4 kB of weights are 0
    command = ("track", motion, "--device", "head", "--causal")
    for name, options in (("packaged", ()), ("same", ("--model", same)), ("other", ("--model", other))):
        run(*command, "-o", tmp_path / f"{name}.bvh", *options)
    packaged, copied, changed = (read_bvh(tmp_path / f"{name}.bvh").pose for name in ("packaged", "same", "other"))
    np.testing.assert_array_equal(copied.rotation, packaged.rotation)
    assert np.abs(changed.rotation - packaged.rotation).max() > 1e-3


def test_samples_of_one_recording(tmp_path: Path, motion: Path, run) -> None:
    run("simulate", motion, "--device", "three_point", "-o", tmp_path / "seen.npz")
    arguments = ("papers", "sample", tmp_path / "seen.npz", "--count", 2)
    run(*arguments, "-o", tmp_path / "a.bvh")
    run(*arguments, "-o", tmp_path / "b.bvh")
    run(*arguments, "-o", tmp_path / "c.bvh", "--seed", 2)
    root = {path.stem: read_bvh(path).pose.root_position for path in tmp_path.glob("?_?.bvh")}
    np.testing.assert_array_equal(root["a_1"], root["b_1"])
    np.testing.assert_array_equal(root["a_2"], root["b_2"])
    assert np.abs(root["a_1"] - root["a_2"]).max() > 1e-4 and np.abs(root["a_1"] - root["c_1"]).max() > 1e-4


def test_data_info(two_people: Path, tmp_path: Path, run) -> None:
    assert "people" in run("data", "info", two_people, "--json", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert (numbers["clips"], numbers["people"]) == (3, 2)
    assert numbers["minutes"] == pytest.approx((20 + 20 + 39 / 2) / 30 / 60, rel=1e-3)


def test_data_sources(run) -> None:
    assert "AMASS" in run("data", "sources")


def test_demo_of_a_file(tmp_path: Path, motion: Path, run) -> None:
    output = run("demo", motion, "-o", tmp_path / "demo")
    assert "cm from head and hands" in output and "cm from headset cameras" in output
    names = sorted(path.name for path in (tmp_path / "demo").iterdir())
    assert names == ["demo.png", "demo.webp", "hands.bvh", "result.bvh", "truth.bvh"]
    truth, result = (read_bvh(tmp_path / "demo" / f"{name}.bvh") for name in ("truth", "result"))
    assert len(truth) == len(result) == 20


@pytest.mark.slow
def test_demo(tmp_path: Path, run) -> None:
    output = run("demo", "-o", tmp_path / "demo")
    assert "unseen body" in output
    assert 100_000 < (tmp_path / "demo" / "demo.webp").stat().st_size < 1_500_000
    rows = [line.split() for line in output.splitlines() if "the " in line and line.strip().startswith("head")]
    assert len(rows) == 4 and all(float(row[-1]) < float(row[-2]) for row in rows)  # better than doing nothing


def test_lines_of_help_are_filled(capsys: pytest.CaptureFixture[str]) -> None:
    """The next word does not fit on a line, in the first text (of a command) and in the last (of shared options)."""
    with pytest.raises(SystemExit):
        main(["track", "--help"])
    framed = capsys.readouterr().out.splitlines()
    lines = [line.strip(" │|").removeprefix("PATH ") for line in framed]
    first = next(k for k, line in enumerate(lines) if line.strip().startswith("recording (.npz"))
    last = next(k for k, line in enumerate(lines) if line.startswith("--smpl-model"))
    indented = framed[first + 1]
    room = len(indented) - 1 - indented.index(lines[first + 1])  # characters of a text, up to the frame
    assert 50 <= room <= 60
    for begin, count in ((first, 4), (last, 3)):
        texts = [line.removeprefix("--smpl-model PATH").strip() for line in lines[begin : begin + count]]
        assert all(len(line) + 1 + len(after.split()[0]) > room - 1 for line, after in pairwise(texts)), texts


def test_options_of_track_are_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["track", "--help"])
    parts = re.split(r"(?m)^ ([a-z ]*(?:arguments|options)) *\n -+ *$", capsys.readouterr().out)
    groups = dict(zip(parts[1::2], parts[2::2], strict=True))
    assert list(groups) == [
        "positional arguments",
        "options",
        "markers options",
        "video options",
        "reading options",
        "many options",
    ]
    for option, group in (("--names", "markers"), ("--overlay", "video"), ("--unit", "reading"), ("--device", "")):
        found = [name for name, text in groups.items() if re.search(rf"(?m)^ {{1,4}}{option}\b", text)]
        assert found == [f"{group} options".strip()]
