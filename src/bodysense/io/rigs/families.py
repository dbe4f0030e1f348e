"""Families of rigs by the names that only they use: what a user is told, never what decides."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bodysense.io.rigs.words import NAMESPACE

# The first family of which all names are there (lower case, no punctuation; '*' stands for any beginning).
_FAMILIES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("Mixamo", ("*mixamorig",)),
    ("Reallusion (CC, iClone)", ("*ccbase",)),
    ("VRoid", ("*jbip",)),
    ("3ds Max Biped", ("*bip",)),
    ("CMU", ("lhipjoint", "leftupleg")),
    ("Rocketbox", ("lowerback", "leftupleg", "lefthandindex1")),
    ("cgspeed's Daz and 3ds Max rig", ("lbuttock", "lthigh", "lshldr")),
    ("Daz, Poser", ("lshldr", "lforearm")),
    ("MakeHuman, as MocapNET writes", ("lbuttock", "lhip", "lknee", "lelbow")),
    ("Bandai-Namco", ("jointroot", "upperarml", "lowerarml")),
    ("Xsens, lower-case names", ("lhip", "lknee", "lankle", "lclavicle")),
    ("Xsens MVN", ("pelvis", "l5", "t8")),
    ("Meta", ("broot", "blupleg")),
    ("OpenNI", ("torso", "lefthip", "leftknee", "leftfoot")),
    ("Kinect", ("spinebase", "hipleft")),
    ("Blender Rigify", ("*def",)),
    ("Blender's human metarig", ("thighl", "shinl", "upperarml")),
    ("Unreal", ("pelvis", "thighl", "upperarml")),
    ("Auto-Rig Pro", ("thighstretchl", "armstretchl")),
    ("MakeHuman", ("upperarm01l", "lowerleg02l")),
    ("Daz Genesis", ("lshldrbend", "lthighbend")),
    ("Daz Genesis", ("lupperarm", "lshin", "abdomen")),
    ("ARKit", ("hipsjoint", "spine7joint")),
    ("mocopi", ("torso7", "luparm")),
    ("Second Life", ("mpelvis", "mtorso")),
    ("OptiTrack", ("luarm", "lfarm")),
    ("CMU", ("lfemur", "ltibia", "lhumerus")),
    ("Roblox", ("humanoidrootpart", "lowertorso")),
    ("Rokoko", ("leftthigh", "leftshin", "leftarm")),
    ("Unity, VRM", ("leftupperleg", "leftlowerleg")),
    ("Perception Neuron", ("leftinhandindex",)),
    ("SMPL", ("lefthip", "leftknee", "leftcollar", "spine1")),
    ("SMPL", ("lhip", "lknee", "lcollar", "spine1")),
    ("Biovision", ("lefthip", "leftknee", "leftankle", "leftcollar")),
    ("Biovision", ("leftcollar", "leftuparm", "leftlowarm")),
    ("3-D pose lifter", ("lefthip", "leftknee", "leftankle", "leftelbow")),
    ("Vicon, MotionBuilder", ("leftupleg", "leftleg", "leftforearm")),
    ("MikuMikuDance", ("センター",)),
)


def family_of(names: Sequence[str]) -> str | None:
    """The family of rigs that joints' names are of; None for none that is known."""
    plain = {re.sub(r"[\W_]", "", NAMESPACE.sub("", name).lower()) for name in names}
    whole = {re.sub(r"[\W_]", "", name.lower()) for name in names}
    for family, needed in _FAMILIES:
        if all(_has(word, plain, whole) for word in needed):
            return family
    return None


def _has(word: str, plain: set[str], whole: set[str]) -> bool:
    if word.startswith("*"):
        return sum(name.startswith(word[1:]) for name in whole) > 5
    return word in plain
