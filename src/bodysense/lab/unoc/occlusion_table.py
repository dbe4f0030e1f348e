"""UNOC's Table 1: how much of a recording a headset does not see, and how often the body touches itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from bodysense.devices.simulated.headset_camera import HeadsetCamera
from bodysense.io.clip import Clip
from bodysense.lab.chart import BarPanel, plain_bars
from bodysense.lab.datasets import Census, DataSet, census_of, describe, missing
from bodysense.lab.scoring import MAIN
from bodysense.lab.spread import spread
from bodysense.lab.table import Cell, Report
from bodysense.lab.unoc.occlusion_statistics import GROUPS, PUBLISHED, Column, Counts, column, count

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.io.clip import Clip


Counted = dict[str, list[Counts]]  # by category


def count_clips(
    clips: Iterable[Clip], jobs: int, advance: Callable[[Clip], None], camera: HeadsetCamera = HeadsetCamera()
) -> tuple[Counted, Census]:
    """Hiding and contact in every clip, and how much motion that was. `advance` is told of every clip that is done."""
    counted: Counted = {}
    census = Census()
    for clip, counts in spread(partial(_count, camera=camera), clips, jobs):
        counted.setdefault(clip.category or "(none)", []).append(counts)
        census += census_of(clip)
        advance(clip)
    return counted, census


def columns_of(counted: Counted) -> list[Column]:
    """A column a category, then all."""
    columns = [column(category, rows) for category, rows in sorted(counted.items())]
    return [*columns, column("all", [row for rows in counted.values() for row in rows])]


def numbers_of(columns: Iterable[Column]) -> dict[str, float]:
    """'<column>_<group>_hidden' (share of time), '…_seconds', '<column>_self_contact', '…_hand_contact'."""
    numbers: dict[str, float] = {}
    for one in columns:
        rows = {f"{group}_{name}": getattr(hiding, field) for group, hiding in one.hiding.items() for name, field in
                (("hidden", "ratio"), ("seconds", "duration"))}  # fmt: skip
        rows |= {"self_contact": one.self_contact, "hand_contact": one.hand_contact}
        numbers |= {f"{one.name}_{key}": value for key, value in rows.items() if value is not None}
    return numbers


def occlusion_report(counted: Sequence[tuple[DataSet, Counted, Census]]) -> Report:
    """The table of one data set, by category, or of several, a column each."""
    if len(counted) == 1:
        columns = columns_of(counted[0][1])
    else:
        columns = [column(data.name, [row for rows in one.values() for row in rows]) for data, one, _ in counted]
    every = [*columns, *PUBLISHED]
    total = sum((census for _, _, census in counted), start=Census())
    return Report(
        name="unoc-table1",
        title="UNOC, Table 1: occlusion and contact",
        columns=("", *(one.name for one in columns), *(f"{one.name}, published" for one in PUBLISHED)),
        rows=tuple(_rows(every)),
        numbers=numbers_of(columns) | total.numbers(),
        data=(
            *(describe(data, census) for data, _, census in counted),
            *missing([one.name for one in PUBLISHED], [data for data, _, _ in counted]),
        ),
        remarks=tuple(_remarks(columns)),
        caption="Share of time hidden; mean length of the spans of hiding. What is hidden is the joint of either side, "
        "three points of a foot, every point of a hand.",
        panels=(_panel("hidden, % of time", every, "ratio", 100.0), _panel("mean span, s", every, "duration", 1.0)),
    )


def _count(clip: Clip, camera: HeadsetCamera) -> Counts:
    return count(clip.pose, clip.frame_rate, camera)


def _rows(columns: Sequence[Column]) -> Iterator[tuple[Cell, ...]]:
    yield ("frames", *(one.frames for one in columns))
    yield ("frames/s", *(", ".join(f"{rate:g}" for rate in one.frame_rates) for one in columns))
    yield ("self-contact, %", *(_percent(one.self_contact) for one in columns))
    yield ("hand-body contact, %", *(_percent(one.hand_contact) for one in columns))
    for group in GROUPS:
        yield (f"{group} hidden, %", *(_percent(one.hiding[group].ratio) for one in columns))
        yield (f"{group} span, s", *(one.hiding[group].duration for one in columns))


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _remarks(columns: Sequence[Column]) -> Iterator[str]:
    """Which of our shares lie among the published ones."""
    for one in columns:
        if one.name in MAIN or len(columns) == 1 or one.name not in ("all", "sport", "dance", "other"):
            inside, outside = [], []
            for group in GROUPS:
                published = [ratio for known in PUBLISHED if (ratio := known.hiding[group].ratio) is not None]
                ratio = one.hiding[group].ratio
                if ratio is not None:
                    shown = f"{group} {100 * ratio:.0f} %"
                    low, high = min(published), max(published)
                    if low <= ratio <= high:
                        inside.append(shown)
                    else:
                        outside.append(f"{shown} (published {100 * low:.0f} to {100 * high:.0f} %)")
            yield (
                f"{one.name}: hidden within the published range: {', '.join(inside) or 'none'}; "
                f"outside: {', '.join(outside) or 'none'}."
            )


def _panel(measure: str, columns: Sequence[Column], field: str, factor: float) -> BarPanel:
    """All of ours, or the only one, between UNOC and Talking With Hands."""
    ours = columns[-len(PUBLISHED) - 1]
    series = [ours, *PUBLISHED[:2]]
    heights = [[getattr(one.hiding[group], field) for group in GROUPS] for one in series]
    names = (ours.name, *(f"{one.name} (published)" for one in PUBLISHED[:2]))
    bars = [
        plain_bars(name, [None if value is None else factor * value for value in row])
        for name, row in zip(names, heights, strict=True)
    ]
    return BarPanel(measure.partition(",")[0], GROUPS, tuple(bars), measure)


def occlusion_table(clips: Iterable[Clip], camera: HeadsetCamera = HeadsetCamera()) -> tuple[Table, dict[str, float]]:
    """UNOC, Table 1: a column a category, then all, then the published ones; and the numbers of ours."""
    from rich.table import Table

    from bodysense.lab.unoc import occlusion_statistics as statistics

    ours = columns_of(count_clips(clips, 1, lambda clip: None, camera)[0])
    header, rows = statistics.table([*ours, *statistics.PUBLISHED])
    shown = Table(title="Occlusion and contact (UNOC, Table 1; the last columns are published)")
    for name in header:
        shown.add_column(name, justify="left" if name == header[0] else "right")
    for row in rows:
        shown.add_row(*row)
    return shown, numbers_of(ours)
