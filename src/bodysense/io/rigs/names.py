"""Names alone: which of our joints are in a list without a tree, such as markers named after joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from bodysense.body.hand import FINGERS
from bodysense.io.rigs import words
from bodysense.io.rigs.named import NEEDED
from bodysense.io.rigs.words import ORDINALS, PARTS, PHALANGES

_MIDDLE = ("pelvis", "neck", "head", "head_top")
_SPINE = ("spine1", "spine2", "spine3")
_ENDS = {"head": ("head_top",), "foot": ("toe",)}  # the ends of parts
_SIDED = ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot", "toe")
_TRUNK = ("chest", "thorax", "upperchest")  # the upper end of the spine, in a body divided into parts
_LIMBS = ("arm", "leg")
_LOW = "lowerback"  # part of the pelvis if there is a spine
_SILENT = frozenset(("joint", "jnt", "jt", "center", "centre", "big", "bone", "c", "m"))  # words without meaning
_CARRIER = "hipjoint"  # the hip if nothing else is; otherwise a joint between pelvis and hip
_TIP = 4


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
    def rank(self) -> int:
        """The number, counted towards the body of two shoulders: the inner one is the collar."""
        return -self.number if self.means == ("shoulder", "collar") else self.number

    @property
    def says_palm(self) -> bool:
        """Whether it is named as a bone inside the palm."""
        return any(PHALANGES.get(word) == 0 for word in self.after)


def joints_of(names: Sequence[str]) -> dict[str, str]:
    """Return which of our joints the given ones are: {given name: ours}. Ends of limbs and head are our end sites.

    A name counts if all of its words are known, or are a common prefix (Bip01, b_). Joints that we lack (twist bones,
    eyes, more of the spine) and fingers of one joint are skipped. Of the spine of a whole body the first joint, the
    middle and the last are ours.
    """
    read = _read(names)
    fingers = {name: finger for name in read if (finger := _finger_of(name, read))}
    ranks = {word: rank for rank, word in enumerate(PARTS)}
    plain = [name for name in read if name.word and name not in fingers]
    plain.sort(key=lambda name: (name.word == _CARRIER, len(name.means) > 1, ranks[name.word], name.rank))
    found: dict[str, str] = {}
    for name in plain:
        parts = _ENDS.get(name.means[0], ()) if name.is_end else name.means
        parts = [part for part in parts if part in (_SIDED if name.side else _MIDDLE)]
        free = [ours for part in parts if (ours := f"{name.side}_{part}".removeprefix("_")) not in found]
        if free:
            found[free[0]] = name.given
    spine = [name for name in plain if name.means == ("spine",) and not name.side and not name.is_end]
    found |= _spine(spine, is_whole=all(ours in found for ours in NEEDED)) | _fingers(fingers)
    return {given: ours for ours, given in found.items()}


def joint_of(name: str) -> str | None:
    """Return the joint with a common name, independent of any file: left_forearm; None for others and whole limbs."""
    return None if words.part_word(name) in _LIMBS else joints_of([name]).get(name)


def _spine(names: Sequence[_Name], is_whole: bool) -> dict[str, str]:
    """Return joints of the spine, ours → given, from names in upward order."""
    if not is_whole or all(name.given in _SPINE for name in names):
        top = [name.given for name in names if name.word in _TRUNK]
        own = {name.given.lower(): name.given for name in names if name.given.lower() in _SPINE}
        return ({"spine3": top[-1]} if top else {}) | own
    chain = [name.given for name in names if name.word != _LOW or not any(other.word == "spine" for other in names)]
    if len(chain) > 2:
        chain = [chain[0], chain[len(chain) // 2], chain[-1]]
    return dict(zip(_SPINE if len(chain) > 2 else ("spine1", "spine3"), chain, strict=False))


def _finger_of(name: _Name, names: Sequence[_Name]) -> tuple[str, int] | None:
    """Return the finger and joint (4: the tip) that a name means."""
    said = [PHALANGES[word] for word in name.after if word in PHALANGES]
    numbers = [word for word in name.after if word.isdigit()]
    part = PARTS.get(name.word, ("",))[0]
    if part == "finger" and numbers:  # Finger01, Finger0Nub; Finger1Proximal
        is_zero_based = any(other.word == "finger" and "0" in other.after for other in names)
        which, numbers = int(numbers[0][0]) - (not is_zero_based), [numbers[0][1:], *numbers[1:]]
        joint = next((int(number) + is_zero_based for number in numbers if number), 1 if is_zero_based else -1)
    elif part in FINGERS:
        which, joint = FINGERS.index(part), name.number
    elif ordinals := [word for word in name.after if word in ORDINALS and said]:
        which, joint = ORDINALS.index(ordinals[0]), -1
    else:
        return None
    joint = _TIP if name.is_end else said[0] if said else joint
    return (FINGERS[which], joint) if name.side and 0 <= which < len(FINGERS) else None


def _fingers(names: dict[_Name, tuple[str, int]]) -> dict[str, str]:
    """Return joints and tips of fingers, ours → given, of fingers with two joints or more."""
    found: dict[str, str] = {}
    rooted = {name.side for name, (finger, _) in names.items() if finger == "thumb" and name.says_palm}
    for name, (finger, joint) in names.items():
        bends = finger == "thumb" and name.side in rooted and joint < _TIP  # a metacarpal counts as the first joint
        number = min(joint + 1, 3) if bends else joint
        if 1 <= number <= _TIP:
            found.setdefault(f"{name.side}_{finger}{'_tip' if number == _TIP else number}", name.given)
    whole = {
        ours[:-1] for ours in found if ours[-1].isdigit() and sum(f"{ours[:-1]}{k}" in found for k in (1, 2, 3)) > 1
    }
    return {ours: given for ours, given in found.items() if ours.removesuffix("_tip").rstrip("123") in whole}


def _read(names: Sequence[str]) -> list[_Name]:
    """Parse the names that mean a part of a body and nothing else."""
    said = {name: words.words(name) for name in dict.fromkeys(names) if not words.is_helper(name)}
    before = {name: tuple(takewhile(lambda word: not words.is_known(word), own)) for name, own in said.items()}
    often = Counter(word for start in before.values() for word in set(start))
    silent = {word for word, count in often.items() if 2 * count > len(said)} | _SILENT
    result = []
    for given, own in said.items():
        rest = own[len(before[given]) :]
        unknown = {word for word in before[given] if word not in silent}
        unknown |= {word for word in rest if not words.is_known(word) and word not in _SILENT}
        if rest and all(word.isdigit() for word in unknown):
            word = words.part_word(given)
            after = rest[rest.index(word) + 1 :] if word else rest
            result.append(_Name(given, words.side_of(given), word, after, words.is_end(given)))
    return result
