"""UNOC's Figures 5 and 7: which frames and hands are drawn, their errors, and what is red."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.io.clip import Clip
from bodysense.pictures.camera import Lens
from bodysense_lab.core.scoring import scored_points
from bodysense_lab.papers.unoc.figures import (
    Completions,
    Example,
    draw_figure_5,
    draw_figure_7,
    finger_error,
    most_bent,
    most_hidden,
)

from ...conftest import Command, Refused

LENS = Lens(width=60, height=80)


def reds(picture: np.ndarray) -> int:
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 1.9 * green) & (red > 1.9 * blue)).sum())


def fist(pose: Pose, frame: int, side: str, angle: float) -> Pose:
    """Bend every joint of a hand in a frame."""
    skeleton, rotation = pose.skeleton, pose.rotation.copy()
    joints = np.flatnonzero(skeleton.wrist_of[: len(skeleton.joints)] == skeleton.index(f"{side}_wrist"))
    rotation[frame, joints] = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
    return Pose(skeleton, pose.root_position, rotation)


@pytest.fixture
def found(short_clip: Clip) -> Completions:
    position, _ = forward_kinematics(short_clip.pose)
    seen = np.ones(position.shape[:2], dtype=bool)
    seen[:, short_clip.pose.skeleton.index("left_knee")] = False
    off = {"last known": position + np.array([0.3, 0, 0]), "network": position + np.array([0, 0.1, 0])}
    return Completions(short_clip, seen, off, short_clip.pose)


def test_each_part_gives_the_frame_in_which_most_is_hidden() -> None:
    seen = np.ones((30, 7), dtype=bool)
    for frame, count in ((4, 2), (7, 5), (13, 1), (22, 7), (29, 3)):
        seen[frame, :count] = False
    assert most_hidden(seen, 3) == [7, 13, 22]
    assert most_hidden(seen[:2], 5) == [0, 1], "a motion of two frames has two parts"


def test_errors_are_of_hidden_joints_of_the_body(found: Completions) -> None:
    assert found.errors() == pytest.approx({"last known": 30.0, "network": 10.0, "inverse kinematics": 0.0})
    everything = replace(found, seen=np.ones_like(found.seen))
    assert set(everything.errors().values()) == {0.0}, "nothing is hidden"
    skeleton = found.truth.pose.skeleton
    moved = found.position["network"].copy()
    moved[:, [p for p in range(len(skeleton.points)) if p not in scored_points(skeleton)]] += 1.0
    assert replace(found, position={"network": moved}).errors()["network"] == pytest.approx(10.0)


def test_figure_5_has_a_column_for_each_method_and_reddens_what_is_hidden(found: Completions) -> None:
    picture = draw_figure_5(found, [0, 9, 19], LENS)
    assert picture.shape[1] == 4 * LENS.width and (picture.shape[0] - 3 * LENS.height) < LENS.height
    columns = np.split(picture, 4, axis=1)
    assert all(reds(column) > 20 for column in columns)
    seen = draw_figure_5(replace(found, seen=np.ones_like(found.seen)), [0, 9, 19], LENS)
    assert reds(seen) == 0
    assert (columns[1] != columns[2]).any() and (columns[0] != columns[3]).any()


def test_examples_are_the_hands_that_are_bent_most(short_clip: Clip) -> None:
    pose = fist(fist(short_clip.pose, 3, "right", 1.0), 15, "left", 1.5)
    assert most_bent(replace(short_clip, pose=pose), 2) == [Example(3, "right"), Example(15, "left")]


def test_figure_7_shows_both_hands_of_an_example_and_their_error(short_clip: Clip) -> None:
    truth, other = short_clip.pose, fist(short_clip.pose, 3, "right", 1.2)
    assert finger_error(short_clip, short_clip) == 0.0 < finger_error(short_clip, replace(short_clip, pose=other))
    same = draw_figure_7(truth, truth, [Example(3, "right")])
    bent, elsewhere = (draw_figure_7(truth, other, [Example(3, side)]) for side in ("right", "left"))
    half = len(same) // 2
    assert (bent[half:] != same[half:]).any(), "the predicted hand is below"
    np.testing.assert_array_equal(bent[:half], same[:half])
    np.testing.assert_array_equal(elsewhere, draw_figure_7(truth, truth, [Example(3, "left")]))


def test_the_commands_write_pictures(motion: Path, tmp_path: Path, run: Command, refused: Refused) -> None:
    text = run("evaluate", "unoc-figure5", motion, "-o", tmp_path / "five.webp", "--moments", 2)
    assert "last known: " in text and "inverse kinematics: " in text
    text = run("evaluate", "unoc-figure7", motion, "-o", tmp_path / "seven.png", "--moments", 1)
    assert "fingers: " in text
    for name in ("five.webp", "seven.png"):
        with Image.open(tmp_path / name) as picture:
            assert min(picture.size) > 200
    line = refused("evaluate", "unoc-figure5", motion, "-o", tmp_path / "five.gif")
    assert "a picture is written as .png or .webp" in line
