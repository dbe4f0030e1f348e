"""How well holes are filled: parts of people are removed for some seconds, filled, and compared with the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from bodysense.body.gaps import runs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    slerp,
)
from bodysense.filling import open_partial
from bodysense.io.clip import Clip
from bodysense.io.fingers import FINGERS
from bodysense.io.holes import missing_items
from bodysense.io.resample import resample
from bodysense.take import track
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.table import Report, finite

RATE, LEAD = 30.0, 1.0  # Hz; s of known frames that a clip has on either side of a gap at least
KEPT = 2.0  # s of known frames on either side that are used, at most
SECONDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
KNOTS = 2  # known frames on either side through which a cubic spline goes
# joints that are removed with all their descendants, and points that are scored
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
OTHERS = ("slerp", "cubic spline", "causal")
METHODS = (OURS, *OTHERS)


@dataclass(frozen=True)
class Gap:
    """One gap, filled."""

    part: str
    seconds: float
    method: str
    error: float  # m, mean of the points over the gap


def score_holes(clips: Iterable[Clip], seed: int = 1, advance: Callable[[Clip], None] = lambda clip: None) -> list[Gap]:
    """Fill a gap of each part and length in every clip that is long enough; its place is drawn."""
    rng, found = np.random.default_rng(seed), []
    for clip in clips:
        short = resample(clip, RATE)
        for part, seconds, cut, first in _cuts(short, rng):
            found += score_gap(cut, part, seconds, first)
        advance(clip)
    return found


def _cuts(clip: Clip, rng: np.random.Generator) -> Iterator[tuple[str, float, Clip, int]]:
    """For each part and length: the frames about a gap, and the first of them that the part lacks."""
    lead, kept = round(LEAD * RATE), round(KEPT * RATE)
    for part in PARTS:
        for seconds in SECONDS:
            count = round(seconds * RATE)
            if len(clip) < count + 2 * lead or (part == "fingers" and not clip.has_fingers):
                continue
            first = int(rng.integers(lead, len(clip) - count - lead + 1))
            begin = max(0, first - kept)
            yield part, seconds, replace(clip, pose=clip.pose[begin : first + count + kept]), first - begin


def score_gap(clip: Clip, part: str, seconds: float, first: int) -> list[Gap]:
    """A gap of a part, filled by every method."""
    roots, points = PARTS[part]
    count = round(seconds * RATE)
    missing = [f"{root}+:{first}-{first + count - 1}" for root in roots]
    partial = open_partial(clip, missing_items(missing))
    window, skeleton = slice(first, first + count), clip.pose.skeleton
    places = skeleton.indices(points)

    def place(rotation: np.ndarray) -> np.ndarray:
        pose = Pose(skeleton, clip.pose.root_position[window], rotation[window])
        return np.asarray(forward_kinematics(pose)[0])[:, places]

    causal = track(clip, missing=missing, causal=True).estimate.pose.rotation
    filled = {
        OURS: np.asarray(track(clip, missing=missing).clip.pose.rotation),
        "slerp": between(partial.rotation, partial.missing, slerped),
        "cubic spline": between(partial.rotation, partial.missing, splined),
        "causal": np.where(partial.missing[..., None], causal, partial.rotation),
    }
    truth = place(np.asarray(clip.pose.rotation))
    return [
        Gap(part, seconds, method, float(np.linalg.norm(place(filled[method]) - truth, axis=-1).mean()))
        for method in METHODS
    ]


def between(
    rotation: np.ndarray, missing: np.ndarray, fill: Callable[[np.ndarray, int, int], np.ndarray]
) -> np.ndarray:
    """Local rotations (T, J, 4), each joint filled in its gaps from its own known frames."""
    rotation = np.array(rotation)
    for joint in np.flatnonzero(missing.any(axis=0)):
        for first, end in runs(missing[:, joint]):
            rotation[first:end, joint] = fill(rotation[:, joint], first, end)
    return rotation


def slerped(rotation: np.ndarray, first: int, end: int) -> np.ndarray:
    """Rotations (N, 4) of one joint (T, 4) at constant speed from one side of a gap to the other."""
    share = np.arange(1, end - first + 1) / (end - first + 1)
    before, after = (np.repeat(rotation[k : k + 1], end - first, axis=0) for k in (first - 1, end))
    return np.asarray(slerp(before, after, share))


def splined(rotation: np.ndarray, first: int, end: int) -> np.ndarray:
    """Rotations (N, 4) of one joint (T, 4) on the cubic spline of its rotation vectors from the frame before a gap."""
    frames = np.concatenate([np.arange(first - KNOTS, first), np.arange(end, end + KNOTS)])
    before = rotation[first - 1 : first]
    vectors = np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(before), rotation[frames])))
    way = CubicSpline(frames, vectors)(np.arange(first, end))
    return np.asarray(quaternion_multiply(before.repeat(len(way), axis=0), quaternion_exp(way)))


def report_of(gaps: list[Gap], name: str) -> Report:
    """The table: a row a part and length."""
    rows, numbers, labels = [], {}, []
    errors: dict[str, list[float]] = {OURS: [], "best other": []}
    for part in PARTS:
        for seconds in SECONDS:
            those = [gap for gap in gaps if (gap.part, gap.seconds) == (part, seconds)]
            if not those:
                continue
            means = {m: 100 * float(np.mean([gap.error for gap in those if gap.method == m])) for m in METHODS}
            words = part.replace("_", " ")
            rows.append((words, f"{seconds:g} s", len(those) // len(METHODS), *means.values()))
            labels.append(f"{words} {seconds:g} s")
            numbers[f"{part}_{seconds:g}_cm"] = means[OURS]
            numbers[f"{part}_{seconds:g}_best_other_cm"] = min(means[other] for other in OTHERS)
            errors[OURS].append(means[OURS])
            errors["best other"].append(numbers[f"{part}_{seconds:g}_best_other_cm"])
    return Report(
        name="holes",
        title=f"Parts missing in {name}, cm",
        columns=("part", "gap", "gaps", *METHODS),
        rows=tuple(rows),
        numbers=finite(numbers),
        caption="Mean error of the part's points in the gap, cm. Cubic spline: through two known frames on each side, "
        "joint by joint. Causal: completed as in live tracking.",
        digits=2,
        panels=(BarPanel("error, cm", tuple(labels), tuple(plain_bars(*one) for one in errors.items()), "cm"),),
    )
