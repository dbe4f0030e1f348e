"""PAHMT's Figures 3 and 4: hands alone from windows, frames with raised wrists, and columns of bodies."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.keypoints import ArmKeypoints, arms_from_torso
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.papers.pahmt.camera_view import VIEW_POINTS, view_points
from bodysense_lab.papers.pahmt.features import window_of
from bodysense_lab.papers.pahmt.network import ArmNetwork
from bodysense_lab.papers.pahmt.options import FINGERS, ArmNetworkConfig
from bodysense_lab.rendering.figures import (
    ARMS_AND_HANDS,
    HANDS_ALONE,
    LANDMARKS,
    FilmedTake,
    draw_figure_3,
    draw_figure_4,
    hands_alone,
    pictures_at,
    raised,
)
from bodysense_lab.rendering.take import RenderedTake, plan_takes

from ...conftest import Refused


@pytest.fixture(scope="module")
def take(waving_clip: Clip) -> RenderedTake:
    """A take of two seconds."""
    return plan_takes(waving_clip, 1, 2.0, np.random.default_rng(0))[0][0]


@pytest.fixture(scope="module")
def network() -> ArmNetwork:
    """A small untrained network of hands alone."""
    torch.manual_seed(0)
    return ArmNetwork(ArmNetworkConfig(kind="cnn", input="hands", width=16, layers=1, heads=2)).eval()


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory, take: RenderedTake) -> Path:
    """A video whose pictures become brighter."""
    av = pytest.importorskip("av")
    path = tmp_path_factory.mktemp("film") / "take.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("h264", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(len(take.time)):
            picture = np.full((48, 64, 3), 4 * k, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))
    return path


@pytest.fixture
def film(video: Path, take: RenderedTake) -> FilmedTake:
    truth = arms_from_torso(take.pose)
    bent = truth.copy()
    bent[..., 2, :] = [np.cos(0.6), 0.0, np.sin(0.6), 0.0]  # the left forearm
    return FilmedTake(video, take, {ARMS_AND_HANDS: truth, LANDMARKS: bent, HANDS_ALONE: bent})


def test_hands_alone_are_predicted_in_the_middle_of_windows(take: RenderedTake, network: ArmNetwork) -> None:
    keypoints = take.keypoints()
    found = hands_alone(keypoints, network)
    assert found.shape == (len(take.time), len(FINGERS), 4)
    for start in (0, 8, 28):  # the last one ends with the video
        window = ArmKeypoints(**{name: value[None, start : start + 32] for name, value in vars(keypoints).items()})
        with torch.no_grad():
            alone = network.quaternions(network(window_of(window)))[0].numpy()
        middle = {0: slice(0, 16), 8: slice(16, 24), 28: slice(16, 32)}[start]
        here = found[start + middle.start : start + middle.stop]
        assert np.abs((here * alone[middle]).sum(axis=-1)) == pytest.approx(1.0, abs=1e-5)


def test_other_networks_and_short_videos_are_refused(take: RenderedTake, network: ArmNetwork) -> None:
    with pytest.raises(BodysenseError, match="a video of 20 frames is shorter than the network's window of 32"):
        hands_alone(take.keypoints()[slice(20)], network)
    arms = ArmNetwork(ArmNetworkConfig(kind="cnn", width=16, layers=1, heads=2))
    with pytest.raises(BodysenseError, match="reads arms; train one with `bodysense train arms --input hands`"):
        hands_alone(take.keypoints(), arms)


def test_the_frames_with_the_highest_wrist_are_drawn(take: RenderedTake) -> None:
    height = view_points(take.pose)[:, :, VIEW_POINTS.index("wrist"), 1].max(axis=1)
    first, second = raised(take, 2)
    assert first < 30 <= second
    assert (height[first], height[second]) == (height[:30].max(), height[30:].max())
    assert raised(replace(take, pose=take.pose[:1]), 4) == [0]


def test_pictures_of_frames(video: Path) -> None:
    found = pictures_at(video, [3, 40], (32, 24))
    assert {frame: one.shape for frame, one in found.items()} == {3: (24, 32, 3), 40: (24, 32, 3)}
    assert found[3].mean() == pytest.approx(12, abs=6) and found[40].mean() == pytest.approx(160, abs=6)


def test_figures_have_a_row_for_each_moment_and_a_column_for_each_method(film: FilmedTake) -> None:
    three, four = draw_figure_3([film], 2), draw_figure_4([film, film], 1)
    assert three.shape == (34 + 2 * 240, 320 + 4 * 220, 3) and four.shape == (34 + 2 * 240, 320 + 3 * 220, 3)
    landmarks, network, truth = np.split(four[34:, 320:], 3, axis=1)
    np.testing.assert_array_equal(network, truth)
    assert (landmarks != truth).any()


def test_wrists_are_straight_in_the_last_two_columns_of_figure_3(film: FilmedTake) -> None:
    turned = {name: one.copy() for name, one in film.rotation.items()}
    for one in turned.values():
        one[:, [3, 22]] = [np.cos(0.7), 0.0, 0.0, np.sin(0.7)]  # both wrists
    before, after = (draw_figure_3([one], 1)[34:, 320:] for one in (film, replace(film, rotation=turned)))
    for k, is_same in enumerate((False, False, True, True)):
        column = slice(220 * k, 220 * (k + 1))
        assert np.array_equal(before[:, column], after[:, column]) == is_same


def test_errors_of_a_film(film: FilmedTake) -> None:
    assert film.errors(ARMS_AND_HANDS)["arms_deg"] == pytest.approx(0, abs=1e-3)
    assert film.errors(LANDMARKS)["arms_deg"] > 1 and film.errors(LANDMARKS)["hands_cm"] == pytest.approx(0, abs=1e-6)


def test_the_commands_refuse_other_pictures_and_folders(tmp_path: Path, refused: Refused) -> None:
    for command in ("pahmt-figure3", "pahmt-figure4"):
        hands = ("--hands", tmp_path / "none.pt") if command.endswith("3") else ()
        assert "a picture is written as .png or .webp" in refused(
            "evaluate", command, tmp_path, *hands, "-o", tmp_path / "three.gif"
        )
        assert not list(tmp_path.iterdir())
