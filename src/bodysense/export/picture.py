"""Pictures of motion: truth, signal and result side by side, as an animation (GIF) or a strip of moments (PNG)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside

INK, MUTED, HIDDEN, RESULT = "#22303c", "#b8c2cc", "#d62839", "#1b7f79"


@dataclass(frozen=True)
class Panel:
    """One figure of a picture: where points are, and which of them are drawn in red."""

    title: str
    position: np.ndarray  # (T, P, 3) m, world
    hidden: np.ndarray | None = None  # (T, P) bool
    color: str = INK


def draw_strip(path: str | Path, skeleton: Skeleton, panels: list[Panel], time: np.ndarray, moments: int = 7) -> None:
    """A PNG: one row a panel, `moments` evenly spaced frames across."""
    frames = np.linspace(0, len(time) - 1, moments + 2).astype(int)[1:-1]
    pyplot = load_pyplot()
    width, height = 1.15, 2.15
    figure, axis = pyplot.subplots(figsize=(1.3 * moments, 2.5 * len(panels)))
    for row, panel in enumerate(reversed(panels)):
        for column, frame in enumerate(frames):
            _draw(axis, skeleton, panel, int(frame), (column * width, row * height))
        axis.text(-0.55, (row + 1) * height - 0.18, panel.title, fontsize=11, color=panel.color)
    for column, frame in enumerate(frames):
        axis.text(column * width, -0.22, f"{time[frame]:.1f} s", fontsize=9, ha="center", color=INK)
    axis.set_xlim(-0.6, (moments - 0.45) * width)
    axis.set_ylim(-0.3, len(panels) * height)
    _bare(axis)
    with written_beside(path) as beside:
        figure.savefig(beside, dpi=100, bbox_inches="tight", pad_inches=0.1)
    pyplot.close(figure)


def draw_sheet(path: str | Path, skeleton: Skeleton, position: np.ndarray, columns: int = 6) -> None:
    """A PNG of bodies (N, P, 3) m in rows."""
    pyplot = load_pyplot()
    width, height = 1.6, 2.3
    columns = min(columns, len(position))
    rows = -(-len(position) // columns)
    figure, axis = pyplot.subplots(figsize=(1.6 * columns, 2.3 * rows))
    panel = Panel("", position)
    for body in range(len(position)):
        row, column = divmod(body, columns)
        _draw(axis, skeleton, panel, body, (column * width, (rows - 1 - row) * height))
    axis.set_xlim(-0.55 * width, (columns - 0.45) * width)
    axis.set_ylim(-0.1, rows * height)
    _bare(axis)
    with written_beside(path) as beside:
        figure.savefig(beside, dpi=100, bbox_inches="tight", pad_inches=0.1)
    pyplot.close(figure)


def draw_animation(
    path: str | Path, skeleton: Skeleton, panels: list[Panel], time: np.ndarray, rate: float = 8.0
) -> None:
    """A GIF of all panels side by side, at `rate` pictures a second."""
    from matplotlib.animation import PillowWriter

    pyplot = load_pyplot()
    moments = np.arange(time[0], time[-1] + 0.5 / rate, 1 / rate)
    frames = np.minimum(np.searchsorted(time, moments), len(time) - 1)
    width = 1.5
    figure, axis = pyplot.subplots(figsize=(2.1 * len(panels), 3.2))
    figure.subplots_adjust(0, 0, 1, 1)

    def show(frame: int) -> None:
        axis.clear()
        for column, panel in enumerate(panels):
            _draw(axis, skeleton, panel, int(frame), (column * width, 0.0))
            axis.text(column * width, 2.0, panel.title, fontsize=8, ha="center", color=panel.color)
        axis.set_xlim(-width / 2, (len(panels) - 0.5) * width)
        axis.set_ylim(-0.1, 2.15)
        _bare(axis)

    writer = PillowWriter(fps=round(rate))
    with written_beside(path) as beside, writer.saving(figure, str(beside), dpi=72):
        for frame in frames.tolist():
            show(frame)
            writer.grab_frame()
    pyplot.close(figure)


def load_pyplot() -> Any:
    """Matplotlib's pyplot, drawing into files. Raises BodysenseError where it is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise BodysenseError("pictures need matplotlib: pip install matplotlib") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def _bare(axis: Any) -> None:
    """Nothing but the figures."""
    axis.set_aspect("equal")
    axis.axis("off")


def _draw(axis: Any, skeleton: Skeleton, panel: Panel, frame: int, place: tuple[float, float]) -> None:
    """One body at a place of the picture, seen from its front left, a little from above; hidden points red."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Circle

    position = panel.position[frame]
    center = position[0] * np.array([1.0, 0.0, 1.0])
    across, up, near = _view(position - center, _facing(skeleton, position))
    drawn = np.stack([across, up], axis=-1) + np.array(place)
    hidden = np.zeros(len(position), dtype=bool) if panel.hidden is None else panel.hidden[frame]
    bones = sorted(range(1, len(position)), key=lambda point: near[point])
    axis.add_collection(
        LineCollection(
            [drawn[[point, skeleton.parents[point]]] for point in bones],
            colors=[HIDDEN if hidden[point] else panel.color for point in bones],
            linewidths=[1.0 if skeleton.wrist_of[point] >= 0 else 3.0 for point in bones],
            capstyle="round",
        )
    )
    head, top = skeleton.index("head"), skeleton.index("head_top")
    middle = (drawn[head] + drawn[top]) / 2
    axis.add_patch(Circle(tuple(middle), 0.1, facecolor="white", edgecolor=panel.color, linewidth=2.2, zorder=5))
    axis.plot([place[0] - 0.5, place[0] + 0.5], [place[1]] * 2, color=MUTED, linewidth=0.8, zorder=0)


def _facing(skeleton: Skeleton, position: np.ndarray) -> float:
    """Heading of the hips, radians about +Y."""
    left, right = (position[skeleton.index(f"{side}_hip")] for side in ("left", "right"))
    across = left - right
    return float(np.arctan2(-across[2], across[0]))


def _view(position: np.ndarray, facing: float, azimuth: float = 0.5, elevation: float = 0.15) -> tuple[np.ndarray, ...]:
    """Orthographic view: across (to the right of the picture), up, and nearness."""
    turn = facing + azimuth
    # The viewer stands in front of the body: its left is on the picture's right.
    across = position[:, 0] * np.cos(turn) - position[:, 2] * np.sin(turn)
    near = position[:, 0] * np.sin(turn) + position[:, 2] * np.cos(turn)
    up = position[:, 1] * np.cos(elevation) - near * np.sin(elevation)
    return across, up, near
