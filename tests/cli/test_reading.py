"""Lines that commands print about a motion file, and options that correct what was found."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.cli import main
from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.io.motion_files import write_motion
from bodysense.sources import partial_motion


@pytest.fixture
def inches(tmp_path: Path, short_clip: Clip) -> Path:
    """A motion in inches with a floor 20 inches too low, and an unrecognisable name for the left elbow."""
    pose = short_clip.pose
    low = Clip("low", Pose(pose.skeleton, pose.root_position - [0.0, 0.508, 0.0], pose.rotation), short_clip.frame_rate)
    path = tmp_path / "inches.bvh"
    write_bvh(path, low, unit=0.0254)
    path.write_text(path.read_text().replace("left_elbow", "Gelenk"))
    return path


def test_info_reports_the_recognised_rig(inches: Path, tmp_path: Path, run) -> None:
    output = run("data", "info", inches, "--picture", tmp_path / "figures.png", "--json", tmp_path / "numbers.json")
    assert (
        "inches.bvh: SMPL, 52 joints, inches, 1.70 m tall" in output
        and "y up, floor at -0.5" in output
        and "confidence" in output
    )
    assert (tmp_path / "figures.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "numbers.json").read_text())["clips"] == 1


def test_info_of_a_folder_skips_and_counts_what_it_cannot_read(inches: Path, tmp_path: Path, run, refused) -> None:
    (tmp_path / "torn.bvh").write_text(inches.read_text()[:500])
    output = " ".join(run("data", "info", tmp_path).split())
    assert "inches" in output and "skipped 1 of 2 files" in output and "torn.bvh: there is no MOTION section" in output
    inches.rename(tmp_path / "also_torn.bvh").write_text("HIERARCHY")
    assert "none of its 2 files can be read; the first: " in refused("data", "info", tmp_path)


def test_info_describes_files_without_a_rig(tmp_path: Path, short_clip: Clip, run, refused) -> None:
    """glTF, VRM animations, results of SMPL, recordings and markers; refusals name the fix."""
    write_motion(tmp_path / "body.glb", short_clip)
    write_motion(tmp_path / "body.vrma", short_clip)
    np.savez(tmp_path / "video.npz", poses=np.zeros((5, 72)), trans=np.tile([0.0, 0.9, 0.0], (5, 1)))
    run("simulate", tmp_path / "body.glb", "-o", tmp_path / "seen.jsonl")
    run("simulate", tmp_path / "body.glb", "--device", "gloves", "-o", tmp_path / "gloves.csv")
    for name, kind in (
        ("body.glb", "glTF, "),
        ("body.vrma", "VRM animation, "),
        ("video.npz", "SMPL, 30 Hz; no frame rate"),
        ("seen.jsonl", "recording, "),
        ("gloves.csv", "markers, "),
    ):
        assert kind in run("data", "info", tmp_path / name)
    (tmp_path / "take.fbx").write_bytes(b"Kaydara")
    assert "cannot be read, or is damaged" in refused("data", "info", tmp_path / "take.fbx")
    output = run("data", "info", tmp_path)
    assert "take.fbx: this FBX file cannot be read" in output and "skipped 1 of 6 files" in output


def test_options_of_every_command_that_reads_motion(inches: Path, tmp_path: Path, run, refused) -> None:
    out = tmp_path / "out.bvh"
    output = run("track", inches, "--device", "head", "-o", out)
    assert "read " in output and "inches, " in output
    run(
        "simulate",
        inches,
        "-o",
        tmp_path / "seen.npz",
        "--unit",
        "in",
        "--up",
        "y",
        "--floor",
        "-0.508",
        "--height",
        1.9,
    )
    assert "--figure is for motions, not for recordings; leave it out" in refused(
        "track", tmp_path / "seen.npz", "-o", out, "--figure", 1
    )
    assert "--unit mile: give m, cm" in refused("simulate", inches, "-o", out.with_suffix(".npz"), "--unit", "mile")


def test_a_table_of_joints_is_drafted_edited_and_read(inches: Path, tmp_path: Path, run, refused) -> None:
    table, seen = tmp_path / "joints.json", tmp_path / "seen.npz"
    output = run("data", "joints", inches, "-o", table)
    drafted = json.loads(table.read_text())
    assert "65 of 65 joints and end sites named" in output and drafted["Gelenk"] == "left_elbow"
    table.write_text(json.dumps(drafted | {"left_index1": ""}))
    run("simulate", inches, "-o", seen, "--joints", table)
    for change, message in (
        ({"Gelenk": ""}, "it names no left_elbow; a body needs a pelvis, and all 6 joints"),
        ({"Gelenk": "left_elbo"}, "no joint of ours is 'left_elbo'; near are left_elbow"),
        ({"Gelenkk": "left_elbow"}, "the file has no joint 'Gelenkk'; near are Gelenk"),
        ({"Gelenk": "left_knee"}, "'left_knee' stands twice"),
    ):
        table.write_text(json.dumps(drafted | change))
        assert message in refused("simulate", inches, "-o", seen, "--joints", table)
    table.write_text("[")
    assert "not JSON" in refused("simulate", inches, "-o", seen, "--joints", table)


def test_an_incomplete_body_is_drafted_by_joint_names(tmp_path: Path, run, refused) -> None:
    """Upper bodies are recognised by the names of their joints."""
    tree = "JOINT Spine\n{\nOFFSET 0 20 0\nCHANNELS 1 Zrotation\n"
    tree += "".join(
        f"JOINT {side}Arm\n{{\nOFFSET {x} 30 0\nCHANNELS 1 Zrotation\n"
        f"JOINT {side}ForeArm\n{{\nOFFSET {x} 0 0\nCHANNELS 1 Zrotation\nEnd Site\n{{\nOFFSET {x} 0 0\n}}\n}}\n}}\n"
        for side, x in (("Left", 25), ("Right", -25))
    )
    head = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\n"
    path = tmp_path / "upper.bvh"
    path.write_text(f"{head}{tree}}}\n}}\nMOTION\nFrames: 1\nFrame Time: 0.03\n0 0 0 0 0 0\n")
    assert "two legs and two arms were not found" in refused("data", "info", path)
    assert "5 of 8 joints and end sites named, by their names alone: " in run(
        "data", "joints", path, "-o", tmp_path / "joints.json"
    )
    assert "the table for --joints is JSON" in refused("data", "joints", path, "-o", tmp_path / "out.bvh")
    drafted = json.loads((tmp_path / "joints.json").read_text())
    assert drafted["LeftForeArm"] == "left_elbow" and drafted["Hips"] == "pelvis" and drafted["Spine"] == ""


def test_the_library_takes_the_same_options(inches: Path) -> None:
    import bodysense
    from bodysense.io.reading_options import ReadingOptions

    clip = bodysense.read(inches, ReadingOptions(height=1.9))
    assert isinstance(clip, Clip) and clip.pose.skeleton.height == pytest.approx(1.9)
    assert np.abs(read_bvh(inches, unit=0.0254).pose.root_position).max() < 2


def test_joint_positions_are_tracked_and_not_converted(tmp_path: Path, run, refused) -> None:
    """All commands use one reader; positions that are read as rotations would give a knotted body."""
    clip = packaged_performance()
    places, out = tmp_path / "places.npy", tmp_path / "out.bvh"
    np.save(places, np.asarray(forward_kinematics(clip.pose)[0])[200:220, :22])
    for command in (("convert", places, "-o", out), ("simulate", places, "-o", tmp_path / "out.npz")):
        assert "joint places, not a motion; complete it first: bodysense track places.npy" in refused(*command)
    assert "markers, 30 Hz; 22 points of a body" in run("data", "info", places)
    assert "the body is completed from them" in run("track", places, "-o", out)


def test_a_rate_is_refused_if_the_file_has_one(tmp_path: Path, motion: Path, run, refused) -> None:
    out = tmp_path / "out.glb"
    message = "the file says its frame rate; leave {} 60 out"
    assert message.format("--rate") in refused("track", motion, "-o", out, "--rate", 60)
    assert message.format("--rate") in refused("simulate", motion, "-o", tmp_path / "out.npz", "--rate", 60)
    assert message.format("--file-rate") in refused("convert", motion, "-o", out, "--file-rate", 60)
    np.save(tmp_path / "turns.npy", np.zeros((5, 66)))
    assert "30 Hz is taken (--file-rate)" in run("convert", tmp_path / "turns.npy", "-o", out)
    assert "5 frames at 60 Hz" in run("convert", tmp_path / "turns.npy", "-o", out, "--file-rate", 60)
    np.savez(tmp_path / "other.npz", joints=np.zeros((5, 22, 3)))
    assert "no 'poses' in it" in refused("track", tmp_path / "other.npz", "-o", out, "--rate", 60)


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A complete motion in centimetres."""
    write_bvh(tmp_path / "whole.bvh", replace(packaged_performance(), pose=packaged_performance().pose[200:230]))
    return tmp_path / "whole.bvh"


def test_a_complete_file_is_refused_if_options_would_change_it(whole: Path, tmp_path: Path, run, refused) -> None:
    out = tmp_path / "out.bvh"
    for option in (("--height", 1.5), ("--up", "y"), ("--unit", "cm"), ("--floor", 0.1)):
        assert f"{option[0]} {option[1]} would change nothing; leave that out, or write it with --rig bodysense" in (
            refused("track", whole, "-o", out, *option)
        )
    assert not out.exists()
    run("track", whole, "-o", out, "--height", 1.5, "--rig", "bodysense")
    assert read_bvh(out).pose.skeleton.height == pytest.approx(1.5, abs=1e-3)


def test_track_reports_how_a_motion_was_read(inches: Path, tmp_path: Path, run) -> None:
    """The line is printed for files with holes (NaN), too."""
    assert "inches, 1.70 m tall" in run("track", inches, "-o", tmp_path / "out.bvh")
    lines = inches.read_text().splitlines()
    lines[-1] = " ".join([*lines[-1].split()[:-3], "nan", "nan", "nan"])
    inches.write_text("\n".join(lines))
    assert "inches, 1.70 m tall" in run("track", inches, "-o", tmp_path / "out.bvh")
    np.save(tmp_path / "turns.npy", np.zeros((5, 66)))
    assert "30 Hz is taken (--rate)" in run("track", tmp_path / "turns.npy", "-o", tmp_path / "out.glb")


def test_a_filled_file_keeps_its_size_and_refuses_another(whole: Path, tmp_path: Path, run, refused) -> None:
    """A height holds for our own rig alone; filling without it, or on our rig, works."""
    assert "an item is empty; name joints" in refused("track", whole, "--missing", "", "-o", tmp_path / "out.bvh")
    filling = ("track", whole, "--missing", "left_hand:3-9", "-o", tmp_path / "out.bvh")
    assert "--height 1.5 would not change the body's; leave that out" in refused(*filling, "--height", 1.5)
    assert "wrote" in run(*filling, "--height", 1.5, "--rig", "bodysense") and "wrote" in run(*filling)


def test_convert_warns_of_limbs_that_are_held_still(
    whole: Path, tmp_path: Path, run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.glb"
    assert "WARNING" not in run("convert", whole, "-o", out)
    clip = read_bvh(whole)
    rotation = np.array(clip.pose.rotation)
    elbow = clip.pose.skeleton.index("left_elbow")
    rotation[5:, elbow] = rotation[5, elbow]
    write_bvh(whole, replace(clip, pose=replace(clip.pose, rotation=rotation)))
    monkeypatch.setattr(partial_motion, "rigged_of", None)  # the file's rig is recognised once
    assert main(["convert", str(whole), "-o", str(out), "--json", str(tmp_path / "out.json")]) == 0
    output, (line,) = capsys.readouterr().err, json.loads((tmp_path / "out.json").read_text())["warnings"]
    assert f"WARNING: {line}" in output and "WARNING: limbs are held still" in output and "left_elbow 2" in output
    assert "complete them: bodysense track whole.bvh -o out.glb" in output
