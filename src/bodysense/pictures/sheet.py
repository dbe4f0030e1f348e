"""Sheets of bodies (PNG)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.files import written_beside
from bodysense.pictures.animation import draw_pose
from bodysense.pictures.camera import Lens, follow_body

_LENS = Lens(width=144, height=207, view_height=2.3)


def draw_sheet(path: str | Path, pose: Pose) -> None:
    """Write a PNG of bodies (N, …) in rows of six, each from its front left."""
    from PIL import Image

    pictures = []
    for k in range(len(pose.root_position)):
        body = pose[k : k + 1]
        camera = replace(follow_body(body, 1.0, _LENS), follow=np.asarray(body.root_position)[:, [0, 2]])
        pictures += draw_pose(body, camera)
    columns = min(6, len(pictures))
    pictures += [np.full_like(pictures[0], 255)] * (-len(pictures) % columns)
    rows = [np.concatenate(pictures[first : first + columns], axis=1) for first in range(0, len(pictures), columns)]
    with written_beside(path) as beside:
        Image.fromarray(np.concatenate(rows)).save(beside)
