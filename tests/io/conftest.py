"""Motions for the tests of files: random ones on our joints, and the same as other programs store them.

Small folders laid out as the published data sets are (joint names, bones between ours, units, channels, file names) are
made here from the project's own motion, by code that shares nothing with the readers but the kinematics.
"""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics, local_rotation, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply
from bodysense.geometry.rotation import quaternion_rotate as rotate
from bodysense.io.clip import Clip

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "rigs")]  # helpers of these tests

Reframe = Callable[..., Clip]


@pytest.fixture
def reframe() -> Reframe:
    """Return the same motion on a skeleton with another rest pose: `rest` has local rotations {joint: (4,)}."""

    def change(clip: Clip, rest: Mapping[str, np.ndarray], names: Mapping[str, str] | None = None) -> Clip:
        skeleton = clip.pose.skeleton
        pose = rest_pose(skeleton)
        for joint, turn in rest.items():
            pose.rotation[skeleton.index(joint)] = turn
        frame = forward_kinematics(pose)[1]
        parents = np.array(skeleton.parents)
        offset = skeleton.rest_offset.copy()
        offset[1:] = rotate(frame[parents[1:]], skeleton.rest_offset[1:])
        world = quaternion_multiply(forward_kinematics(clip.pose)[1], quaternion_conjugate(frame))
        names = names or {}
        renamed = Skeleton(
            tuple(names.get(joint, joint) for joint in skeleton.joints), skeleton.end_sites, skeleton.parents, offset
        )
        return Clip(clip.name, Pose(renamed, clip.pose.root_position, local_rotation(renamed, world)), clip.frame_rate)

    return change


# --- the published data sets ---


@dataclass(frozen=True)
class Release:
    """A folder in the layout of a published data set, and the motion written to each of its files."""

    folder: Path
    truth: dict[str, Clip]  # on our joints, by the key of the source


@dataclass(frozen=True)
class Bone:
    """A joint of another rig, or an End Site: it moves with our joint `carrier`."""

    name: str
    parent: str
    carrier: str
    place: tuple[str, str, float]  # at rest: from a point of ours towards another, by a share of the way


FINGERS = ("thumb", "index", "middle", "ring", "pinky")


MetaRig = Literal["unoc", "player", "twh"]


def meta_rig(kind: MetaRig) -> list[Bone]:
    """UNOC's hierarchy, that of the takes in its authors' web player, or that of Talking With Hands.

    All have more of a spine than we do, shoulder blades, twists, and the thumb's carpal. The player's has two joints a
    foot, the trunk before the legs, and the right side before the left.
    """
    bones: list[Bone] = []
    twh, sides = kind == "twh", (("left", "l"), ("right", "r"))

    def add(name: str, parent: str, carrier: str, towards: str = "", share: float = 0.0, start: str = "") -> None:
        bones.append(Bone(name, parent, carrier, (start or carrier, towards or carrier, share)))

    def leg(side: str, s: str) -> None:
        add(f"b_{s}_upleg", "b_root", f"{side}_hip")
        add(f"b_{s}_leg", f"b_{s}_upleg", f"{side}_knee")
        if kind == "twh":
            add(f"b_{s}_foot_twist", f"b_{s}_leg", f"{side}_knee", f"{side}_ankle", 0.9)
            add(f"b_{s}_foot", f"b_{s}_foot_twist", f"{side}_ankle")
            add("End Site", f"b_{s}_foot", f"{side}_ankle", f"{side}_foot", 0.5)
            return
        if kind == "unoc":
            add(f"b_{s}_talocrural", f"b_{s}_leg", f"{side}_ankle")
            add(f"b_{s}_subtalar", f"b_{s}_talocrural", f"{side}_ankle", f"{side}_foot", 0.2)
            add(f"b_{s}_transversetarsal", f"b_{s}_subtalar", f"{side}_ankle", f"{side}_foot", 0.5)
            add(f"b_{s}_ball", f"b_{s}_transversetarsal", f"{side}_foot")
        else:
            add(f"b_{s}_subtalar", f"b_{s}_leg", f"{side}_ankle")
            add(f"b_{s}_ball", f"b_{s}_subtalar", f"{side}_foot")
        add("End Site", f"b_{s}_ball", f"{side}_foot", f"{side}_toe", 1.0)

    def trunk() -> None:
        add("b_spine0", "b_root", "spine1")
        add("b_spine1", "b_spine0", "spine1", "spine2", 0.5)
        add("b_spine2", "b_spine1", "spine2")
        add("b_spine3", "b_spine2", "spine3")
        add("b_neck0", "b_spine3", "neck")
        add("b_head", "b_neck0", "head")
        add("b_head_null" if twh else "End Site", "b_head", "head", "head_top", 1.0)

    def arm(side: str, s: str) -> None:
        if twh:
            add(f"b_{s}_eye", "b_head", "head", f"{side}_hip", 0.1)  # next to the middle
        add(f"b_{s}_shoulder", "b_spine3", f"{side}_collar")
        add(f"p_{s}_scap", f"b_{s}_shoulder", f"{side}_collar", f"{side}_shoulder", 0.5)
        add(f"b_{s}_arm", f"p_{s}_scap", f"{side}_shoulder")
        if twh:
            add(f"b_{s}_arm_twist", f"b_{s}_arm", f"{side}_shoulder", f"{side}_elbow", 0.5)
        add(f"b_{s}_forearm", f"b_{s}_arm_twist" if twh else f"b_{s}_arm", f"{side}_elbow")
        add(f"b_{s}_wrist_twist", f"b_{s}_forearm", f"{side}_elbow", f"{side}_wrist", 0.6)
        add(f"b_{s}_wrist", f"b_{s}_wrist_twist", f"{side}_wrist")
        add(f"b_{s}_thumb0", f"b_{s}_wrist", f"{side}_wrist", f"{side}_thumb1", 0.5)
        for finger in FINGERS:
            above = f"b_{s}_thumb0" if finger == "thumb" else f"b_{s}_wrist"
            for k in (1, 2, 3):
                add(f"b_{s}_{finger}{k}", above, f"{side}_{finger}{k}")
                above = f"b_{s}_{finger}{k}"
            add("End Site", above, f"{side}_{finger}3", f"{side}_{finger}_tip", 1.0)

    if twh:
        add("body_world", "", "pelvis")
    add("b_root", "body_world" if twh else "", "pelvis")
    if kind == "player":
        trunk()
        for limb in (arm, leg):
            for side, s in reversed(sides):
                limb(side, s)
        return bones
    for side, s in sides:
        leg(side, s)
    trunk()
    for side, s in sides:
        arm(side, s)
    return bones


def mixamo_rig() -> list[Bone]:
    """Mixamo's hierarchy: our joints by its names; fingertips, head top and toe tips are joints."""
    names = {"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck"}
    names |= {"head": "Head", "head_top": "HeadTop_End"}
    parts = {"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hip": "UpLeg"}
    parts |= {"knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "toe": "Toe_End"}
    parts |= {f"{f}{k}": f"Hand{f.capitalize()}{k}" for f in FINGERS for k in (1, 2, 3)}
    parts |= {f"{f}_tip": f"Hand{f.capitalize()}4" for f in FINGERS}
    names |= {
        f"{side}_{ours}": f"{side.capitalize()}{name}" for side in ("left", "right") for ours, name in parts.items()
    }
    ours = default_skeleton()
    bones = []
    for point, parent in zip(ours.points, ours.parents, strict=True):
        above = ours.points[parent] if parent >= 0 else ""
        carrier = point if point in ours.joints else above
        bones.append(
            Bone(f"mixamorig:{names[point]}", above and f"mixamorig:{names[above]}", carrier, (point, point, 0))
        )
    return bones


def bvh_text(bones: list[Bone], clip: Clip, frame_time: str, order: str, frames: Mapping[str, np.ndarray]) -> str:
    """A clip as BVH in centimetres on another rig. `frames` are the constant turns (4,) of its joints in ours."""
    ours = clip.pose.skeleton
    rest = dict(zip(ours.points, ours.path @ ours.rest_offset, strict=True))
    place = {bone: rest[a] + share * (rest[b] - rest[a]) for bone in bones for a, b, share in [bone.place]}
    position, world = forward_kinematics(clip.pose)
    still = np.array([1.0, 0, 0, 0])
    joints = {bone.name: bone for bone in bones if bone.name != "End Site"}

    def turned(bone: Bone) -> np.ndarray:
        if bone.name == "body_world":  # carries the body about and does not turn
            return np.tile(still, (len(clip), 1))
        return quaternion_multiply(world[:, ours.index(bone.carrier)], frames.get(bone.name, still))

    rows = [100 * position[:, 0]]
    lines: list[str] = []

    def write(bone: Bone, indent: str) -> None:
        above = joints.get(bone.parent)
        offset = np.zeros(3)
        if above is not None:
            offset = rotate(quaternion_conjugate(frames.get(above.name, still)), place[bone] - place[above])
        kind = "End Site" if bone.name == "End Site" else f"{'JOINT' if above else 'ROOT'} {bone.name}"
        lines.append(f"{indent}{kind}\n{indent}{{")
        lines.append(f"{indent}  OFFSET {' '.join(f'{100 * x:.6f}' for x in offset)}")
        if bone.name != "End Site":
            local = turned(bone)
            if above is not None:
                local = quaternion_multiply(quaternion_conjugate(turned(above)), local)
            rows.append(Rotation.from_quat(local, scalar_first=True).as_euler(order, degrees=True))
            where = "" if above else "Xposition Yposition Zposition "
            turns = " ".join(f"{axis}rotation" for axis in order)
            lines.append(f"{indent}  CHANNELS {3 if above else 6} {where}{turns}")
            children = [child for child in bones if child.parent == bone.name]
            for child in children:
                write(child, indent + "  ")
            if not children:
                lines.append(f"{indent}  End Site\n{indent}  {{\n{indent}    OFFSET 0 0 0\n{indent}  }}")
        lines.append(f"{indent}}}")

    write(bones[0], "")
    values = np.concatenate(rows, axis=1)
    motion = "\n".join(" ".join(f"{x:.5f}" for x in row) for row in values)
    head = "HIERARCHY\n" + "\n".join(lines)
    return f"{head}\nMOTION\nFrames: {len(clip)}\nFrame Time: {frame_time}\n{motion}\n"


def taller(clip: Clip, height: float, first: int, count: int, rate: float) -> Clip:
    """A few frames of a clip, of a person of another height."""
    skeleton = clip.pose.skeleton.scaled(height)
    pose = clip.pose[first : first + count]
    return replace(clip, pose=Pose(skeleton, pose.root_position, pose.rotation), frame_rate=rate)


@pytest.fixture
def unoc(tmp_path: Path, waving_clip: Clip) -> Release:
    """UNOC's release: 13 participants, 120 Hz, an A-pose at rest, and files without body motion.

    Every second file is like the takes of the authors' web player.
    """
    rigs, down = (meta_rig("unoc"), meta_rig("player")), rest_pose(default_skeleton())
    for side, sign in (("left", -1), ("right", 1)):
        down.rotation[default_skeleton().index(f"{side}_shoulder")] = quaternion_exp(np.array([0, 0, sign * 0.7]))
    at_rest = forward_kinematics(down)[1]
    frames = {
        bone.name: quaternion_conjugate(at_rest[default_skeleton().index(bone.carrier)])
        for rig in rigs
        for bone in rig
        if bone.name != "End Site"
    }
    folder, truth = tmp_path / "UNOC", {}
    for k in range(13):
        clip = taller(waving_clip, 1.5 + 0.04 * k, 5 * k, 5, 120.0)
        key = f"P{k + 1}/merged bvh/take_{k}_merged.bvh"
        path = folder / key
        path.parent.mkdir(parents=True)
        path.write_text(bvh_text(rigs[k % 2], clip, "0.008333", "XYZ", frames))
        truth[key] = clip
    (folder / "reference_skeleton.bvh").write_text("not read")
    (folder / "P1" / "hands").mkdir()
    (folder / "P1" / "hands" / "take_0.bvh").write_text("not read")
    (folder / "P1" / "merged bvh" / "occlusions.json").write_text("{}")
    return Release(folder, truth)


@pytest.fixture
def talking_with_hands(tmp_path: Path, waving_clip: Clip) -> Release:
    """A clone of Talking With Hands: zip files of takes, two speakers in each, with unusable rest poses."""
    rig = meta_rig("twh")
    rng = np.random.default_rng(3)
    turns = quaternion_exp(rng.normal(size=(len(rig), 3)))
    frames = {bone.name: turn for bone, turn in zip(rig, turns, strict=True) if bone.name != "body_world"}
    folder, truth = tmp_path / "TalkingWithHands32M", {}
    takes = [("session1", "take1", "noFingers"), ("session2", "take3", "hasFingers")]
    for k, (session, take, fingers) in enumerate(takes):
        path = folder / "mocap_data" / session / f"{take}.zip"
        path.parent.mkdir(parents=True)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for speaker in ("deep5", f"shallow{26 + k}"):
                clip = taller(waving_clip, 1.6 + 0.1 * k, 40 * k, 40, 90.0)
                member = f"{take}/{take}_{fingers}_{speaker}_scale_local.bvh"
                archive.writestr(member, bvh_text(rig, clip, "0.0111111", "ZXY", frames))
                archive.writestr(f"__MACOSX/{take}/._{take}_{speaker}.bvh", b"\0")
                truth[f"mocap_data/{session}/{take}.zip/{member}"] = clip
    (folder / "configs").mkdir()
    (folder / "configs" / "conversations.json").write_text(
        '{"session2": {"take3": "10 min 1 secs"}, "total number of takes": 1}'
    )
    (folder / "audio_data" / "session2").mkdir(parents=True)
    with zipfile.ZipFile(folder / "audio_data" / "session2" / "take3.zip", "w") as archive:
        archive.writestr("take3_deep5.wav", b"")
    return Release(folder, truth)


@pytest.fixture
def mixamo(tmp_path: Path, waving_clip: Clip) -> Release:
    """Motions exported from Mixamo: two in a folder each, one downloaded twice, one for a second character."""
    folder, truth = tmp_path / "Mixamo", {}
    keys = ("Jump/Jump.bvh", "Walking.bvh", "Walking (1).bvh", "more/Ty@Walking.bvh")
    for k, key in enumerate(keys):
        clip = taller(waving_clip, 1.7, 10 * k, 5, 30.0)
        (folder / key).parent.mkdir(parents=True, exist_ok=True)
        (folder / key).write_text(bvh_text(mixamo_rig(), clip, "0.0333333", "ZYX", {}))
        truth[key] = clip
    return Release(folder, truth)


@pytest.fixture
def small_bvh_text() -> str:
    """A BVH file without a body."""
    joint = "JOINT Lid\n{\nOFFSET 0 10 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 5 0\n}\n}\n"
    root = "ROOT Box\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n" + joint + "}\n"
    return f"HIERARCHY\n{root}MOTION\nFrames: 2\nFrame Time: 0.1\n0 0 0 0 0 0\n1 1 1 1 1 1\n"
