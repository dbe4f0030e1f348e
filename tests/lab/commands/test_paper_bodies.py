"""HMD-VAE's commands, as their users call them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh
from bodysense.io.formats.recording import Recording
from bodysense_lab.commands.paper_bodies import write_samples


@pytest.mark.slow
def test_bodies_from_the_prior(run, small_vae: Path, tmp_path: Path) -> None:
    for name in ("bodies.bvh", "bodies.png"):
        output = run("papers", "generate", "-o", tmp_path / name, "--network", small_vae, "--count", 5, "--seed", 2)
        assert output == f"wrote {tmp_path / name}: 5 bodies\n"
    sheet = read_bvh(tmp_path / "bodies.bvh")
    assert len(sheet) == 5
    assert (tmp_path / "bodies.png").read_bytes().startswith(b"\x89PNG")
    run("papers", "generate", "-o", tmp_path / "again.bvh", "--network", small_vae, "--count", 5, "--seed", 2)
    np.testing.assert_array_equal(read_bvh(tmp_path / "again.bvh").pose.rotation, sheet.pose.rotation)
    run("papers", "generate", "-o", tmp_path / "other.bvh", "--network", small_vae, "--count", 5, "--seed", 3)
    assert not np.allclose(read_bvh(tmp_path / "other.bvh").pose.rotation, sheet.pose.rotation)


@pytest.mark.slow
def test_invalid_arguments_of_generate_are_refused(refused, small_vae: Path, tmp_path: Path) -> None:
    output = refused("papers", "generate", "-o", tmp_path / "bodies.txt", "--network", small_vae)
    assert output.endswith("bodies.txt: the output ends in '.txt'; valid are .png and .bvh")
    output = refused("papers", "generate", "-o", tmp_path / "bodies.bvh", "--network", small_vae, "--count", 0)
    assert output == "--count 0: give a whole number, 1 to 1000"
    assert "no such model file" in refused(
        "papers", "generate", "-o", tmp_path / "a.bvh", "--network", tmp_path / "gone.onnx"
    )


@pytest.mark.slow
def test_samples_are_of_head_and_hands(small_vae: Path, tmp_path: Path, short_clip: Clip) -> None:
    recording = Recording(observe(short_clip.pose, short_clip.time, HEADSET_CAMERA), short_clip.pose.skeleton)
    with pytest.raises(BodysenseError, match=r"papers sample draws from head and hands .*'pelvis' is tracked too"):
        write_samples(recording, tmp_path / "out.bvh", 2, 1, small_vae)
