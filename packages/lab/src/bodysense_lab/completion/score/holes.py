"""Scores of filled holes: parts of bodies are removed for some seconds, filled, and compared with the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from bodysense.body.hands.hand import FINGERS
from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    slerp,
)
from bodysense.io.clip import Clip
from bodysense.io.holes import below, missing_items
from bodysense.io.resample import resample
from bodysense.sources.partial_motion import PartialMotion, open_partial
from bodysense.takes.filling import fill_motion, known_points
from bodysense.takes.two_way import TwoWayTracker
from bodysense.tracking.tracker import TrackerSettings
from bodysense_lab.core.intervals import interval
from bodysense_lab.core.table import Cell, Report, finite
from bodysense_lab.core.tallies import Tallies

RATE, LEAD = 30.0, 1.0  # Hz; s of known frames on either side of a gap
SECONDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
KNOTS = 2  # known frames of a cubic spline on either side
NEAR_DISTANCE = 0.5  # m, deviation of the distance weight (published: 0.2; 0.5 errs less on validation people)
VARIANCE_SHARE = 0.99  # share of the variance that principal components keep
LEAST_SPREAD = 1e-3  # m, lower bound of the deviation by which coordinates are divided
EASE_SECONDS = 0.5  # s in which inertialisation removes a difference of speed
# Joints that are removed with all their descendants, and points that are scored.
PARTS = {
    "arm": (("left_shoulder",), ("left_elbow", "left_wrist")),
    "leg": (("left_hip",), ("left_knee", "left_ankle", "left_foot")),
    "legs": (
        ("left_hip", "right_hip"),
        tuple(f"{side}_{part}" for side in ("left", "right") for part in ("knee", "ankle", "foot")),
    ),
    "upper_body": (
        ("spine1",),
        ("spine3", "head", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    ),
    "fingers": (
        tuple(f"left_{finger}1" for finger in FINGERS),
        tuple(f"left_{finger}{part}" for finger in FINGERS for part in ("3", "_tip")),
    ),
}
OURS = "bodysense"
OTHERS = ("slerp", "cubic spline", "inertialised", "intercorrelated", "causal")
METHODS = (OURS, *OTHERS)


def score_holes(
    clips: Iterable[Clip],
    parts: Sequence[str] = tuple(PARTS),
    advance: Callable[[Clip], None] = lambda clip: None,
) -> Tallies:
    """Fill a gap of each part and length, at a random time, in every clip that is long enough.

    Returns one error for each gap, the mean of the part's points in cm, under (part, seconds, method).
    """
    rng, found = np.random.default_rng(1), Tallies()
    for clip in clips:
        at_rate = resample(clip, RATE)
        for part, seconds, begin in _draw_gaps(at_rate, parts, rng):
            for method, error in score_gap(at_rate, part, seconds, begin).items():
                found.add((part, seconds, method), np.array(100 * error), clip.person or "unknown")
        advance(clip)
    return found


def _draw_gaps(clip: Clip, parts: Sequence[str], rng: np.random.Generator) -> Iterator[tuple[str, float, int]]:
    """Yield part, length in s and first frame of random gaps, with `LEAD` known seconds on either side."""
    lead = round(LEAD * RATE)
    for part in parts:
        for seconds in SECONDS:
            count = round(seconds * RATE)
            if len(clip) < count + 2 * lead or (part == "fingers" and not clip.has_fingers):
                continue
            yield part, seconds, lead + int(rng.integers(0, len(clip) - count - 2 * lead + 1))


def score_gap(clip: Clip, part: str, seconds: float, begin: int) -> dict[str, float]:
    """Return the mean error in m of a part's points in a gap that begins at frame `begin`, by method.

    All methods know `LEAD` seconds on either side, the intercorrelation knows the whole clip.
    """
    roots, points = PARTS[part]
    first, count = round(LEAD * RATE), round(seconds * RATE)
    near = replace(clip, pose=clip.pose[begin - first : begin + count + first])
    partial = open_partial(near, missing_items([f"{root}+:{first}-{first + count - 1}" for root in roots]))
    window, skeleton = slice(first, first + count), clip.pose.skeleton
    places = skeleton.indices(points)

    def place(rotation: np.ndarray) -> np.ndarray:
        pose = Pose(skeleton, near.pose.root_position[window], rotation[window])
        return np.asarray(forward_kinematics(pose)[0])[:, places]

    found = {method: place(rotation) for method, rotation in fill_by_all_methods(partial).items()}
    descendants = {point for root in roots for point in below(skeleton.index(root), skeleton.parents)}
    hidden = sorted(descendants - set(skeleton.indices(roots).tolist()))
    carrier = skeleton.parents[skeleton.index(roots[0])]
    found["intercorrelated"] = intercorrelated(clip.pose, carrier, hidden, begin, begin + count)[:, places]
    truth = place(np.asarray(near.pose.rotation))
    return {method: float(np.linalg.norm(found[method] - truth, axis=-1).mean()) for method in METHODS}


def fill_by_all_methods(partial: PartialMotion) -> dict[str, np.ndarray]:
    """Return local rotations (T, J, 4) of a motion, with its gaps filled by each of `METHODS`.

    The intercorrelation, which gives positions only, is omitted. Within a gap, the causal method equals live tracking.
    """
    tracker = TwoWayTracker(Person(partial.clip.pose.skeleton), None, TrackerSettings())
    known = known_points(partial)
    forward, _ = tracker.tracker.step(known, tracker.tracker.start())
    return {
        OURS: fill_motion(partial, tracker.complete(known, float(np.median(np.diff(known.time))))),
        "slerp": fill_gaps(partial.rotation, partial.missing, slerped),
        "cubic spline": fill_gaps(partial.rotation, partial.missing, splined),
        "inertialised": fill_gaps(partial.rotation, partial.missing, inertialised),
        "causal": np.where(partial.missing[..., None], forward.pose.rotation, partial.rotation),
    }


def fill_gaps(
    rotation: np.ndarray, missing: np.ndarray, fill: Callable[[np.ndarray, int, int], np.ndarray]
) -> np.ndarray:
    """Return local rotations (T, J, 4), with the gaps of each joint filled from its own known frames."""
    rotation = np.array(rotation)
    hidden = {joint: runs(missing[:, joint]) for joint in np.flatnonzero(missing.any(axis=0)).tolist()}
    for span in {span for spans in hidden.values() for span in spans}:
        joints = [joint for joint, spans in hidden.items() if span in spans]
        rotation[span[0] : span[1], joints] = fill(rotation[:, joints], *span)
    return rotation


def slerped(rotation: np.ndarray, first: int, end: int) -> np.ndarray:
    """Interpolate joints (T, J, 4) at constant speed from one side of a gap to the other; returns (N, J, 4).

    With an interpolated root this is the interpolation of Harvey et al., Robust Motion In-betweening, 2020.
    """
    share = np.arange(1, end - first + 1)[:, None] / (end - first + 1)
    before, after = (np.broadcast_to(rotation[k], (end - first, *rotation.shape[1:])) for k in (first - 1, end))
    return np.asarray(slerp(before, after, share))


def splined(rotation: np.ndarray, first: int, end: int) -> np.ndarray:
    """Interpolate joints (T, J, 4) by cubic splines of rotation vectors from the frame before a gap to (N, J, 4)."""
    frames = np.concatenate([np.arange(first - KNOTS, first), np.arange(end, end + KNOTS)])
    vector = CubicSpline(frames, _rotation_vectors(rotation[first - 1], rotation[frames]))(np.arange(first, end))
    return np.asarray(
        quaternion_multiply(np.broadcast_to(rotation[first - 1], (*vector.shape[:-1], 4)), quaternion_exp(vector))
    )


def inertialised(rotation: np.ndarray, first: int, end: int) -> np.ndarray:
    """Interpolate joints (T, J, 4) by slerp, eased from and to the speeds of the known frames; returns (N, J, 4).

    The offset from slerp is a quintic that begins at zero with the difference of speed. It ends at rest after
    `EASE_SECONDS`, or with the gap (Bollo, Inertialization, GDC 2018).
    """
    count = end - first
    before, after = rotation[first - 1], rotation[end]
    step = _rotation_vectors(before, after) / (count + 1)
    elapsed = np.arange(1.0, count + 1)[:, None, None]
    offset = _ease_offset(elapsed, count + 1) * (_rotation_vectors(rotation[first - 2], before) - step)
    remaining = count + 1 - elapsed
    offset = offset - _ease_offset(remaining, count + 1) * (_rotation_vectors(after, rotation[end + 1]) - step)
    return np.asarray(quaternion_multiply(slerped(rotation, first, end), quaternion_exp(offset)))


def intercorrelated(pose: Pose, carrier: int, hidden: Sequence[int], first: int, end: int) -> np.ndarray:
    """Return positions (N, P, 3) of a motion's points in a gap; points `hidden` are predicted by principal components.

    Gløersen and Federolf, Predicting Missing Marker Trajectories in Human Motion Data Using Marker Intercorrelations,
    2016. Points are weighted by their distance from the missing ones. The prediction maps the components of the known
    frames with the missing points at their mean to the components of the complete known frames. Here all points are in
    the axes of the joint `carrier` of the missing part, and the differences at both sides of the gap are removed
    linearly.
    """
    position, rotation = (np.asarray(part) for part in forward_kinematics(pose))
    place, turn = position[:, [carrier]], np.broadcast_to(rotation[:, [carrier]], (*position.shape[:2], 4))
    local = np.asarray(quaternion_rotate(quaternion_conjugate(turn), position - place))
    known = np.r_[0:first, end : len(position)]
    mean, spread = local[known].mean(axis=0), np.maximum(local[known].std(axis=0), LEAST_SPREAD)
    distance = np.linalg.norm(mean[:, None] - mean[hidden], axis=-1).min(axis=1)
    scale = np.exp(-0.5 * (distance / NEAR_DISTANCE) ** 2)[:, None] / spread
    whole = (local - mean) * scale
    masked = whole.copy()
    masked[:, hidden] = 0
    whole, masked = whole.reshape(len(local), -1), masked.reshape(len(local), -1)
    components, of_lacking = _components(whole[known]), _components(masked[known])
    sides = masked[first - 1 : end + 1]
    found = (sides @ of_lacking @ (of_lacking.T @ components) @ components.T).reshape(len(sides), *mean.shape)
    found = found / scale + mean
    share = np.linspace(0, 1, len(found))[:, None, None]
    found += (1 - share) * (local[first - 1] - found[0]) + share * (local[end] - found[-1])
    result = position[first:end].copy()
    result[:, hidden] = (place[first:end] + quaternion_rotate(turn[first:end], found[1:-1]))[:, hidden]
    return result


def _components(data: np.ndarray) -> np.ndarray:
    """Return the principal components (D, K) of data (N, D) that keep `VARIANCE_SHARE` of its variance."""
    _, size, directions = np.linalg.svd(data, full_matrices=False)
    share = np.cumsum(size**2) / max(float((size**2).sum()), 1e-12)
    return directions[: int(np.searchsorted(share, VARIANCE_SHARE)) + 1].T


def _ease_offset(elapsed: np.ndarray, span: int) -> np.ndarray:
    """Return the offset, in frames, of a unit difference of speed, `elapsed` frames after a side of a gap."""
    most = min(EASE_SECONDS * RATE, span)
    share = np.minimum(elapsed / most, 1.0)
    return most * (share - 6 * share**3 + 8 * share**4 - 3 * share**5)


def _rotation_vectors(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return rotation vectors (..., 3) from a to b."""
    return np.asarray(quaternion_log(quaternion_multiply(np.broadcast_to(quaternion_conjugate(a), b.shape), b)))


def holes_report(gaps: Tallies, name: str) -> Report:
    """Return the table: a row for each part and length, with intervals over people."""
    rows: list[tuple[Cell, ...]] = []
    numbers: dict[str, float] = {}
    for part in PARTS:
        for seconds in SECONDS:
            found = {method: gaps[part, seconds, method] for method in METHODS}
            ours, count = found[OURS], int(found[OURS].count)
            if not count:
                continue
            best = min((found[other] for other in OTHERS), key=lambda other: other.mpjpe)
            own, more = ours.interval(), interval(ours.shares(), best.shares())
            words, key = part.replace("_", " "), f"{part}_{seconds:g}"
            more_text = f"{more.low:+.2f} to {more.high:+.2f}"
            rows.append((words, f"{seconds:g} s", count, *(one.mpjpe for one in found.values()), more_text))
            numbers |= {f"{key}_cm": ours.mpjpe, f"{key}_best_other_cm": best.mpjpe, f"{key}_gaps": float(count)}
            numbers |= {f"{key}_low_cm": own.low, f"{key}_high_cm": own.high}
    return Report(
        name="holes",
        title=f"Parts missing in {name}, cm",
        columns=("part", "gap", "gaps", *METHODS, "more than the best other"),
        rows=tuple(rows),
        numbers=finite(numbers),
        caption="Mean error of the part's points in the gap, cm. Cubic spline: through two known frames on each side, "
        "joint by joint. Inertialised: slerp, eased from the speed at each side. Intercorrelated: from the other "
        "joints, by principal components of the clip's known frames. Causal: as in live tracking. "
        "The last column is a 95 % interval over people.",
        digits=2,
    )
