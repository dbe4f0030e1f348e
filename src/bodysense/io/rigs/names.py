"""Names of joints: the words in them (`names.toml`), and which of our joints a list of names means.

In a tree of joints, the chains between named joints tell the others. In a list without a tree, such as markers named
after joints, names are the only evidence.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from itertools import takewhile
from typing import TypeVar

from bodysense.body.hands.hand import FINGERS

_TABLE = tomllib.loads(files("bodysense.io.rigs").joinpath("names.toml").read_text(encoding="utf-8"))
PARTS = {word: tuple(means.split(" or ")) for means, spellings in _TABLE["parts"].items() for word in spellings}
"""Word → the parts of a body that it may mean."""
_RANK = {word: rank for rank, word in enumerate(PARTS)}
_PHALANGES = {word: joint for joint, spellings in enumerate(_TABLE["phalanges"]) for word in spellings}
_ORDINALS = _TABLE["ordinals"]
_HELPERS, _ENDS, _ANIMALS, _LEFT, _RIGHT, _SILENT = (
    frozenset(_TABLE[kind]) for kind in ("helpers", "ends", "animals", "left", "right", "silent")
)
_KNOWN = frozenset((*PARTS, *_PHALANGES, *_ORDINALS)) | _HELPERS | _ENDS | _ANIMALS | _LEFT | _RIGHT
_WORDS = _KNOWN | _SILENT  # into which a word without a change of case is divided
_LONGEST = max(map(len, _KNOWN))
_VERTEBRAE = frozenset(("l5", "l3", "t12", "t8"))  # whole names in Xsens files

_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
_NAMESPACE = re.compile(r"^.*[:|]")  # mixamorig7:, Armature|
_SHORT_FORM = re.compile(r"\[[^\]]*\]")  # NPC L Thigh [LThg]
_ACCENT = re.compile("[\u0300-\u036f]")

ARMS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "elbow", "wrist"))
LEGS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle"))
_WHOLE = {"pelvis", "head", *ARMS, *LEGS}  # joints of a whole body
_MIDDLE = ("pelvis", "neck", "head", "head_top")
_SPINE = ("spine1", "spine2", "spine3")
_BODY_ENDS = {"head": ("head_top",), "foot": ("toe",)}  # the ends of parts
_SIDED = ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot", "toe")
_TRUNK = ("chest", "thorax", "upperchest")  # the upper end of the spine, in a body divided into parts
_LIMBS = ("arm", "leg")
_LOW = "lowerback"  # part of the pelvis if there is a spine
_CARRIER = "hipjoint"  # the hip if nothing else is; otherwise a joint between pelvis and hip
_TIP = 4  # joint of a finger that is its end
_Joint = TypeVar("_Joint", str, int)


def family_of(names: Sequence[str]) -> str | None:
    """Return the family of rigs with such joint names, which is printed and decides nothing; None if unknown."""
    whole, plain = (
        {re.sub(r"[\W_]", "", name.lower()) for name in given}
        for given in (names, [_NAMESPACE.sub("", name) for name in names])
    )

    def has(word: str) -> bool:
        return sum(name.startswith(word[1:]) for name in whole) > 5 if word.startswith("*") else word in plain

    return next((family for family, *needed in _TABLE["families"] if all(map(has, needed))), None)


# --- one name ---


@lru_cache(maxsize=4096)
def words(name: str) -> tuple[str, ...]:
    """Return the longest known words of a name, in lower case: 'mixamorig:LeftUpLeg' is left, upleg."""
    name = unicodedata.normalize("NFKD", _SHORT_FORM.sub("", _NAMESPACE.sub("", name)))
    name = unicodedata.normalize("NFC", _ACCENT.sub("", name))
    if name.lower() in _VERTEBRAE:
        return (name.lower(),)
    given = [word.lower() for word in _SPLIT.findall(name.replace("_", " "))]
    result: list[str] = []
    while given:
        joined = ((n, _split_word("".join(given[:n]))) for n in (3, 2, 1) if n <= len(given))
        count, found = next((pair for pair in joined if pair[1]), (1, given[:1]))
        result += found
        given = given[count:]
    return tuple(result)


def _split_word(word: str) -> list[str]:
    """Split a word into known words, or return [] if impossible: 'lhip' is l, hip; 'mhip' m, hip."""
    if not word or len(word) > 2 * _LONGEST:
        return []
    for cut in range(len(word), 0, -1):
        head, tail = word[:cut], word[cut:]
        if head in _WORDS and (cut > 1 or len(tail) > 1 or not word.isascii()):
            if not tail:
                return [head]
            if rest := _split_word(tail):
                return [head, *rest]
    return []


@lru_cache(maxsize=4096)
def parts(name: str) -> frozenset[str]:
    """Return the parts of a body that a name may mean; empty if it means nothing known."""
    if word := part_word(name):
        return frozenset(PARTS[word])
    joined = "".join(word for word in words(name) if not word.isdigit() and word not in _LEFT | _RIGHT)
    for word in sorted(PARTS, key=len, reverse=True):  # a word inside others; a short one must end them
        inside = word in joined if len(word) > 3 else len(word) > 2 and joined.endswith(word)
        if inside and PARTS[word][0] not in FINGERS:
            return frozenset(PARTS[word])
    return frozenset()


def part_word(name: str) -> str:
    """Return the word of a name that means a part: a finger's, or else the last: the wrist of 'forearm_hand'; or ''."""
    known = [word for word in words(name) if word in PARTS]
    fingers = [word for word in known if PARTS[word][0] in FINGERS] or [word for word in known if word == "finger"]
    return fingers[-1] if fingers else known[-1] if known else ""


@lru_cache(maxsize=4096)
def is_helper(name: str) -> bool:
    """Whether a name means a twist bone, a face bone, a garment or a control instead of a joint of the body."""
    return any(word.rstrip("s") in _HELPERS or word in _HELPERS for word in words(name))


def is_end(name: str) -> bool:
    """Whether a name means the tip of something."""
    return not _ENDS.isdisjoint(words(name))


def is_animal(name: str) -> bool:
    """Whether a name means a part that people lack."""
    return not _ANIMALS.isdisjoint(words(name))


def side_of(name: str) -> str:
    """Return 'left' or 'right' from a name; '' if it names neither, or both."""
    left, right = (not side.isdisjoint(words(name)) for side in (_LEFT, _RIGHT))
    return "" if left == right else "left" if left else "right"


# --- lists of names ---


@dataclass(frozen=True)
class _Name:
    given: str
    side: str
    word: str  # that names the part
    after: tuple[str, ...]  # words that follow it, numbers among them
    is_end: bool

    @property
    def means(self) -> tuple[str, ...]:
        """Possible joints, most likely first."""
        return ("hip",) if self.word == _CARRIER else PARTS.get(self.word, ())

    @property
    def number(self) -> int:
        """The number after the part; -1 without a number."""
        return next((int(word) for word in self.after if word.isdigit()), -1)

    @property
    def order(self) -> tuple[bool, bool, int, int]:
        """Sort key: better names first, the spine upward; of two shoulders the outer one, as the inner is a collar."""
        rank = -self.number if self.means == ("shoulder", "collar") else self.number
        return self.word == _CARRIER, len(self.means) > 1, _RANK[self.word], rank


def joints_of(names: Iterable[str]) -> dict[str, str]:
    """Return which of our joints the given ones are: {given name: ours}. Ends of limbs and head are our end sites.

    A name counts if all of its words are known, or are a common prefix (Bip01, b_). Joints that we lack (twist bones,
    eyes, more of the spine) and fingers of one joint are skipped. Of the spine of a whole body the first joint, the
    middle and the last are ours.
    """
    return dict(_joints_of(tuple(names)))


@lru_cache(maxsize=64)
def _joints_of(names: tuple[str, ...]) -> dict[str, str]:
    read = _read(names)
    fingers = {name: finger for name in read if (finger := _finger_of(name, read))}
    found: dict[str, str] = {}
    plain = sorted((name for name in read if name.word and name not in fingers), key=lambda name: name.order)
    for name in plain:
        parts = _BODY_ENDS.get(name.means[0], ()) if name.is_end else name.means
        parts = [part for part in parts if part in (_SIDED if name.side else _MIDDLE)]
        free = [ours for part in parts if (ours := f"{name.side}_{part}".removeprefix("_")) not in found]
        if free:
            found[free[0]] = name.given
    spine = [name for name in plain if name.means == ("spine",) and not name.side and not name.is_end]
    found |= _spine(spine, is_whole=found.keys() >= _WHOLE) | _fingers(fingers)
    return {given: ours for ours, given in found.items()}


def joint_of(name: str) -> str | None:
    """Return the joint with a common name, independent of any file: left_forearm; None for others and whole limbs."""
    return None if part_word(name) in _LIMBS else joints_of([name]).get(name)


def _spine(names: Sequence[_Name], is_whole: bool) -> dict[str, str]:
    """Return joints of the spine, ours → given, from names in upward order."""
    if not is_whole or all(name.given in _SPINE for name in names):
        top = [name.given for name in names if name.word in _TRUNK]
        own = {name.given.lower(): name.given for name in names if name.given.lower() in _SPINE}
        return ({"spine3": top[-1]} if top else {}) | own
    has_spine = any(name.word == "spine" for name in names)
    return spread([name.given for name in names if name.word != _LOW or not has_spine])


def spread(spine: Sequence[_Joint]) -> dict[str, _Joint]:
    """Return our joints of a spine of any number of joints, from below: the first, the middle and the last."""
    if len(spine) > 2:
        return dict(zip(_SPINE, (spine[0], spine[len(spine) // 2], spine[-1]), strict=True))
    return dict(zip(("spine1", "spine3"), spine, strict=False))


def _finger_of(name: _Name, names: Sequence[_Name]) -> tuple[str, int] | None:
    """Return the finger and joint (4: the tip) that a name means."""
    phalanges = [_PHALANGES[word] for word in name.after if word in _PHALANGES]
    numbers = [word for word in name.after if word.isdigit()]
    part = PARTS.get(name.word, ("",))[0]
    if part == "finger" and numbers:  # Finger0, Finger01, Finger0Nub; Finger01, Finger11; Finger1Proximal
        others = [other.after for other in names if other.word == "finger"]
        firsts = {word[0] for after in others for word in [word for word in after if word.isdigit()][:1]}
        is_bare = any("0" in after for after in others)  # the first joint of a finger is not numbered
        is_zero_based = is_bare or {"0"} < firsts
        which, numbers = int(numbers[0][0]) - (not is_zero_based), [numbers[0][1:], *numbers[1:]]
        joint = next((int(number) + is_bare for number in numbers if number), 1 if is_bare else -1)
    elif part in FINGERS:
        which, joint = FINGERS.index(part), name.number
    elif ordinals := [word for word in name.after if word in _ORDINALS and phalanges]:
        which, joint = _ORDINALS.index(ordinals[0]), -1
    else:
        return None
    joint = _TIP if name.is_end else phalanges[0] if phalanges else joint
    return (FINGERS[which], joint) if name.side and 0 <= which < len(FINGERS) else None


def _fingers(names: dict[_Name, tuple[str, int]]) -> dict[str, str]:
    """Return joints and tips of fingers, ours → given, of fingers with two joints or more."""
    found: dict[str, str] = {}
    rooted = {  # hands whose thumb has a bone inside the palm, which counts as its first joint
        name.side
        for name, (finger, _) in names.items()
        if finger == "thumb" and any(_PHALANGES.get(word) == 0 for word in name.after)
    }
    numbers: dict[tuple[str, str], set[int]] = {}
    for name, (finger, joint) in names.items():
        numbers.setdefault((name.side, finger), set()).add(joint if not name.is_end else -1)
    # Fingers numbered 2 to 4 lack the bone inside the palm, which is the first.
    palmless = {key for key, own in numbers.items() if {2, 3, _TIP} <= own and 1 not in own}
    for name, (finger, joint) in names.items():
        if (name.side, finger) in palmless and not name.is_end:
            found.setdefault(f"{name.side}_{finger}{joint - 1}", name.given)
            continue
        number = min(joint + 1, 3) if finger == "thumb" and name.side in rooted and joint < _TIP else joint
        if 1 <= number <= _TIP:
            found.setdefault(f"{name.side}_{finger}{'_tip' if number == _TIP else number}", name.given)
    joints = Counter(ours[:-1] for ours in found if ours[-1].isdigit())
    return {ours: given for ours, given in found.items() if joints[ours.removesuffix("_tip").rstrip("123")] > 1}


def _read(names: Sequence[str]) -> list[_Name]:
    """Parse the names that mean a part of a body and nothing else."""
    split = {name: words(name) for name in dict.fromkeys(names) if not is_helper(name)}
    before = {name: tuple(takewhile(lambda word: word not in _KNOWN, own)) for name, own in split.items()}
    often = Counter(word for start in before.values() for word in set(start))
    silent = {word for word, count in often.items() if 2 * count > len(split)} | _SILENT
    result = []
    for given, own in split.items():
        rest = own[len(before[given]) :]
        unknown = {word for word in before[given] if word not in silent}
        unknown |= {word for word in rest if word not in _KNOWN and word not in _SILENT}
        if rest and all(word.isdigit() for word in unknown):
            word = part_word(given)
            after = rest[rest.index(word) + 1 :] if word else rest
            result.append(_Name(given, side_of(given), word, after, is_end(given)))
    return result
