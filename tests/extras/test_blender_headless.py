"""The extension in Debian's Blender and in the module `bpy`.

Holes are filled, known bones are unchanged, live poses match the server's.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense.io.motion_files import write_motion
from bodysense_live.protocols.vmc import vmc_packets

pytestmark = [pytest.mark.slow, pytest.mark.blender]
# Pythons with PyPI's module `bpy`, which has Blender 4.2 or later, separated as in PATH.
MODULES = tuple(path for path in os.environ.get("BPY_PYTHONS", "").split(os.pathsep) if path)
FRAMES, HOLE = 120, slice(40, 81)  # of the take; Blender's frames begin at 1
LIVE = (0, 60, 110)


@pytest.fixture(scope="module")
def clip() -> Clip:
    return Clip("performance", packaged_performance().pose[:FRAMES], 30.0)


@pytest.fixture(scope="module", params=("blender", *MODULES))
def found(
    request: pytest.FixtureRequest, clip: Clip, packages: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    """Run the script in Debian's Blender, or in a Python with the module `bpy`."""
    program = request.param if request.param in MODULES else shutil.which("blender")
    if program is None:
        pytest.skip("no blender on this machine: apt-get install blender")
    folder = tmp_path_factory.mktemp("blender")
    (archive,) = (packages / "blender").glob("*.zip")
    write_motion(folder / "take.bvh", clip, "mixamo")
    packets = [packet.hex() for k in LIVE for packet in vmc_packets(clip.pose[k], k / 30)]
    (folder / "packets.json").write_text(json.dumps(packets))
    start, place = [program], archive.parent
    if program not in MODULES:
        start += ["--background", "--factory-startup", "--python-exit-code", "3", "--python"]
        place = folder
        with zipfile.ZipFile(archive) as extension:
            extension.extractall(folder / "bodysense_addon")
        for wheel in (folder / "bodysense_addon" / "wheels").glob("*.whl"):
            with zipfile.ZipFile(wheel) as package:
                package.extractall(folder / "wheels")
    given = [str(place), *(str(folder / name) for name in ("take.bvh", "packets.json", "found.json"))]
    ran = subprocess.run(
        [*start, str(Path(__file__).parent / "blender_script.py"), "--", *given],
        capture_output=True,
        text=True,
        timeout=480,
        check=False,
        env={**os.environ, "PYTHONPATH": "", "BLENDER_USER_RESOURCES": str(folder / "user")},
    )
    assert ran.returncode == 0, ran.stdout[-3000:] + ran.stderr[-3000:]
    return json.loads((folder / "found.json").read_text())


def _of_hole(name: str) -> bool:
    return '"mixamorig:LeftArm"' in name or '"mixamorig:LeftForeArm"' in name


@pytest.mark.parametrize("way", ["selected", "unkeyed"])
def test_a_hole_is_filled_and_what_is_known_stays(found: dict[str, Any], way: str) -> None:
    truth, filled = found["keys"], found[way]["keys"]
    assert set(filled) == set(truth)
    for name, keys in truth.items():
        if not _of_hole(name):
            assert filled[name] == keys, name
        else:
            assert len(filled[name]) == FRAMES
            for part in (slice(0, HOLE.start), slice(HOLE.stop, None)):
                assert filled[name][part] == keys[part], name
    hand, true = (np.array(of["mixamorig:LeftHand"]) for of in (found[way]["places"], found["truth"]))
    assert np.ptp(hand[HOLE], axis=0).max() > 0.05  # m: it moves
    assert np.linalg.norm(hand - true, axis=1)[HOLE].max() < 0.5
    assert np.linalg.norm(np.diff(hand, axis=0), axis=1).max() < 0.2  # m in a frame: no leap at the edges
    assert found[way]["places"]["mixamorig:RightHand"] == found["truth"]["mixamorig:RightHand"]


def test_the_new_action_leaves_the_old_one(found: dict[str, Any]) -> None:
    assert found["selected"]["action"].endswith("filled")


def test_a_body_is_completed_from_head_and_hands(found: dict[str, Any]) -> None:
    for name, most in (("Head", 0.03), ("LeftHand", 0.03), ("RightHand", 0.03), ("Hips", 0.2), ("LeftFoot", 0.6)):
        ours, true = (np.array(of[f"mixamorig:{name}"]) for of in (found["completed"]["places"], found["truth"]))
        distance = np.linalg.norm(ours - true, axis=1)
        assert distance.mean() < most, name
        if name == "Hips":
            assert distance.max() > 1e-3  # they were not tracked


def test_refusals_are_one_line(found: dict[str, Any]) -> None:
    frames, nothing, wheels, program = (line.strip() for line in found["refused"])
    assert frames == "Error: frames 41-9999: the action has 1-120; give a part of it"
    assert nothing.startswith("Error: nothing is missing; select pose bones")
    assert "wheels are not installed; use Get Extensions, Install from Disk" in wheels
    assert program == "Error: /no/python: Blender's Python cannot be started: No such file or directory"


def test_live_poses_are_the_servers(found: dict[str, Any], clip: Clip) -> None:
    position, _ = forward_kinematics(clip.pose)
    assert len(found["live"]) == len(LIVE)
    for k, places in zip(LIVE, found["live"], strict=True):
        for name, (x, y, z) in places.items():
            ours = np.asarray(position)[k, clip.pose.skeleton.index(name)]
            assert np.linalg.norm(np.array([x, z, -y]) - ours) < 1e-3, (k, name)


def test_the_timer_runs_a_job_in_slices(found: dict[str, Any]) -> None:
    ticked = found["ticked"]
    assert ticked["ended"] == ["FINISHED"], ticked["reports"]
    texts = ticked["texts"]
    assert texts[0] == "reading frame 1 of 1-120"
    assert "bodysense starts (Esc cancels)" in texts
    assert any(re.fullmatch(r"bodysense: \d+ % \(Esc cancels\)", text) for text in texts if text)
    assert re.fullmatch(r"keying bone (\d+) of \1", texts[-2])
    assert texts[-1] is None
    assert ticked["action"].endswith("filled")


def test_esc_cancels_and_changes_nothing(found: dict[str, Any]) -> None:
    assert found["cancelled"]["ended"] == ["CANCELLED"]
    assert found["cancelled"]["same"]


def test_datagrams_are_received_and_recorded(found: dict[str, Any]) -> None:
    received = found["received"]
    assert received["ended"] == ["FINISHED"]
    assert received["reports"] == ["a datagram was left out: a text without an end"]
    keys = received["keys"]
    assert any("LeftHandIndex3" in name for name in keys)
    assert any(name.endswith("location 2") for name in keys)
    assert all(points[0][0] == 5 for points in keys.values())
