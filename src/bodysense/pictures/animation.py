"""Animations of a body as animated WebP, which every browser plays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.surface import fit_surface
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.pictures.camera import FollowingCamera
from bodysense.pictures.painter import BodyPainter


def draw_pose(pose: Pose, camera: FollowingCamera) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of a posed body (T, …). Raises BodysenseError unless the camera has T frames."""
    if len(pose.root_position) != len(camera):
        raise BodysenseError(f"a camera of {len(camera)} frames cannot show {len(pose.root_position)}; frame it anew")
    painter = BodyPainter(camera)
    for frame, mesh in enumerate(fit_surface(pose.skeleton).placed(pose)):
        yield painter.draw(mesh, camera.eye(frame))


def write_animation(path: str | Path, pose: Pose, camera: FollowingCamera, rate: float) -> None:
    """Write a posed body (T, …) at `rate` Hz as an animated WebP that repeats for ever."""
    write_pictures(path, draw_pose(pose, camera), rate)


def write_pictures(path: str | Path, drawn: Iterable[np.ndarray], rate: float) -> None:
    """Write pictures (H, W, 3) uint8 at `rate` Hz as an animated WebP that repeats for ever."""
    from PIL import Image, features

    if not features.check("webp"):
        raise BodysenseError(f"{path}: this Pillow writes no WebP; pip install --force-reinstall pillow")
    pictures = [Image.fromarray(picture) for picture in drawn]
    # Whole milliseconds, rounded so that errors do not add up.
    ends = np.round(1000 * np.arange(len(pictures) + 1) / rate).astype(int)
    with written_beside(path) as beside:
        pictures[0].save(
            beside,
            format="WEBP",
            save_all=True,
            append_images=pictures[1:],
            duration=np.diff(ends).tolist(),
            loop=0,
            quality=76,
            method=2,
        )
