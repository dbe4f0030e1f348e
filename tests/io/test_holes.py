"""Missing parts of a motion: names, ranges, NaN, limbs that are held still."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.formats.bvh_text import BvhFile, open_bvh
from bodysense.io.holes import Missing, below, flat_lined, missing_items, missing_mask
from bodysense.io.rigged import read_rigged
from bodysense.io.target_rigs.own_rig import SourceJoints, joints_of_file

JOINTS = ("Hips", "LeftUpLeg", "LeftFoot", "LeftToeBase", "mixamorig:LeftForeArm", "LeftHand", "LeftHandIndex1")
PARENTS = (-1, 0, 1, 2, 0, 4, 5)
OURS = {"pelvis": 0, "left_hip": 1, "left_ankle": 2, "left_foot": 3, "left_elbow": 4, "left_wrist": 5, "left_index1": 6}


def missing_in(text: str, frames: int = 10) -> set[tuple[int, str]]:
    mask = missing_mask(missing_items(text), JOINTS, PARENTS, frames, OURS)
    return {(int(t), JOINTS[j]) for t, j in np.argwhere(mask)}


@pytest.mark.parametrize(
    ("text", "joint"),
    [
        ("LeftHand", "LeftHand"),
        ("left_hand", "LeftHand"),
        ("left hand", "LeftHand"),
        ("left_wrist", "LeftHand"),
        ("left_forearm", "mixamorig:LeftForeArm"),
        ("LeftForeArm", "mixamorig:LeftForeArm"),
        ("mixamorig:LeftForeArm", "mixamorig:LeftForeArm"),
        ("left_thigh", "LeftUpLeg"),
        ("LeftFoot", "LeftFoot"),
        ("left_toe", "LeftToeBase"),
    ],
)
def test_a_joint_by_the_files_name_ours_or_a_usual_one(text: str, joint: str) -> None:
    assert missing_in(text, 2) == {(0, joint), (1, joint)}


def test_ranges_and_descendants_of_a_joint() -> None:
    assert missing_in("LeftHand+:2-3,Hips:9-9") == {
        (2, "LeftHand"), (3, "LeftHand"), (2, "LeftHandIndex1"), (3, "LeftHandIndex1"), (9, "Hips"),
    }  # fmt: skip
    assert missing_in("mixamorig:LeftForeArm:4-4") == {(4, "mixamorig:LeftForeArm")}
    assert missing_items(["a", "b+:0-7"]) == (Missing("a"), Missing("b", True, (0, 7)))
    assert missing_items("a , b : 0 - 7") == (Missing("a", False, (0, 7)), Missing("b", False, (0, 7)))
    assert below(4, PARENTS) == [4, 5, 6]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("left_han", r"no such joint; did you mean LeftHand\? Valid are Hips, LeftUpLeg"),
        ("tail", "no such joint; valid are Hips, LeftUpLeg"),
        ("LeftHand:5-7s", "frames are given as FIRST-LAST, such as LeftHand:0-99"),
        ("left_foot", "LeftFoot or LeftToeBase may be meant"),
        ("LeftHand:5-12", "frames 0 to 9"),
        ("LeftHand:5-2", "ends before it begins"),
        ("LeftHand,,Hips", "an item is empty"),
        ("LeftForeArm LeftHand:2-3", "more than one joint; put commas between them: LeftForeArm,LeftHand"),
        ("LeftForeArm..LeftHand:2-3", "more than one joint"),
        ("left_forearm;left_hand", "more than one joint"),
        ("LeftHand:5", "frames are given as FIRST-LAST, such as LeftHand:0-99"),
        ("mixamorig:LeftForeArm:5-", "as FIRST-LAST, such as mixamorig:LeftForeArm:0-99"),
        ("LeftHand:5:8", "frames are given as FIRST-LAST, such as LeftHand:0-99"),
        ("", "an item is empty"),
    ],
)
def test_invalid_ranges_are_refused(text: str, message: str) -> None:
    with pytest.raises(BodysenseError, match=message) as error:
        missing_in(text)
    assert "\n" not in str(error.value)


@given(st.text(max_size=20))
def test_any_text_is_understood_or_refused_in_one_line(text: str) -> None:
    try:
        missing_in(text)
    except BodysenseError as error:
        assert len(str(error).splitlines()) <= 1 + text.count("\n")


@pytest.fixture
def take(waving_clip: Clip, tmp_path: Path) -> tuple[BvhFile, SourceJoints]:
    write_bvh(tmp_path / "take.bvh", waving_clip)
    file = open_bvh(tmp_path / "take.bvh")
    return file, joints_of_file(file, read_rigged(file.text(), file.path))


def held(file: BvhFile, joints: list[str], frames: slice, to: float | None = None) -> BvhFile:
    """The file with joints held where they were, or at a value."""
    values, changed = file.values.copy(), np.zeros(file.values.shape, dtype=bool)
    for name in joints:
        columns = list(file.columns[file.joints.index(name)])
        values[frames, columns] = values[frames.start, columns] if to is None else to
        changed[frames, columns] = True
    return file.with_values(values, changed)


@pytest.mark.parametrize("to", [None, 0.0])
def test_a_limb_that_is_held_still_is_missing(take: tuple[BvhFile, SourceJoints], to: float | None) -> None:
    file, rig = take
    arm = ["left_shoulder", "left_elbow"]
    found = flat_lined(held(file, arm, slice(30, 60), to), rig)
    never = flat_lined(file, rig)  # hips that do not turn from the first frame to the last
    assert never[:, file.joints.index("left_hip")].all()
    names = {file.joints[j] for j in np.flatnonzero((found & ~never).any(axis=0))}
    assert set(arm) <= names <= {file.joints[j] for j in below(file.joints.index("left_shoulder"), file.parents)}
    frames = np.flatnonzero(found[:, file.joints.index("left_elbow")])
    assert (frames[0], frames[-1], len(frames)) == (30, 59, 30)


def test_resting_joints_are_not_missing(take: tuple[BvhFile, SourceJoints]) -> None:
    """A pause of the whole body, a short one of a limb, and joints that the motion never turned."""
    file, rig = take
    turning = [file.joints[j] for j in range(len(file.joints)) if np.ptp(file.values[:, list(file.columns[j])]) > 0]
    assert not flat_lined(held(file, turning, slice(20, 60)), rig)[:, file.joints.index("left_elbow")].any()
    assert not flat_lined(held(file, ["left_elbow"], slice(20, 30)), rig)[:, file.joints.index("left_elbow")].any()
    assert not flat_lined(file, rig)[:, file.joints.index("right_wrist")].any()
