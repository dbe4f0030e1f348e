"""What the name of a joint says: a side, the parts of a body it may be, a helper that is none.

The one table of words: a tree of joints is recognised by its structure, in which these weigh in, and a list of names
alone (`io.rigs.names`) by them.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache

_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
NAMESPACE = re.compile(r"^.*[:|]")  # mixamorig7:, Armature|
_ACCENT = re.compile("[\u0300-\u036f]")

# Words, and the parts of a body they may stand for: in names without a tree the first that no surer name has taken.
# The better of two words for one part stands before the other; those of the spine go from below up.
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
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
# Which joint of a finger a word says: 0 is inside the palm, 4 the tip.
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
_VERTEBRAE = frozenset(("l5", "l3", "t12", "t8"))  # names in full, of Xsens
_KNOWN = frozenset((*PARTS, *PHALANGES, *ORDINALS)) | _HELPERS | _ENDS | _ANIMALS | _LEFT | _RIGHT
_LONGEST = max(map(len, _KNOWN))


@lru_cache(maxsize=4096)
def words(name: str) -> tuple[str, ...]:
    """The words of a name, in lower case, as long as they are known: 'mixamorig:LeftUpLeg' is left, upleg."""
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
    """The known words that a word is made of, if all of it is: 'lhip' is l, hip; 'handthumb' hand, thumb."""
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
    """Parts of a body that a name may stand for; none where it says nothing."""
    if word := part_word(name):
        return frozenset(PARTS[word])
    joined = "".join(word for word in words(name) if not word.isdigit() and word not in _LEFT | _RIGHT)
    for word in sorted(PARTS, key=len, reverse=True):
        if PARTS[word][0] not in FINGERS and len(word) > 2 and _is_in(word, joined):
            return frozenset(PARTS[word])
    return frozenset()


def part_word(name: str) -> str:
    """The word of a name that says which part it is: a finger's, or else the longest, of two the last; or ''."""
    said = [word for word in words(name) if word in PARTS]
    fingers = [word for word in said if PARTS[word][0] in FINGERS] or [word for word in said if word == "finger"]
    return fingers[-1] if fingers else max(reversed(said), key=len, default="")


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


def is_known(word: str) -> bool:
    """Whether a word says anything."""
    return word in _KNOWN


def side_of(name: str) -> str:
    """'left' or 'right', as a name says; '' where it says neither, or both."""
    left, right = (bool(side & set(words(name))) for side in (_LEFT, _RIGHT))
    return "" if left == right else "left" if left else "right"


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
