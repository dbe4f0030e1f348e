"""Sheets of stick figures (PNG)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside

INK, MUTED = "#22303c", "#b8c2cc"


def draw_sheet(path: str | Path, skeleton: Skeleton, position: np.ndarray, columns: int = 6) -> None:
    """A PNG of bodies (N, P, 3) m in rows."""
    pyplot = load_pyplot()
    width, height = 1.6, 2.3
    columns = min(columns, len(position))
    rows = -(-len(position) // columns)
    figure, axis = pyplot.subplots(figsize=(1.6 * columns, 2.3 * rows))
    for body in range(len(position)):
        row, column = divmod(body, columns)
        _draw(axis, skeleton, position[body], (column * width, (rows - 1 - row) * height))
    axis.set_xlim(-0.55 * width, (columns - 0.45) * width)
    axis.set_ylim(-0.1, rows * height)
    _bare(axis)
    with written_beside(path) as beside:
        figure.savefig(beside, dpi=100, bbox_inches="tight", pad_inches=0.1)
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


def _draw(axis: Any, skeleton: Skeleton, position: np.ndarray, place: tuple[float, float]) -> None:
    """One body (P, 3) m at a place of the picture, seen from its front left, a little from above."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Circle

    center = position[0] * np.array([1.0, 0.0, 1.0])
    across, up, near = _view(position - center, _facing(skeleton, position))
    drawn = np.stack([across, up], axis=-1) + np.array(place)
    bones = sorted(range(1, len(position)), key=lambda point: near[point])
    axis.add_collection(
        LineCollection(
            [drawn[[point, skeleton.parents[point]]] for point in bones],
            colors=INK,
            linewidths=[1.0 if skeleton.wrist_of[point] >= 0 else 3.0 for point in bones],
            capstyle="round",
        )
    )
    head, top = skeleton.index("head"), skeleton.index("head_top")
    middle = (drawn[head] + drawn[top]) / 2
    axis.add_patch(Circle(tuple(middle), 0.1, facecolor="white", edgecolor=INK, linewidth=2.2, zorder=5))
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
