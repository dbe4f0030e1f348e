"""HMD-VAE's Figure 4: one motion by several models under the truth, bodies coloured by the error of their joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError, missing_package
from bodysense.files import written_beside
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.quality.metrics import joint_error
from bodysense.sources.open import MotionSource
from bodysense_lab.papers.hmd_vae.system import complete
from bodysense_lab.papers.paper_options import PaperOptions

INK = "#22303c"
COLUMNS = 8  # frames of the motion
WORST = 30.0  # cm: the end of the colour scale
_WIDTH, _HEIGHT = 1.3, 2.1  # m of one body's cell
_LETTERS = 12  # in a line of a row's name
_SIDE = np.array([0.87, 0.0, 0.5])  # the picture's horizontal in the frame of the first body: seen from the front right


def reconstructed(clip: Clip, networks: Mapping[str, Path | None]) -> dict[str, np.ndarray]:
    """Return positions (T, P, 3) m of a motion by every network; None is the packaged one."""
    opened = MotionSource(clip.name, given=clip)
    clips = {name: complete(opened, PaperOptions(networks=path)) for name, path in networks.items()}
    return {name: np.asarray(forward_kinematics(one.pose)[0]) for name, one in clips.items()}


def load_pyplot() -> Any:
    """Return Matplotlib's pyplot, set to draw into files. Raises BodysenseError if it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        raise missing_package(error) from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def frames_within(clip: Clip, span: tuple[float, float] | None) -> np.ndarray:
    """Return the indices of the frames from one second of a motion to another; all if `span` is None.

    Raises BodysenseError unless the span begins before it ends, and is within the motion.
    """
    first, last = (0.0, clip.seconds) if span is None else span
    if not 0 <= first < last <= clip.seconds:
        raise BodysenseError(
            f"--span {first:g} {last:g}: give two seconds of the motion, from 0 to "
            f"{np.floor(100 * clip.seconds) / 100:g}, the earlier one first"
        )
    return np.flatnonzero((clip.time >= first) & (clip.time <= last))


def draw_reconstructions(
    path: Path, truth: Clip, rows: Mapping[str, np.ndarray], span: tuple[float, float] | None = None
) -> None:
    """Draw the truth and below it each row (T, P, 3) m, at frames that are spread evenly over the motion.

    `span` is the first and last second that is drawn. Raises BodysenseError for one beyond the motion.
    """
    pyplot = load_pyplot()
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    skeleton = truth.pose.skeleton
    true = np.asarray(forward_kinematics(truth.pose)[0])
    within = frames_within(truth, span)
    frames = within[np.linspace(0, len(within) - 1, min(COLUMNS, len(within))).round().astype(int)]
    scale = ScalarMappable(Normalize(0, WORST), "viridis_r")
    figure, axis = pyplot.subplots(figsize=(1.3 * len(frames) + 2.3, 2.0 * (len(rows) + 1)))
    bones = [point for point in range(1, len(skeleton.points)) if skeleton.wrist_of[point] < 0]
    lowest = 0.0
    for row, (name, position) in enumerate({"truth": true, **rows}.items()):
        base = (len(rows) - row) * _HEIGHT
        axis.text(-0.6 * _WIDTH, base + 1, row_label(name), va="center", ha="right", color=INK)
        for column, frame in enumerate(frames):
            drawn = _flat(truth, position[frame], int(frame)) + np.array([column * _WIDTH, base])
            lowest = min(lowest, drawn[:, 1].min())
            error = joint_error(position[frame], true[frame])
            ends = [[point, skeleton.parents[point]] for point in bones]
            colours = INK if row == 0 else scale.to_rgba(np.array([error[pair].mean() for pair in ends]))
            axis.add_collection(LineCollection(list(drawn[ends]), colors=colours, linewidths=4.0, capstyle="round"))
    axis.set_xlim(-2 * _WIDTH, len(frames) * _WIDTH)
    axis.set_ylim(lowest - 0.1, (len(rows) + 1) * _HEIGHT)
    axis.set_aspect("equal")
    axis.axis("off")
    figure.colorbar(scale, ax=axis, label="error of joints, cm", shrink=0.5)
    with written_beside(path) as beside:
        figure.savefig(beside, dpi=110, bbox_inches="tight")
    pyplot.close(figure)


def row_label(name: str) -> str:
    """Return a network's name in lines that are as narrow as the margin."""
    return "\n".join(fill(part, _LETTERS) for part in name.split("-"))


def mean_errors(
    truth: Clip, rows: Mapping[str, np.ndarray], span: tuple[float, float] | None = None
) -> dict[str, float]:
    """Return the mean error of body joints in cm by row, from the first to the last second of `span`."""
    true, within = np.asarray(forward_kinematics(truth.pose)[0]), frames_within(truth, span)
    body = np.flatnonzero(truth.pose.skeleton.wrist_of < 0)
    return {name: float(joint_error(position, true)[within][:, body].mean()) for name, position in rows.items()}


def _flat(truth: Clip, position: np.ndarray, frame: int) -> np.ndarray:
    """Points (P, 2) m of a picture that stands on the floor under the true pelvis."""
    front = quaternion_conjugate(heading(np.asarray(truth.pose.rotation)[0, 0]))
    offset = position - np.asarray(truth.pose.root_position)[frame] * [1.0, 0.0, 1.0]
    turned = np.asarray(quaternion_rotate(np.broadcast_to(front, (len(offset), 4)), offset))
    return np.stack([turned @ _SIDE, turned[:, 1]], axis=-1)
