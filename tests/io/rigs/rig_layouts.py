"""Rigs that people have: names, hierarchy, rest pose, unit and traps of each."""

# ruff: noqa: E501

from __future__ import annotations

from rig_files import Bones, Layout, bones_of

LEG = "{0} | {top} | @hip\n{1} | {0} | @knee\n{2} | {1} | @ankle\n"
FOOT = "{3} | {2} | @foot\nEnd Site | {3} | @toe\n"
ARM = "{0} | {top} | @collar\n{1} | {0} | @shoulder\n{2} | {1} | @elbow\n{3} | {2} | @wrist\n"


def leg(top: str, *names: str) -> str:
    return (LEG + (FOOT if len(names) > 3 else "End Site | {2} | @foot\n")).format(*names, top=top)


def arm(top: str, *names: str) -> str:
    """Collar, shoulder, elbow and wrist; of three names there is no collar."""
    if len(names) == 3:
        text = "{0} | {top} | @shoulder\n{1} | {0} | @elbow\n{2} | {1} | @wrist\n"
        return text.format(*names, top=top)
    return ARM.format(*names, top=top)


def spine(root: str, names: str, places: str, head: str = "Neck Head", above: str = "-") -> str:
    """Root, spine, neck and head, one on the other."""
    lines, parent = [f"{root} | {above} | pelvis"], root
    for name, place in zip(names.split(), places.split(), strict=True):
        lines.append(f"{name} | {parent} | {place}")
        parent = name
    parts = head.split()
    for name, place in zip(parts, ("neck", "head")[-len(parts) :], strict=True):
        lines.append(f"{name} | {parent} | {place}")
        parent = name
    lines.append(f"End Site | {parent} | head_top")
    return "\n".join(lines) + "\n"


def shifted(bones: Bones, order: tuple[int, ...]) -> Bones:
    """Return the bones with the children of the root in another order."""
    root = bones[0][0]
    tops = [bone for bone in bones if bone[1] == root]
    return [bones[0], *(tops[k] for k in order), *(bone for bone in bones[1:] if bone[1] != root)]


MIXAMO = spine("m:Hips", "m:Spine m:Spine1 m:Spine2", "spine1 spine2 spine3", "m:Neck m:Head").replace(
    "End Site | m:Head | head_top", "m:HeadTop_End | m:Head | head_top"
)
MIXAMO += "m:LeftEye | m:Head | head>left_hip:0.08\nm:RightEye | m:Head | head>right_hip:0.08\n"
MIXAMO += arm("m:Spine2", "m:*Shoulder", "m:*Arm", "m:*ForeArm", "m:*Hand")
MIXAMO += leg("m:Hips", "m:*UpLeg", "m:*Leg", "m:*Foot", "m:*ToeBase")
MIXAMO_BONES = bones_of(
    MIXAMO.replace("m:", "mixamorig7:"), "Left", "Right", "mixamorig7:*Hand{F}{k}", "mixamorig7:*Hand"
)

CMU = "LowerBack | Hips | pelvis\nSpine | LowerBack | spine1\nSpine1 | Spine | spine3\n"
CMU = "Hips | - | pelvis\n" + CMU + "Neck | Spine1 | neck\nNeck1 | Neck | neck>head:0.4\nHead | Neck1 | head\n"
CMU += "End Site | Head | head_top\n*HipJoint | Hips | pelvis\n" + leg(
    "*HipJoint", "+UpLeg", "+Leg", "+Foot", "+ToeBase"
)
CMU += arm("Spine1", "+Shoulder", "+Arm", "+ForeArm", "+Hand")
CMU += "+FingerBase | +Hand | @wrist\n+HandIndex1 | +FingerBase | @wrist>@middle_tip:0.5\n*Thumb | +Hand | @wrist\n"
CMU_BONES = [
    (name.replace("+", side), parent.replace("+", side), place)
    for letter, side, skip in (("L", "Left", "right_"), ("R", "Right", "left_"))
    for name, parent, place in bones_of(CMU, letter, "R" if letter == "L" else "L")
    if not place.startswith(skip if letter == "L" else "left_")
]
CMU_BONES = list(dict.fromkeys(CMU_BONES))

SPINE3 = "Spine Spine1 Spine2 Spine3"
AT3 = "spine1 spine1>spine2:0.5 spine2 spine3"
BLADE = arm("Spine", "*Shoulder", "*Arm", "*ForeArm", "*Hand") + leg("Hips", "*UpLeg", "*Leg", "*Foot", "*ToeBase")
BLADE += "*HandThumb1 | *Hand | @thumb1\n"
AUTODESK = arm("Spine3", "*Shoulder", "*Arm", "*ForeArm", "*Hand") + leg("Hips", "*UpLeg", "*Leg", "*Foot", "*ToeBase")
AUTODESK += "*ForeArmEnd | *ForeArm | @elbow>@wrist:0.9\n"
BANDAI = arm("Chest", "Shoulder_*", "UpperArm_*", "LowerArm_*", "Hand_*")
BANDAI += leg("Hips", "UpperLeg_*", "LowerLeg_*", "Foot_*", "Toes_*")
XSENS = leg("root", "*hip", "*knee", "*ankle", "*toe") + arm("chest", "*clavicle", "*shoulder", "*elbow", "*wrist")
LIFTER = leg("Hips", "*Hip", "*Knee", "*Ankle") + arm("Neck", "*Shoulder", "*Elbow", "*Wrist")
OPENNI = """
TORSO# | - | pelvis>spine2:1
T*S | TORSO# | pelvis>spine2:1
*_SHOULDER# | T*S | @shoulder
*_ELBOW | *_SHOULDER# | @elbow
*_HAND | *_ELBOW | @wrist
T*H | TORSO# | pelvis>spine2:1
*_HIP# | T*H | @hip
*_KNEE | *_HIP# | @knee
*_FOOT | *_KNEE | @ankle
TN | TORSO# | pelvis>spine2:1
NECK# | TN | neck
HEAD | NECK# | head
End Site | HEAD | head_top
"""
OPENNI_BONES = [
    (name.replace("TLEFT", "TL").replace("TRIGHT", "TR"), parent.replace("TLEFT", "TL").replace("TRIGHT", "TR"), place)
    for name, parent, place in bones_of(OPENNI, "LEFT", "RIGHT")
]
CLASSIC = arm("Chest", "*Collar", "*UpArm", "*LowArm", "*Hand") + leg("Hips", "*UpLeg", "*LowLeg", "*Foot")
CLASSIC2 = arm("Chest2", "*Collar", "*Shoulder", "*Elbow", "*Wrist") + leg("Hips", "*Hip", "*Knee", "*Ankle")
DAZ = leg("hip", "*Buttock", "*Thigh", "*Shin").replace("*Buttock | hip | @hip", "*Buttock | hip | pelvis>@hip:0.4")
DAZ = "*Buttock | hip | pelvis>@hip:0.4\n" + leg("*Buttock", "*Thigh", "*Shin", "*Foot")
DAZ += arm("chest", "*Collar", "*Shldr", "*ForeArm", "*Hand")
MAKEHUMAN = "*buttock | hip | pelvis>@hip:0.3\n" + leg("*buttock", "*hip", "*knee", "*foot")
MAKEHUMAN += "toe1-1.^ | *foot | @foot\nEnd Site | toe1-1.^ | @toe\n" + "".join(
    f"toe{n}-1.^ | *foot | @foot>@ankle:0.{n}\nEnd Site | toe{n}-1.^ | @toe>@ankle:0.{n}\n" for n in (2, 3)
)
MAKEHUMAN += arm("chest", "*collar", "*shoulder", "*elbow", "*hand")
MAKEHUMAN += "jaw | head | head>neck:0.3\ntongue00 | jaw | head>neck:0.2\n" + "".join(
    f"face{k}_* | head | head>@hip:0.{k:02d}\nlid{k}_* | face{k}_* | head>@hip:0.{k + 10}\n" for k in range(1, 20)
)


def dotted(bones: Bones) -> Bones:
    """MakeHuman's sides: at the beginning of some names, at the end of others."""
    return [(a.replace("^", p[0]), b.replace("^", p[0]), p) for a, b, p in bones]


UNREAL = spine("pelvis", "spine_01 spine_02 spine_03", "spine1 spine2 spine3", "neck_01 head", "root")
UNREAL = "root | - | 0\n" + UNREAL + arm("spine_03", "clavicle_*", "upperarm_*", "lowerarm_*", "hand_*")
UNREAL += leg("pelvis", "thigh_*", "calf_*", "foot_*", "ball_*")
UNREAL += "upperarm_twist_01_* | upperarm_* | @shoulder>@elbow:0.5\nthigh_twist_01_* | thigh_* | @hip>@knee:0.5\n"
RIGIFY = spine(
    "DEF-spine", "DEF-spine.001 DEF-spine.002 DEF-spine.003", "spine1 spine2 spine3", "DEF-spine.004 DEF-spine.006"
)
RIGIFY += (
    arm("DEF-spine.003", "DEF-shoulder.*", "DEF-upper_arm.*", "DEF-upper_arm.*.001", "DEF-forearm.*")
    .replace("| @elbow", "| @shoulder>@elbow:0.5")
    .replace("| @wrist", "| @elbow")
)
RIGIFY += "DEF-forearm.*.001 | DEF-forearm.* | @elbow>@wrist:0.5\nDEF-hand.* | DEF-forearm.*.001 | @wrist\n"
RIGIFY += "DEF-thigh.* | DEF-spine | @hip\nDEF-thigh.*.001 | DEF-thigh.* | @hip>@knee:0.5\nDEF-shin.* | DEF-thigh.*.001 | @knee\n"
RIGIFY += "DEF-shin.*.001 | DEF-shin.* | @knee>@ankle:0.5\nDEF-foot.* | DEF-shin.*.001 | @ankle\nDEF-toe.* | DEF-foot.* | @foot\n"
RIGIFY += "DEF-breast.* | DEF-spine.003 | spine3>@shoulder:0.3\nDEF-pelvis.* | DEF-spine | pelvis>@hip:0.5\n"
BIPED = "Bip01 | - | pelvis\nBip01 Pelvis | Bip01 | pelvis\nBip01 Spine | Bip01 Pelvis | spine1\n"
BIPED += "Bip01 Spine1 | Bip01 Spine | spine2\nBip01 Spine2 | Bip01 Spine1 | spine3\nBip01 Neck | Bip01 Spine2 | neck\n"
BIPED += "Bip01 Head | Bip01 Neck | head\nEnd Site | Bip01 Head | head_top\n"
BIPED += leg("Bip01 Pelvis", "Bip01 * Thigh", "Bip01 * Calf", "Bip01 * Foot", "Bip01 * Toe0")
BIPED += arm("Bip01 Neck", "Bip01 * Clavicle", "Bip01 * UpperArm", "Bip01 * Forearm", "Bip01 * Hand")
VROID = spine(
    "J_Bip_C_Hips",
    "J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest",
    "spine1 spine2 spine3",
    "J_Bip_C_Neck J_Bip_C_Head",
)
VROID += arm("J_Bip_C_UpperChest", "J_Bip_*_Shoulder", "J_Bip_*_UpperArm", "J_Bip_*_LowerArm", "J_Bip_*_Hand")
VROID += leg("J_Bip_C_Hips", "J_Bip_*_UpperLeg", "J_Bip_*_LowerLeg", "J_Bip_*_Foot", "J_Bip_*_ToeBase")
VROID += "".join(
    f"J_Sec_*_Skirt{k} | {'J_Bip_C_Hips' if k == 1 else f'J_Sec_*_Skirt{k - 1}'} | @hip>@ankle:0.{2 * k - 1}\n"
    for k in (1, 2, 3, 4)
)
KINECT = (
    """
SpineBase | - | pelvis
SpineMid | SpineBase | spine1
SpineShoulder | SpineMid | spine3
Neck | SpineShoulder | neck
Head | Neck | head
End Site | Head | head_top
"""
    + arm("SpineShoulder", "Shoulder*", "Elbow*", "Wrist*")
    + leg("SpineBase", "Hip*", "Knee*", "Ankle*", "Foot*")
)
NEURON = spine("Hips", "Spine Spine1 Spine2", "spine1 spine2 spine3") + arm(
    "Spine2", "*Shoulder", "*Arm", "*ForeArm", "*Hand"
)
NEURON += leg("Hips", "*UpLeg", "*Leg", "*Foot")
NEURON += "".join(f"*InHand{f} | *Hand | @wrist>@{f.lower()}1:0.4\n" for f in ("Index", "Middle", "Ring", "Pinky"))
SMPL = spine("Pelvis", "Spine1 Spine2 Spine3", "spine1 spine2 spine3") + arm(
    "Spine3", "*_Collar", "*_Shoulder", "*_Elbow", "*_Wrist"
)
SMPL += leg("Pelvis", "*_Hip", "*_Knee", "*_Ankle", "*_Foot") + "*_Hand | *_Wrist | @middle1\n"
MVN = spine("Pelvis", "L5 L3 T12 T8", AT3) + arm("T8", "*Shoulder", "*UpperArm", "*ForeArm", "*Hand")
MVN += leg("Pelvis", "*UpperLeg", "*LowerLeg", "*Foot", "*Toe")
ICLONE = spine(
    "CC_Base_Hip",
    "CC_Base_Waist CC_Base_Spine01 CC_Base_Spine02",
    "spine1 spine2 spine3",
    "CC_Base_NeckTwist01 CC_Base_Head",
)
ICLONE = ICLONE.replace("CC_Base_Hip | - | pelvis", "CC_Base_Hip | - | pelvis\nCC_Base_Pelvis | CC_Base_Hip | pelvis")
ICLONE += leg("CC_Base_Pelvis", "CC_Base_*_Thigh", "CC_Base_*_Calf", "CC_Base_*_Foot", "CC_Base_*_ToeBase")
ICLONE += arm("CC_Base_Spine02", "CC_Base_*_Clavicle", "CC_Base_*_Upperarm", "CC_Base_*_Forearm", "CC_Base_*_Hand")
ICLONE += "CC_Base_*_CalfTwist01 | CC_Base_*_Calf | @knee>@ankle:0.4\nCC_Base_*_UpperarmTwist01 | CC_Base_*_Upperarm | @shoulder>@elbow:0.3\n"
MMD = spine("センター", "上半身 上半身2", "spine1 spine3", "首 頭") + arm("上半身2", "*肩", "*腕", "*ひじ", "*手首")
MMD += "下半身 | センター | pelvis\n" + leg("下半身", "*足", "*ひざ", "*足首", "*つま先")
ROKOKO = spine("Hips", "Spine1 Spine2 Spine3 Spine4", AT3) + arm("Spine4", "*Shoulder", "*Arm", "*ForeArm", "*Hand")
ROKOKO += leg("Hips", "*Thigh", "*Shin", "*Foot", "*Toe")

SIX = ("ZXY", "XYZ", "YZX", "ZYX", "XZY", "YXZ")
LAYOUTS: dict[str, Layout] = {
    "Mixamo": Layout(MIXAMO_BONES),
    "CMU, its own unit": Layout(CMU_BONES, unit=0.056444, rest="slanted"),
    "CMU, metres": Layout(CMU_BONES, unit=1.0, rest="slanted"),
    "CMU, a tenth": Layout(CMU_BONES, unit=0.0056444, rest="slanted"),
    "cgspeed's Daz": Layout(
        bones_of(spine("hip", "abdomen chest", "spine1 spine3", "neck head") + DAZ, "l", "r", "*{F}{k}", "*Hand")
    ),
    "MakeHuman": Layout(
        dotted(
            bones_of(
                spine("hip", "abdomen chest", "spine1 spine3", "neck head") + MAKEHUMAN,
                "l",
                "r",
                "finger{n}-{k}.*",
                "*hand",
            )
        ),
        unit=0.1,
        has_known_unit=False,
    ),
    "Vicon Blade": Layout(bones_of(spine("Hips", "Spine", "spine1", "Head") + BLADE, "Left", "Right"), unit=0.0254),
    "Spine3, Neck1": Layout(
        bones_of(spine("Hips", SPINE3, AT3, "Neck Head") + AUTODESK, "Left", "Right"),
        unit=0.0254,
        rest="along y",
        orders=SIX,
        has_positions=True,
    ),
    "Bandai-Namco": Layout(
        bones_of(
            "joint_Root | - | 0\n" + spine("Hips", "Spine Chest", "spine1 spine3", "Neck Head", "joint_Root") + BANDAI,
            "L",
            "R",
        ),
        has_positions=True,
    ),
    "Xsens, lower case": Layout(
        bones_of(
            spine("root", "lowerback upperback chest", "spine1 spine2 spine3", "lowerneck upperneck") + XSENS, "l", "r"
        ),
        unit=1.0,
        rest="along y",
    ),
    "pose lifter": Layout(
        bones_of(spine("Hips", "Spine", "spine1", "Neck Head") + LIFTER, "Left", "Right"),
        unit=0.001,
        up="-y",
        has_positions=True,
    ),
    "stick figure": Layout(
        bones_of(
            spine("Hips", "Chest", "spine1")
            + arm("Chest", "*Shoulder", "*Elbow", "*Wrist").replace("*Wrist |", "End Site |")
            + "*Hip | Hips | @hip\n*Knee | *Hip | @knee\nEnd Site | *Knee | @ankle\n",
            "Left",
            "Right",
        ),
        lacks=("left_wrist", "right_wrist", "left_ankle", "right_ankle"),
    ),
    "OpenNI": Layout(OPENNI_BONES, unit=0.001, lacks=("pelvis",)),
    "classic": Layout(
        bones_of(spine("Hips", "Chest", "spine1") + CLASSIC, "Left", "Right"), unit=0.0254, rest="hanging"
    ),
    "classic, two chests": Layout(
        bones_of(spine("Hips", "Chest Chest2", "spine1 spine3") + CLASSIC2, "Left", "Right"), rest="hanging"
    ),
    "Unreal": Layout(bones_of(UNREAL, "l", "r", "{f}_0{k}_*", "hand_*"), up="z", rest="A"),
    "Rigify": Layout(bones_of(RIGIFY, "L", "R", "DEF-f_{f}.0{k}.*", "DEF-hand.*"), unit=1.0, up="z", rest="A"),
    "3ds Max Biped": Layout(
        bones_of(BIPED, "L", "R", "Bip01 * Finger{m}{j}", "Bip01 * Hand"), unit=0.0254, rest="odd", still=("neck",)
    ),
    "VRoid": Layout(bones_of(VROID, "L", "R", "J_Bip_*_{F}{k}", "J_Bip_*_Hand"), unit=1.0),
    "Kinect": Layout(bones_of(KINECT, "Left", "Right"), unit=1.0, has_positions=True),
    "Perception Neuron": Layout(bones_of(NEURON, "Left", "Right"), orders=("YXZ",)),
    "SMPL": Layout(bones_of(SMPL, "L", "R"), unit=1.0, up="z"),
    "Xsens MVN": Layout(bones_of(MVN, "Left", "Right"), unit=1.0, up="z"),
    "iClone": Layout(bones_of(ICLONE, "L", "R", "CC_Base_*_{F}{k}", "CC_Base_*_Hand"), rest="A"),
    "MikuMikuDance": Layout(bones_of(MMD, "左", "右"), unit=0.08, has_known_unit=False, rest="A"),
    "Rokoko": Layout(bones_of(ROKOKO, "Left", "Right", "*Finger{n}{k}x", "*Hand"), unit=1.0),
}
