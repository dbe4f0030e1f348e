"""Jerk in the second after a joint is lost or seen again.

Jerk is the third difference of a joint's place, at 30 Hz. For each joint that the headset loses or sees again, the
second that begins with that frame has a peak jerk and an area under the jerk. The table has their means over all such
moments. The truth has jerk too: compare the others with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip
from bodysense.takes.last_known import Hold
from bodysense_lab.core.score_table import ScoreColumn, ScoreRow, ScoreTable, score_report
from bodysense_lab.core.scoring import RATE, Tally, group_of, part_errors, scored_points
from bodysense_lab.core.table import Report
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet, describe_data
from bodysense_lab.papers.unoc.ik_tracker import IkTracker, IkTrackerSettings
from bodysense_lab.papers.unoc.learned import track_clip

SECOND = round(RATE)  # frames
EVENTS = {"regained": "seen again", "lost": "lost"}
METHODS = {
    "truth": "truth",
    "last_known": "last known",
    "last_known_tracker": "last known, smoothed",
    "best": "shipped, before IK",
    "tracker": "shipped",
}
# By kind of position: the methods before and after inverse kinematics and smoothing, and the published changes of the
# error of hidden and of all joints (section 5.1), cm.
_SMOOTHED = {
    "the shipped predictor": (("best", "tracker"), (-0.04, 1.5)),
    "last known positions": (("last_known", "last_known_tracker"), (-3.5, 2.4)),
}
_FRAMES = "frames"  # the place of errors over all frames

TABLE = ScoreTable(
    name="transitions",
    title="The second after a joint is lost, or seen again",
    axes=("joint is", "motion"),
    places={event: ScoreRow(label, event) for event, label in EVENTS.items()} | {_FRAMES: ScoreRow("")},
    methods=METHODS,
    figures=(
        ScoreColumn("moments", "peak", "count", "{place.key}_moments"),
        ScoreColumn("peak jerk, m/s³", "peak", key="{method}_{place.key}_peak_jerk"),
        ScoreColumn("area, m/s²", "area", key="{method}_{place.key}_jerk_area"),
        ScoreColumn("occluded RMSJPE", "occluded", "rmsjpe", "{method}_occluded_rmsjpe_cm"),
        ScoreColumn("all RMSJPE", "all", "rmsjpe", "{method}_all_rmsjpe_cm"),
    ),
    caption="Means over moments; errors of the body in cm, over all frames. Last known: turning with the head's "
    "heading.",
    rows=tuple(EVENTS),
    of_groups=(1, "{} peak"),
)


def moments(visible: np.ndarray) -> dict[str, np.ndarray]:
    """Places (frame, point) at which points (T, P) are seen again, and lost, and whose second is in the clip.

    Three frames before them are needed as well, for the jerk.
    """
    before, now = visible[:-1], visible[1:]
    found = {"regained": now & ~before, "lost": before & ~now}
    result = {}
    for event, mask in found.items():
        frames, points = np.nonzero(mask)
        frames = frames + 1
        whole = (frames >= 3) & (frames + SECOND <= len(visible))
        result[event] = np.stack([frames[whole], points[whole]], axis=-1)
    return result


def jerks_at(position: np.ndarray, where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the peak jerk (N,) m/s³ and the area under the jerk (N,) m/s² of the seconds that begin at moments (N, 2).

    `position` is (T, P, 3) m.
    """
    if not len(where):
        return np.zeros(0), np.zeros(0)
    jerk = np.linalg.norm(np.diff(position, 3, axis=0), axis=-1) * RATE**3  # the first is that of frame 3
    seconds = jerk[where[:, :1] - 3 + np.arange(SECOND), where[:, 1:]]
    return seconds.max(axis=1), seconds.sum(axis=1) / RATE


def transitions_of_clip(clip: Clip, model: Path | None, settings: IkTrackerSettings) -> Tallies:
    """All methods on one clip. Last known positions are also solved and smoothed as the network's are."""
    tracked = track_clip(clip, model, settings)
    truth = np.asarray(forward_kinematics(tracked.clip.pose)[0])
    names = {"last_known": "heading", "best": "network", "tracker": "bodysense"}
    position = {"truth": truth, **{method: tracked.position[name] for method, name in names.items()}}
    held = IkTracker(Hold(tracked.clip.pose.skeleton), settings)
    solved, _, _ = held.step(tracked.observation, held.start())
    position["last_known_tracker"] = np.asarray(forward_kinematics(solved)[0])
    return transitions_of(position, truth, tracked.observation.has_position, tracked.clip)


def transitions_of(position: Mapping[str, np.ndarray], truth: np.ndarray, visible: np.ndarray, clip: Clip) -> Tallies:
    """Methods with positions (T, P, 3) m at 30 Hz; visible (T, P). Of the joints that UNOC's tables test."""
    group, tested = group_of(clip), scored_points(clip.pose.skeleton)
    where = moments(visible[:, tested])
    found = Tallies()  # by group of categories, event, method and measure
    for method, values in position.items():
        error, points = part_errors(values, truth, clip.pose.skeleton, False)["body"]
        errors = {"occluded": error[~visible[:, points]], "all": error}
        for event in (*EVENTS, _FRAMES):
            jerks: dict[str, np.ndarray] = {}
            if event != _FRAMES:
                jerks["peak"], jerks["area"] = jerks_at(values[:, tested], where[event])
            for measure, counted in (jerks | errors).items():
                found.add((group, event, method, measure), counted)
    return found


def transitions_report(found: Mapping[tuple, Tally], census: Census, data: DataSet) -> Report:
    """Return the table of the methods at both events."""
    # Errors are in the rows of events with moments.
    observed_events = {key[:2] for key, tally in found.items() if key[3] == "peak" and tally.count}
    found = {
        key: one
        for key, one in found.items()
        if key[1] == _FRAMES or key[3] in ("peak", "area") or key[:2] in observed_events
    }
    remarks = []
    for event, title in EVENTS.items():
        if ("main", event) not in observed_events:
            continue
        times = [
            f"{found['main', event, method, measure].mpjpe / true:.1f} times" if true else "many times"
            for measure in ("peak", "area")
            for true in [found["main", event, "truth", measure].mpjpe]
            for method in ("best", "tracker")
        ]
        remarks.append(
            f"When a joint is {title}, the shipped predictor's peak jerk is {times[0]} the truth's before IK and "
            f"smoothing and {times[1]} after; the area under its jerk {times[2]} and {times[3]}."
        )
    if remarks:
        for positions, (methods, published) in _SMOOTHED.items():
            changes = []
            for part, change in zip(("occluded", "all"), published, strict=True):
                before, after = (found["main", _FRAMES, method, part].rmsjpe for method in methods)
                changes.append(f"{before:.2f} to {after:.2f} cm at {part} joints (published: {change:+g} cm)")
            remarks.append(f"IK and smoothing change the RMSJPE of {positions} from {' and from '.join(changes)}.")
    title = "What smoothing gives and costs"
    return score_report(TABLE, found, census, (describe_data(data, census),), remarks, remarks_title=title)
