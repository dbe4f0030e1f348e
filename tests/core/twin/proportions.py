"""A wearer's proportions, inferred while the tracker runs.

Lengths between tracked points are counted in histograms. Twice a second the likeliest body is fitted to a quantile of
each, and to a stature that the height of the head tells of, standing or seated. The body in use moves there slowly.
"""

from dataclasses import dataclass, field
from math import hypot, log

import numpy as np

from bodysense.body.person import Person
from bodysense.body.shape import Measured

from .points import HEAD, HEAD_TOP, PARENT, PARTNER, PELVIS, SIDES, SKELETON, at, rest_height
from .tracked import Tracked

BIN, BINS = 0.005, 480  # m
LOOK, FIT_EVERY = 0.1, 0.5  # s between two looks at lengths, and between two fits
QUICK = 0.4  # s in which half of what the body in use lacks is made up
VAGUE = 0.06  # m: points that err more together measure nothing

STOOP = 0.02  # m by which people stand lower than at rest
BOB = 0.06  # m, of a walker's head, from top to bottom
LONG_ENOUGH = 1.0  # s that a head must have been so high
MEAN_STATURE, STATURE_DEVIATION = 1.695, 0.09  # m, of adults
STANDING_NOISE = 0.03  # m, standard deviation of a standing head's height
SEATED_HEAD, SEATED_SLOPE, SEATED_NOISE = 1.19, 0.7, 0.035  # m, head's joint of a seated adult, by stature
LOW_HEAD, LOW_LIKELIHOOD = 1.15, 0.75  # m: a lower head may be that of anybody who kneels; logarithm
HIGH_HEAD = 1.95  # m: a higher head is on stairs, or over a floor of another height

LAG = 1.0  # s by which the place where a head has been follows it
WALKS, RUNS = 0.6, 4.0  # m between the two of a walker; farther is an error of tracking
ROLLS = 0.5  # s of walking that make a seat e times less likely
MISTAKEN = 0.1  # m by which a guess from a seat was too tall for a body that then walks
TIPTOE = 0.08  # m by which a head may be higher than at rest: shoes, tiptoe
CONTRADICTED = 2.0  # s after which a known height that is too low counts no more

UNKNOWN_LEG = 0.06  # m: deviations of a leg's bones together are more if nothing is known
SHRINK_TIME = 3.0  # s after which a body does not shrink any more
SHRINKING = -1.0  # in place of the stature that a body may not fall far below: it may
MOST_SHRINKING = 0.015  # m
MOVES = 0.2  # m/s, of the head
STILL_GROWTH, MOVING_GROWTH = 0.02, 0.1  # m/s, of the stature of a still wearer, of others


@dataclass(frozen=True)
class Evidence:
    """A length that depends on proportions: the quantile that is used, and its difference from the rest pose."""

    start: int
    end: int | None  # None: the floor
    quantile: float
    deviation: float  # m
    slack: float = 0.0  # m


def _both(start: str, end: str, quantile: float, deviation: float, slack: float = 0.0) -> list[Evidence]:
    return [Evidence(at(f"{side}_{start}"), at(f"{side}_{end}"), quantile, deviation, slack) for side in SIDES]


EVIDENCE = [
    *_both("shoulder", "elbow", 0.5, 0.006),
    *_both("elbow", "wrist", 0.5, 0.006),
    *_both("hip", "knee", 0.5, 0.006),
    *_both("knee", "ankle", 0.5, 0.006),
    *_both("ankle", "foot", 0.5, 0.006),
    *_both("wrist", "middle1", 0.5, 0.004),
    *_both("hip", "ankle", 0.95, 0.02, 0.01),
    *_both("shoulder", "wrist", 0.98, 0.03, 0.02),
    Evidence(at("left_shoulder"), at("right_shoulder"), 0.5, 0.01),
    Evidence(at("left_hip"), at("right_hip"), 0.5, 0.006),
    Evidence(PELVIS, HEAD, 0.95, 0.02, 0.01),
    Evidence(HEAD, None, 0.95, 0.03, 0.01),
]
HEAD_OVER_FLOOR = len(EVIDENCE) - 1


@dataclass
class Proportions:
    """Beliefs about a body."""

    current: np.ndarray  # (65, 3) m, rest offsets in use
    believed: np.ndarray  # (65, 3) m, toward which those in use move
    deviation: np.ndarray  # (65,) m, standard deviation of each bone's length
    since: float = 0.0  # s since lengths were last looked at
    due: float = 0.0  # s since `believed` was last fitted
    elapsed: float = 0.0  # s of evidence
    head: np.ndarray | None = None  # (3,) m, world, at the last look
    been: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m, world: where it has been of late
    speed: float = 0.0  # m/s, of the head
    walked: float = 0.0  # s for which an upright head moved along the floor
    tallest: float = 0.0  # m: the stature that a body may not fall far below any more
    contradicting: float = 0.0  # s for which the head has been too high for the known height
    seated: bool = False  # `tallest` may be a guess from a seat
    released: bool = False  # the head contradicted the known height, which counts no more
    seconds: np.ndarray = field(default_factory=lambda: np.zeros((len(EVIDENCE), BINS), np.float32))


def first_proportions(person: Person) -> Proportions:
    """Return the beliefs before the first frame."""
    offset = person.skeleton.rest_offset
    return Proportions(offset.copy(), offset.copy(), person.bone_deviation.copy())


def is_unknown(person: Person) -> bool:
    """Whether nothing is known of the body, not even by an earlier session."""
    leg, point = 0.0, at("left_ankle")
    while point != PELVIS:
        leg, point = leg + person.bone_deviation[point], PARENT[point]
    return person.height is None and not person.lengths and leg > UNKNOWN_LEG


def _count(seen: Tracked, passed: float, own: Proportions) -> bool:
    """Count a frame's lengths, `passed` s after the frame that was looked at before. Returns whether there are any."""
    any_length = False
    for k, one in enumerate(EVIDENCE):
        start, end = one.start, one.start if one.end is None else one.end
        if not seen.has_position[start] or not seen.has_position[end]:
            continue
        if not seen.accuracy[start] + seen.accuracy[end] < VAGUE:
            continue
        apart = seen.position[start] - seen.position[end]
        value = seen.position[start][1] - seen.floor if one.end is None else float(np.linalg.norm(apart))
        if 0 < value < BIN * BINS:
            own.seconds[k, int(value / BIN)] += np.float32(min(passed, 2 * LOOK))
            any_length = True
    return any_length


def quantile(seconds: np.ndarray, share: float) -> tuple[float, float]:
    """The quantile (m) of a length, and for how many seconds it was seen."""
    total = np.cumsum(seconds, dtype=float)
    enough = total >= float(np.float32(share)) * total[-1]
    return (int(np.argmax(enough[:-1]) if enough[:-1].any() else BINS - 1) + 0.5) * BIN, float(total[-1])


def upright_head(seconds: np.ndarray) -> tuple[float, float]:
    """How high the head's joint is when the body is as upright as it has been, and for how many seconds it was seen.

    The middle of what is within a walker's bob of the top. Not a high quantile, which would be the top of the bob, and
    after hours in a chair would still be there.
    """
    total = float(np.cumsum(seconds, dtype=float)[-1])
    above = np.cumsum(seconds[::-1], dtype=float)[::-1]
    high = (above >= min(LONG_ENOUGH, total / 2)) & (above > 0)
    top = int(np.flatnonzero(high)[-1]) if high.any() else 0
    low = max(top - int(BOB / BIN), 0)
    within = float(above[top] + np.sum(seconds[low:top], dtype=float))
    sums = np.cumsum(seconds[low:], dtype=float)
    reached = np.flatnonzero(sums >= within / 2)
    return (min(low + int(reached[0]) if len(reached) else BINS - 1, BINS - 1) + 0.5) * BIN, total


def _log_normal(value: float, variance: float) -> float:
    return -0.5 * (value * value / variance + log(variance))


def infer_height(own: Proportions, head: float, total: float) -> tuple[str, Measured | None]:
    """Whether the wearer stands, sits, or is low or high, and what the head's height then says of the stature.

    A head may be a small body's that stands, a large body's that sits, or be lower (kneeling, crouching) or higher (on
    stairs) than either; the likeliest of these is taken, given the body that all else suggests.
    """
    stature = rest_height(own.believed, HEAD_TOP)
    ratio = stature / rest_height(own.believed, HEAD)
    unsure, walks = STATURE_DEVIATION**2, own.walked / ROLLS
    stands = _log_normal(head + STOOP - stature / ratio, STANDING_NOISE**2 + unsure / ratio**2)
    seat_height = head - SEATED_HEAD - SEATED_SLOPE * (stature - MEAN_STATURE)
    sits = _log_normal(seat_height, SEATED_NOISE**2 + SEATED_SLOPE**2 * unsure) - walks
    if head > HIGH_HEAD:
        return "high", None
    if head < LOW_HEAD and LOW_LIKELIHOOD - walks > max(stands, sits):
        return "low", None
    if sits > stands:
        return "sits", Measured(MEAN_STATURE + (head - SEATED_HEAD) / SEATED_SLOPE, SEATED_NOISE / SEATED_SLOPE)
    return "stands", Measured((head + STOOP) * ratio, STANDING_NOISE * (1 + 1 / (1 + total)) * ratio)


def _fit_lengths(person: Person, height: Measured | None, own: Proportions) -> None:
    """The likeliest body for lengths that were seen or are known, and a height. Both sides are averaged."""
    seen = dict[tuple[int, int], list[Measured]]()
    for one, seconds in zip(EVIDENCE[:HEAD_OVER_FLOOR], own.seconds, strict=False):
        value, total = quantile(seconds, one.quantile)
        if total > 0 and one.end is not None:
            pair = (one.start, one.end)
            if PARTNER[one.start] < one.start:
                pair = (int(PARTNER[one.start]), int(PARTNER[one.end]))
            seen.setdefault(pair, []).append(Measured(value + one.slack, one.deviation * (1 + 2 / (1 + total))))
    names = SKELETON.points
    lengths = {
        (names[start], names[end]): Measured(
            float(np.mean([one.value for one in values])), float(np.mean([one.deviation for one in values]))
        )
        for (start, end), values in seen.items()
    }
    body = Person(lengths={**lengths, **person.lengths}, height=height)
    own.believed, own.deviation = body.skeleton.rest_offset, body.bone_deviation


def _fit(person: Person, own: Proportions) -> None:
    """Believe in the body that is likeliest given what is known and what was seen."""
    if person.height is not None and not own.released:
        _fit_lengths(person, person.height, own)
        return
    head, total = upright_head(own.seconds[HEAD_OVER_FLOOR])
    _fit_lengths(person, None, own)  # what is expected of the head's height
    if total > 0:
        stance, height = infer_height(own, head, total)
        if height is not None:
            _fit_lengths(person, height, own)
        # A body that was guessed from a seat gives way to one that walks, if they differ by much.
        shorter = rest_height(own.believed, HEAD_TOP) < own.tallest - MISTAKEN
        if stance == "stands" and own.seated and shorter and own.walked > 0:
            own.tallest, own.seated = SHRINKING, False
        if stance != "stands":
            own.seated = True
    stature, least = rest_height(own.believed, HEAD_TOP), own.tallest - MOST_SHRINKING
    if stature < least:
        own.believed = own.believed * (least / stature)


def _look_at_head(person: Person, seen: Tracked, own: Proportions) -> None:
    """Look at how the head moves: whether it walks, and whether it is too high for the height that is known."""
    if not seen.has_position[HEAD]:
        return
    world, height = seen.base + seen.position[HEAD], seen.position[HEAD][1] - seen.floor
    if own.head is None:
        own.speed, own.been = 0.0, world
    else:
        own.speed = float(np.linalg.norm(world - own.head)) / own.since
        own.been = own.been + min(own.since / LAG, 1.0) * (world - own.been)
    own.head = world
    ahead = hypot(world[0] - own.been[0], world[2] - own.been[2])
    if WALKS < ahead < RUNS and height > upright_head(own.seconds[HEAD_OVER_FLOOR])[0] - BOB:
        own.walked += own.since
    above = person.height is not None and height > rest_height(own.believed, HEAD) + TIPTOE
    own.contradicting = own.contradicting + own.since if above else 0.0
    own.released = own.released or own.contradicting > CONTRADICTED


def _approach(person: Person, interval: float, own: Proportions) -> None:
    """Move the body in use toward the believed one, so slowly that a still wearer does not visibly grow."""
    missing = abs(rest_height(own.believed, HEAD_TOP) - rest_height(own.current, HEAD_TOP))
    known = person.height is not None and not own.released
    most = interval * (MOVING_GROWTH if own.speed > MOVES or known else STILL_GROWTH)
    share = 1 - 2 ** (-interval / QUICK)
    if share * missing > most:
        share = most / missing
    own.current = own.current + share * (own.believed - own.current)


def step(person: Person, seen: Tracked, interval: float, own: Proportions) -> None:
    """Count the lengths of a frame, and move toward the likeliest body."""
    if person.is_known:
        return
    own.since, own.due = own.since + interval, own.due + interval
    if own.since >= LOOK or own.elapsed <= 0:
        first = _count(seen, own.since, own) and own.elapsed <= 0
        _look_at_head(person, seen, own)
        if first or own.elapsed > 0:
            own.elapsed += own.since
        own.since = 0.0
        if first or own.due >= FIT_EVERY:
            _fit(person, own)
            own.due = 0.0
        if first and is_unknown(person):  # an unknown body begins as the first frame suggests
            own.current = own.believed.copy()
    _approach(person, interval, own)
    stature = rest_height(own.current, HEAD_TOP)
    arrived = stature < rest_height(own.believed, HEAD_TOP) + MOST_SHRINKING
    if own.elapsed >= SHRINK_TIME and (own.tallest >= 0 or arrived):
        own.tallest = max(own.tallest, stature)
