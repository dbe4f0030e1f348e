"""How well holes are filled: limbs of test clips are taken away for some seconds and compared with the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from bodysense.body.gaps import runs
from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import slerp
from bodysense.filling import Holed, filled, observed, on_feet, open_holed, pose_of
from bodysense.io.clip import Clip
from bodysense.io.fingers import FINGERS
from bodysense.io.holes import Missing
from bodysense.io.resample import resample
from bodysense.metrics import foot_skate
from bodysense.observation import EXACT_ACCURACY, Estimate, Observation
from bodysense.tracker import Tracker
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.table import Report, cell, finite

RATE, LONGEST, LEAD = 30.0, 12.0, 1.0  # Hz; s of a clip that are used; s before a gap
SECONDS = (1.0, 2.0, 3.0)
# Joints that are removed with all their children, and the points that are scored.
LIMBS = {
    "left arm": (("left_shoulder",), ("left_elbow", "left_wrist")),
    "left leg": (("left_hip",), ("left_knee", "left_ankle", "left_foot")),
    "left hand": (("left_wrist",), ("left_index1", "left_pinky1", "left_index_tip", "left_thumb_tip")),
    "left fingers": (
        tuple(f"left_{finger}1" for finger in FINGERS),
        tuple(f"left_{finger}{part}" for finger in FINGERS for part in ("3", "_tip")),
    ),
}
FINGERED = ("left hand", "left fingers")  # which only clips with fingers have
FOOT = "left_foot"  # the ball, whose sliding is scored where it truly stands
METHODS = ("slerp", "filled")
_TOGETHER = 64  # takes that are tracked in one call


@dataclass(frozen=True)
class Gap:
    """One gap, filled."""

    limb: str
    seconds: float
    method: str
    error: float  # m, mean of the points over the gap
    speed: float  # m/s, of the fastest point from one side of the gap to the other
    truth_speed: float  # m/s, the same of the truth
    skate: float = float("nan")  # cm/s of the ball of the foot while it truly stands; NaN where it does not


@dataclass(frozen=True, eq=False)
class HoleTake:
    """A clip from which a limb is taken away for some seconds."""

    clip: Clip
    limb: str
    seconds: float
    first: int  # frame that misses the limb
    holed: Holed

    @property
    def window(self) -> slice:
        """The gap and a frame on either side."""
        return slice(self.first - 1, self.first + int(self.seconds * RATE) + 1)


def score_holes(clips: Iterable[Clip], seed: int = 1, advance: Callable[[Clip], None] = lambda clip: None) -> list[Gap]:
    """Fill a gap of each limb and length in every clip that is long enough; where it lies is drawn."""
    found: list[Gap] = []
    takes = _takes(clips, np.random.default_rng(seed), advance)
    while group := list(islice(takes, _TOGETHER)):
        estimate = _tracked(group)
        for k, take in enumerate(group):
            found += _gaps(take, estimate.of(k))
    return found


def _takes(clips: Iterable[Clip], rng: np.random.Generator, advance: Callable[[Clip], None]) -> Iterator[HoleTake]:
    for clip in clips:
        short = resample(clip, RATE)
        short = replace(short, pose=short.pose[: int(LONGEST * RATE)])
        for limb, (roots, _) in LIMBS.items():
            for seconds in SECONDS:
                count, lead = int(seconds * RATE), int(LEAD * RATE)
                if len(short) < count + 2 * lead or (limb in FINGERED and not clip.has_fingers):
                    continue
                first = int(rng.integers(lead, len(short) - count - lead + 1))
                missing = [Missing(root, True, (first, first + count - 1)) for root in roots]
                yield HoleTake(short, limb, seconds, first, open_holed(short, missing))
        advance(clip)


def _tracked(takes: Sequence[HoleTake]) -> Estimate:
    """Bodies (B, T) of all takes, tracked in one call; shorter ones go on for as long, with nothing tracked."""
    frames = max(len(take.clip) for take in takes)
    seen = [observed(take.holed) for take in takes]

    def together(values: Sequence[np.ndarray], fill: float) -> np.ndarray:
        blank = np.full((len(values), frames, *values[0].shape[1:]), fill, dtype=values[0].dtype)
        for row, own in zip(blank, values, strict=True):
            row[: len(own)] = own
        return blank

    whole = Observation(
        points=seen[0].points,
        position=together([one.position for one in seen], np.nan),
        rotation=together([one.rotation for one in seen], np.nan),
        has_position=together([one.has_position for one in seen], False),
        has_rotation=together([one.has_rotation for one in seen], False),
        accuracy=together([one.accuracy for one in seen], EXACT_ACCURACY),
        time=np.arange(frames) / RATE,
    )
    tracker = Tracker([Person(take.clip.pose.skeleton) for take in takes])
    return tracker.step(whole, tracker.start())[0]


def report_of(gaps: list[Gap], name: str) -> Report:
    """The table: a row a limb and length."""
    rows, numbers, keys = [], {}, []
    for limb in LIMBS:
        for seconds in SECONDS:
            those = {m: [g for g in gaps if (g.limb, g.seconds, g.method) == (limb, seconds, m)] for m in METHODS}
            if not those["filled"]:
                continue
            errors = [100 * float(np.mean([gap.error for gap in those[method]])) for method in METHODS]
            speeds = [float(np.mean([gap.speed for gap in those[method]])) for method in METHODS]
            truth = float(np.mean([gap.truth_speed for gap in those["filled"]]))
            skates = [_mean([gap.skate for gap in those[method]]) for method in METHODS]
            count = len(those["filled"])
            rows.append((limb, f"{seconds:g} s", count, *errors, *speeds, truth, *map(cell, skates)))
            key = f"{limb.replace(' ', '_')}_{seconds:g}s"
            keys.append(key)
            numbers |= {f"{key}_{method}_cm": value for method, value in zip(METHODS, errors, strict=True)}
            numbers |= {f"{key}_{method}_skate": value for method, value in zip(METHODS, skates, strict=True)}
            numbers[f"{key}_peak_speed"], numbers[f"{key}_truth_peak_speed"] = speeds[1], truth
    return Report(
        name="holes",
        title=f"Limbs missing in {name}",
        columns=(
            *("limb", "gap", "gaps", "slerp cm", "filled cm", "slerp m/s", "filled m/s", "truth m/s"),
            *("slerp skate", "filled skate"),
        ),
        rows=tuple(rows),
        numbers=finite(numbers),
        caption="Mean error of the limb's points in the gap; mean over gaps of the fastest point's greatest speed; "
        "skate: cm/s of the ball of the foot while it truly stands.",
        digits=2,
        panels=(
            BarPanel(
                "error, cm",
                tuple(f"{row[0]} {row[1]}" for row in rows),
                tuple(plain_bars(method, [numbers[f"{key}_{method}_cm"] for key in keys]) for method in METHODS),
                "cm",
            ),
        ),
    )


def _gaps(take: HoleTake, estimate: Estimate) -> list[Gap]:
    """A gap, filled by every method; of the estimate the take's own frames count."""
    clip, holed, own = take.clip, take.holed, slice(len(take.clip))
    ours = on_feet(holed, filled(holed, estimate.pose[own]), estimate.contact[own], 0.0)
    points = LIMBS[take.limb][1]
    places, ball = clip.pose.skeleton.indices(points), [points.index(FOOT)] if FOOT in points else []

    def seen(rotation: np.ndarray) -> np.ndarray:
        pose = Pose(clip.pose.skeleton, clip.pose.root_position, rotation)
        return np.asarray(forward_kinematics(pose)[0])[take.window][:, places]

    truth = seen(np.asarray(clip.pose.rotation))
    found = {"slerp": seen(_slerped(holed)), "filled": seen(np.asarray(pose_of(holed, ours).rotation))}
    return [
        Gap(
            limb=take.limb,
            seconds=take.seconds,
            method=method,
            error=_distance(place[1:-1] - truth[1:-1]).mean(),
            speed=_speed(place),
            truth_speed=_speed(truth),
            skate=foot_skate(place[:, ball], truth[:, ball], RATE),
        )
        for method, place in found.items()
    ]


def _slerped(holed: Holed) -> np.ndarray:
    """Every joint turned at constant speed from one side of its gap to the other."""
    rotation = np.array(holed.rotation)
    for joint in np.flatnonzero(holed.missing.any(axis=0)):
        for first, end in runs(holed.missing[:, joint]):
            share = np.arange(1, end - first + 1) / (end - first + 1)
            before, after = (np.repeat(rotation[k : k + 1, joint], end - first, axis=0) for k in (first - 1, end))
            rotation[first:end, joint] = slerp(before, after, share)
    return rotation


def _mean(values: list[float]) -> float:
    """Return the mean of finite values; NaN without any."""
    there = [value for value in values if np.isfinite(value)]
    return float(np.mean(there)) if there else float("nan")


def _distance(vector: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vector, axis=-1)


def _speed(place: np.ndarray) -> float:
    return float(_distance(np.diff(place, axis=0)).max() * RATE)
