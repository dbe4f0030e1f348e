"""Joint names of other programs and data sets, and which of our joints (SMPL-H's names) they are."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bodysense.errors import BodysenseError

_PREFIX = re.compile(r"^(.*:|mixamorig\d*|bip0*\d+|[mf]avg)", re.IGNORECASE)
_BODY = ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_NEEDED = ("pelvis", "head", *(f"{side}_{part}" for side in ("left", "right") for part in _BODY[1:7]))


@dataclass(frozen=True)
class Naming:
    """How one program or data set names its joints. '*' stands for the side, '|' parts alternatives, best first.

    Upper and lower case, blanks and punctuation do not count, nor does a prefix ('mixamorig:', 'Bip01 ', 'm_avg_').
    """

    sides: str  # left and right
    middle: str  # pelvis, neck, head
    spine: str  # from the pelvis up; a file may have some of them
    sided: str  # collar, shoulder, elbow, wrist, hip, knee, ankle, foot (the ball of the foot)
    fingers: str = "*Hand{finger}{joint}"
    finger: str = "Thumb Index Middle Ring Pinky"
    joint: str = "1 2 3 4"  # the last is the fingertip
    thumb_joint: str = ""  # where the thumb's joints are named otherwise
    ends: str = "HeadTop_End|Head_End *Toe_End|*ToeBase_End"  # top of the head, tip of the toes


NAMINGS = {
    # Mixamo, MotionBuilder, CMU as converted by cgspeed, LaFAN1, and the files of Rocketbox in this project's layout
    "hips": Naming(
        "Left Right",
        "Hips Neck Head",
        "Spine Spine1 Spine2 Spine3 Spine4",
        "*Shoulder *Arm *ForeArm *Hand *UpLeg *Leg *Foot *ToeBase|*Toe",
    ),
    "rokoko": Naming(
        "Left Right",
        "Hips Neck Head",
        "Spine1 Spine2 Spine3 Spine4",
        "*Shoulder *Arm *ForeArm *Hand *Thigh *Shin *Foot *Toe",
        "*Finger{finger}{joint}",
        "1 2 3 4 5",
        "Proximal Medial Distal Tip",
        "Metacarpal Proximal Distal Tip",
        "HeadTip|HeadEnd *ToeTip",
    ),
    # Xsens MVN: the segments of .mvnx and FBX
    "xsens": Naming(
        "Left Right",
        "Pelvis Neck Head",
        "L5 L3 T12 T8",
        "*Shoulder *UpperArm *ForeArm *Hand *UpperLeg *LowerLeg *Foot *Toe",
        "*{finger}{joint}",
        "First Second Third Fourth Fifth",
        "PP MP DP Tip",
        "MC PP DP Tip",
    ),
    # Biovision's own names: Xsens MVN's BVH, 3ds Max's BVH
    "biovision": Naming(
        "Left Right",
        "Hips Neck Head",
        "Chest Chest2 Chest3 Chest4",
        "*Collar *Shoulder *Elbow *Wrist *Hip *Knee *Ankle *Toe",
    ),
    # Unity's humanoid and VRM
    "humanoid": Naming(
        "Left Right",
        "Hips Neck Head",
        "Spine Chest UpperChest",
        "*Shoulder *UpperArm *LowerArm *Hand *UpperLeg *LowerLeg *Foot *Toes|*Toe",
        "*{finger}{joint}",
        "Thumb Index Middle Ring Little",
        "Proximal Intermediate Distal Tip",
    ),
    # 3ds Max Biped: Bip01 L UpperArm …, Microsoft Rocketbox
    "biped": Naming(
        "L R",
        "Pelvis Neck Head",
        "Spine Spine1 Spine2 Spine3",
        "*Clavicle *UpperArm *Forearm *Hand *Thigh *Calf *Foot *Toe0",
        "*Finger{finger}{joint}",
        "0 1 2 3 4",
        "- 1 2 Nub",
        ends="HeadNub *Toe0Nub",
    ),
    "smpl": Naming(
        "left right",
        "pelvis neck head",
        "spine1 spine2 spine3",
        "*_collar *_shoulder *_elbow *_wrist *_hip *_knee *_ankle *_foot",
        "*_{finger}{joint}",
    ),
    "smpl_short": Naming(
        "L R",
        "Pelvis Neck Head",
        "Spine1 Spine2 Spine3",
        "*_Collar *_Shoulder *_Elbow *_Wrist *_Hip *_Knee *_Ankle *_Foot",
        "*_{finger}{joint}",
    ),
    # UNOC's release and Talking With Hands 16.2M
    "meta": Naming(
        "l r",
        "b_root b_neck0 b_head",
        "b_spine0 b_spine1 b_spine2 b_spine3",
        "b_*_shoulder b_*_arm b_*_forearm b_*_wrist b_*_upleg b_*_leg b_*_talocrural|b_*_foot|b_*_foot_twist b_*_ball",
        "b_*_{finger}{joint}",
        joint="1 2 3 3_Nub",
        ends="b_head_null *_ball_end",
    ),
    # DAZ and Poser, also of CMU by cgspeed
    "daz": Naming(
        "l r",
        "hip neck head",
        "abdomen chest",
        "*Collar *Shldr *ForeArm *Hand *Thigh *Shin *Foot *Toe",
        "*{finger}{joint}",
        "Thumb Index Mid Ring Pinky",
    ),
}


def recognise(names: Sequence[str], source: str = "skeleton", known: Mapping[str, str] | None = None) -> dict[str, str]:
    """Which of our joints the given ones are: {given name: ours}. Fingertips, head top and toe tips are our end sites.

    `known` says it for names of no naming, and goes before it. Joints that we do not have (twist bones, eyes, more of
    the spine) and fingers of one joint are left out. One spine joint is spine1, two are spine1 and spine3, of more than
    three the first, the middle and the last are taken. Raises BodysenseError, naming `source`, what is missing, and the
    nearest names known, where this is not a human body by any naming of `NAMINGS`.
    """
    known = dict(known or {})
    keys = {_key(name): name for name in reversed(names) if name not in known}
    naming, matched = max(((n, _matched(n, keys)) for n in NAMINGS.values()), key=lambda pair: len(pair[1]))
    found = known | {given: ours for given, ours in matched.items() if ours not in known.values()}
    missing = [joint for joint in _NEEDED if joint not in found.values()]
    if missing:
        patterns = {pattern.lower(): (pattern, joint) for pattern, joint in _joints_of(naming).items()}
        unknown = [name for name in names if name not in found]
        near = {name: difflib.get_close_matches(name.lower(), patterns, n=1, cutoff=0.6) for name in unknown}
        hints = [f"{name!r}" + "".join(f" (like {patterns[key][0]!r}?)" for key in near[name]) for name in unknown[:8]]
        guesses = {name: patterns[key][1] for name in unknown for key in near[name] if patterns[key][1] in missing}
        raise BodysenseError(
            f"{source}: no joint here is {', '.join(missing[:4])}{', …' if len(missing) > 4 else ''}; "
            f"unknown are {', '.join(hints) or 'none'}{', …' if len(unknown) > 8 else ''}; "
            f"say which is which, e.g. joints={guesses or {'its name': missing[0]}}"
        )
    return found


def _key(name: str) -> str:
    """What counts of a name."""
    plain = re.sub(r"[^a-z0-9:]", "", name.lower())
    return _PREFIX.sub("", plain) or plain


def _matched(naming: Naming, keys: dict[str, str]) -> dict[str, str]:
    """Given name → ours, for one naming."""
    found: dict[str, str] = {}
    for pattern, joint in _joints_of(naming).items():
        given = keys.get(_key(pattern))
        if given is not None and joint not in found.values():
            found[given] = joint
    # A finger of one joint is no finger: in CMU's files LeftHandIndex1 is all four together.
    found = {g: o for g, o in found.items() if o[-1] != "1" or f"{o[:-1]}2" in found.values()}
    spine = [keys[_key(name)] for name in naming.spine.split() if _key(name) in keys]
    if len(spine) > 1:
        chosen = [spine[0], spine[len(spine) // 2], spine[-1]] if len(spine) > 2 else spine
        ours = ["spine1", "spine2", "spine3"] if len(spine) > 2 else ["spine1", "spine3"]
        found |= dict(zip(chosen, ours, strict=True))
    elif spine:
        found[spine[0]] = "spine1"
    return found


def _joints_of(naming: Naming) -> dict[str, str]:
    """Every name of a naming but the spine's, best alternatives first: {its name: our joint or end site}."""
    table = dict(zip(naming.middle.split(), ("pelvis", "neck", "head"), strict=True))
    head_top, toe = naming.ends.split()
    table |= dict.fromkeys(head_top.split("|"), "head_top")
    for side, given in zip(("left", "right"), naming.sides.split(), strict=True):
        for names, part in zip((*naming.sided.split(), toe), (*_BODY, "toe"), strict=True):
            table |= dict.fromkeys((name.replace("*", given) for name in names.split("|")), f"{side}_{part}")
        for name, finger in zip(naming.finger.split(), _FINGERS, strict=True):
            joints = naming.thumb_joint if finger == "thumb" and naming.thumb_joint else naming.joint
            ours = (*(f"{side}_{finger}{k}" for k in (1, 2, 3)), f"{side}_{finger}_tip")
            for joint, our in zip(joints.split(), ours, strict=True):
                table[naming.fingers.format(finger=name, joint=joint.strip("-")).replace("*", given)] = our
    return table
