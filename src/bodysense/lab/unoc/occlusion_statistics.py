"""How much of a recording a headset would not see, and how often the body touches itself (UNOC, Table 1).

The paper does not say which joints make up its rows *body* and *all*. Its own figures fit if the points below count
equally: three for a foot, and in *all* every point of the hands as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.headset_camera import BODY_JOINTS, FOOT_POINTS, SIDES, HeadsetCamera, see
from bodysense.errors import BodysenseError
from bodysense.lab.unoc.contact import self_contact

GROUPS = ("body", "shoulder", "elbow", "hand", "hip", "knee", "foot", "all")  # the rows of Table 1, in its order


def group_points(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Indices of the points that make up each of `GROUPS`."""
    parts = {name: skeleton.indices([f"{side}_{name}" for side in SIDES]) for name in BODY_JOINTS}
    parts["foot"] = skeleton.indices([f"{side}_{name}" for side in SIDES for name in FOOT_POINTS])
    parts["hand"] = np.flatnonzero(skeleton.path[:, skeleton.indices([f"{side}_wrist" for side in SIDES])].any(axis=1))
    body = np.concatenate([parts[name] for name in (*BODY_JOINTS, "foot")])
    groups = {**parts, "body": body, "all": np.concatenate([body, parts["hand"]])}
    return {name: groups[name] for name in GROUPS}


@dataclass(frozen=True, eq=False)
class Counts:
    """What is counted on one recording. Those of several add up; weights are seconds, so frame rates may differ."""

    frames: int
    frame_rates: frozenset[float]  # Hz
    seconds: float
    hidden: np.ndarray  # (G,) s: of GROUPS, the time hidden, summed over points
    spans: np.ndarray  # (G,) number of unbroken spans of hiding
    self_contact: float  # s
    hand_contact: float  # s

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            frames=self.frames + other.frames,
            frame_rates=self.frame_rates | other.frame_rates,
            seconds=self.seconds + other.seconds,
            hidden=self.hidden + other.hidden,
            spans=self.spans + other.spans,
            self_contact=self.self_contact + other.self_contact,
            hand_contact=self.hand_contact + other.hand_contact,
        )


def count(pose: Pose, frame_rate: float, camera: HeadsetCamera = HeadsetCamera(), margin: float = 0.005) -> Counts:
    """Count hiding and contact in one recording.

    Args:
        pose: (T,) poses.
        frame_rate: Hz.
        camera: of the headset.
        margin: m, by which primitives are enlarged to find contacts.

    Raises BodysenseError for a frame rate of 0 or less, and for skeletons that the camera does not know.
    """
    if not frame_rate > 0:
        raise BodysenseError(f"frame_rate {frame_rate:g} must be above 0 frames a second")
    hidden = ~see(pose, camera).visible
    contact = self_contact(pose, margin)
    begins = hidden & ~np.concatenate([np.zeros_like(hidden[:1]), hidden[:-1]])
    groups = group_points(pose.skeleton).values()
    return Counts(
        frames=len(hidden),
        frame_rates=frozenset([float(frame_rate)]),
        seconds=len(hidden) / frame_rate,
        hidden=np.array([hidden[:, points].sum() for points in groups]) / frame_rate,
        spans=np.array([begins[:, points].sum() for points in groups]),
        self_contact=contact.body.sum() / frame_rate,
        hand_contact=contact.hand.sum() / frame_rate,
    )


@dataclass(frozen=True)
class Hiding:
    """How much a group of points is hidden; None where there is no figure."""

    ratio: float | None  # share of time, 0 to 1
    duration: float | None  # s, mean of the unbroken spans


@dataclass(frozen=True)
class Column:
    """One data set, or a part of one, as a column of Table 1; contacts are shares of time, 0 to 1."""

    name: str
    frames: int
    frame_rates: tuple[float, ...]  # Hz
    self_contact: float | None
    hand_contact: float | None
    hiding: Mapping[str, Hiding]  # by GROUPS


def _published(*rows: tuple[float | None, float | None]) -> dict[str, Hiding]:
    """Published percentages and seconds, in the order of GROUPS."""
    return {
        name: Hiding(None if percent is None else percent / 100, duration)
        for name, (percent, duration) in zip(GROUPS, rows, strict=True)
    }


# Table 1 of the paper. Mixamo's ratios of hand and hip cannot be read in the copy at hand.
PUBLISHED = (
    Column(
        "UNOC",
        1_800_000,
        (120.0,),
        0.24,
        0.59,
        _published((35, 3.02), (46, 5.61), (13, 2.40), (24, 1.50), (53, 7.28), (59, 3.74), (24, 0.78), (27, 2.00)),
    ),
    Column(
        "TWH16.2M",
        16_200_000,
        (90.0,),
        0.025,
        0.039,
        _published((38, 4.39), (3, 2.16), (9, 1.14), (14, 0.98), (99, 207.27), (81, 12.2), (23, 2.17), (22, 1.70)),
    ),
    Column(
        "Mixamo",
        261_000,
        (30.0,),
        0.13,
        0.24,
        _published((47, 1.04), (68, 1.77), (45, 1.06), (None, 0.86), (None, 1.44), (35, 0.78), (41, 0.67), (35, 0.95)),
    ),
)


def column(name: str, counts: Iterable[Counts]) -> Column:
    """The column of Table 1 for several recordings. Raises BodysenseError where they hold no frame."""
    total = sum(counts, start=_NOTHING)
    if total.frames == 0:
        raise BodysenseError(f"{name}: there are no frames to count; give at least one recording that is not empty")
    sizes = [len(points) for points in group_points(default_skeleton()).values()]
    rows = zip(GROUPS, total.hidden, total.spans, sizes, strict=True)
    return Column(
        name=name,
        frames=total.frames,
        frame_rates=tuple(sorted(total.frame_rates)),
        self_contact=total.self_contact / total.seconds,
        hand_contact=total.hand_contact / total.seconds,
        hiding={
            group: Hiding(float(hidden / (size * total.seconds)), float(hidden / spans) if spans else None)
            for group, hidden, spans, size in rows
        },
    )


_NOTHING = Counts(0, frozenset(), 0.0, np.zeros(len(GROUPS)), np.zeros(len(GROUPS), dtype=np.int64), 0.0, 0.0)


def table(columns: Sequence[Column]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of Table 1 for printing: its statistics down the side, a column for each data set."""
    rows = [
        ("frames", *(f"{column.frames:,}" for column in columns)),
        ("frames/s", *(", ".join(f"{rate:g}" for rate in column.frame_rates) for column in columns)),
        ("self-contact", *(_percent(column.self_contact) for column in columns)),
        ("hand-body contact", *(_percent(column.hand_contact) for column in columns)),
    ]
    for group in GROUPS:
        cells = (column.hiding[group] for column in columns)
        rows.append((f"{group} hidden", *(f"{_percent(cell.ratio)}  {_seconds(cell.duration)}" for cell in cells)))
    return ("", *(column.name for column in columns)), rows


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f} %"


def _seconds(duration: float | None) -> str:
    return "–" if duration is None else f"{duration:.2f} s"
