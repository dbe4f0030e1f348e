"""Rigs of video tools, games, headsets and data sets, and odd variants of rigs."""

# ruff: noqa: E501

from __future__ import annotations

from more_layouts import FOUR, HIPS, layout, plain
from rig_files import Layout
from rig_layouts import CMU_BONES, arm, leg, spine

LEGS, TOES = "*UpLeg *Leg *Foot *ToeBase", "*UpperLeg *LowerLeg *Foot *Toes"
CMU_MAKEHUMAN = spine("Hips", "LowerBack Spine Spine1", "spine1 spine2 spine3", "Neck Head").replace(
    "Head | Neck | head", "Neck1 | Neck | neck>head:0.3\nHead | Neck1 | head"
)
CMU_MAKEHUMAN += arm("Spine1", "*Shoulder", "*Arm", "*ForeArm", "*Hand")
CMU_MAKEHUMAN += "*HipJoint | Hips | pelvis\n" + leg("*HipJoint", "*UpLeg", "*Leg", "*Foot", "*ToeBase")
CMU_MAKEHUMAN += "*FingerBase | *Hand | @middle1\n*HandFinger1 | *FingerBase | @middle2\n*Thumb | *Hand | @thumb2\n"
CMU_MAKEHUMAN = CMU_MAKEHUMAN.replace("*HipJoint", "~HipJoint").replace("*Thumb", "~Thumb")


def cmu_of_makehuman() -> list[tuple[str, str, str]]:
    """The same, sides that no other name tells among them."""
    bones = []
    for side, letter in (("Left", "L"), ("Right", "R")):
        text = CMU_MAKEHUMAN.replace("~", letter).replace("*", side).replace("@", f"{side.lower()}_")
        bones += [tuple(part.strip() for part in line.split("|")) for line in text.strip().splitlines()]
    return list(dict.fromkeys(bones))


GAME = "Root | - | 0\n" + spine("pelvis", "spine_01 spine_02 spine_03", "spine1 spine2 spine3", "neck_01 head", "Root")
GAME += arm("spine_03", "clavicle_*", "upperarm_*", "lowerarm_*", "hand_*") + leg(
    "pelvis", "thigh_*", "calf_*", "foot_*", "ball_*"
)
MANNY = (
    GAME.replace("Root", "root")
    + "upperarm_twist_01_* | upperarm_* | @shoulder>@elbow:0.3\nthigh_twist_02_* | thigh_* | @hip>@knee:0.6\n"
)
MANNY += "calf_correctiveRoot_* | calf_* | @knee\ncalf_kneeBack_* | calf_correctiveRoot_* | @knee>@ankle:0.05\n"
MANNY += (
    "index_metacarpal_* | hand_* | @wrist>@index1:0.3\nik_foot_root | root | 0\nik_foot_* | ik_foot_root | @ankle\n"
)
MANNY += "ik_hand_root | root | 0\nik_hand_gun | ik_hand_root | right_wrist\nik_hand_* | ik_hand_gun | @wrist\n"
ICLONE = "CC_Base_BoneRoot | - | 0\n" + spine(
    "CC_Base_Hip",
    "CC_Base_Waist CC_Base_Spine01 CC_Base_Spine02",
    "spine1 spine2 spine3",
    "CC_Base_NeckTwist01 CC_Base_Head",
    "CC_Base_BoneRoot",
)
ICLONE = ICLONE.replace(
    "CC_Base_Head | CC_Base_NeckTwist01 |",
    "CC_Base_NeckTwist02 | CC_Base_NeckTwist01 | neck>head:0.5\nCC_Base_Head | CC_Base_NeckTwist02 |",
)
ICLONE += "CC_Base_Pelvis | CC_Base_Hip | pelvis\nCC_Base_FacialBone | CC_Base_Head | head\nCC_Base_JawRoot | CC_Base_FacialBone | head>neck:0.2\nCC_Base_*_Eye | CC_Base_FacialBone | head>@hip:0.06\n"
ICLONE += leg("CC_Base_Pelvis", *(f"CC_Base_*_{part}" for part in ("Thigh", "Calf", "Foot", "ToeBase")))
ICLONE += arm("CC_Base_Spine02", *(f"CC_Base_*_{part}" for part in ("Clavicle", "Upperarm", "Forearm", "Hand")))
ICLONE += "".join(
    f"CC_Base_*_{a}Twist0{k} | CC_Base_*_{a} | @{b}>@{c}:0.{3 * k}\n"
    for a, b, c in (("Thigh", "hip", "knee"), ("Upperarm", "shoulder", "elbow"), ("Forearm", "elbow", "wrist"))
    for k in (1, 2)
)
ICLONE += "CC_Base_*_RibsTwist | CC_Base_Spine02 | spine3>@shoulder:0.4\nCC_Base_*_Breast | CC_Base_*_RibsTwist | spine3>@shoulder:0.5\n"
ARKIT = "root | - | 0\n" + spine(
    "hips_joint",
    " ".join(f"spine_{k}_joint" for k in range(1, 8)),
    "spine1 spine1>spine2:0.3 spine1>spine2:0.7 spine2 spine2>spine3:0.3 spine2>spine3:0.7 spine3",
    "neck_1_joint head_joint",
    "root",
)
ARKIT = ARKIT.replace(
    "head_joint | neck_1_joint |",
    "neck_2_joint | neck_1_joint | neck>head:0.3\nneck_3_joint | neck_2_joint | neck>head:0.5\nneck_4_joint | neck_3_joint | neck>head:0.8\nhead_joint | neck_4_joint |",
)
ARKIT += "jaw_joint | head_joint | head>neck:0.2\n*_eye_joint | head_joint | head>@hip:0.06\n*_eyeball_joint | *_eye_joint | head>@hip:0.08\n*_handThumbStart_joint | *_hand_joint | @wrist>@thumb1:0.5\n"
ARKIT += arm("spine_7_joint", "*_shoulder_1_joint", "*_arm_joint", "*_forearm_joint", "*_hand_joint") + leg(
    "hips_joint", "*_upLeg_joint", "*_leg_joint", "*_foot_joint", "*_toes_joint"
)
MOCOPI = spine(
    "root",
    " ".join(f"torso_{k}" for k in range(1, 8)),
    "spine1 spine1>spine2:0.3 spine1>spine2:0.7 spine2 spine2>spine3:0.3 spine2>spine3:0.7 spine3",
    "neck_1 head",
)
MOCOPI = MOCOPI.replace("head | neck_1 |", "neck_2 | neck_1 | neck>head:0.5\nhead | neck_2 |")
MOCOPI += arm("torso_7", "*_shoulder", "*_up_arm", "*_low_arm", "*_hand") + leg(
    "root", "*_up_leg", "*_low_leg", "*_foot", "*_toes"
)
META = "Root | - | 0\n" + spine("Hips", "SpineLower SpineMiddle SpineUpper Chest", FOUR, "Neck Head", "Root")
META += "*Shoulder | Chest | @collar\n*Scapula | *Shoulder | @collar>@shoulder:0.5\n*ArmUpper | *Scapula | @shoulder\n*ArmLower | *ArmUpper | @elbow\n*HandWristTwist | *ArmLower | @elbow>@wrist:0.8\n*HandWrist | *ArmLower | @wrist\n*HandPalm | *HandWrist | @wrist>@middle1:0.5\n"
META += (
    leg("Hips", "*UpperLeg", "*LowerLeg", "*FootAnkle", "*FootBall")
    + "*FootAnkleTwist | *LowerLeg | @knee>@ankle:0.9\n*FootSubtalar | *FootAnkle | @ankle>@foot:0.2\n"
)
XNA = "root ground | - | 0\n" + spine(
    "root hips", "spine~lower spine~upper", "spine1 spine3", "head~neck~lower head~neck~upper", "root ground"
).replace("~", " ")
XNA += arm("spine upper", "arm * shoulder 1", "arm * shoulder 2", "arm * elbow", "arm * wrist") + leg(
    "root hips", "leg * thigh", "leg * knee", "leg * ankle", "leg * toes"
)
XNA += "arm * shoulder 2a | arm * shoulder 2 | @shoulder>@elbow:0.3\nhead jaw | head neck upper | head>neck:0.2\n"
SKYRIM = "NPC Root [Root] | - | 0\nNPC COM [COM ] | NPC Root [Root] | pelvis\n" + "".join(
    f"{name} | {above} | {place}\n"
    for name, above, place in (
        ("NPC Pelvis [Pelv]", "NPC COM [COM ]", "pelvis"),
        ("NPC Spine [Spn0]", "NPC COM [COM ]", "spine1"),
        ("NPC Spine1 [Spn1]", "NPC Spine [Spn0]", "spine2"),
        ("NPC Spine2 [Spn2]", "NPC Spine1 [Spn1]", "spine3"),
        ("NPC Neck [Neck]", "NPC Spine2 [Spn2]", "neck"),
        ("NPC Head [Head]", "NPC Neck [Neck]", "head"),
        ("End Site", "NPC Head [Head]", "head_top"),
    )
)
SKYRIM += leg(
    "NPC Pelvis [Pelv]", "NPC * Thigh [*Thg]", "NPC * Calf [*Clf]", "NPC * Foot [*ft ]", "NPC * Toe0 [*Toe]"
) + arm(
    "NPC Spine2 [Spn2]", "NPC * Clavicle [*Clv]", "NPC * UpperArm [*Uar]", "NPC * Forearm [*Lar]", "NPC * Hand [*Hnd]"
)
SKYRIM += "Shield | NPC L Forearm [LLar] | left_elbow>left_wrist:0.5\nWeapon | NPC R Hand [RHnd] | right_middle1\nCamera3rd [Cam3] | NPC Root [Root] | head\n"
SKYRIM += "NPC * RearCalf [RrClf] | NPC * Calf [*Clf] | @knee>@ankle:0.3\n"
SIMS = (
    "b__ROOT__ | - | 0\n"
    + spine(
        "b__Pelvis__", "b__Spine0__ b__Spine1__ b__Spine2__", "spine1 spine2 spine3", "b__Neck__ b__Head__", "b__ROOT__"
    )
    + arm("b__Spine2__", *(f"b__*_{part}__" for part in ("Clavicle", "UpperArm", "Forearm", "Hand")))
    + leg("b__Pelvis__", *(f"b__*_{part}__" for part in ("Thigh", "Calf", "Foot", "Toe")))
)
SIMS += "b__*_ButtCloth__ | b__Pelvis__ | @hip>@knee:0.1\nb__*_ShirtCloth__ | b__*_UpperArm__ | @shoulder>@elbow:0.2\n"
GTA = "SKEL_ROOT | - | pelvis\n" + spine(
    "SKEL_Pelvis", "SKEL_Spine0 SKEL_Spine1 SKEL_Spine2 SKEL_Spine3", FOUR, "SKEL_Neck_1 SKEL_Head", "SKEL_ROOT"
).replace("SKEL_Spine0 | SKEL_Pelvis", "SKEL_Spine_Root | SKEL_ROOT | pelvis\nSKEL_Spine0 | SKEL_Spine_Root")
GTA += (
    arm("SKEL_Spine3", *(f"SKEL_*_{part}" for part in ("Clavicle", "UpperArm", "Forearm", "Hand")))
    + leg("SKEL_Pelvis", *(f"SKEL_*_{part}" for part in ("Thigh", "Calf", "Foot", "Toe0")))
    + "MH_*_Knee | SKEL_*_Calf | @knee\nRB_*_ThighRoll | SKEL_*_Thigh | @hip\n"
)
RIG_PRO = (
    spine("root.x", "spine_01.x spine_02.x spine_03.x", "spine1 spine2 spine3", "neck.x head.x")
    + arm("spine_03.x", "shoulder.*", "arm_stretch.*", "forearm_stretch.*", "hand.*")
    + leg("root.x", "thigh_stretch.*", "leg_stretch.*", "foot.*", "toes_01.*")
)
RIG_PRO += "thigh_twist.* | root.x | @hip\narm_twist.* | shoulder.* | @shoulder\nforearm_twist.* | forearm_stretch.* | @elbow>@wrist:0.5\nleg_twist.* | leg_stretch.* | @knee>@ankle:0.5\n"
METARIG = spine("spine", "spine.001 spine.002 spine.003", "spine1 spine2 spine3", "spine.004 spine.006").replace(
    "spine.006 | spine.004 |", "spine.005 | spine.004 | neck>head:0.5\nspine.006 | spine.005 |"
)
METARIG += (
    arm("spine.003", "shoulder.*", "upper_arm.*", "forearm.*", "hand.*")
    + leg("spine", "thigh.*", "shin.*", "foot.*", "toe.*")
    + "heel.02.* | foot.* | @ankle>@foot:-0.3\npelvis.* | spine | pelvis>@hip:0.5\nbreast.* | spine.003 | spine3>@shoulder:0.4\npalm.01.* | hand.* | @wrist>@index1:0.3\n"
)
BEAT = (
    spine("Hips", "Spine Spine1 Spine2 Spine3", FOUR, "Neck Head").replace(
        "Head | Neck |", "Neck1 | Neck | neck>head:0.5\nHead | Neck1 |"
    )
    + arm("Spine3", "*Shoulder", "*Arm", "*Arm1", "*Hand")
    + leg("Hips", "*UpLeg", "*Leg", "*Foot", "*ToeBase").replace(
        "*ToeBase | *Foot |", "*FootF | *Foot | @ankle>@foot:0.4\n*ToeBase | *FootF |"
    )
)
BEAT += "".join(
    f"*Hand{letter}{k} | {'*Hand' if k == 1 else f'*Hand{letter}{k - 1}'} | @{finger}{k}\n"
    for letter, finger in zip("TIMRP", ("thumb", "index", "middle", "ring", "pinky"), strict=True)
    for k in (1, 2, 3)
)
ASF = spine("root", "lowerback upperback thorax", "spine1 spine2 spine3", "lowerneck head").replace(
    "head | lowerneck |", "upperneck | lowerneck | neck>head:0.5\nhead | upperneck |"
)
ASF += (
    "*hipjoint | root | pelvis\n"
    + leg("*hipjoint", "*femur", "*tibia", "*foot", "*toes")
    + arm("thorax", "*clavicle", "*humerus", "*radius", "*wrist")
    + "*hand | *wrist | @wrist>@middle1:0.5\n*fingers | *hand | @middle1\n*thumb | *wrist | @thumb1\n"
)
LIFTED = (
    "Hip | - | pelvis\nSpine | Hip | spine1\nThorax | Spine | spine3\nNeck | Thorax | neck\nEnd Site | Neck | head\n"
    + leg("Hip", "*Hip", "*Knee", "*Ankle")
    + arm("Thorax", "*Shoulder", "*Elbow", "*Wrist")
)
BIPED = "Bip001 | - | pelvis\nBip001 Footsteps | Bip001 | pelvis>head:-1.5\n" + spine(
    "Bip001 Pelvis",
    "Bip001 Spine,Bip001 Spine1,Bip001 Spine2".replace(" ", "~").replace(",", " "),
    "spine1 spine2 spine3",
    "Bip001~Neck Bip001~Head",
    "Bip001",
).replace("~", " ")
BIPED += leg("Bip001 Spine", *(f"Bip001 * {part}" for part in ("Thigh", "Calf", "Foot", "Toe0"))) + arm(
    "Bip001 Neck", *(f"Bip001 * {part}" for part in ("Clavicle", "UpperArm", "Forearm", "Hand"))
)
BIPED += "Bip001 *UpArmTwist | Bip001 * Clavicle | @shoulder\nBip001 *ThighTwist | Bip001 * Thigh | @hip>@knee:0.3\nBip001 Xtra01 | Bip001 Head | head>neck:-0.2\nBip001 Prop1 | Bip001 R Hand | right_middle1\n"
READY = (
    "Armature | - | 0\n"
    + spine("Hips", "Spine Spine1 Spine2", "spine1 spine2 spine3", "Neck Head", "Armature").replace(
        "End Site | Head | head_top", "HeadTop_End | Head | head_top\n*Eye | Head | head>@hip:0.06"
    )
    + arm("Spine2", "*Shoulder", "*Arm", "*ForeArm", "*Hand")
    + leg("Hips", "*UpLeg", "*Leg", "*Foot", "*ToeBase")
)
KINECT1 = (
    "HipCenter | - | pelvis\nSpine | HipCenter | spine1\nShoulderCenter | Spine | neck\nHead | ShoulderCenter | head\nEnd Site | Head | head_top\n"
    + arm("ShoulderCenter", "Shoulder*", "Elbow*", "Wrist*")
    + "Hand* | Wrist* | @middle1\n"
    + leg("HipCenter", "Hip*", "Knee*", "Ankle*", "Foot*")
)
FREE = (
    "pelvis | - | pelvis\npelvis.* | pelvis | pelvis>@hip:0.9\nspine | pelvis | pelvis\nspine.001 | spine | spine2\nneck | spine.001 | neck\nface | neck | head\nEnd Site | face | head_top\n"
    + leg("pelvis.*", "thigh.*", "shin.*", "foot.*")
    + "heel.02.* | shin.* | @ankle>@foot:-0.2\n"
    + arm("spine.001", "shoulder.*", "upper_arm.*", "forearm.*", "hand.*")
)
ROBLOX = (
    "HumanoidRootPart | - | pelvis\n"
    + spine("LowerTorso", "UpperTorso", "spine1", "Head", "HumanoidRootPart")
    + arm("UpperTorso", "*UpperArm", "*LowerArm", "*Hand")
    + leg("LowerTorso", "*UpperLeg", "*LowerLeg", "*Foot")
)
REFERENCE = plain("Hips", "Spine Spine1 Spine2", "Neck Head", HIPS, LEGS, above="Reference")
BY_ENDS = "RootJoint | - | pelvis\npelvis_lowerback | RootJoint | spine1\nlowerback_torso | pelvis_lowerback | spine3\ntorso_head | lowerback_torso | neck\nEnd Site | torso_head | head_top\n"
BY_ENDS += arm("lowerback_torso", "*torso_clavicle", "*clavicle_upperarm", "*upperarm_forearm", "*forearm_hand") + leg(
    "RootJoint", "*pelvis_thigh", "*thigh_shin", "*shin_foot", "*foot_toes"
)

FURTHER: dict[str, Layout] = {
    "Plask": layout(plain("hips", "spine spine1 spine2", "neck head", "*Shoulder *Arm *ForeArm *Hand", LEGS, more="*HandIndex1 | *Hand | @index1\n"), "left", "right"),
    "CMU, MotionBuilder": Layout(CMU_BONES, unit=0.056444, rest="slanted", t_posed=True),
    "MakeHuman, game engine": layout(GAME, "l", "r", "{f}_0{k}_*", "hand_*", unit=0.1, has_known_unit=False),
    "MakeHuman, game engine, metres": layout(GAME, "l", "r", "{f}_0{k}_*", "hand_*", unit=1.0, up="z", rest="A"),
    "MakeHuman, CMU": Layout(cmu_of_makehuman(), unit=0.1, has_known_unit=False),  # type: ignore[arg-type]
    "MakeHuman, CMU, metres": Layout(cmu_of_makehuman(), unit=1.0, up="z", rest="A"),  # type: ignore[arg-type]
    "Unreal 5": layout(MANNY, "l", "r", "{f}_0{k}_*", "hand_*", up="z", rest="A"),
    "Character Creator": layout(ICLONE, "L", "R", "CC_Base_*_{F}{k}", "CC_Base_*_Hand", rest="A"),
    "ARKit": layout(ARKIT, "left", "right", "*_hand{F}_{k}_joint", "*_hand_joint", unit=1.0, rest="odd"),
    "mocopi": layout(MOCOPI, "l", "r", orders=("YXZ",), has_positions=True),
    "Meta, whole body": layout(META, "Left", "Right", "*Hand{F}{k}", "*HandWrist", unit=1.0, rest="odd"),
    "XNALara": layout(XNA, "left", "right", "arm * finger {n}{k}", "arm * wrist", unit=1.0, rest="A"),
    "Skyrim": layout(SKYRIM, "L", "R", "NPC * Finger{m}{k} [*F{m}{k}]", "NPC * Hand [*Hnd]", unit=0.014, has_known_unit=False, up="z", rest="odd"),
    "The Sims": layout(SIMS, "L", "R", "b__*_{F}{k}__", "b__*_Hand__", unit=1.0, rest="odd"),
    "GTA": layout(GTA, "L", "R", "SKEL_*_Finger{m}{k}", "SKEL_*_Hand", unit=1.0, up="z", rest="odd"),
    "Auto-Rig Pro": layout(RIG_PRO, "l", "r", "c_{f}{k}.*", "hand.*", unit=1.0, up="z", rest="A"),
    "Blender's metarig": layout(METARIG, "L", "R", "f_{f}.0{k}.*", "hand.*", unit=1.0, up="z", rest="A"),
    "BEAT": layout(BEAT, "L", "R", has_positions=True, orders=("XYZ",)),
    "CMU, names of ASF": layout(ASF, "l", "r", unit=0.056444, rest="slanted"),
    "video to BVH": layout(LIFTED, unit=1.0, up="z", lacks=("head",)),
    "3ds Max Biped, twists": layout(BIPED, "L", "R", "Bip001 * Finger{m}{j}", "Bip001 * Hand", unit=0.0254, up="z", rest="odd", still=("neck", "spine1")),
    "Ready Player Me": layout(READY, fingers="*Hand{F}{k}", unit=1.0),
    "Kinect, first": layout(KINECT1, unit=1.0, has_positions=True),
    "FreeMoCap": layout(FREE, "L", "R", unit=1.0, up="z", rest="A", still=("spine1",)),
    "Roblox": layout(ROBLOX, unit=0.36, has_known_unit=False),
    "MotionBuilder, Reference": layout(REFERENCE, fingers="*Hand{F}{k}", rest="odd"),
    "named by both ends": layout(BY_ENDS, "l", "r", unit=1.0, lacks=("head",)),
    "Unity": layout(plain("Hips", "Spine Chest UpperChest", "Neck Head", "*Shoulder *UpperArm *LowerArm *Hand", TOES), fingers="*{F}{k}", unit=1.0, has_positions=True),
}  # fmt: skip
