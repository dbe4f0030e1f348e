"""The world of a source, judged from evidence: its upward axis, and whether it is seen in a mirror.

Every reader and live input asks here. Evidence for an axis is added up in units of its logarithm: the word of the
format, the file's rest pose, and the motion: the body stands on something that stays at one height (the floor is
usually at 0), and what touches it does not slide. A body that stands along an axis counts, but never decides against
a file's own word: people lie, crawl and stand on their hands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.observing.world_axes import TURNS, UpAxis

AXES: tuple[UpAxis, ...] = ("y", "z", "x", "-y", "-z", "-x")  # the first of equal ones is taken

# Weights of evidence, as differences of the logarithm of likelihood. They were chosen on CMU, Rocketbox and UNOC clips
# turned to six axes and cut to 3 s, 1 s and one frame, so that the right word of a file was not overruled in any, and a
# wrong one was corrected in 8 of 10 single frames and 9 of 10 seconds. Contact says nothing of one frame: only the
# trunk and a floor at 0 speak against the word of its file.
FORMAT = 6.0  # the format defines the axis
REST_POSE = 4.0  # the file's own rest pose stands along the axis
HABIT = 0.5  # nothing else speaks, and more files have the axis than any other
USUAL = 2.0  # most files of the kind have the axis
_STANDS = 2.0  # times the mean cosine between body and axis
_ONE_LEVEL = 1.5  # times the share of frames in which the lowest point is on the floor
_AT_ZERO = 3.0  # the floor is at 0; less the farther it is (`_ZERO`)
_HOLDS = 4.0  # times the share of frames in which something on the floor does not slide
_OVERRULES = 2.0  # what the trunk adds: it alone does not overrule the usual axis of a kind of files
_UNSURE = 1.0  # a smaller difference of two axes is a doubt
_LIES = 0.3  # mean cosine of body and axis below which a body lies or bends
_UNLIKELY = 3.0  # difference of evidence from which a given axis is doubted

_NEAR = 0.06  # of a person's height of 1.7 m, in metres: points this close to the floor touch it
_ZERO = 0.1  # m: from 0 to a floor that is 1/e as likely the floor as one at 0
_STILL = 0.15  # m/s: touching points that are slower do not slide
_FRAMES = 240  # moments that are examined
_MOMENT = 1 / 15  # s; a speed over it is not noise
_FLOOR_SHARE = 10  # percentile of the lowest heights that is the floor
_AS_STILL, _QUIVER = 1.3, 0.005  # times the stillest point's speed, and m/s more: as still as it
_MOVES = 0.3  # m/s: of a body whose points are all slower, resting points are no evidence

# m over the floor at which joints are when the body rests on them; others are 0.06.
CLEARANCE = {
    "pelvis": 0.10,
    "hip": 0.09,
    "ankle": 0.08,
    "foot": 0.02,
    "toe": 0.0,
    "wrist": 0.03,
    "shoulder": 0.08,
    "head": 0.08,
    "head_top": 0.0,
    "spine1": 0.09,
    "spine2": 0.10,
    "spine3": 0.11,
}
_CLEARANCE = 0.06  # m, of any other joint


@dataclass(frozen=True)
class Upward:
    """The upward axis of a source."""

    axis: UpAxis
    margin: float  # difference of evidence to the next axis; negative if the axis was given against the evidence
    other: UpAxis  # the next likely axis
    stands: float  # -1 to 1: mean cosine between the body and the axis
    word: UpAxis | None = None  # of the file, if it has one
    evidence: Mapping[UpAxis, float] = field(default_factory=dict)  # of each axis

    @property
    def is_unsure(self) -> bool:
        """Whether another axis is nearly as likely."""
        return self.margin < _UNSURE

    @property
    def is_against_the_file(self) -> bool:
        """Whether the motion overrules the file's own word."""
        return self.word is not None and self.word != self.axis


def clearance_of(names: Sequence[str]) -> np.ndarray:
    """Return the heights (P,) m at which joints are when the body rests on them."""
    parts = (name.removeprefix("left_").removeprefix("right_") for name in names)
    return np.array([CLEARANCE.get(part, _CLEARANCE) for part in parts])


def doubts(found: Upward, source: str) -> list[str]:
    """Return a warning about an axis that was found, with the option that settles it; nothing if there is no doubt.

    `source` is what has the file's word: 'its rest pose'.
    """
    says = f"{signed(found.axis)} is taken as up"
    if found.is_against_the_file:
        return [f"{says}, though {source} has {signed(str(found.word))} up: give --up {found.word} if that is right"]
    if found.stands < _LIES:
        reason = f", as {source} has it" if found.word else ""
        other = f"give --up {found.other} if it stands along that axis"
        return [f"the body lies, bends or is upside down most of the time: {says}{reason}; {other}"]
    if found.is_unsure:
        return [f"{says}, but {signed(found.other)} is nearly as likely: give --up {found.axis} or --up {found.other}"]
    return []


def check_overruled(name: str, found: Upward) -> None:
    """Raise BodysenseError, beginning with `name`, if the motion speaks against the usual axis, but not clearly."""
    if found.is_against_the_file and found.margin < _OVERRULES:
        raise BodysenseError(
            f"{name}: the body stands along {signed(found.axis)} or lies on a floor under {signed(str(found.word))}, "
            f"which its motion does not tell; give the upward axis, --up {found.axis} or --up {found.word}"
        )


def told_warning(told: UpAxis, found: Upward) -> list[str]:
    """Return a warning about a given axis that the motion makes unlikely, or nothing.

    `found` is judged without the file's word.
    """
    if found.evidence[found.axis] - found.evidence[told] < _UNLIKELY:
        return []
    likely = signed(found.axis)
    return [f"--up {told}: the body stands along {likely}, not {signed(told)}; leave it out, or give --up {found.axis}"]


def signed(axis: str) -> str:
    """Return the name of an axis for messages: '+Y', '-Z'."""
    return axis.upper() if axis.startswith("-") else f"+{axis.upper()}"


def moments(frames: int, rate: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return frames (N,) spread over a motion, the frames (N,) a moment later, and the moment in seconds."""
    step = max(1, round(rate * _MOMENT))
    if frames <= step:
        still = np.arange(max(frames, 1))
        return still, still, 1.0
    first = np.unique(np.linspace(0, frames - 1 - step, _FRAMES).astype(int))
    return first, first + step, step / rate


def judged_up(
    place: np.ndarray,
    later: np.ndarray,
    moment: float,
    body: np.ndarray,
    *,
    clearance: np.ndarray | float = _CLEARANCE,
    words: Mapping[UpAxis, float] | None = None,
) -> Upward:
    """Return the likeliest upward axis of points in the file's axes.

    Args:
        place: (N, P, 3) m, positions of the body's points in some frames (`moments`), NaN where missing.
        later: (N, P, 3) m, the same points a moment later.
        moment: that moment, s.
        body: (N, 3) vectors from the feet to the shoulders, or up the trunk.
        clearance: (P,) m, heights of the points when the body rests on them.
        words: evidence of the file for each axis: `FORMAT`, `REST_POSE`, `USUAL`.
    """
    evidence: dict[UpAxis, float] = {axis: (words or {}).get(axis, 0.0) for axis in AXES}
    length = np.linalg.norm(body, axis=-1)
    known = length > 1e-9  # NaN compares false
    mean = (body[known] / length[known, None]).mean(axis=0) if known.any() else np.zeros(3)
    with np.errstate(invalid="ignore"):
        speed = np.linalg.norm(later - place, axis=-1) / moment
        finite = np.isfinite(speed)
        moves = np.max(speed, axis=1, initial=0.0, where=finite) > _MOVES
        stillest = np.min(speed, axis=1, initial=_STILL, where=finite)
        # The stillest part of a body is the part that carries it.
        rests = (speed < _STILL) & (speed <= (_AS_STILL * stillest + _QUIVER)[:, None])
    stands: dict[UpAxis, float] = {}
    for axis in AXES:
        stands[axis] = float(quaternion_rotate(TURNS[axis], mean)[1])
        heights = (_along(axis, place) - clearance, _along(axis, later) - clearance)
        evidence[axis] += _STANDS * stands[axis] + _resting(*heights, rests & moves[:, None])
    ranked = sorted(AXES, key=lambda axis: -evidence[axis])
    word = max(words, key=lambda axis: words[axis]) if words else None
    best, other = ranked[:2]
    return Upward(best, evidence[best] - evidence[other], other, stands[best], word, evidence)


def _along(axis: UpAxis, place: np.ndarray) -> np.ndarray:
    """Return the heights (...) of positions (..., 3) along an axis."""
    return (-1.0 if axis[0] == "-" else 1.0) * place[..., "xyz".index(axis[-1])]


def _resting(height: np.ndarray, later: np.ndarray, rests: np.ndarray) -> float:
    """Return the evidence for a floor under points of heights (N, P) m, and a moment later, that `rests` (N, P)."""
    seen = np.isfinite(height).any(axis=1)
    if not seen.any():
        return 0.0
    lowest = np.nanmin(height[seen], axis=1)
    floor = float(np.percentile(lowest, _FLOOR_SHARE))
    level = float((np.abs(lowest - floor) < _NEAR).mean())
    touches = (np.abs(height - floor) < _NEAR) & (np.abs(later - floor) < _NEAR)
    holds = (touches & rests).any(axis=1)
    return float(_ONE_LEVEL * level + _AT_ZERO * np.exp(-((floor / _ZERO) ** 2)) + _HOLDS * holds.mean())
