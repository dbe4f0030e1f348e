"""More rigs that people have, as their programs name and order them."""

# ruff: noqa: E501

from __future__ import annotations

from rig_files import Layout, bones_of
from rig_layouts import arm, leg, spine

THREE = "spine1 spine2 spine3"
FOUR = "spine1 spine1>spine2:0.5 spine2 spine3"


def plain(
    root: str, back: str, top: str, arms: str, legs: str, places: str = THREE, more: str = "", above: str = ""
) -> str:
    """A rig whose names are given from the pelvis up, from collars outward and from hips down; '*' is the side."""
    trunk = spine(root, back, places, top, above or "-")
    head = f"{above} | - | 0\n" if above else ""
    return head + trunk + arm(back.rsplit(maxsplit=1)[-1], *arms.split()) + leg(root, *legs.split()) + more


HIPS = "*Shoulder *Arm *ForeArm *Hand"
DEEP = plain(
    "hips_JNT", "spine_JNT spine1_JNT spine2_JNT", "neck_JNT head_JNT",
    "*_shoulder_JNT *_arm_JNT *_forearm_JNT *_hand_JNT", "*_upleg_JNT *_leg_JNT *_foot_JNT *_toebase_JNT",
)  # fmt: skip
SECOND_LIFE = plain(
    "mPelvis", "mTorso mChest", "mNeck mHead", "mCollar* mShoulder* mElbow* mWrist*", "mHip* mKnee* mAnkle* mFoot*",
    "spine1 spine3", "mSkull | mHead | head_top\nmEye* | mHead | head>@hip:0.06\n",
)  # fmt: skip
BENTO = SECOND_LIFE + "".join(
    f"mTail{k} | {'mPelvis' if k == 1 else f'mTail{k - 1}'} | pelvis>head:-0.{k}\n" for k in (1, 2, 3)
)
BENTO += "mWingsRoot | mChest | spine3>head:-0.1\nmWing1* | mWingsRoot | spine3>@shoulder:0.3\nmWing2* | mWing1* | spine3>@shoulder:0.9\n"
MAKEHUMAN = spine("root", "spine05 spine04 spine03 spine01", FOUR, "neck01 head")
MAKEHUMAN += "clavicle.* | spine01 | @collar\nshoulder01.* | clavicle.* | @collar>@shoulder:0.6\nupperarm01.* | shoulder01.* | @shoulder\n"
MAKEHUMAN += "upperarm02.* | upperarm01.* | @shoulder>@elbow:0.5\nlowerarm01.* | upperarm02.* | @elbow\nlowerarm02.* | lowerarm01.* | @elbow>@wrist:0.5\n"
MAKEHUMAN += "wrist.* | lowerarm02.* | @wrist\npelvis.* | root | pelvis>@hip:0.5\nupperleg01.* | pelvis.* | @hip\nupperleg02.* | upperleg01.* | @hip>@knee:0.5\n"
MAKEHUMAN += "lowerleg01.* | upperleg02.* | @knee\nlowerleg02.* | lowerleg01.* | @knee>@ankle:0.5\nfoot.* | lowerleg02.* | @ankle\n"
MAKEHUMAN += "toe1-1.* | foot.* | @foot\nEnd Site | toe1-1.* | @toe\njaw | head | head>neck:0.3\neye.* | head | head>@hip:0.06\nbreast.* | spine03 | spine3>@shoulder:0.3\n"
GENESIS8 = spine("hip", "abdomenLower abdomenUpper chestLower chestUpper", FOUR, "neckLower head")
GENESIS8 += "pelvis | hip | pelvis\n"
GENESIS8 += "*Collar | chestUpper | @collar\n*ShldrBend | *Collar | @shoulder\n*ShldrTwist | *ShldrBend | @shoulder>@elbow:0.5\n*ForearmBend | *ShldrTwist | @elbow\n"
GENESIS8 += "*ForearmTwist | *ForearmBend | @elbow>@wrist:0.5\n*Hand | *ForearmTwist | @wrist\n*ThighBend | pelvis | @hip\n*ThighTwist | *ThighBend | @hip>@knee:0.5\n"
GENESIS8 += "*Shin | *ThighTwist | @knee\n*Foot | *Shin | @ankle\n*Metatarsals | *Foot | @ankle>@foot:0.5\n*Toe | *Metatarsals | @foot\nEnd Site | *Toe | @toe\n"
GENESIS9 = spine("hip", "spine1 spine2 spine3 spine4", FOUR, "neck1 head") + "pelvis | hip | pelvis\n"
GENESIS9 += arm("spine4", "*_shoulder", "*_upperarm", "*_forearm", "*_hand") + leg(
    "pelvis", "*_thigh", "*_shin", "*_foot", "*_toes"
)
GENESIS9 += "*_upperarmtwist1 | *_upperarm | @shoulder>@elbow:0.3\n*_thightwist1 | *_thigh | @hip>@knee:0.3\n"
KINECT = plain(
    "PELVIS", "SPINE_NAVAL SPINE_CHEST", "NECK HEAD", "CLAVICLE_* SHOULDER_* ELBOW_* WRIST_*", "HIP_* KNEE_* ANKLE_* FOOT_*",
    "spine1 spine3", "HAND_* | WRIST_* | @middle1\nHANDTIP_* | HAND_* | @middle_tip\nTHUMB_* | WRIST_* | @thumb2\nNOSE | HEAD | head>left_hip:-0.05\nEYE_* | HEAD | head>@hip:-0.06\nEAR_* | HEAD | head>@hip:0.05\n",
)  # fmt: skip
TALKING = "body_world | - | 0\n" + spine(
    "b_root", "b_spine0 b_spine1 b_spine2 b_spine3", FOUR, "b_neck0 b_head", "body_world"
)
TALKING += arm("b_spine3", "b_*_shoulder", "b_*_arm", "b_*_forearm", "b_*_wrist") + leg(
    "b_root", "b_*_upleg", "b_*_leg", "b_*_talocrural", "b_*_ball"
)
TALKING += "p_*_scap | b_*_shoulder | @collar>@shoulder:0.5\nb_*_arm_twist | b_*_arm | @shoulder>@elbow:0.5\n"
VALVE = plain(
    "ValveBiped.Bip01_Pelvis", " ".join(f"ValveBiped.Bip01_Spine{k}" for k in ("", 1, 2, 4)), "ValveBiped.Bip01_Neck1 ValveBiped.Bip01_Head1",
    " ".join(f"ValveBiped.Bip01_*_{part}" for part in ("Clavicle", "UpperArm", "Forearm", "Hand")),
    " ".join(f"ValveBiped.Bip01_*_{part}" for part in ("Thigh", "Calf", "Foot", "Toe0")), FOUR,
)  # fmt: skip
TRUEBONES = "Bip01 | - | pelvis\n" + spine(
    "Bip01_Pelvis", "Bip01_Spine Bip01_Spine1", "spine1 spine3", "Bip01_Neck Bip01_Head", "Bip01"
)
TRUEBONES += leg("Bip01_Spine", "Bip01_*_Thigh", "Bip01_*_Calf", "Bip01_*_Foot", "Bip01_*_Toe0")
TRUEBONES += arm("Bip01_Neck", "Bip01_*_Clavicle", "Bip01_*_UpperArm", "Bip01_*_Forearm", "Bip01_*_Hand")
TRUEBONES += "Bip01_Ponytail1 | Bip01_Head | head>neck:-0.3\nBip01_Ponytail11 | Bip01_Ponytail1 | head>neck:0.5\n"


def layout(
    text: str, left: str = "Left", right: str = "Right", fingers: str = "", hand: str = "*Hand", **how
) -> Layout:
    return Layout(bones_of(text, left, right, fingers, hand), **how)


MORE: dict[str, Layout] = {
    "LaFAN1": layout(plain("Hips", "Spine Spine1 Spine2", "Neck Head", HIPS, "*UpLeg *Leg *Foot *Toe"), rest="along y", orders=("ZYX",)),
    "100STYLE": layout(
        plain("Hips", "Chest Chest2 Chest3 Chest4", "Neck Head", "*Collar *Shoulder *Elbow *Wrist", "*Hip *Knee *Ankle *Toe", FOUR),
        orders=("YXZ",),
    ),
    "ACCAD": layout(plain("root", "ToSpine Spine Spine1", "Neck Head", HIPS, "*UpLeg *Leg *Foot *ToeBase"), unit=0.0254),
    "Move.ai": layout(plain("Hips", "Spine Spine1 Spine2", "Neck Head", HIPS, "*UpLeg *Leg *Foot *ToeBase", above="Root"), fingers="*Hand{F}{k}"),
    "DeepMotion": layout(DEEP, "l", "r", "*_hand{F}{k}_JNT", "*_hand_JNT"),
    "Poser": layout(plain("hip", "abdomen chest", "neck head", "*Collar *Shldr *ForeArm *Hand", "*Thigh *Shin *Foot", "spine1 spine3"), "l", "r", unit=2.62, has_known_unit=False),
    "Second Life": layout(SECOND_LIFE, unit=0.0254),
    "Second Life, Bento": layout(BENTO, unit=1.0, up="z", fingers="mHand{F}{k}*", hand="mWrist*"),
    "MakeHuman, default": layout(MAKEHUMAN, "L", "R", "finger{n}-{k}.*", "wrist.*", unit=0.1, has_known_unit=False),
    "Daz Genesis 8": layout(GENESIS8, "l", "r", "*{F}{k}", rest="A"),
    "Daz Genesis 9": layout(GENESIS9, "l", "r", "*_{f}{k}", "*_hand", rest="A"),
    "HumanIK": layout(
        plain("Character1_Hips", "Character1_Spine Character1_Spine1 Character1_Spine2", "Character1_Neck Character1_Head",
              " ".join(f"Character1_*{part}" for part in ("Shoulder", "Arm", "ForeArm", "Hand")),
              " ".join(f"Character1_*{part}" for part in ("UpLeg", "Leg", "Foot", "ToeBase"))),
        fingers="Character1_*Hand{F}{k}", hand="Character1_*Hand", rest="odd",
    ),
    "Axis": layout(plain("Hips", "Spine Spine1 Spine2", "Neck Head", HIPS, "*UpLeg *Leg *Foot") + "*InHandIndex | *Hand | @wrist>@index1:0.4\n", unit=1.0, orders=("YXZ",), has_positions=True),
    "Kinect Azure": layout(KINECT, "LEFT", "RIGHT", unit=0.001, up="-y", has_positions=True),
    "Talking With Hands": layout(TALKING, "l", "r", "b_*_{f}{k}", "b_*_wrist", unit=1.0, rest="odd"),
    "Valve": layout(VALVE, "L", "R", "ValveBiped.Bip01_*_Finger{m}{j}", "ValveBiped.Bip01_*_Hand", unit=0.0254, up="z", rest="odd"),
    "Truebones": layout(TRUEBONES, "L", "R", "Bip01_*_Finger{m}{j}", "Bip01_*_Hand", up="z", rest="odd", still=("neck", "spine1")),
    "Advanced Skeleton": layout(
        plain("Root_M", "Spine1_M Spine2_M Chest_M", "Neck_M Head_M", "Scapula_* Shoulder_* Elbow_* Wrist_*", "Hip_* Knee_* Ankle_* Toes_*"),
        "L", "R", "{F}Finger{k}_*", "Wrist_*",
    ),
    "OptiTrack": layout(plain("Hip", "Ab Chest", "Neck Head", "*Shoulder *UArm *FArm *Hand", "*Thigh *Shin *Foot *Toe", "spine1 spine3"), "L", "R"),
    "iPi": layout(plain("Hip", "LowerSpine MiddleSpine Chest", "Neck Head", "*Clavicle *Shoulder *Forearm *Hand", "*Thigh *Shin *Foot *Toe"), "L", "R"),
    "Cascadeur": layout(plain("pelvis", "stomach chest", "neck head", "clavicle_* arm_* forearm_* hand_*", "thigh_* calf_* foot_* toe_*", "spine1 spine3"), "l", "r"),
    "Blender, B-": layout(
        plain("B-hips", "B-spine B-chest B-upperChest", "B-neck B-head", "B-shoulder.* B-upperArm.* B-forearm.* B-hand.*", "B-thigh.* B-shin.* B-foot.* B-toe.*"),
        "L", "R", "B-{f}0{k}.*", "B-hand.*", unit=1.0, up="z", rest="A",
    ),
    "SMPL-X": layout(plain("pelvis", "spine1 spine2 spine3", "neck head", "*_collar *_shoulder *_elbow *_wrist", "*_hip *_knee *_ankle *_foot", more="jaw | head | head>neck:0.3\n*_eye_smplhf | head | head>@hip:0.06\n"), "left", "right", "*_{f}{k}", "*_wrist", unit=1.0),
}  # fmt: skip
