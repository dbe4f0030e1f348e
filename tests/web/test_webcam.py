"""The page's webcam, fed from a rendered film of the packaged performance."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.camera_view import Camera
from bodysense.io.bvh import read_bvh
from bodysense_lab.rendering.scene import load_figure, sample_scene
from bodysense_lab.rendering.stage import open_stage
from bodysense_live.page_files import WEBCAM

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]

RATE, SECONDS = 15, 4


def film(path: Path) -> Path:
    """Write the film, MJPEG."""
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


Watched = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="module")
def watched(scenario: Scenario, site: Path, tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("webcam")
    missing = [name for name in WEBCAM if not (site / name).is_file()]
    if missing:
        pytest.skip(f"MediaPipe's {missing[0]} is missing: run scripts/build_landmarkers.py, and `npm ci` in web/")
    pytest.importorskip("moderngl", reason="needs packages/lab[render]")
    return folder, scenario("webcam", site, film(folder / "person.mjpeg"), folder / "seen.png")


def test_a_webcam_sees_a_person(watched: Watched) -> None:
    said = watched[1]
    assert int(said["points"]) >= 8
    assert said["nobody"].startswith("Nobody is seen yet")


def test_a_webcams_body_stands_on_the_floor(watched: Watched) -> None:
    clip = read_bvh(watched[0] / "seen.png.bvh")
    position = np.asarray(forward_kinematics(clip.pose)[0])
    ankles = position[:, clip.pose.skeleton.indices(["left_ankle", "right_ankle"]), 1].min(axis=1)
    assert abs(np.median(ankles) - 0.075) < 0.05


def test_a_webcams_picture_is_seen_beside_the_body_and_what_it_waits_for(watched: Watched) -> None:
    small = watched[1]["small"]
    assert small["isShown"] and small["colours"] > 100
    assert [line for line in small["said"] if line.startswith("Loading")] and small["said"][-1].startswith(
        "You are seen"
    )
    assert small["said"].count("The browser asks for the webcam …") == 1  # a second press does nothing
    assert watched[1]["isGone"]
