"""Figure 4: a row of bodies a network under the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from bodysense.body.pose import forward_kinematics
from bodysense.cli import main
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.papers.hmd_vae.figure import draw_reconstructions, frames_within, mean_errors, row_label


def test_bodies_are_coloured_by_their_error(short_clip: Clip, tmp_path: Path) -> None:
    true = np.asarray(forward_kinematics(short_clip.pose)[0])
    rows = {"same": true, "off": true + np.array([0.2, 0, 0])}
    assert mean_errors(short_clip, rows) == pytest.approx({"same": 0.0, "off": 20.0})
    colours = []
    for row, position in rows.items():
        draw_reconstructions(tmp_path / "one.png", short_clip, {row: position})
        picture = imread(tmp_path / "one.png")[:, :-200, :3]  # without the scale
        half = picture[len(picture) // 2 :]
        colours.append(half[np.ptp(half, axis=-1) > 0.2].mean(axis=0))
    assert np.abs(colours[0] - colours[1]).max() > 0.2


def test_a_span_of_the_motion_is_drawn_and_scored(short_clip: Clip) -> None:
    frames = frames_within(short_clip, (0.2, 0.5))
    assert (frames[0], frames[-1], len(frames)) == (6, 15, 10)
    np.testing.assert_array_equal(frames_within(short_clip, None), np.arange(20))
    true = np.asarray(forward_kinematics(short_clip.pose)[0])
    off = true + np.where(np.arange(20) < 10, 0.1, 0.3)[:, None, None] * [1.0, 0, 0]
    assert mean_errors(short_clip, {"off": off}, (0.0, 0.25)) == pytest.approx({"off": 10.0})
    assert mean_errors(short_clip, {"off": off}, (0.4, 0.6)) == pytest.approx({"off": 30.0})
    for span in ((0.5, 0.2), (-1.0, 0.2), (0.1, 9.0)):
        with pytest.raises(BodysenseError, match=r"--span .*: give two seconds of the motion, from 0 to 0\.66, "):
            frames_within(short_clip, span)
    assert len(frames_within(short_clip, (0.0, 0.66))) == 20, "what the message offers is accepted"


def test_names_of_a_sweep_are_broken_into_lines() -> None:
    assert row_label("model1-beta0.01-latent30-blocks3") == "model1\nbeta0.01\nlatent30\nblocks3"
    assert max(map(len, row_label("a name that is rather long").splitlines())) <= 12


def test_the_command_draws_the_packaged_model(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = motion.with_name("figure4.webp")
    assert main(["evaluate", "hmd-vae-figure4", str(motion), "--span", "0.1", "0.5", "-o", str(out)]) == 0
    assert "model 4: " in capsys.readouterr().out
    assert imread(out).std() > 0.01
    assert main(["evaluate", "hmd-vae-figure4", str(motion), "-o", str(motion.with_name("x.bvh"))]) == 2
