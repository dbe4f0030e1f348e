"""Charts: lines, and groups of bars with errors (as in UNOC's Fig. 6) or next to published figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import missing_package
from bodysense.files import written_beside

INK, MUTED = "#22303c", "#b8c2cc"
COLORS = ("#5b7fa6", "#1b7f79", "#c98a2b")


@dataclass(frozen=True)
class Bars:
    """Bars of one colour, one in each of G groups."""

    label: str
    height: np.ndarray  # (G,); NaN: no bar
    error: np.ndarray  # (G,) drawn up and down; NaN: no error bar
    mark: tuple[str, ...]  # (G,) text beyond the error bar


@dataclass(frozen=True)
class BarPanel:
    """One row of a chart with groups of bars."""

    title: str
    groups: tuple[str, ...]
    series: tuple[Bars, ...]  # up to three
    measure: str  # label of the vertical axis


@dataclass(frozen=True)
class Line:
    """One line of a chart."""

    label: str
    x: np.ndarray  # (N,)
    y: np.ndarray  # (N,)


@dataclass(frozen=True)
class LinePanel:
    """One row of a chart with lines and their legend."""

    title: str
    lines: tuple[Line, ...]
    over: str  # label of the horizontal axis
    measure: str  # label of the vertical axis


Panel = BarPanel | LinePanel


def plain_bars(label: str, heights: Sequence[float | None]) -> Bars:
    """Return bars without errors and marks; None: no bar."""
    height = np.array([np.nan if one is None else one for one in heights], dtype=float)
    return Bars(label, height, np.full(len(height), np.nan), ("",) * len(height))


def load_pyplot() -> Any:
    """Return Matplotlib's pyplot, set to draw into files. Raises BodysenseError if it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        raise missing_package(error) from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def draw_panels(path: str | Path, panels: Sequence[Panel], title: str) -> None:
    """Draw panels one below the other into a PNG file; panels of bars share a legend."""
    pyplot = load_pyplot()
    widest = max((len(panel.groups) for panel in panels if isinstance(panel, BarPanel)), default=0)
    size = (max(6.5, 0.9 * widest + 1.5), 0.7 + 2.6 * len(panels))
    figure, axes = pyplot.subplots(len(panels), squeeze=False, figsize=size, layout="constrained")
    lines = [line.label for panel in panels if isinstance(panel, LinePanel) for line in panel.lines]
    style = {label: k for k, label in enumerate(dict.fromkeys(lines))}  # the same in every panel
    for axis, panel in zip(axes[:, 0], panels, strict=True):
        if isinstance(panel, LinePanel):
            _draw_lines(axis, panel, style)
            continue
        _draw(axis, panel)
        axis.margins(y=0.12)
        axis.set_xlim(-0.6, max(len(panel.groups), 4) - 0.4)  # keeps the bars of a single group narrow
    legend: dict[str, Any] = {}
    for axis, panel in zip(axes[:, 0], panels, strict=True):
        if isinstance(panel, LinePanel):
            continue
        handles, labels = axis.get_legend_handles_labels()
        legend |= dict(zip(labels, handles, strict=True))
    if legend:
        figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=len(legend), frameon=False)
    figure.suptitle(title, fontsize=12, color=INK)
    with written_beside(path) as beside:
        figure.savefig(beside, dpi=130)
    pyplot.close(figure)


def _draw(axis: Any, panel: BarPanel) -> None:
    """Draw bars, their errors and marks, and the names of the groups."""
    place, width = np.arange(len(panel.groups)), 0.8 / len(panel.series)
    for k, bars in enumerate(panel.series):
        x = place + (k - (len(panel.series) - 1) / 2) * width
        axis.bar(x, bars.height, 0.9 * width, color=COLORS[k], label=bars.label)
        error = np.nan_to_num(bars.error)
        axis.errorbar(x, bars.height, error, fmt="none", ecolor=INK, elinewidth=1, capsize=2.5 * bool(error.any()))
        for at, height, reach, mark in zip(x, bars.height, error, bars.mark, strict=True):
            up = height >= 0
            axis.annotate(
                mark,
                (at, height + (reach if up else -reach)),
                (0, 1 if up else -1),
                textcoords="offset points",
                ha="center",
                va="bottom" if up else "top",
                color=INK,
            )
    axis.axhline(0, color=INK, linewidth=0.8)
    axis.set_xticks(place, panel.groups, rotation=25 if max(map(len, panel.groups)) > 9 else 0)
    _style_axis(axis, panel)


def _draw_lines(axis: Any, panel: LinePanel, style: Mapping[str, int]) -> None:
    for line in panel.lines:
        dashes, color = divmod(style[line.label], len(COLORS))
        axis.plot(line.x, line.y, ("-", "--", ":")[dashes % 3], color=COLORS[color], linewidth=1.5, label=line.label)
    axis.set_xlabel(panel.over)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    _style_axis(axis, panel)


def _style_axis(axis: Any, panel: Panel) -> None:
    axis.set_ylabel(panel.measure)
    axis.set_title(panel.title, loc="left", fontsize=11)
    axis.grid(axis="y", color=MUTED, linewidth=0.4)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
