"""Defects that are made in a true motion are found where they are, and repaired; the rest stays byte for byte."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bodysense as bs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reach
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.formats.fbx.motion import parse_fbx
from bodysense.quality.defects import KINDS, Defect
from bodysense.quality.defects import find_defects as defects_of
from bodysense.quality.foot_defects import foot_motion

Make = Callable[[Clip], tuple[Clip, str, int, int]]


@pytest.fixture(scope="module")
def clean() -> Clip:
    clip = packaged_performance()
    return Clip("clean", clip.pose[60:240], clip.frame_rate)


def find_defects(clip: Clip, only: Collection[str] = ()) -> list[Defect]:
    return defects_of(clip.pose, clip.frame_rate, only)


def with_rotation(clip: Clip, rotation: np.ndarray) -> Clip:
    return replace(clip, pose=Pose(clip.pose.skeleton, clip.pose.root_position, rotation))


def turned(clip: Clip, joint: str, frames: slice, degrees: float, axis: int = 2) -> Clip:
    rotation, index = np.array(clip.pose.rotation), clip.pose.skeleton.index(joint)
    turn = quaternion_exp(np.eye(3)[axis] * np.deg2rad(degrees))
    rotation[frames, index] = quaternion_multiply(
        rotation[frames, index], np.broadcast_to(turn, rotation[frames, index].shape)
    )
    return with_rotation(clip, rotation)


def spiked(clip: Clip) -> tuple[Clip, str, int, int]:
    return turned(clip, "left_elbow", slice(80, 82), 35), "left_elbow", 80, 81


def popped(clip: Clip) -> tuple[Clip, str, int, int]:
    return turned(clip, "right_shoulder", slice(90, None), 45), "right_shoulder", 90, 90


def frozen(clip: Clip) -> tuple[Clip, str, int, int]:
    joint = most_moving(clip)
    rotation, index = np.array(clip.pose.rotation), clip.pose.skeleton.index(joint)
    rotation[70:100, index] = rotation[69, index]
    return with_rotation(clip, rotation), joint, 70, 99


def most_moving(clip: Clip) -> str:
    steps = np.abs(np.diff(np.asarray(clip.pose.rotation), axis=0)).sum(axis=(0, 2))
    arms = [f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "elbow")]
    return max(arms, key=lambda name: steps[clip.pose.skeleton.index(name)])


def swapped(clip: Clip) -> tuple[Clip, str, int, int]:
    apart = turned(clip, "left_shoulder", slice(None), 50)
    rotation, index = np.array(apart.pose.rotation), clip.pose.skeleton.indices
    parts = ("collar", "shoulder", "elbow", "wrist")
    left, right = (index([f"{side}_{part}" for part in parts]) for side in ("left", "right"))
    mirror = np.array([1.0, 1.0, -1.0, -1.0])
    frames, own = slice(60, 100), rotation.copy()
    rotation[frames, left], rotation[frames, right] = own[frames][:, right] * mirror, own[frames][:, left] * mirror
    return with_rotation(clip, rotation), "left_shoulder", 60, 99


def bent_back(clip: Clip) -> tuple[Clip, str, int, int]:
    rotation, index = np.array(clip.pose.rotation), clip.pose.skeleton.index("left_knee")
    rotation[100:120, index] = quaternion_exp(np.array([np.deg2rad(-40), 0.0, 0.0]))
    return with_rotation(clip, rotation), "left_knee", 100, 119


def standing_clip(clip: Clip) -> Clip:
    """The clip's upper body on legs that stand still."""
    pose = clip.pose
    rotation, root = np.array(pose.rotation), np.array(pose.root_position)
    rotation[
        :, pose.skeleton.indices([f"{s}_{p}" for s in ("left", "right") for p in ("hip", "knee", "ankle", "foot")])
    ] = [*(1.0, 0.0, 0.0, 0.0)]
    rotation[:, 0] = [1.0, 0.0, 0.0, 0.0]
    root[:] = pose.skeleton.rest_offset[0] - [0.0, 0.03, 0.0]
    still = Pose(pose.skeleton, root, rotation)
    rest = np.asarray(forward_kinematics(Pose(pose.skeleton, pose.skeleton.rest_offset[0], rotation[0]))[0])
    for side in ("left", "right"):
        still = reach(still, f"{side}_ankle", np.tile(rest[pose.skeleton.index(f"{side}_ankle")], (len(clip), 1)))
    return replace(clip, pose=still)


def slid(clip: Clip) -> tuple[Clip, str, int, int]:
    still = standing_clip(clip)
    ankle = np.asarray(forward_kinematics(still.pose)[0])[:, clip.pose.skeleton.index("right_ankle")].copy()
    ankle[60:90, 2] += np.linspace(0.01, 0.2, 30)
    ankle[90:, 2] += 0.2
    return replace(still, pose=reach(still.pose, "right_ankle", ankle)), "right_ankle", 60, 89


def sunk(clip: Clip) -> tuple[Clip, str, int, int]:
    still = standing_clip(clip)
    ankle = np.asarray(forward_kinematics(still.pose)[0])[:, clip.pose.skeleton.index("right_ankle")].copy()
    ankle[60:70, 1] -= 0.02
    root = np.array(still.pose.root_position)
    root[60:70, 1] -= 0.1
    return replace(still, pose=replace(still.pose, root_position=root)), "right_ankle", 60, 69


MADE: dict[str, Make] = {
    **{"spike": spiked, "pop": popped, "freeze": frozen, "swap": swapped},
    **{"knee": bent_back, "slide": slid, "floor": sunk},
}


def covers(defects: list[Defect], kind: str, joint: str, first: int, last: int) -> bool:
    """Whether defects of the kind cover at least four fifths of the frames, and few others."""
    frames = {f for d in defects if d.kind == kind and d.joint == joint for f in range(d.first, d.last + 1)}
    wanted = set(range(first, last + 1))
    return len(frames & wanted) >= 0.8 * len(wanted) and len(frames - wanted) <= 4


def test_true_motion_has_no_defects(clean: Clip) -> None:
    assert not find_defects(clean) and not find_defects(standing_clip(clean))


@pytest.mark.parametrize("kind", KINDS)
def test_made_defects_are_found_and_named(kind: str, clean: Clip) -> None:
    made, joint, first, last = MADE[kind](clean)
    assert covers(find_defects(made), kind, joint, first, last)
    assert not [
        defect
        for defect in find_defects(made, [other for other in KINDS if other != kind])
        if kind in ("spike", "freeze", "slide") and defect
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_repairs_leave_no_defect_of_the_kind(kind: str, clean: Clip) -> None:
    made, _, first, last = MADE[kind](clean)
    done = bs.repair(made, only=[kind])
    assert done.defects and not done.remaining
    beside = np.r_[0 : max(0, first - 15), min(len(clean), last + 16) : len(clean)]
    if kind not in ("slide", "pop"):  # a foot that slid away stands elsewhere until it is lifted
        np.testing.assert_array_equal(done.take.clip.pose.rotation[beside], made.pose.rotation[beside])


@pytest.mark.parametrize("kind", ["spike", "freeze", "swap"])
def test_repairs_halve_the_error(kind: str, clean: Clip) -> None:
    """Against the true motion; for swaps with the arms apart."""
    made, _, first, last = MADE[kind](clean)
    truth = turned(clean, "left_shoulder", slice(None), 50) if kind == "swap" else clean
    mended = bs.repair(made, only=[kind]).take.clip
    places = [np.asarray(forward_kinematics(clip.pose)[0])[first : last + 1] for clip in (truth, made, mended)]
    before, after = (np.linalg.norm(place - places[0], axis=-1).mean() for place in places[1:])
    assert after <= 0.5 * before


def test_repaired_feet_stand(clean: Clip) -> None:
    made, *_ = slid(clean)
    assert 100 * foot_motion(made.pose, made.frame_rate, "right").along[62:88].mean() > 15
    mended = bs.repair(made, only=["slide"]).take.clip
    assert 100 * foot_motion(mended.pose, mended.frame_rate, "right").along[62:88].mean() < 2


def test_a_file_keeps_every_other_byte(clean: Clip, tmp_path: Path) -> None:
    made, *_ = spiked(clean)
    write_bvh(tmp_path / "take.bvh", made)
    done = bs.repair(tmp_path / "take.bvh")
    done.save(tmp_path / "mended.bvh")
    before, after = ((tmp_path / name).read_bytes().splitlines() for name in ("take.bvh", "mended.bvh"))
    changed = [k for k, (one, other) in enumerate(zip(before, after, strict=True)) if one != other]
    head = before.index(b"MOTION") + 3
    assert changed == [head + 80, head + 81]
    for k in changed:
        differing = [c for c, (a, b) in enumerate(zip(before[k].split(), after[k].split(), strict=True)) if a != b]
        assert len(differing) <= 3  # the angles of one joint


def test_slides_and_swaps_come_back_in_the_files_rig(clean: Clip, tmp_path: Path) -> None:
    for kind, ending in (("slide", ".bvh"), ("swap", ".fbx")):
        made, *_ = MADE[kind](clean)
        path, out = tmp_path / f"take{ending}", tmp_path / f"mended{ending}"
        bs.write(path, made)
        bs.repair(path, only=[kind]).save(out)
        again = bs.read(out)
        assert isinstance(again, Clip) and not find_defects(again, [kind])
    assert parse_fbx((tmp_path / "mended.fbx").read_bytes(), tmp_path).joints[0] == "pelvis"


def test_a_whole_take_is_unchanged(clean: Clip, tmp_path: Path) -> None:
    write_bvh(tmp_path / "take.bvh", clean)
    done = bs.repair(tmp_path / "take.bvh")
    done.save(tmp_path / "same.bvh")
    assert not done.defects and (tmp_path / "same.bvh").read_bytes() == (tmp_path / "take.bvh").read_bytes()


def test_commands(clean: Clip, tmp_path: Path, run: Callable[..., str], refused: Callable[..., str]) -> None:
    made, *_ = spiked(clean)
    take, out, picture = tmp_path / "take.bvh", tmp_path / "mended.bvh", tmp_path / "defects.png"
    write_bvh(take, made)
    assert "1 defects in 180 frames" in run("check", take, "--picture", picture) and picture.stat().st_size > 500
    assert "no defects in 180 frames" in run("check", take, "--only", "slide", "swap")
    assert "left_elbow" in run("repair", take, "-o", out, "--dry-run") and not out.exists()
    assert "1 defects found, 0 after the repair" in run("repair", take, "-o", out, "--json", tmp_path / "found.json")
    assert "no defects" in run("check", out) and '"left_elbow"' in (tmp_path / "found.json").read_text()
    assert "--only" in refused("check", take, "--only", "ghosts")
    np.savez(tmp_path / "seen.npz", a=1)
    bs.write(tmp_path / "seen.jsonl", bs.simulate(clean, "three_point", None))
    assert "not a motion; complete it first: bodysense track" in refused("check", tmp_path / "seen.jsonl")


def test_unknown_kinds_are_refused(clean: Clip) -> None:
    with pytest.raises(BodysenseError, match=r"unknown kind of defect 'ghost'; valid are spike, pop, freeze"):
        find_defects(clean, ["ghost"])
