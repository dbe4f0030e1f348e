"""Data: is what came whole, finite and on time?"""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from bodysense.body.gaps import runs
from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.checks.timing import TIMED
from bodysense_conform.subject import FOOT_POINTS, Subject

_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
NEEDED = ("pelvis", "head", *(f"{side}_{part}" for side in ("left", "right") for part in _LIMBS))
_TREND = 120  # frames at either end that are compared
_EASED = 0.1  # m/s: a body whose fastest joint was so slow before it stood still came to rest
_STUCK = 0.05  # m/s: a body that moves faster than this on average does not repeat bit for bit


def joints_present(subject: Subject) -> Value:
    """Needed joints that never come."""
    missing = [name for name in NEEDED if not subject.has(name)]
    return Value(len(missing), ", ".join(missing))


def long_enough(subject: Subject) -> Value | Unanswered:
    """Length of the subject."""
    return (
        Value(subject.seconds)
        if len(subject) >= 10 and subject.seconds >= 1
        else Unanswered(
            f"{len(subject)} frames in {subject.seconds:.2f} s; 10 frames and 1 s are the least that can be judged"
        )
    )


def messages_decode(subject: Subject) -> Value | Unanswered:
    """Share of messages that cannot be read."""
    transport = subject.transport
    if not transport.messages:
        return Unanswered("a motion file has no messages")
    return Value(100 * transport.malformed / transport.messages, f"{transport.malformed} of {transport.messages}")


def messages_lost(subject: Subject) -> Value | Unanswered:
    """Share of messages that the sequence numbers miss."""
    transport = subject.transport
    if not transport.messages:
        return Unanswered("a motion file has no messages")
    return Value(100 * transport.lost / (transport.messages + transport.lost), f"{transport.lost} missing")


def finite(subject: Subject) -> Value:
    """Values of valid points that are no numbers."""
    position = subject.valid & ~np.isfinite(subject.position).all(axis=-1)
    rotation = subject.valid & subject.rotated & ~np.isfinite(subject.rotation).all(axis=-1)
    bad = position | rotation
    return Value(int(bad.sum()), *_worst(subject, bad))


def no_zero_positions(subject: Subject) -> Value:
    """Share of valid points at exactly (0, 0, 0): what unset memory looks like."""
    zero = np.asarray(subject.known & (subject.position == 0).all(axis=-1))
    zero[:, [name == "pelvis" for name in subject.points]] = False  # a motion file may begin at the origin
    return Value(100 * float(zero.sum()) / max(int(subject.known.sum()), 1), *_worst(subject, zero))


def within_reach(subject: Subject) -> Value:
    """Greatest distance from the origin."""
    far = np.linalg.norm(np.nan_to_num(subject.places), axis=-1)
    return Value(float(far.max(initial=0)), *_worst(subject, far))


def unit_quaternions(subject: Subject) -> Value | Unanswered:
    """Greatest departure of a rotation's length from 1."""
    length = np.linalg.norm(subject.rotation, axis=-1)
    off = np.where(subject.valid & subject.rotated & np.isfinite(length), np.abs(length - 1), 0)
    if not subject.rotated.any():
        return Unanswered("there are no rotations")
    return Value(float(off.max(initial=0)), *_worst(subject, off))


def sign_flips(subject: Subject) -> Value | Unanswered:
    """Changes of a quaternion's sign between frames, per minute: harmless to who slerps, a spin to who lerps."""
    if not subject.rotated.any() or len(subject) < 2:
        return Unanswered("there are no rotations over time")
    flips = (subject.turns[1:] * subject.turns[:-1]).sum(axis=-1) < 0
    return Value(60 * float(flips.sum()) / max(subject.seconds, 1e-9), *_worst(subject, flips))


def presence(subject: Subject) -> Value:
    """Share of frames that have any point, outside of steps that take the device off."""
    counted = np.ones(len(subject), dtype=bool)
    for step in subject.labelled("remount"):
        counted &= ~subject.during(step)
    present = np.asarray(subject.valid.any(axis=1))
    return Value(100 * float(present[counted].mean()) if counted.any() else 0.0)


def coverage(subject: Subject) -> Value:
    """Share of frames with any point in which the least seen needed joint is valid."""
    present = np.asarray(subject.valid.any(axis=1))
    shares = {
        name: float(subject.valid[present, subject.points.index(name)].mean())
        for name in NEEDED
        if name in subject.points and present.any()
    }
    if not shares:
        return Value(0.0, "no needed joint")
    least = min(shares, key=lambda name: shares[name])
    return Value(100 * shares[least], least)


def validity_trend(subject: Subject) -> Value | Unanswered:
    """By how much the share of valid points falls from the first frames to the last."""
    if len(subject) < 2 * _TREND:
        return Unanswered(f"{len(subject)} frames; {2 * _TREND} are needed")
    share = subject.valid.mean(axis=1)
    return Value(100 * float(share[:_TREND].mean() - share[-_TREND:].mean()))


def flag_agrees(subject: Subject) -> Value | Unanswered:
    """Frames whose 'all tracked' is not what their joints say."""
    told = subject.transport.all_tracked
    if told is None:
        return Unanswered("it gives no such flag")
    return Value(100 * float((told != subject.valid[:, _body(subject)].all(axis=1)).mean()))


def frozen_frames(subject: Subject) -> Value | Unanswered:
    """The longest time for which the whole body repeats bit for bit, in a subject that moves."""
    if len(subject) < 2 or not np.nanmean(subject.speed) > _STUCK:
        return Unanswered("the body hardly moves")
    same = (subject.places[1:] == subject.places[:-1]).all(axis=-1) & (subject.known[1:] & subject.known[:-1])
    stuck = (same | ~subject.known[1:]).all(axis=1) & subject.known[1:].any(axis=1)
    if not subject.transport.messages:  # in a file bodies come to rest, and editors hold its first or last pose
        fastest = np.nan_to_num(subject.speed).max(axis=1)
        for start, end in runs(stuck):
            if start == 0 or end == len(stuck) or fastest[start - 1] < _EASED:
                stuck[start:end] = False
    run, start = longest_run(stuck)
    return Value(run * subject.interval, "", start)


def frozen_joint(subject: Subject) -> Value | Unanswered:
    """The longest time for which a joint stays in place bit for bit while the bone that carries it moves."""
    longest, where, frame = 0, "", None
    for parent, child in subject.bones:
        if child in FOOT_POINTS or child.endswith("_knee"):  # held feet may stand exactly, and the shin on them
            continue
        still = (np.diff(subject.at(child), axis=0) == 0).all(axis=-1)
        moves = np.linalg.norm(np.diff(subject.at(parent), axis=0), axis=-1) > 0.001
        run, start = longest_run(still & moves)
        if run > longest:
            longest, where, frame = run, child, start
    return Value(longest * subject.interval, where, frame)


def joints_apart(subject: Subject) -> Value | Unanswered:
    """Share of frames in which two needed joints lie within a millimetre of each other."""
    here = [name for name in NEEDED if subject.has(name)]
    if len(here) < 2:
        return Unanswered("fewer than two joints")
    worst, where = 0.0, ""
    for k, one in enumerate(here):
        for other in here[k + 1 :]:
            share = 100 * float((subject.length(one, other) < 1e-3).mean())
            if share > worst:
                worst, where = share, f"{one}, {other}"
    return Value(worst, where)


def windows_wellformed(subject: Subject) -> Value | Unanswered:
    """Steps of the script that end before they begin, or overlap the one before."""
    if not subject.steps:
        return Unanswered("no script")
    bad = [step.label for step in subject.steps if not step.end > step.start]
    bad += [b.label for a, b in pairwise(subject.steps) if b.start < a.end - 1e-9]
    return Value(len(bad), ", ".join(bad))


def windows_covered(subject: Subject) -> Value | Unanswered:
    """Steps of the script that lack frames in more than 2 % of their time."""
    if not subject.steps:
        return Unanswered("no script")
    bad = []
    for step in subject.steps:
        inside = subject.time[subject.during(step)]
        edges = np.diff(np.concatenate([[step.start], inside, [step.end]]))
        missing = float(edges[edges > 3 * subject.interval].sum())
        if step.label != "remount" and missing > 0.02 * (step.end - step.start) + 3 * subject.interval:
            bad.append(step.label)
    return Value(len(bad), ", ".join(bad))


def longest_run(flags: np.ndarray) -> tuple[int, int | None]:
    """Length and start of the longest run of True."""
    start, end = max(runs(flags), key=lambda run: run[1] - run[0], default=(0, 0))
    return end - start, start if end else None


def _body(subject: Subject) -> list[int]:
    """Places of the joints of the body: hands come by themselves."""
    from bodysense.body.skeleton import BODY

    return [k for k, name in enumerate(subject.points) if name in BODY]


def _worst(subject: Subject, amount: np.ndarray) -> tuple[str, int | None]:
    """The point and the frame with most of something (T, P)."""
    if not amount.any():
        return "", None
    frame, point = np.unravel_index(int(np.argmax(amount)), amount.shape)
    return subject.points[int(point)], int(frame)


_check = partial(check_of, "data")
_timed = partial(check_of, "data", before=TIMED)

CHECKS = (
    _check(
        "long_enough", long_enough, "s", "A second is the least of which motion can be judged.", least=1, required=True
    ),
    _check("joints_present", joints_present, "joints", "An avatar needs a pelvis, a head, arms and legs.", most=0),
    _check("messages_decode", messages_decode, "%", "A receiver drops what it cannot read.", most=0),
    _check("messages_lost", messages_lost, "%", "Lost messages are seen as stutter.", most=1),
    _check("finite", finite, "values", "One NaN makes a whole avatar vanish.", most=0, required=True),
    _check("no_zero_positions", no_zero_positions, "%", "Unset joints pull limbs to the origin.", most=1),
    _check("within_reach", within_reach, "m", "Far from the origin single precision is too coarse.", most=1000),
    _check("unit_quaternions", unit_quaternions, "", "Rotations of other lengths scale a body.", most=1e-3),
    _check("sign_flips", sign_flips, "/min", "Programs that blend linearly spin at a flip."),
    _check("presence", presence, "%", "Frames without a body are seen as drop-outs.", least=95, required=True),
    _check(
        "coverage",
        coverage,
        "%",
        "A joint that is mostly invalid is no joint.",
        least=50,
        after=("joints_present", "presence"),
    ),
    _check(
        "validity_trend", validity_trend, "%", "Tracking that decays in a take ends lost.", most=25, after=("presence",)
    ),
    _check("flag_agrees", flag_agrees, "%", "A flag that says otherwise than the joints misleads.", most=1),
    _timed("frozen_frames", frozen_frames, "s", "A body that repeats bit for bit has no tracker behind it.", most=1.0),
    _check(
        "frozen_joint",
        frozen_joint,
        "s",
        "A joint that hangs in the air tears its limb.",
        most=0.5,
        after=("frozen_frames", *TIMED),
    ),
    _check("joints_apart", joints_apart, "%", "Two joints in one place are one that was copied.", most=5),
    _check("windows_wellformed", windows_wellformed, "steps", "Steps that overlap cannot be judged.", most=0),
    _check(
        "windows_covered",
        windows_covered,
        "steps",
        "A step without frames cannot be judged.",
        most=0,
        after=("windows_wellformed",),
    ),
)
