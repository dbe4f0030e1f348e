"""Wrong files: one line that names the fault, status 2, no traceback, and no remaining file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.formats.recording import Recording, write_recording


def files(folder: Path) -> list[str]:
    """Return the names of all files below a folder, including hidden ones."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def broken(tmp_path: Path, motion: Path, short_clip: Clip) -> Path:
    """A folder of files each of which is wrong in its own way; good ones are `motion.bvh` and `seen.npz`.

    Tests of readers cover other faults of files: all errors become a line in the same way.
    """
    lines = motion.read_text().splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("Frame Time"))
    lines[start + 1] = " ".join(["nan", *lines[start + 1].split()[1:]])
    (tmp_path / "nan.bvh").write_text("\n".join(lines) + "\n")

    poses, trans = np.zeros((4, 156)), np.zeros((4, 3))
    np.savez(tmp_path / "nan.npz", poses=poses + np.nan, trans=trans, mocap_framerate=30.0)
    (tmp_path / "motion.csv").write_text("1,2,3")

    recording = Recording(observe(short_clip.pose, short_clip.time, HEADSET_CAMERA), short_clip.pose.skeleton)
    write_recording(tmp_path / "seen.npz", recording)
    with np.load(tmp_path / "seen.npz") as archive:
        arrays = dict(archive)
    spoilt = {name: np.array(["tail", *arrays[name][1:]]) for name in ("points", "joints")}
    content: dict[str, Any] = arrays | spoilt
    np.savez(tmp_path / "tail.npz", **content)

    header = b'{"__metadata__": {"format": "another"}}'
    (tmp_path / "foreign.safetensors").write_bytes(len(header).to_bytes(8, "little") + header)
    (tmp_path / "old.onnx").write_text("hello")
    return tmp_path


SIMULATE = ("simulate", "{file}", "-o", "{folder}/out.npz")
TRACK = ("track", "{file}", "-o", "{folder}/out.bvh")
MODEL = ("track", "{folder}/seen.npz", "--model", "{file}", "-o", "{folder}/out.bvh")
DEMO = ("demo", "{file}", "-o", "{folder}/demo")

WRONG = {
    "poses that are NaN": (SIMULATE, "nan.npz", "'poses' is not finite in row 0"),
    "another kind of file": (
        SIMULATE,
        "motion.csv",
        r"markers, not a motion; .* or give a file of \.bvh, \.fbx, \.mvnx, \.npz",
    ),
    "frames that are NaN": (DEMO, "nan.bvh", "frame 0 is not finite"),
    "another skeleton": (TRACK, "tail.npz", "unknown joint 'tail'"),
    "holes of a recording": ((*TRACK, "--missing", "head"), "seen.npz", "--missing is for a motion"),
    "a foreign network": (MODEL, "foreign.safetensors", "the weights are not bodysense-completion's"),
    "a network of an older version": (
        MODEL,
        "old.onnx",
        r"of an older version; give the \.safetensors",
    ),
    "a recording that is recorded": (
        SIMULATE,
        "seen.npz",
        "a recording, not a motion; complete it first",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_files(broken: Path, refused, what: str) -> None:
    command, name, text = WRONG[what]
    before = files(broken)
    line = refused(*(word.format(file=broken / name, folder=broken) for word in command))
    assert name in line
    assert re.search(text, line), line
    assert files(broken) == before


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ([""], '"": unknown command'),
        (["serve", ""], '"": unknown argument'),
        (["demo", ""], 'PATH "": give a file or folder'),
        (["conform", ""], 'SOURCE "": give a file, a folder or a stream'),
        (["serve", "--replay", ""], '--replay "": give a file or folder'),
    ],
)
def test_an_empty_word_is_named(refused, words: list[str], named: str) -> None:
    assert named in refused(*words)


def test_a_split_without_clips(tmp_path: Path, short_clip: Clip, refused) -> None:
    (tmp_path / "folder" / "anna").mkdir(parents=True)
    write_bvh(tmp_path / "folder" / "anna" / "a.bvh", short_clip)
    lines = [refused("data", "info", tmp_path / "folder", "--split", split) for split in ("val", "test")]
    assert all("folder: none of its 1 clips is of split" in line for line in lines)
    assert all("(1 of train); people are split by their names: give motion of more people" in line for line in lines)
