"""Whatever is wrong with what the user gives: one line that names it, status 2, no traceback, no file left behind."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.io.bvh import write_bvh
from bodysense.io.clip import Clip
from bodysense.io.recording import Recording, write_recording


def files(folder: Path) -> list[str]:
    """Names of all files below a folder, also hidden ones."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def broken(tmp_path: Path, motion: Path, short_clip: Clip) -> Path:
    """A folder of files each of which is wrong in its own way; good ones are `motion.bvh` and `seen.npz`."""
    text = motion.read_text()
    lines = text.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("Frame Time"))
    (tmp_path / "cut.bvh").write_text(text[: len(text) // 2])
    (tmp_path / "cut_tree.bvh").write_text(text[:300])
    first = lines[start + 1].split()
    spoilt = [*lines[: start + 1], " ".join(["nan", *first[1:]]), *lines[start + 2 :]]
    (tmp_path / "nan.bvh").write_text("\n".join(spoilt) + "\n")
    (tmp_path / "empty.bvh").write_text("")

    poses, trans = np.zeros((4, 156)), np.zeros((4, 3))
    np.savez(tmp_path / "shape.npz", poses=poses[:, :100], trans=trans, mocap_framerate=30.0)
    np.savez(tmp_path / "nan.npz", poses=poses + np.nan, trans=trans, mocap_framerate=30.0)
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "motion.csv").write_text("1,2,3")

    recording = Recording(observe(short_clip.pose, short_clip.time, HEADSET_CAMERA), short_clip.pose.skeleton)
    write_recording(tmp_path / "seen.npz", recording)
    with np.load(tmp_path / "seen.npz") as archive:
        arrays = dict(archive)
    changes = {
        "backwards": {"time": arrays["time"][::-1]},
        "few": {"position": arrays["position"][:3]},
        "nose": {"points": np.array(["nose", *arrays["points"][1:]])},
        "tail": {
            "points": np.array(["tail", *arrays["points"][1:]]),
            "joints": np.array(["tail", *arrays["joints"][1:]]),
        },
    }
    for name, change in changes.items():
        content: dict[str, Any] = arrays | change
        np.savez(tmp_path / f"{name}.npz", **content)
    header = '{"format": "bodysense recording 1", "points": ["head"]}\n'
    (tmp_path / "backwards.jsonl").write_text(header + '{"time": 1}\n{"time": 0.5}\n')
    (tmp_path / "cut.jsonl").write_text(header + '{"time": 1, "posi')

    header = b'{"__metadata__": {"format": "another"}}'
    (tmp_path / "foreign.safetensors").write_bytes(len(header).to_bytes(8, "little") + header)
    (tmp_path / "text.safetensors").write_text("hello")
    (tmp_path / "old.onnx").write_text("hello")
    (tmp_path / "nothing").mkdir()
    return tmp_path


SIMULATE = ("simulate", "{file}", "-o", "{folder}/out.npz")
TRACK = ("track", "{file}", "-o", "{folder}/out.bvh")
MOTION = ("track", "{file}", "--device", "headset_camera", "-o", "{folder}/out.bvh")
MODEL = ("track", "{folder}/seen.npz", "--model", "{file}", "-o", "{folder}/out.bvh")
DEMO = ("demo", "{file}", "-o", "{folder}/demo")

WRONG = {
    "a truncated motion": (SIMULATE, "cut.bvh", "announces .* values .*, but there are .* whole frames"),
    "a truncated hierarchy": (SIMULATE, "cut_tree.bvh", "there is no MOTION section; the file is cut off"),
    "an empty file": (SIMULATE, "empty.bvh", "the file is empty"),
    "frames that are NaN": (SIMULATE, "nan.bvh", "frame 0 is not finite; cut or mend it"),
    "poses of another shape": (SIMULATE, "shape.npz", r"'poses' has shape \(4, 100\)"),
    "poses that are NaN": (SIMULATE, "nan.npz", "'poses' is not finite in row 0"),
    "text for an archive": (SIMULATE, "text.npz", "cannot be read as an .npz file"),
    "another kind of file": (
        SIMULATE,
        "motion.csv",
        r"markers, not a motion; .* or give a file of \.bvh, \.npz",
    ),
    "a missing motion": (SIMULATE, "missing.bvh", "[Nn]o such file"),
    "the same, to be shown": (DEMO, "nan.bvh", "frame 0 is not finite"),
    "a recording backwards": (TRACK, "backwards.npz", "time goes from .* times must increase: sort the frames"),
    "lines backwards": (TRACK, "backwards.jsonl", r"time goes from 1 s to 0\.5 s at frame 1; times must increase"),
    "too few positions": (
        TRACK,
        "few.npz",
        r"position has shape \(3, 65, 3\); 20 frames of 65 points need \(20, 65, 3\)",
    ),
    "an unknown point": (TRACK, "nose.npz", "unknown joint 'nose'"),
    "a line cut short": (TRACK, "cut.jsonl", r"line 2 is not JSON; was the file cut short\?"),
    "an unknown joint that is missing": (
        (*TRACK, "--missing", "left_han"),
        "motion.bvh",
        "the motion has no such joint; valid are pelvis, left_hip",
    ),
    "everything missing": ((*TRACK, "--missing", "pelvis+"), "motion.bvh", "everything hangs on it; give the frames"),
    "holes of a recording": ((*TRACK, "--missing", "head"), "seen.npz", "--missing is for a motion"),
    "a recording's own rig": ((*TRACK, "--rig", "source"), "seen.npz", r"only a \.bvh file has a rig of its own"),
    "a foreign network": (MODEL, "foreign.safetensors", "the weights are not bodysense-completion's"),
    "text for a network": (MODEL, "text.safetensors", "truncated or not a safetensors file"),
    "a network of an older version": (
        MODEL,
        "old.onnx",
        r"of an older version; give the \.safetensors",
    ),
    "a missing network": (MODEL, "missing.safetensors", "no such model file"),
    "a recording that is recorded": (
        SIMULATE,
        "seen.npz",
        "a recording, not a motion; complete it first",
    ),
    "an empty folder": (("data", "info", "{file}"), "nothing", r"no \.bvh or \.npz file in it"),
    "a missing folder": (("data", "info", "{file}"), "missing", "no such folder"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_files(broken: Path, refused, what: str) -> None:
    command, name, text = WRONG[what]
    before = files(broken)
    line = refused(*(word.format(file=broken / name, folder=broken) for word in command))
    assert name in line
    assert re.search(text, line), line
    assert files(broken) == before


def test_another_skeleton_is_refused(broken: Path, refused) -> None:
    assert "unknown joint 'tail'" in refused("track", broken / "tail.npz", "-o", broken / "out.bvh")


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (
            ("simulate", "{folder}/motion.bvh", "-o", "{folder}/a.txt"),
            r"a\.txt: signals of headset_camera are written as \.npz, \.jsonl; give a name that ends so",
        ),
        (("track", "{folder}/seen.npz", "-o", "{folder}/a.txt"), r"ends in '\.txt'; give a name that ends in \.bvh"),
        (("track", "{folder}/seen.npz", "-o", "{folder}/a"), r"ends in 'nothing'; give a name that ends in \.bvh"),
        (
            ("track", "{folder}/seen.npz", "-o", "{folder}/nothing"),
            r"nothing is a folder; give the name of a file in it",
        ),
        (("demo", "{folder}/motion.bvh", "-o", "{folder}/motion.csv"), r"motion\.csv: no folder can be made there"),
    ],
)
def test_output_of_the_wrong_kind(broken: Path, refused, command: tuple[str, ...], text: str) -> None:
    before = files(broken)
    assert re.search(text, refused(*(word.format(folder=broken) for word in command)))
    assert files(broken) == before


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--floor", "nan"), "floor nan m; give the floor's height in metres"),
        (("--floor", "5"), r"the head is 3\.\d+ m below the floor"),
        (("--person", "{folder}/me.json", "--height", "1.7"), "holds the wearer's height; leave one of both out"),
        (("--save-person", "{folder}/missing/me.json"), "does not exist; create it"),
    ],
)
def test_values_that_cannot_be(broken: Path, refused, options: tuple[str, ...], text: str) -> None:
    given = [word.format(folder=broken) for word in options]
    line = refused("track", broken / "motion.bvh", "--device", "headset_camera", "-o", broken / "out.bvh", *given)
    assert re.search(text, line), line
    assert not (broken / "out.bvh").exists()


def test_nothing_tracked_at_all(broken: Path, refused) -> None:
    header = '{"format": "bodysense recording 1", "points": ["head"]}\n'
    (broken / "dark.jsonl").write_text(header + '{"time": 1}\n{"time": 2}\n')
    assert "dark.jsonl: nothing is tracked in its 2 frames" in refused(
        "track", broken / "dark.jsonl", "-o", broken / "out.bvh"
    )


def test_a_split_without_clips(tmp_path: Path, short_clip: Clip, refused) -> None:
    (tmp_path / "folder" / "anna").mkdir(parents=True)
    write_bvh(tmp_path / "folder" / "anna" / "a.bvh", short_clip)
    lines = [refused("data", "info", tmp_path / "folder", "--split", split) for split in ("val", "test")]
    assert all("folder: none of its 1 clips is of split" in line for line in lines)
    assert all("(1 of train); people are split by their names: give motion of more people" in line for line in lines)
