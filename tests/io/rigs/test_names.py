"""Joints recognised by names alone: complete skeletons of real programs, and names without meaning."""

from __future__ import annotations

import pytest
from further_layouts import FURTHER
from more_layouts import MORE
from rig_files import mapped
from rig_layouts import LAYOUTS

from bodysense.body.skeleton import default_skeleton
from bodysense.io.rigs.names import is_helper, joint_of, joints_of

MIXAMO = """
Hips Spine Spine1 Spine2 Neck Head HeadTop_End LeftShoulder LeftArm LeftForeArm LeftHand LeftHandThumb1
LeftHandThumb2 LeftHandThumb3 LeftHandThumb4 LeftHandIndex1 LeftHandIndex2 LeftHandIndex3 LeftHandIndex4
RightShoulder RightArm RightForeArm RightHand LeftUpLeg LeftLeg LeftFoot LeftToeBase LeftToe_End RightUpLeg
RightLeg RightFoot RightToeBase
"""

EVERY = LAYOUTS | MORE | FURTHER
# Joints that their names alone make others than they are by their place, or that no point of ours is.
BY_NAME_ALONE = {
    "MakeHuman": {"toe2-1.l": "left_toe", "toe2-1.r": "right_toe"},
    "stick figure": {"Chest": "spine3"},
    "ACCAD": {"Spine": "spine1"},
    "MakeHuman, default": {"spine01": "spine1", "spine04": "spine2", "spine05": "spine3"},
    "Kinect Azure": {"SPINE_CHEST": "spine1"},
    "iPi": {"Chest": "spine1"},
    "MakeHuman, CMU": {"Spine": "spine1"},
    "MakeHuman, CMU, metres": {"Spine": "spine1"},
    "Meta, whole body": {
        f"{side}{name}": f"{side.lower()}_{ours}"
        for side in ("Left", "Right")
        for name, ours in (("Scapula", "collar"), ("Shoulder", "shoulder"))
    },
    "Skyrim": {"NPC R Finger21 [RF21]": "right_middle1"},
    "Auto-Rig Pro": {"shoulder.l": "left_shoulder", "shoulder.r": "right_shoulder"},
    "BEAT": {"Spine1": "spine1"},
    "3ds Max Biped, twists": {"Bip001 R Finger2": "right_middle1"},
    "named by both ends": {"torso_head": "head"},
}
# Rigs of which more than four joints are found by their place.
MANY_BY_PLACE = {"Rigify", "Rokoko", "Kinect Azure", "MakeHuman, CMU", "MakeHuman, CMU, metres", "Auto-Rig Pro"}
MANY_BY_PLACE |= {"Blender's metarig", "BEAT", "CMU, names of ASF"}


def names_of(rig: str) -> list[str]:
    return [name for name, *_ in EVERY[rig].bones if name != "End Site"]


def test_joints_of_every_rig_have_the_names_of_their_places() -> None:
    for rig in EVERY:
        places, found = mapped(EVERY[rig]), joints_of(names_of(rig))
        others = {given: ours for given, ours in found.items() if places.get(ours) != given and ours != "pelvis"}
        assert others == BY_NAME_ALONE.get(rig, {}), rig
        assert (len(places.keys() - set(found.values())) > 4) == (rig in MANY_BY_PLACE), rig


def test_our_own_names_are_ours() -> None:
    ours = default_skeleton().joints
    assert joints_of(ours) == {joint: joint for joint in ours}


@pytest.mark.parametrize(("spine", "ours"), [
    (["Spine"], ["spine1"]),
    (["Spine", "Spine1"], ["spine1", "spine3"]),
    (["Spine", "Spine1", "Spine2"], ["spine1", "spine2", "spine3"]),
    (["Spine", "Spine1", "Spine2", "Spine3"], ["spine1", "spine2", "spine3"]),
])  # fmt: skip
def test_spines_of_any_length(spine: list[str], ours: list[str]) -> None:
    found = joints_of([name for name in MIXAMO.split() if not name.startswith("Spine")] + spine)
    assert [found[name] for name in spine if name in found] == ours
    assert spine[0] in found and spine[-1] in found


def test_blanks_case_and_punctuation_do_not_count() -> None:
    assert joints_of([name.upper().replace("LEFT", "left ") for name in MIXAMO.split()]).keys() == {
        name.upper().replace("LEFT", "left ") for name in MIXAMO.split()
    }


def test_the_order_of_names_does_not_matter() -> None:
    for rig in EVERY:
        joints = names_of(rig)
        assert joints_of(sorted(joints, key=lambda given: given[::-1])) == joints_of(joints), rig


@pytest.mark.parametrize(("text", "ours"), [
    ("LShoulder LUArm LFArm LHand", "left_collar left_shoulder left_elbow left_wrist"),
    ("LShoulder LElbow LHand", "left_shoulder left_elbow left_wrist"),
    ("LWrist LHand", "left_wrist -"),
    ("arm_left_shoulder_1 arm_left_shoulder_2", "left_collar left_shoulder"),
    ("RHip RKnee RFoot", "right_hip right_knee right_ankle"),
    ("RAnkle RFoot RToe", "right_ankle right_foot right_toe"),
    ("RThigh RLeg", "right_hip right_knee"),
    ("RHipJoint RKnee", "right_hip right_knee"),
    ("MidHip Thorax", "pelvis spine3"),
    ("Root Pelvis", "- pelvis"),
    ("LKneeOut LElbowLat LASI T8 Shoulder LHead", "- - - - - -"),
    ("左肩 左腕 左ひじ 左手首", "left_collar left_shoulder left_elbow left_wrist"),
    ("左人指１ 左人指２ 左足ＩＫ", "left_index1 left_index2 -"),
    ("왼쪽어깨 오른손목 오른발목", "left_shoulder right_wrist right_ankle"),
    ("右大腿 右小腿 右脚", "right_hip right_knee right_ankle"),
    ("L_Finger01 L_Finger02 L_Finger11 L_Finger12", "left_thumb1 left_thumb2 left_index1 left_index2"),
    ("L_Finger0 L_Finger01 L_Finger1 L_Finger11", "left_thumb1 left_thumb2 left_index1 left_index2"),
    ("LeftFirstMC LeftFirstPP LeftFirstDP LeftSecondMC LeftSecondPP LeftSecondMP LeftSecondDP",
     "left_thumb1 left_thumb2 left_thumb3 - left_index1 left_index2 left_index3"),
    ("LeftFinger1Metacarpal LeftFinger1Proximal LeftFinger1Distal LeftFinger1Tip LeftFinger2Metacarpal "
     "LeftFinger2Proximal LeftFinger2Medial LeftFinger2Distal LeftFinger2Tip",
     "left_thumb1 left_thumb2 left_thumb3 left_thumb_tip - left_index1 left_index2 left_index3 left_index_tip"),
    ("m_avg_root m_avg_Pelvis m_avg_L_Hip m_avg_L_Hand m_avg_L_Wrist", "- pelvis left_hip - left_wrist"),
    ("b_l_upleg b_l_leg b_l_talocrural b_l_subtalar b_l_ball", "left_hip left_knee left_ankle - left_foot"),
    ("upperChest leftIndexProximal leftIndexIntermediate leftIndexDistal",
     "spine3 left_index1 left_index2 left_index3"),
    ("lShldr lForeArm lMid1 lMid2 rButtock", "left_shoulder left_elbow left_middle1 left_middle2 -"),
    ("LeftHandIndex1 LeftHandIndex2 LeftHandIndex3 LeftHandIndex4 LeftToeBase LeftToe_End",
     "left_index1 left_index2 left_index3 left_index_tip left_foot left_toe"),
    ("L_Finger11 L_Finger12 L_Finger21 L_Finger22", "left_thumb1 left_thumb2 left_index1 left_index2"),
])  # fmt: skip
def test_some_names(text: str, ours: str) -> None:
    found = joints_of(text.split())
    assert [found.get(name, "-") for name in text.split()] == ours.split()


def test_common_names_of_joints() -> None:
    names = ["left_forearm", "RightThigh", "left hand", "left_arm", "left_leg", "tail"]
    assert [joint_of(name) for name in names] == ["left_elbow", "right_hip", "left_wrist", None, None, None]


@pytest.mark.parametrize("name", ["CC_Base_L_ThighTwist01", "l_upperarmtwist1", "左腕捩", "LeftEye", "IK_foot_l"])
def test_helpers(name: str) -> None:
    assert is_helper(name) and not joints_of([name])


def test_a_skeleton_without_a_body_has_no_joints() -> None:
    assert joints_of(["a", "b", "LeftUperLeg"]) == {}
