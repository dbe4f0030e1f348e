"""Odd files of people, and of others: heads and wrists that end oddly, odd fingers, a crab, UTF-16, gzip."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from rig_files import Layout, bones_of, held_still, mapped, motion, write
from rig_layouts import LAYOUTS, arm, leg, spine
from test_rigs import beast, of

import bodysense
from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip

TRUNK = spine("Hips", "Spine Chest", "spine1 spine3") + leg("Hips", "*UpLeg", "*Leg", "*Foot", "*Toe")
WITH_HAND = TRUNK + arm("Chest", "*Shoulder", "*Arm", "*ForeArm", "*Hand") + "End Site | *Hand | @middle_tip\n"
WITHOUT_HAND = TRUNK + "*Shoulder | Chest | @collar\n*Arm | *Shoulder | @shoulder\n*ForeArm | *Arm | @elbow\n"
WITHOUT_HAND += "End Site | *ForeArm | @wrist\n"


def errors(clip: Clip, truth: Clip, names: tuple[str, ...]) -> tuple[float, float]:
    """Largest error of the places (m) and of the world rotations (degrees) of some joints."""
    found, known = forward_kinematics(clip.pose), forward_kinematics(truth.pose)
    ours, theirs = clip.pose.skeleton.indices(names), truth.pose.skeleton.indices(names)
    off = np.linalg.norm(np.asarray(found[0])[:, ours] - np.asarray(known[0])[:, theirs], axis=-1)
    turned = geodesic_angle(np.asarray(found[1])[:, ours], np.asarray(known[1])[:, theirs])
    return float(off.max()), float(np.rad2deg(turned.max()))


@pytest.mark.parametrize("has_hand", [False, True])
def test_an_end_site_is_a_wrist_only_of_an_arm_without_hand(tmp_path: Path, has_hand: bool) -> None:
    layout = Layout(bones_of(WITH_HAND if has_hand else WITHOUT_HAND, "Left", "Right"))
    wrist = {ours: given for ours, given in mapped(layout).items() if ours == "left_wrist"}
    assert bool(wrist) == has_hand
    clip = held_still(motion(14, 48), layout)
    text = write(layout, clip)
    rigged = of(text)
    elbow = rigged.rig.joints["left_elbow"]
    assert elbow == mapped(layout)["left_elbow"]
    assert rigged.rig.joints["left_wrist"] == (mapped(layout)["left_wrist"] if has_hand else f"{elbow}_end")
    assert errors(rigged.clip, clip, ("left_wrist", "right_wrist"))[0] < 1e-3
    (tmp_path / "take.bvh").write_text(text)
    bodysense.track(tmp_path / "take.bvh", device="three_point").save(tmp_path / "out.bvh", "source")
    assert elbow in (tmp_path / "out.bvh").read_text()
    again = bodysense.read(tmp_path / "out.bvh")
    assert isinstance(again, Clip) and len(again) == 14


def ended(text: str, head: str, end: str) -> str:
    """A file whose head's end, the first below it, has another offset."""
    lines = text.splitlines()
    first = next(k for k, line in enumerate(lines) if line.split()[-1] == head)
    at = next(k for k, line in enumerate(lines) if "OFFSET" in line and k > first + 2)
    lines[at] = re.sub("OFFSET.*", f"OFFSET {end}", lines[at])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("Mixamo", "20 0 0"),
        ("CMU, metres", "0 0 20"),
        ("Unreal", "0 -12 0"),
        ("classic", "0 0 0"),
        ("Mixamo", "0 -12 0"),
    ],
)
def test_the_end_of_a_head_may_point_anywhere(name: str, end: str) -> None:
    layout = LAYOUTS[name]
    clip = held_still(motion(14, 48), layout)
    in_units = " ".join(f"{0.01 * float(value) / layout.unit:.4f}" for value in end.split())
    text = ended(write(layout, clip), mapped(layout)["head"], in_units)
    rigged = of(text)
    assert {part: rigged.rig.joints[part] for part in ("neck", "head")} == {
        part: mapped(layout)[part] for part in ("neck", "head")
    }
    assert "head_top" not in rigged.rig.joints
    off, turned = errors(rigged.clip, clip, ("neck", "head"))
    assert off < 1e-3 and turned < 0.1


@pytest.mark.parametrize(
    ("finger", "what"),
    [
        ("LeftHandIndex", "turned"),
        ("LeftHandThumb", "folded"),
        ("RightHandPinky", "short"),
        ("LeftHandThumb", "turned"),
    ],
)
def test_a_finger_refuses_no_body(finger: str, what: str) -> None:
    """Its joints' frames are turned by up to half a turn, its second bone points back, or it has no length."""
    layout = LAYOUTS["Mixamo"]
    clip = held_still(motion(10, 60), layout)
    text = write(layout, clip)
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if line.split()[-1] == f"mixamorig7:{finger}2" and what != "turned":
            parts = lines[k + 2].split()
            factor = -1.0 if what == "folded" else 0.0
            lines[k + 2] = " ".join([parts[0], *(f"{factor * float(value):.6f}" for value in parts[1:])])
    if what == "turned":
        names = [line.split()[-1] for line in lines if line.split()[0] in ("ROOT", "JOINT")]
        column = 3 + 3 * names.index(f"mixamorig7:{finger}1")
        first = lines.index("MOTION") + 3
        for k in range(first, len(lines)):
            row = lines[k].split()
            row[column : column + 3] = ["179.9", "-90.0", f"{10 * (k - first)}"]
            lines[k] = " ".join(row)
    rigged = of("\n".join(lines) + "\n")
    parts = ("head", "left_wrist", "right_wrist", "left_ankle", "right_elbow")
    off, turned = errors(rigged.clip, clip, parts)
    assert off < 1e-3 and turned < 0.1
    assert np.isfinite(rigged.clip.pose.rotation).all()


@pytest.mark.parametrize("missing", ["", "head", "left_wrist:2-5"])
def test_a_crab_is_not_tracked(tmp_path: Path, missing: str) -> None:
    path = tmp_path / "crab.bvh"
    path.write_text(beast(5, 0.8, 0))
    with pytest.raises(BodysenseError, match="not a humanoid"):
        bodysense.track(path, missing=missing or ())


@pytest.mark.parametrize("missing", ["", "left_wrist:2-3"])
def test_a_bvh_in_utf_16_or_gzip_is_refused_with_the_way_on(tmp_path: Path, missing: str) -> None:
    text = write(LAYOUTS["Mixamo"], motion(5, 20))
    spoilt = {
        "UTF-16; save it as UTF-8: iconv -f UTF-16": [text.encode("utf-16"), text.encode("utf-16-le")],
        "compressed by gzip; unpack it: gunzip -c take.bvh": [gzip.compress(text.encode())],
    }
    path = tmp_path / "take.bvh"
    for message, contents in spoilt.items():
        for content in contents:
            path.write_bytes(content)
            for use in (
                lambda: bodysense.track(path, missing=missing or ()),
                lambda: bodysense.convert(path, tmp_path / "o.glb"),
            ):
                with pytest.raises(BodysenseError, match=rf"take\.bvh: {message}") as caught:
                    use()
                assert "\n" not in str(caught.value)
    assert not (tmp_path / "o.glb").exists()
