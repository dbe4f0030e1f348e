"""UNOC's Table 1: how much of a recording a headset does not see, and how often the body touches itself.

The paper does not say which joints make up its rows *body* and *all*. Its own figures fit if the points below count
equally: three for a foot, and in *all* every point of the hands as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.headset_camera import BODY_JOINTS, FOOT_POINTS, SIDES, HeadsetCamera, see
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.core.table import Cell, Report
from bodysense_lab.data.datasets import Census, DataSet, describe_data, missing_data_remarks
from bodysense_lab.papers.unoc.score.contact import self_contact

GROUPS = ("body", "shoulder", "elbow", "hand", "hip", "knee", "foot", "all")  # the rows of Table 1, in its order


def group_points(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Indices of the points that make up each of `GROUPS`."""
    parts = {name: skeleton.indices([f"{side}_{name}" for side in SIDES]) for name in BODY_JOINTS}
    parts["foot"] = skeleton.indices([f"{side}_{name}" for side in SIDES for name in FOOT_POINTS])
    parts["hand"] = np.flatnonzero(skeleton.path[:, skeleton.indices([f"{side}_wrist" for side in SIDES])].any(axis=1))
    body = np.concatenate([parts[name] for name in (*BODY_JOINTS, "foot")])
    groups = {**parts, "body": body, "all": np.concatenate([body, parts["hand"]])}
    return {name: groups[name] for name in GROUPS}


@dataclass(eq=False)
class Counts:
    """Counts of recordings. Counts add up; weights are seconds, so frame rates may differ."""

    frames: int = 0
    frame_rates: frozenset[float] = frozenset()  # Hz
    seconds: float = 0.0
    hidden: np.ndarray = field(default_factory=lambda: np.zeros(len(GROUPS)))  # (G,) s hidden, summed over points
    spans: np.ndarray = field(default_factory=lambda: np.zeros(len(GROUPS), dtype=np.int64))  # (G,) unbroken ones
    self_contact: float = 0.0  # s
    hand_contact: float = 0.0  # s

    def merge(self, other: Counts) -> None:
        """Count what another has counted."""
        for name, value in vars(other).items():
            before = getattr(self, name)
            setattr(self, name, before | value if name == "frame_rates" else before + value)


def count(pose: Pose, frame_rate: float, camera: HeadsetCamera = HeadsetCamera()) -> Counts:
    """Count hiding and contact in one recording.

    Args:
        pose: (T,) poses.
        frame_rate: Hz.
        camera: of the headset.

    Raises BodysenseError for a frame rate of 0 or less, and for skeletons that the camera does not know.
    """
    if not frame_rate > 0:
        raise BodysenseError(f"frame_rate {frame_rate:g} must be above 0 frames a second")
    hidden = ~see(pose, camera).visible
    contact = self_contact(pose)
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


# Figures of a column by their keys: label in the table, and factor.
FIGURES = {
    "self_contact": ("self-contact, %", 100),
    "hand_contact": ("hand-body contact, %", 100),
    **{
        f"{group}_{key}": (f"{group} {label}", factor)
        for group in GROUPS
        for key, label, factor in (("hidden", "hidden, %", 100), ("seconds", "span, s", 1))
    },
}


@dataclass(frozen=True)
class Column:
    """One data set, or a part of one, as a column of Table 1."""

    name: str
    frames: int
    frame_rates: tuple[float, ...]  # Hz
    figures: Mapping[str, float]  # by `FIGURES`; shares of time, 0 to 1, and s; missing ones are left out


def _published(
    name: str, frames: int, frame_rate: float, self_contact: float, hand_contact: float, hiding: str
) -> Column:
    """A column of the paper; `hiding` is percentage/seconds in the order of GROUPS."""
    figures = {"self_contact": self_contact, "hand_contact": hand_contact}
    for group, pair in zip(GROUPS, hiding.split(), strict=True):
        percent, seconds = pair.split("/")
        figures |= ({f"{group}_hidden": float(percent) / 100} if percent else {}) | {f"{group}_seconds": float(seconds)}
    return Column(name, frames, (frame_rate,), figures)


# Table 1 of the paper. Mixamo's ratios of hand and hip cannot be read in the copy at hand.
PUBLISHED = (
    _published("UNOC", 1_800_000, 120.0, 0.24, 0.59, "35/3.02 46/5.61 13/2.40 24/1.50 53/7.28 59/3.74 24/0.78 27/2.00"),
    _published(
        *("TWH16.2M", 16_200_000, 90.0, 0.025, 0.039),
        "38/4.39 3/2.16 9/1.14 14/0.98 99/207.27 81/12.2 23/2.17 22/1.70",
    ),
    _published("Mixamo", 261_000, 30.0, 0.13, 0.24, "47/1.04 68/1.77 45/1.06 /0.86 /1.44 35/0.78 41/0.67 35/0.95"),
)


def column(name: str, counts: Iterable[Counts]) -> Column:
    """The column of Table 1 for several recordings. Raises BodysenseError where they hold no frame."""
    total = Counts()
    for one in counts:
        total.merge(one)
    if total.frames == 0:
        raise BodysenseError(f"{name}: there are no frames to count; give at least one recording that is not empty")
    figures: dict[str, float] = {}
    points = group_points(default_skeleton()).values()
    for group, hidden, spans, of_group in zip(GROUPS, total.hidden, total.spans, points, strict=True):
        figures[f"{group}_hidden"] = float(hidden / (len(of_group) * total.seconds))
        if spans:
            figures[f"{group}_seconds"] = float(hidden / spans)
    figures |= {name: getattr(total, name) / total.seconds for name in ("self_contact", "hand_contact")}
    return Column(name, total.frames, tuple(sorted(total.frame_rates)), figures)


Counted = dict[str, Counts]  # by category


def count_clip(clip: Clip, camera: HeadsetCamera = HeadsetCamera()) -> Counted:
    """Count occlusion and contact in a clip, under its category."""
    return {clip.category or "(none)": count(clip.pose, clip.frame_rate, camera)}


def columns_of(counted: Counted) -> list[Column]:
    """A column a category, then all."""
    columns = [column(category, [counts]) for category, counts in sorted(counted.items())]
    return [*columns, column("all", counted.values())]


def occlusion_report(counted: Sequence[tuple[DataSet, Counted, Census]]) -> Report:
    """The table of one data set, by category, or of several, a column each."""
    if len(counted) == 1:
        columns = columns_of(counted[0][1])
    else:
        columns = [column(data.name, one.values()) for data, one, _ in counted]
    total = sum((census for _, _, census in counted), start=Census())
    table = occlusion_table(columns)
    return replace(
        table,
        numbers=table.numbers | total.numbers(),
        data=(
            *(describe_data(data, census) for data, _, census in counted),
            *missing_data_remarks([one.name for one in PUBLISHED], [data for data, _, _ in counted]),
        ),
        remarks=tuple(_remarks(columns)),
    )


def occlusion_table(columns: Sequence[Column]) -> Report:
    """Return our columns next to the published ones."""
    every = [*columns, *PUBLISHED]
    rows: list[tuple[Cell, ...]] = [
        ("frames", *(one.frames for one in every)),
        ("frames/s", *(", ".join(f"{rate:g}" for rate in one.frame_rates) for one in every)),
    ]
    for key, (label, factor) in FIGURES.items():
        rows.append((label, *(factor * one.figures[key] if key in one.figures else None for one in every)))
    return Report(
        name="unoc-table1",
        title="UNOC, Table 1: occlusion and contact",
        columns=("", *(one.name for one in columns), *(f"{one.name}, published" for one in PUBLISHED)),
        rows=tuple(rows),
        numbers={f"{one.name}_{key}": value for one in columns for key, value in one.figures.items()},
        caption="Share of time hidden; mean length of the spans of hiding. What is hidden is the joint of either side, "
        "three points of a foot, every point of a hand.",
    )


def _remarks(columns: Sequence[Column]) -> Iterator[str]:
    """Which of our shares lie among the published ones."""
    for one in columns:
        if len(columns) > 1 and one.name in ("all", "sport", "dance", "other"):
            continue
        found: dict[bool, list[str]] = {True: [], False: []}
        for group in GROUPS:
            key = f"{group}_hidden"
            published = [known.figures[key] for known in PUBLISHED if key in known.figures]
            ratio, low, high = one.figures[key], min(published), max(published)
            is_inside = low <= ratio <= high
            span = "" if is_inside else f" (published {100 * low:.0f} to {100 * high:.0f} %)"
            found[is_inside].append(f"{group} {100 * ratio:.0f} %{span}")
        inside, outside = (", ".join(found[key]) or "none" for key in (True, False))
        yield f"{one.name}: hidden within the published range: {inside}; outside: {outside}."
