"""What the name of a joint hints at: a side, the parts of a body it may be, a helper that is none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
_NOTED = re.compile(r"^.*:")  # a namespace, mixamorig7:

# Words, parts of a body they may stand for. Longer words are looked for first.
_PARTS: dict[str, tuple[str, ...]] = {
    "pelvis": ("pelvis",),
    "hips": ("pelvis",),
    "cog": ("pelvis",),
    "hip": ("pelvis", "hip"),
    "hipjoint": ("before the hip",),
    "buttock": ("before the hip",),
    "glute": ("before the hip",),
    "waist": ("spine",),
    "spine": ("spine",),
    "chest": ("spine",),
    "torso": ("spine",),
    "thorax": ("spine",),
    "abdomen": ("spine",),
    "lowerback": ("spine",),
    "upperback": ("spine",),
    "sternum": ("spine",),
    "ribs": ("spine",),
    "neck": ("neck",),
    "head": ("head",),
    "skull": ("head",),
    "clavicle": ("collar",),
    "collar": ("collar",),
    "scapula": ("collar",),
    "shoulder": ("collar", "shoulder"),
    "shldr": ("collar", "shoulder"),
    "upperarm": ("shoulder",),
    "uparm": ("shoulder",),
    "humerus": ("shoulder",),
    "bicep": ("shoulder",),
    "arm": ("shoulder",),
    "elbow": ("elbow",),
    "forearm": ("elbow",),
    "lowerarm": ("elbow",),
    "lowarm": ("elbow",),
    "radius": ("elbow",),
    "wrist": ("wrist",),
    "hand": ("wrist",),
    "palm": ("wrist",),
    "thigh": ("hip",),
    "upleg": ("hip",),
    "upperleg": ("hip",),
    "femur": ("hip",),
    "knee": ("knee",),
    "shin": ("knee",),
    "calf": ("knee",),
    "tibia": ("knee",),
    "lowerleg": ("knee",),
    "lowleg": ("knee",),
    "leg": ("knee", "hip"),
    "ankle": ("ankle",),
    "talocrural": ("ankle",),
    "foot": ("ankle", "foot"),
    "toe": ("foot",),
    "toes": ("foot",),
    "toebase": ("foot",),
    "ball": ("foot",),
    "thumb": ("thumb",),
    "pollex": ("thumb",),
    "index": ("index",),
    "forefinger": ("index",),
    "pointer": ("index",),
    "middle": ("middle",),
    "mid": ("middle",),
    "ring": ("ring",),
    "pinky": ("pinky",),
    "pinkie": ("pinky",),
    "little": ("pinky",),
    "carpal": ("carpal",),
    "metacarpal": ("carpal",),
    "finger": ("finger",),
}
# Of Japanese (MikuMikuDance) and German, Spanish, French rigs: the few that differ from all of the above.
_PARTS |= {
    "下半身": ("pelvis",), "センター": ("pelvis",), "上半身": ("spine",), "首": ("neck",), "頭": ("head",),
    "肩": ("collar",), "腕": ("shoulder",), "ひじ": ("elbow",), "手首": ("wrist",), "足首": ("ankle",),
    "足": ("hip",), "ひざ": ("knee",), "つま先": ("foot",),
    "親指": ("thumb",), "人指": ("index",), "中指": ("middle",), "薬指": ("ring",), "小指": ("pinky",),
}  # fmt: skip
_FINGERS = frozenset(
    word for word, means in _PARTS.items() if means[0] in ("thumb", "index", "middle", "ring", "pinky")
)
# fmt: off
_HELPERS = frozenset((
    "twist", "roll", "ik", "pole", "helper", "aux", "ctrl", "goal", "corrective", "share", "cloth", "skirt", "hair",
    "prop", "weapon", "breast", "boob", "bust", "pectoral", "jaw", "eye", "brow", "tongue", "ear", "cheek", "lip",
    "nose", "teeth", "butt", "捩", "捩り", "ＩＫ",
))
# fmt: on
_ENDS = frozenset(("end", "nub", "null", "tip", "top", "site", "effector", "endeffector"))
_ANIMALS = frozenset(
    ("tail", "paw", "hoof", "wing", "mane", "fin", "claw", "foreleg", "hindleg", "horselink", "abdomenlegs")
)
_LEFT = frozenset(("l", "left", "lft", "lt", "links", "izq", "gauche", "sx", "左"))
_RIGHT = frozenset(("r", "right", "rgt", "rt", "rechts", "der", "droite", "dx", "右"))


def words(name: str) -> list[str]:
    """The words of a name, in lower case: 'mixamorig:LeftUpLeg' is left, up, leg."""
    found = _SPLIT.findall(_NOTED.sub("", name).replace("_", " "))
    result: list[str] = []
    for given in found:
        word = given.lower().replace("左", "").replace("右", "")
        rest = word[1:]
        if word not in _PARTS and word[:1] in ("l", "r") and (rest in _PARTS or rest in ("buttock",)):
            result += [word[0], rest]  # lhip, rankle
        else:
            result.append(word)
    return [word for word in result if word] + [mark for mark in "左右" if mark in name]


@lru_cache(maxsize=4096)
def parts(name: str) -> frozenset[str]:
    """Parts of a body that a name may stand for; none where it says nothing."""
    given = words(name)
    plain = [word for word in given if word not in _LEFT | _RIGHT and not word.isdigit()]
    joined = "".join(plain)
    if exact := [word for word in plain if word in _FINGERS]:
        return frozenset(_PARTS[exact[-1]])
    for word in sorted(_PARTS, key=len, reverse=True):
        if word in plain or (word not in _FINGERS and len(word) > 2 and _is_in(word, joined)):
            return frozenset(_PARTS[word])
    return frozenset()


def _is_in(word: str, joined: str) -> bool:
    """Whether a word is part of a name's words run together; a short one must end them."""
    return word in joined if len(word) > 3 else joined.endswith(word)


@lru_cache(maxsize=4096)
def is_helper(name: str) -> bool:
    """Whether a name is that of a twist bone, a face bone, a garment, a control: of no joint of the body."""
    return any(word.rstrip("s") in _HELPERS or word in _HELPERS for word in words(name))


@lru_cache(maxsize=4096)
def is_end(name: str) -> bool:
    """Whether a name is that of the tip of something."""
    return any(word in _ENDS for word in words(name))


@lru_cache(maxsize=4096)
def is_animal(name: str) -> bool:
    """Whether a name is that of a part that people lack."""
    return any(word in _ANIMALS for word in words(name))


def side(one: Sequence[str], other: Sequence[str]) -> int:
    """1 where the first of two mirrored chains of names is the left one, -1 where it is the right one, 0: not told."""
    votes = 0
    for a, b in zip(one, other, strict=False):
        votes += _side(a, b)
    return (votes > 0) - (votes < 0)


def _side(a: str, b: str) -> int:
    """The same of two names: by what of them differs, or by a word of each."""
    if a == b:
        return 0
    x, y = words(a), words(b)
    for left, right, sign in ((x, y, 1), (y, x, -1)):
        if _LEFT & set(left) and _RIGHT & set(right):
            return sign
    start = next((k for k, (p, q) in enumerate(zip(a, b, strict=False)) if p != q), 0)
    mine, theirs = a[start : start + 1].lower(), b[start : start + 1].lower()
    return {("l", "r"): 1, ("r", "l"): -1}.get((mine, theirs), 0)


def number(name: str) -> int | None:
    """The last number in a name."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else None
