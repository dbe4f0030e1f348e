"""Holes: which joints of a motion are missing, and when, given by name or detected in the file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bodysense.errors import BodysenseError, unknown_name
from bodysense.geometry.gaps import runs
from bodysense.io.rigs.names import joint_of

if TYPE_CHECKING:
    from bodysense.io.rigs.joint_file import JointFile
    from bodysense.io.target_rigs.own_rig import SourceJoints

_KEYED = 0.5  # share of frames in which descendants move while a joint is held on purpose
FLAT = 0.5  # s: a limb whose numbers are constant for this long, while the trunk turns, was not tracked
_ITEM = re.compile(r"(?P<name>.+?)(?P<below>\+?)(?:\s*:\s*(?P<first>\d+)\s*-\s*(?P<last>\d+))?")
_RANGE = re.compile(r"(\s*:\s*-?\d[^:]*)+$")  # numbers after a colon that are no range
_BETWEEN = re.compile(r"[^\w:]+")  # between words: blanks, points, dashes …
_SIDES = ("left", "right")
# Joints whose numbers are never constant while the body moves. Knees at their stop, toes, fingers and collars may rest.
_RESTLESS = tuple(f"{side}_{part}" for side in _SIDES for part in ("shoulder", "elbow", "hip", "wrist", "ankle"))
_ENDS = ("wrist", "ankle")  # some rigs never turn these, from the first frame to the last
_LIMB = ("elbow", "wrist", "knee", "ankle")  # missing together with a shoulder or hip that was never tracked


@dataclass(frozen=True)
class Missing:
    """One item of a list of missing joints: a joint, alone or with its descendants, in all or some frames."""

    name: str
    below: bool = False
    frames: tuple[int, int] | None = None  # the first and the last, counted from 0


def missing_items(given: str | Sequence[str]) -> tuple[Missing, ...]:
    """Return the items of 'left_forearm,LeftHand+:100-240', or of several such texts.

    A range applies to all names since the previous range: here to both.
    """
    return tuple(item for text in ([given] if isinstance(given, str) else given) for item in _items_of(text))


def _items_of(given: str) -> list[Missing]:
    texts = [text.strip() for text in given.split(",")]
    items: list[Missing] = []
    for text in texts:
        found = _ITEM.fullmatch(text)
        if found is None:
            raise BodysenseError(f"missing {','.join(texts)!r}: an item is empty; name joints, such as LeftHand:0-99")
        frames = None if found["first"] is None else (int(found["first"]), int(found["last"]))
        if frames is not None and frames[1] < frames[0]:
            raise BodysenseError(f"missing {text!r}: the range ends before it begins; give FIRST-LAST")
        if frames is not None:
            for k in range(len(items) - 1, -1, -1):
                if items[k].frames is not None:
                    break
                items[k] = replace(items[k], frames=frames)
        items.append(Missing(found["name"], bool(found["below"]), frames))
    return items


def missing_mask(
    items: Sequence[Missing], joints: Sequence[str], parents: Sequence[int], frames: int, ours: Mapping[str, int]
) -> np.ndarray:
    """Return (T, J) bool: the joints that the items name as missing.

    Args:
        items: the missing joints.
        joints: names of the motion's joints, parents before children.
        parents: of each joint; -1 for the root.
        frames: T.
        ours: our name → the motion's joint.

    Raises BodysenseError for unknown or ambiguous names, and for ranges that the motion does not have.
    """
    mask = np.zeros((frames, len(joints)), dtype=bool)
    for item in items:
        those = [_joint(item.name, joints, ours)]
        if item.below:
            those = below(those[0], parents)
        first, last = (0, frames - 1) if item.frames is None else item.frames
        if last >= frames:
            raise BodysenseError(
                f"missing {item.name}:{first}-{last}: the motion has frames 0 to {frames - 1}; end the range there"
            )
        mask[first : last + 1, those] = True
    return mask


def flat_lined(file: JointFile, rig: SourceJoints) -> np.ndarray:
    """Return (T, J) bool: runs in which all numbers of a limb are constant while the trunk turns.

    Lost limbs are often written with their last pose, or at zero. Equally still descendants of such a joint are
    missing with it.
    """
    mask = np.zeros((len(file.values), len(file.joints)), dtype=bool)
    still = np.zeros(mask.shape, dtype=bool)  # the joint's angles equal those of the frame before
    for joint in range(len(file.joints)):
        columns = file.columns_of(joint, "rotation")
        still[1:, joint] = (file.values[1:, columns] == file.values[:-1, columns]).all(axis=1)
    least = max(2, int(np.ceil(FLAT * file.frame_rate)))
    ours, body = rig.ours, still[:, rig.trunk[0]]
    for name in _RESTLESS:
        if name not in ours or not file.order[ours[name]]:
            continue
        joint = ours[name]
        always = bool(still[1:, joint].all())
        if always and name.endswith(_ENDS):
            continue
        limb = [ours[other] for other in ours if other.endswith(_LIMB)]
        for first, end in runs(still[:, joint]):
            if end - first + 1 < least or body[first:end].all():
                continue
            own = below(joint, file.parents)
            turning = [other for other in own[1:] if not still[1:, other].all()]
            if name.endswith("shoulder") and turning and (~still[first:end, turning]).mean() > _KEYED:
                continue  # keyed by hand: a lost arm is lost as a whole
            for other in own:
                moves = not still[1:, other].all() or other == joint or (always and other in limb)
                if moves and still[first:end, other].all():
                    mask[first - 1 : end, other] = True
    return mask


def below(joint: int, parents: Sequence[int]) -> list[int]:
    """Return a joint and its descendants."""
    found = [joint]
    for other in range(joint + 1, len(parents)):
        if parents[other] in found:
            found.append(other)
    return found


def _joint(name: str, joints: Sequence[str], ours: Mapping[str, int]) -> int:
    """Return the joint that a name means: the motion's own name, ours, or a common one."""
    if name in joints:
        return joints.index(name)
    if _RANGE.search(name):
        raise BodysenseError(f"missing {name!r}: frames are given as FIRST-LAST, such as {_RANGE.sub('', name)}:0-99")
    parts = [part for part in _BETWEEN.split(name) if part]
    if len(parts) > 1 and all(part in joints or part in ours or joint_of(part) in ours for part in parts):
        raise BodysenseError(f"missing {name!r}: more than one joint; put commas between them: {','.join(parts)}")
    meant = {k for k, given in enumerate(joints) if _plain(given) == _plain(name)}
    if name in ours:
        meant.add(ours[name])
    if not meant:
        spoken = joint_of(name)
        meant = {ours[spoken]} if spoken is not None and spoken in ours else set()
    if len(meant) == 1:
        return meant.pop()
    if meant:
        raise BodysenseError(
            f"missing {name!r}: {' or '.join(joints[k] for k in sorted(meant))} may be meant; give one of these"
        )
    valid = list(dict.fromkeys([*joints, *ours]))
    raise BodysenseError(f"missing {name!r}: the motion has no such joint; {unknown_name(name, valid)}")


def _plain(name: str) -> str:
    """Return a name's letters and digits, without a character's prefix."""
    return re.sub(r"[^a-z0-9]", "", name.lower().rpartition(":")[2])
