"""A wearer's proportions, inferred while the tracker runs: a robust fit of the shape space to what sensors measure.

Evidence is how often each length was seen, in bins of 5 mm: distances between tracked points, and heights over the
floor. A bone's length is the median of its distances; what bends in between, and how high a head or a pelvis stands, is
a high quantile, since nobody stands higher than upright. The likeliest shape given these lengths is what is believed,
and the body that is shown grows toward it so slowly that nothing jumps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.body.person import Person
from bodysense.body.rigid import RigidTransform
from bodysense.body.shape import Measured, shape_space, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.inputs import Frames

BIN, BINS = 0.005, 480  # m, and how many: lengths up to 2.4 m
FLOOR = "floor"
SEATED = 1.28  # m: heads that never rise higher sit, for the shortest adult's stands higher
STANDING = 1.95  # m: nobody's head joint stands higher
_LOOK = 0.1  # s between two looks at lengths
_ENOUGH = 0.5  # s that a length must have been seen
_EVERY = 0.5  # s between two fits
_QUICK = 0.4  # s in which half of what the shown body lacks is made up
_VAGUE = 0.06  # m: points that err more together measure nothing


@dataclass(frozen=True)
class Length:
    """A distance that tells of proportions."""

    start: str
    end: str  # a point, or the floor: then the height over it
    quantile: float  # of what is seen which is taken
    deviation: float  # m, standard deviation of that, after a long time
    slack: float = 0.0  # m by which the quantile falls short of the rest pose, on average


def _of_both(start: str, end: str, quantile: float, deviation: float, slack: float = 0.0) -> list[Length]:
    return [Length(f"{side}_{start}", f"{side}_{end}", quantile, deviation, slack) for side in ("left", "right")]


LENGTHS = (
    *_of_both("shoulder", "elbow", 0.5, 0.006),
    *_of_both("elbow", "wrist", 0.5, 0.006),
    *_of_both("hip", "knee", 0.5, 0.006),
    *_of_both("knee", "ankle", 0.5, 0.006),
    *_of_both("ankle", "foot", 0.5, 0.006),
    *_of_both("wrist", "middle1", 0.5, 0.004),
    *_of_both("hip", "ankle", 0.95, 0.02, 0.01),
    *_of_both("shoulder", "wrist", 0.98, 0.03, 0.02),
    Length("left_shoulder", "right_shoulder", 0.5, 0.01),
    Length("left_hip", "right_hip", 0.5, 0.006),
    Length("pelvis", "head", 0.95, 0.02, 0.01),
    Length("head", FLOOR, 0.95, 0.03, 0.01),
)


@dataclass(frozen=True, eq=False)
class Proportions:
    """What is believed of the proportions of B people, what of it is shown, and on what it rests."""

    people: tuple[Person, ...]
    rest_offset: np.ndarray  # (B, 65, 3) m, shown
    deviation: np.ndarray  # (B, 65) m, standard deviation of every bone's length
    believed: np.ndarray  # (B, 65, 3) m
    seconds: tuple[np.ndarray, ...]  # B of (L, BINS) float32 s for which each length was in each bin
    since: np.ndarray  # (B,) s since lengths were last looked at
    due: np.ndarray  # (B,) s since the beliefs were last brought up to date

    def updated(self, frame: Frames, interval: np.ndarray, floor: float) -> Proportions:
        """The proportions after one more frame, `interval` (B,) s after the one before."""
        open_to = np.array([not person.is_told for person in self.people])
        if not open_to.any():
            return self
        seconds, since = list(self.seconds), self.since + interval
        look = open_to & (since >= _LOOK)
        for k in np.flatnonzero(look).tolist():
            seconds[k] = _counted(seconds[k], frame, k, since[k], floor)
        due, believed, deviation = self.due + interval, self.believed, self.deviation
        ready = look & (due >= _EVERY)
        if ready.any():
            believed, deviation, due = believed.copy(), deviation.copy(), np.where(ready, 0.0, due)
            for k in np.flatnonzero(ready).tolist():
                believed[k], deviation[k] = likeliest_offsets(seconds[k], self.people[k])
        share = (1 - np.exp2(-interval / _QUICK))[:, None, None]
        shown = self.rest_offset + share * (believed - self.rest_offset)
        since = np.where(look, 0.0, since)
        return Proportions(self.people, shown, deviation, believed, tuple(seconds), since, due)

    @classmethod
    def stacked(cls, parts: Sequence[Proportions]) -> Proportions:
        """Those of several people as one of all of them."""
        people = tuple(person for part in parts for person in part.people)

        def whole(name: str) -> np.ndarray:
            return np.concatenate([getattr(part, name) for part in parts])

        seconds = tuple(each for part in parts for each in part.seconds)
        offset, deviation, believed = whole("rest_offset"), whole("deviation"), whole("believed")
        return cls(people, offset, deviation, believed, seconds, whole("since"), whole("due"))

    def told(self, people: tuple[Person, ...]) -> Proportions:
        """The same evidence, after more was told of the people.

        The body that is shown grows toward what is believed now, but is shown at once where all of it was told.
        """
        fresh = proportions_of(people)
        believed, deviation, shown = fresh.believed.copy(), fresh.deviation.copy(), fresh.rest_offset.copy()
        for k, person in enumerate(people):
            if not person.is_told:
                believed[k], deviation[k] = likeliest_offsets(self.seconds[k], person)
                shown[k] = self.rest_offset[k]
        return Proportions(people, shown, deviation, believed, self.seconds, self.since, self.due)

    def alone(self, k: int) -> Proportions:
        """Those of one of several people."""
        own = slice(k, k + 1)
        return Proportions(
            self.people[own],
            self.rest_offset[own],
            self.deviation[own],
            self.believed[own],
            self.seconds[own],
            self.since[own],
            self.due[own],
        )

    def person(self, k: int, mounts: Mapping[str, RigidTransform]) -> Person:
        """The person as believed now, whose trackers are worn as `mounts` say."""
        one = self.people[k]
        skeleton = one.skeleton.with_offsets(self.believed[k])
        known = {} if one.is_told else {"height": one.height, "lengths": one.lengths}
        return Person(skeleton, bone_deviation=self.deviation[k], mounts=mounts, hands=one.hands, **known)


def proportions_of(people: tuple[Person, ...]) -> Proportions:
    """What is known of people before the first frame."""
    offset = np.array([person.skeleton.rest_offset for person in people])
    deviation = np.array([person.bone_deviation for person in people])
    seconds = (np.zeros((len(LENGTHS), BINS), dtype=np.float32),) * len(people)
    return Proportions(people, offset, deviation, offset, seconds, np.zeros(len(people)), np.zeros(len(people)))


def _places() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    skeleton = default_skeleton()
    start = skeleton.indices([length.start for length in LENGTHS])
    over_floor = np.array([length.end == FLOOR for length in LENGTHS])
    end = skeleton.indices([length.start if length.end == FLOOR else length.end for length in LENGTHS])
    return start, end, over_floor


_START, _END, _OVER_FLOOR = _places()


def _counted(seconds: np.ndarray, frame: Frames, k: int, passed: float, floor: float) -> np.ndarray:
    """Evidence (L, BINS) of a person with one more frame, `passed` s after the one before that was looked at."""
    has, accuracy, position = frame.has_position[k], frame.accuracy[k], frame.position[k]
    known = has[_START] & has[_END] & (accuracy[_START] + accuracy[_END] < _VAGUE)
    if not known.any():
        return seconds
    start = position[_START]
    apart = np.linalg.norm(start - position[_END], axis=-1)
    length = np.where(_OVER_FLOOR, start[:, 1] - floor, apart)
    which = np.flatnonzero(known & (length > 0) & (length < BIN * BINS))
    seconds = seconds.copy()
    seconds[which, (length[which] / BIN).astype(int)] += min(passed, 2 * _LOOK)
    return seconds


def likeliest_offsets(seconds: np.ndarray, person: Person) -> tuple[np.ndarray, np.ndarray]:
    """Rest offsets (65, 3) m of the likeliest body, and deviations (65,) m of its bones.

    Args:
        seconds: (L, BINS) s for which each length was seen in each bin.
        person: what was told: its height and lengths count beside what was seen.
    """
    total = seconds.sum(axis=-1)
    height = person.height
    seen: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for k in np.flatnonzero(total > _ENOUGH):
        length = LENGTHS[k]
        share = np.cumsum(seconds[k]) / total[k]
        value = (np.searchsorted(share, length.quantile) + 0.5) * BIN + length.slack
        deviation = length.deviation * (1 + 2 / (1 + total[k]))
        if length.end == FLOOR:
            # Heads that stand higher than any adult's are on stairs, or over a floor of another height.
            if length.start == "head" and person.height is None and SEATED < value < STANDING:
                height = stature_of_head(value, deviation)
            continue
        # Bodies are symmetric: both sides measure one length.
        left = (length.start.replace("right_", "left_"), length.end.replace("right_", "left_"))
        across = length.start.startswith("left_") and length.end.startswith("right_")
        seen.setdefault((length.start, length.end) if across else left, []).append((value, deviation))
    measured = {
        pair: Measured(float(np.mean([value for value, _ in rows])), float(np.mean([error for _, error in rows])))
        for pair, rows in seen.items()
    }
    guess = Person(height=height, lengths=measured | dict(person.lengths))
    return guess.skeleton.rest_offset, guess.bone_deviation


def stature_of_head(head: float, deviation: float) -> Measured:
    """Stature of somebody whose head joint stands so high, by the mean adult's proportions."""
    mean = shape_space().mean
    joint = (default_skeleton().path @ mean)[default_skeleton().index("head"), 1] + mean[0, 1]
    ratio = float(stature(mean)) / joint
    return Measured(head * ratio, deviation * ratio)
