"""A film of the packaged performance, as a webcam would give it: rendered, MJPEG."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np

from bodysense.demo import packaged_performance
from bodysense.lab.rendering.figure import load_figure
from bodysense.lab.rendering.scene import sample_scene
from bodysense.lab.rendering.stage import open_stage
from bodysense.occlusion.camera_view import Camera

RATE, SECONDS = 15, 4


def film(path: Path) -> Path:
    """Write the film."""
    import av

    clip = packaged_performance()
    step = round(clip.frame_rate / RATE)
    pose = load_figure("woman").wear(clip.pose[: RATE * SECONDS * step : step])
    around = np.median(pose.root_position, axis=0)
    camera = Camera(around + np.array([0.2, 0.15, 2.7]), np.eye(3), np.array(1.0), np.array(4 / 3))
    scene = sample_scene(np.random.default_rng(5), "woman")
    with open_stage(scene, camera, 480, around) as stage, av.open(str(path), "w", format="mjpeg") as container:
        stream = container.add_stream("mjpeg", rate=Fraction(RATE))
        stream.width, stream.height, stream.pix_fmt = *stage.size, "yuvj420p"
        for k in range(len(pose.root_position)):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(stage.draw(pose[k]), format="rgb24")))
        container.mux(stream.encode(None))
    return path
