"""Words in joint names: a side, possible parts of the body, a helper that is not a body part.

This table of words serves both ways of recognition: trees of joints, where names only add evidence to the structure,
and lists of names alone (`io.rigs.names`).
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache

from bodysense.body.hand import FINGERS

_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
NAMESPACE = re.compile(r"^.*[:|]")  # mixamorig7:, Armature|
_ACCENT = re.compile("[\u0300-\u036f]")

# Words, and the parts of a body they may mean. In names without a tree, the first that no better name has taken.
# The better of two words for one part comes first; words of the spine go from bottom to top.
PARTS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("pelvis", "midhip", "hips", "cog", "下半身", "骨盆", "골반", "becken"), ("pelvis",)),
    "hip": ("pelvis", "hip"),
    **dict.fromkeys(("センター", "root"), ("pelvis",)),
    **dict.fromkeys(("hipjoint", "buttock", "glute"), ("before the hip",)),
    **dict.fromkeys(("lowerback", "waist", "腰", "abdomen", "ab", "stomach", "l5", "l3", "spine"), ("spine",)),
    **dict.fromkeys(("上半身", "脊椎", "척추", "torso", "t12", "upperback", "ribs", "sternum", "chest"), ("spine",)),
    **dict.fromkeys(("胸", "가슴", "t8", "thorax", "upperchest"), ("spine",)),
    **dict.fromkeys(("neck", "shouldercenter", "shouldercentre", "首", "颈", "脖子", "목", "hals"), ("neck",)),
    **dict.fromkeys(("head", "skull", "頭", "头", "머리", "kopf"), ("head",)),
    **dict.fromkeys(("clavicle", "collar", "scapula", "锁骨", "쇄골"), ("collar",)),
    **dict.fromkeys(("upperarm", "uparm", "uarm", "humerus", "bicep", "sjc", "上臂", "oberarm"), ("shoulder",)),
    **dict.fromkeys(("腕", "팔", "arm"), ("shoulder",)),
    **dict.fromkeys(("shoulder", "shldr", "肩", "어깨", "schulter"), ("shoulder", "collar")),
    **dict.fromkeys(("elbow", "ejc", "forearm", "lowerarm", "lowarm", "farm", "radius"), ("elbow",)),
    **dict.fromkeys(("ひじ", "肘", "前臂", "팔꿈치", "unterarm"), ("elbow",)),
    **dict.fromkeys(("wrist", "wjc", "hand", "palm", "手首", "手腕", "手", "손목", "손"), ("wrist",)),
    **dict.fromkeys(("hjc", "thigh", "upleg", "upperleg", "femur", "足", "大腿", "허벅지", "oberschenkel"), ("hip",)),
    **dict.fromkeys(("knee", "kjc", "shin", "calf", "tibia", "lowerleg", "lowleg"), ("knee",)),
    **dict.fromkeys(("ひざ", "膝", "小腿", "무릎", "종아리", "unterschenkel"), ("knee",)),
    "leg": ("hip", "knee"),
    **dict.fromkeys(("ankle", "ajc", "talocrural", "足首", "脚踝", "발목"), ("ankle",)),
    **dict.fromkeys(("foot", "脚", "발"), ("ankle", "foot")),
    **dict.fromkeys(("ball", "toebase", "つま先", "脚趾", "발가락"), ("foot",)),
    **dict.fromkeys(("toe", "toes"), ("foot", "toe")),
    **dict.fromkeys(("thumb", "pollex", "親指", "拇指", "엄지"), ("thumb",)),
    **dict.fromkeys(("index", "forefinger", "pointer", "人指", "食指", "검지"), ("index",)),
    **dict.fromkeys(("middle", "mid", "中指", "중지"), ("middle",)),
    **dict.fromkeys(("ring", "薬指", "无名指", "약지"), ("ring",)),
    **dict.fromkeys(("pinky", "pinkie", "little", "小指", "새끼"), ("pinky",)),
    **dict.fromkeys(("carpal", "metacarpal"), ("carpal",)),
    "finger": ("finger",),
}
# Joint of a finger that a word means: 0 is inside the palm, 4 the tip.
PHALANGES = {
    **dict.fromkeys(("metacarpal", "mc"), 0),
    **dict.fromkeys(("proximal", "pp"), 1),
    **dict.fromkeys(("medial", "intermediate", "mp"), 2),
    **dict.fromkeys(("distal", "dp"), 3),
}
ORDINALS = ("first", "second", "third", "fourth", "fifth")
# fmt: off
_HELPERS = frozenset((
    "twist", "roll", "ik", "pole", "helper", "aux", "ctrl", "goal", "corrective", "share", "cloth", "skirt", "hair",
    "prop", "weapon", "breast", "boob", "bust", "pectoral", "jaw", "eye", "brow", "tongue", "ear", "cheek", "lip",
    "nose", "teeth", "butt", "捩", "捩り",
))
# fmt: on
_ENDS = frozenset(("end", "nub", "null", "tip", "top", "site", "effector", "endeffector"))
_ANIMALS = frozenset(
    ("tail", "paw", "hoof", "wing", "mane", "fin", "claw", "foreleg", "hindleg", "horselink", "abdomenlegs")
)
_LEFT = frozenset(
    ("l", "left", "lft", "lt", "links", "izq", "izquierda", "gauche", "sx", "sinistra", "左", "왼", "왼쪽")
)
_RIGHT = frozenset(
    ("r", "right", "rgt", "rt", "rechts", "der", "derecha", "droite", "dx", "destra", "右", "오른", "오른쪽")
)
_VERTEBRAE = frozenset(("l5", "l3", "t12", "t8"))  # whole names in Xsens files
_KNOWN = frozenset((*PARTS, *PHALANGES, *ORDINALS)) | _HELPERS | _ENDS | _ANIMALS | _LEFT | _RIGHT
_LONGEST = max(map(len, _KNOWN))


@lru_cache(maxsize=4096)
def words(name: str) -> tuple[str, ...]:
    """Return the longest known words of a name, in lower case: 'mixamorig:LeftUpLeg' is left, upleg."""
    name = unicodedata.normalize("NFKD", NAMESPACE.sub("", name))
    name = unicodedata.normalize("NFC", _ACCENT.sub("", name))
    if name.lower() in _VERTEBRAE:
        return (name.lower(),)
    given = [word.lower() for word in _SPLIT.findall(name.replace("_", " "))]
    result: list[str] = []
    while given:
        joined = ((n, _parted("".join(given[:n]))) for n in (3, 2, 1) if n <= len(given))
        count, found = next((pair for pair in joined if pair[1]), (1, given[:1]))
        result += found
        given = given[count:]
    return tuple(result)


def _parted(word: str) -> list[str]:
    """Split a word into known words, or return [] if impossible: 'lhip' is l, hip; 'handthumb' hand, thumb."""
    if not word or len(word) > 2 * _LONGEST:
        return []
    for cut in range(len(word), 0, -1):
        head, tail = word[:cut], word[cut:]
        if head in _KNOWN and (cut > 1 or len(tail) > 1 or not word.isascii()):
            if not tail:
                return [head]
            if rest := _parted(tail):
                return [head, *rest]
    return []


@lru_cache(maxsize=4096)
def parts(name: str) -> frozenset[str]:
    """Return the parts of a body that a name may mean; empty if it means nothing known."""
    if word := part_word(name):
        return frozenset(PARTS[word])
    joined = "".join(word for word in words(name) if not word.isdigit() and word not in _LEFT | _RIGHT)
    for word in sorted(PARTS, key=len, reverse=True):
        if PARTS[word][0] not in FINGERS and len(word) > 2 and _is_in(word, joined):
            return frozenset(PARTS[word])
    return frozenset()


def every_part(name: str) -> set[str]:
    """Return the parts that any word of a name may mean: elbow and wrist of 'forearm_hand'."""
    return {part for word in words(name) for part in PARTS.get(word, ())}


def part_word(name: str) -> str:
    """Return the word of a name that means a part: a finger's, or else the longest, of two the last; or ''."""
    said = [word for word in words(name) if word in PARTS]
    fingers = [word for word in said if PARTS[word][0] in FINGERS] or [word for word in said if word == "finger"]
    return fingers[-1] if fingers else max(reversed(said), key=len, default="")


def _is_in(word: str, joined: str) -> bool:
    """Whether a word is part of a name's words run together; a short one must end them."""
    return word in joined if len(word) > 3 else joined.endswith(word)


@lru_cache(maxsize=4096)
def is_helper(name: str) -> bool:
    """Whether a name means a twist bone, a face bone, a garment or a control instead of a joint of the body."""
    return any(word.rstrip("s") in _HELPERS or word in _HELPERS for word in words(name))


@lru_cache(maxsize=4096)
def is_end(name: str) -> bool:
    """Whether a name means the tip of something."""
    return any(word in _ENDS for word in words(name))


@lru_cache(maxsize=4096)
def is_animal(name: str) -> bool:
    """Whether a name means a part that people lack."""
    return any(word in _ANIMALS for word in words(name))


def is_known(word: str) -> bool:
    """Whether a word has a known meaning."""
    return word in _KNOWN


def side_of(name: str) -> str:
    """Return 'left' or 'right' from a name; '' if it names neither, or both."""
    left, right = (bool(side & set(words(name))) for side in (_LEFT, _RIGHT))
    return "" if left == right else "left" if left else "right"


def side(one: Sequence[str], other: Sequence[str]) -> int:
    """Return 1 if the first of two mirrored chains of names is left, -1 if it is right, 0 if unknown."""
    votes = 0
    for a, b in zip(one, other, strict=False):
        votes += _side(a, b)
    return (votes > 0) - (votes < 0)


def _side(a: str, b: str) -> int:
    """Return the sign of `side` for two names, by a word of each or by their first different letter."""
    if a == b:
        return 0
    x, y = words(a), words(b)
    for left, right, sign in ((x, y, 1), (y, x, -1)):
        if _LEFT & set(left) and _RIGHT & set(right):
            return sign
    start = next((k for k, (p, q) in enumerate(zip(a, b, strict=False)) if p != q), 0)
    mine, theirs = a[start : start + 1].lower(), b[start : start + 1].lower()
    return {("l", "r"): 1, ("r", "l"): -1}.get((mine, theirs), 0)
