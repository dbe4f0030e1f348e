"""Bones of known humanoids, and the devices that track them. Pure Python."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .fault import Fault

_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
_LIMBS = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")
# For each family: names of trunk and limbs, the form of a finger's names, and the form that adds a side.
_FAMILIES = {
    "bodysense": (" ".join(_TRUNK), " ".join(_LIMBS), "{finger}{k}", "{side}_{name}"),
    "mixamo": (
        "Hips Spine Spine1 Spine2 Neck Head",
        "UpLeg Leg Foot ToeBase Shoulder Arm ForeArm Hand",
        "Hand{Finger}{k}",
        "{Side}{name}",
    ),
    "unreal": (
        "pelvis spine_01 spine_02 spine_03 neck_01 head",
        "thigh calf foot ball clavicle upperarm lowerarm hand",
        "{finger}_0{k}",
        "{name}_{s}",
    ),
    "rigify": (
        "spine spine.001 spine.002 spine.003 spine.004 spine.006",
        "thigh shin foot toe shoulder upper_arm forearm hand",
        "{f_}{finger}.0{k}",
        "{name}.{S}",
    ),
    "unity": (
        "Hips Spine Chest UpperChest Neck Head",
        "UpperLeg LowerLeg Foot Toes Shoulder UpperArm LowerArm Hand",
        "{Unity}{part}",
        "{Side}{name}",
    ),
    "vrm": (
        "hips spine chest upperChest neck head",
        "UpperLeg LowerLeg Foot Toes Shoulder UpperArm LowerArm Hand",
        "{Unity}{vrmpart}",
        "{side}{name}",
    ),
    "vroid": (
        "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head",
        "UpperLeg LowerLeg Foot ToeBase Shoulder UpperArm LowerArm Hand",
        "{Unity}{k}",
        "J_Bip_{S}_{name}",
    ),
}
_PARTS = ("Proximal", "Intermediate", "Distal")
_THUMB_OF_VRM = ("Metacarpal", "Proximal", "Distal")
_FEWEST = 6  # bones by which a family is recognised: trunk and limbs that share names are more
_HANDS = ("head", "left_wrist", "right_wrist")
_SIX = (*_HANDS, "pelvis", "left_ankle", "right_ankle")
DEVICES = {
    "head": ("head",),
    "three_point": _HANDS,
    "four_point": (*_HANDS, "pelvis"),
    "six_point": _SIX,
    "ten_point": (*_SIX, "spine3", "left_elbow", "right_elbow", "left_knee", "right_knee"),
}
"""Device of `bodysense track --device` → the joints that it tracks."""


def _family(trunk: str, limbs: str, finger: str, sided: str) -> dict[str, str]:
    """Return our joint → the name in a family."""
    names = dict(zip(_TRUNK, trunk.split(), strict=True))
    for side in ("left", "right"):
        sides = {"side": side, "Side": side.capitalize(), "s": side[0], "S": side[0].upper()}
        for ours, name in zip(_LIMBS, limbs.split(), strict=True):
            names[f"{side}_{ours}"] = sided.format(name=name, **sides)
        for one in _FINGERS:
            for k in (1, 2, 3):
                name = finger.format(
                    finger=one,
                    Finger=one.capitalize(),
                    Unity="Little" if one == "pinky" else one.capitalize(),
                    f_="" if one == "thumb" else "f_",
                    k=k,
                    part=_PARTS[k - 1],
                    vrmpart=(_THUMB_OF_VRM if one == "thumb" else _PARTS)[k - 1],
                )
                names[f"{side}_{one}{k}"] = sided.format(name=name, **sides)
    return names


UNITY = _family(*_FAMILIES["unity"])
"""Our joint → the bone of Unity's `HumanBodyBones`, by which VMC names bones."""


def joints_of(bones: Sequence[str]) -> dict[str, str]:
    """Return {our joint: bone} of the family of names that matches most bones.

    A prefix that ends with a colon, and Rigify's DEF-, are ignored.
    """
    bare = {bone.rpartition(":")[2].removeprefix("DEF-"): bone for bone in bones}
    known = [_family(*family) for family in _FAMILIES.values()]
    best = max(known, key=lambda family: sum(name in bare for name in family.values()))
    found = {ours: bare[name] for ours, name in best.items() if name in bare}
    if len(found) < _FEWEST:
        raise Fault(
            "the armature's bones are of no known humanoid; name them as Mixamo, Unreal, Rigify, VRM or Unity do"
        )
    return found


def device_of(selected: Iterable[str], bones: Sequence[str]) -> str:
    """Return the device that tracks exactly the selected bones."""
    ours = {bone: joint for joint, bone in joints_of(bones).items()}
    chosen = {ours.get(bone, bone) for bone in selected}
    for device, joints in DEVICES.items():
        if chosen == set(joints):
            return device
    valid = [" + ".join(joints).replace("left_wrist + right_wrist", "wrists") for joints in DEVICES.values()]
    raise Fault(f"no device tracks {', '.join(sorted(chosen)) or 'no bone'}; select the bones of {', or '.join(valid)}")
