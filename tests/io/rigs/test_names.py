"""Joints recognised by names alone: complete skeletons of real programs, and names without meaning."""

from __future__ import annotations

import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.io.rigs.names import is_helper, joint_of, joints_of

MIXAMO = """
Hips Spine Spine1 Spine2 Neck Head HeadTop_End LeftShoulder LeftArm LeftForeArm LeftHand LeftHandThumb1
LeftHandThumb2 LeftHandThumb3 LeftHandThumb4 LeftHandIndex1 LeftHandIndex2 LeftHandIndex3 LeftHandIndex4
RightShoulder RightArm RightForeArm RightHand LeftUpLeg LeftLeg LeftFoot LeftToeBase LeftToe_End RightUpLeg
RightLeg RightFoot RightToeBase
"""

# Names with blanks in them are parted by commas.
TEXTS = {
    "cgspeed": """
        Hips LHipJoint LeftUpLeg LeftLeg LeftFoot LeftToeBase RHipJoint RightUpLeg RightLeg RightFoot
        RightToeBase LowerBack Spine Spine1 Neck Neck1 Head LeftShoulder LeftArm LeftForeArm LeftHand
        LeftFingerBase LeftHandIndex1 LThumb RightShoulder RightArm RightForeArm RightHand RightFingerBase
        RightHandIndex1 RThumb
    """,
    "lafan": """
        Hips LeftUpLeg LeftLeg LeftFoot LeftToe RightUpLeg RightLeg RightFoot RightToe Spine Spine1 Spine2 Neck
        Head LeftShoulder LeftArm LeftForeArm LeftHand RightShoulder RightArm RightForeArm RightHand
    """,
    "biped": """
        Bip01, Bip01 Pelvis, Bip01 Spine, Bip01 Spine1, Bip01 Spine2, Bip01 Neck, Bip01 Head, Bip01 HeadNub,
        Bip01 L Clavicle, Bip01 L UpperArm, Bip01 L Forearm, Bip01 L Hand, Bip01 L Finger0, Bip01 L Finger01,
        Bip01 L Finger02, Bip01 L Finger0Nub, Bip01 L Finger1, Bip01 L Finger11, Bip01 L Finger12, Bip01 R
        Clavicle, Bip01 R UpperArm, Bip01 R Forearm, Bip01 R Hand, Bip01 L Thigh, Bip01 L Calf, Bip01 L Foot,
        Bip01 L Toe0, Bip01 R Thigh, Bip01 R Calf, Bip01 R Foot, Bip01 R Toe0
    """,
    "xsens_bvh": """
        Hips Chest Chest2 Chest3 Chest4 Neck Head RightCollar RightShoulder RightElbow RightWrist LeftCollar
        LeftShoulder LeftElbow LeftWrist RightHip RightKnee RightAnkle RightToe LeftHip LeftKnee LeftAnkle
        LeftToe
    """,
    "xsens_segments": """
        Pelvis L5 L3 T12 T8 Neck Head RightShoulder RightUpperArm RightForeArm RightHand LeftShoulder
        LeftUpperArm LeftForeArm LeftHand RightUpperLeg RightLowerLeg RightFoot RightToe LeftUpperLeg
        LeftLowerLeg LeftFoot LeftToe LeftFirstMC LeftFirstPP LeftFirstDP LeftSecondMC LeftSecondPP LeftSecondMP
        LeftSecondDP
    """,
    "rokoko": """
        Hips Spine1 Spine2 Spine3 Spine4 Neck Head LeftShoulder LeftArm LeftForeArm LeftHand
        LeftFinger1Metacarpal LeftFinger1Proximal LeftFinger1Distal LeftFinger1Tip LeftFinger2Metacarpal
        LeftFinger2Proximal LeftFinger2Medial LeftFinger2Distal LeftFinger2Tip RightShoulder RightArm
        RightForeArm RightHand LeftThigh LeftShin LeftFoot LeftToe LeftToeTip RightThigh RightShin RightFoot
        RightToe
    """,
    "smpl_short": """
        Pelvis L_Hip R_Hip Spine1 L_Knee R_Knee Spine2 L_Ankle R_Ankle Spine3 L_Foot R_Foot Neck L_Collar
        R_Collar Head L_Shoulder R_Shoulder L_Elbow R_Elbow L_Wrist R_Wrist L_Hand R_Hand
    """,
    "smpl_maya": """
        m_avg_root m_avg_Pelvis m_avg_L_Hip m_avg_L_Knee m_avg_L_Ankle m_avg_L_Foot m_avg_R_Hip m_avg_R_Knee
        m_avg_R_Ankle m_avg_R_Foot m_avg_Spine1 m_avg_Spine2 m_avg_Spine3 m_avg_Neck m_avg_Head m_avg_L_Collar
        m_avg_L_Shoulder m_avg_L_Elbow m_avg_L_Wrist m_avg_L_Hand m_avg_R_Collar m_avg_R_Shoulder m_avg_R_Elbow
        m_avg_R_Wrist
    """,
    "talking": """
        body_world b_root b_l_upleg b_l_leg b_l_foot_twist b_l_foot b_r_upleg b_r_leg b_r_foot_twist b_r_foot
        b_spine0 b_spine1 b_spine2 b_spine3 b_l_shoulder p_l_scap b_l_arm b_l_arm_twist b_l_forearm
        b_l_wrist_twist b_l_wrist b_l_thumb0 b_l_thumb1 b_l_thumb2 b_l_thumb3 b_l_index1 b_l_index2 b_l_index3
        b_r_shoulder p_r_scap b_r_arm b_r_forearm b_r_wrist b_neck0 b_head
    """,
    "unoc": """
        b_root b_l_upleg b_l_leg b_l_talocrural b_l_subtalar b_l_transversetarsal b_l_ball b_r_upleg b_r_leg
        b_r_talocrural b_r_ball b_spine0 b_spine1 b_spine2 b_spine3 b_neck0 b_head b_l_shoulder p_l_scap b_l_arm
        b_l_forearm b_l_wrist_twist b_l_wrist b_r_shoulder b_r_arm b_r_forearm b_r_wrist
    """,
    "vrm": """
        hips spine chest upperChest neck head leftShoulder leftUpperArm leftLowerArm leftHand rightShoulder
        rightUpperArm rightLowerArm rightHand leftUpperLeg leftLowerLeg leftFoot leftToes rightUpperLeg
        rightLowerLeg rightFoot rightToes leftIndexProximal leftIndexIntermediate leftIndexDistal
    """,
    "daz": """
        hip abdomen chest neck head leftEye rightEye rCollar rShldr rForeArm rHand rThumb1 rThumb2 lCollar lShldr
        lForeArm lHand lThumb1 lThumb2 lIndex1 lIndex2 lMid1 lMid2
        rButtock rThigh rShin rFoot lButtock lThigh lShin lFoot
    """,
}
BODY = {name: [word.strip() for word in text.split("," if "," in text else None)] for name, text in TEXTS.items()}
BODY |= {"mixamo_plain": MIXAMO.split(), "mixamo": [f"mixamorig:{name}" for name in MIXAMO.split()]}

EXPECTED = {
    "cgspeed": {"Spine": "spine1", "Spine1": "spine3", "LeftShoulder": "left_collar", "LeftFoot": "left_ankle"},
    "mixamo": {
        "mixamorig:Spine1": "spine2",
        "mixamorig:LeftHandIndex4": "left_index_tip",
        "mixamorig:LeftToe_End": "left_toe",
    },
    "mixamo_plain": {"LeftHandThumb1": "left_thumb1", "HeadTop_End": "head_top", "LeftArm": "left_shoulder"},
    "lafan": {"LeftToe": "left_foot", "LeftFoot": "left_ankle", "LeftLeg": "left_knee"},
    "biped": {
        "Bip01 L Finger0": "left_thumb1",
        "Bip01 L Finger02": "left_thumb3",
        "Bip01 L Finger11": "left_index2",
        "Bip01 L Finger0Nub": "left_thumb_tip",
        "Bip01 Spine2": "spine3",
        "Bip01 L Toe0": "left_foot",
    },
    "xsens_bvh": {
        "Chest": "spine1",
        "Chest3": "spine2",
        "Chest4": "spine3",
        "LeftShoulder": "left_shoulder",
        "LeftHip": "left_hip",
    },
    "xsens_segments": {
        "L5": "spine1",
        "T8": "spine3",
        "LeftShoulder": "left_collar",
        "LeftFirstMC": "left_thumb1",
        "LeftSecondPP": "left_index1",
        "LeftSecondDP": "left_index3",
    },
    "rokoko": {
        "Spine1": "spine1",
        "Spine4": "spine3",
        "LeftFinger1Metacarpal": "left_thumb1",
        "LeftFinger2Proximal": "left_index1",
        "LeftFinger2Tip": "left_index_tip",
        "LeftToeTip": "left_toe",
    },
    "smpl_short": {"L_Foot": "left_foot", "L_Ankle": "left_ankle", "Spine2": "spine2"},
    "smpl_maya": {"m_avg_L_Hip": "left_hip", "m_avg_Pelvis": "pelvis"},
    "talking": {
        "b_root": "pelvis",
        "b_spine0": "spine1",
        "b_spine3": "spine3",
        "b_l_foot": "left_ankle",
        "b_l_thumb1": "left_thumb1",
    },
    "unoc": {"b_l_talocrural": "left_ankle", "b_l_ball": "left_foot"},
    "vrm": {"chest": "spine2", "upperChest": "spine3", "leftIndexDistal": "left_index3"},
    "daz": {"lShldr": "left_shoulder", "lMid1": "left_middle1", "abdomen": "spine1", "chest": "spine3"},
}

LEFT_OUT = {
    "cgspeed": {
        "LHipJoint",
        "RHipJoint",
        "LowerBack",
        "Neck1",
        "LeftFingerBase",
        "RightFingerBase",
        "LThumb",
        "RThumb",
        "LeftHandIndex1",
        "RightHandIndex1",
    },
    "mixamo": set(),
    "mixamo_plain": set(),
    "lafan": set(),
    "biped": {"Bip01"},
    "xsens_bvh": {"Chest2"},
    "xsens_segments": {"L3", "LeftSecondMC"},
    "rokoko": {"Spine2", "LeftFinger2Metacarpal"},
    "smpl_short": {"L_Hand", "R_Hand"},
    "smpl_maya": {"m_avg_root", "m_avg_L_Hand"},
    "vrm": set(),
    "daz": {"leftEye", "rightEye", "rButtock", "lButtock"},
}


@pytest.mark.parametrize("name", BODY)
def test_a_naming_as_it_is_found(name: str) -> None:
    found = joints_of(BODY[name])
    assert EXPECTED[name].items() <= found.items()
    assert set(found.values()) <= set(default_skeleton().points)
    assert len(set(found.values())) == len(found)
    needed = {"pelvis", "head", "neck", "spine1"} | {
        f"{side}_{part}"
        for side in ("left", "right")
        for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist", "collar")
    }
    assert needed <= set(found.values())
    for given, ours in found.items():  # no left is a right
        side = ours.partition("_")[0]
        if side in ("left", "right"):
            plain = given.replace("mixamorig:", "").replace("Bip01 ", "").replace("m_avg_", "").replace("b_", "")
            assert plain[0].lower() == side[0], (given, ours)
    if name in LEFT_OUT:
        assert set(BODY[name]) - set(found) == LEFT_OUT[name]


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
    for name, joints in BODY.items():
        assert joints_of(sorted(joints, key=lambda given: given[::-1])) == joints_of(joints), name


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
