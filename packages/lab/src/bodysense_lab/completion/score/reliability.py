"""Reliability diagram of `evaluate completion`: expected against true errors, by sensor set."""

from __future__ import annotations

from pathlib import Path

from bodysense.files import written_beside
from bodysense_lab.completion.score.measures import REGIONS
from bodysense_lab.completion.score.tables import CompletionTable
from bodysense_lab.core.chart import COLORS, INK, MUTED, load_pyplot

_COLUMNS = 4
_RANGE, _TICKS = (0.1, 60.0), (0.1, 1, 10)  # cm


def draw_reliability(path: str | Path, table: CompletionTable) -> None:
    """Write a PNG of expected and true errors of untracked joints, by region, over all bodies."""
    pyplot = load_pyplot()
    sets = table.settings.sets
    rows = -(-len(sets) // _COLUMNS)
    columns = min(_COLUMNS, len(sets))
    size = (2.9 * columns + 0.4, 3.0 * rows + 0.7)
    figure, axes = pyplot.subplots(rows, columns, squeeze=False, figsize=size, layout="constrained")
    for axis in axes.flat[len(sets) :]:
        axis.axis("off")
    for axis, name in zip(axes.flat, sets, strict=False):
        axis.plot(_RANGE, _RANGE, color=MUTED, linewidth=1.0)
        for region, color in zip(REGIONS, COLORS, strict=False):
            expected, error = table.calibration(name, region=region).curve()
            axis.plot(100 * expected, 100 * error, marker="o", markersize=2.5, color=color, label=f"{region} body")
        whole = table.calibration(name)
        axis.set_title(name.replace("_", " "), loc="left", fontsize=10, color=INK)
        note = f"ECE {whole.ece:.3f}\n{whole.coverage:.0%} within 90 %"
        axis.text(0.05, 0.95, note, transform=axis.transAxes, va="top", fontsize=8, color=INK)
        axis.set(xscale="log", yscale="log", xlim=_RANGE, ylim=_RANGE, aspect="equal")
        for set_ticks in (axis.set_xticks, axis.set_yticks):
            set_ticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
        axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].legend(loc="lower right", frameon=False, fontsize=8)
    figure.supxlabel("expected error, cm", fontsize=10)
    figure.supylabel("mean true error, cm", fontsize=10)
    with written_beside(path) as beside:
        figure.savefig(beside, dpi=130)
    pyplot.close(figure)
