"""The exported file is the network: the same bodies as PyTorch's, under the measured head."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense_lab.papers.hmd_vae.body_vae import BodyVaeModel, load_body_vae
from bodysense_lab.papers.hmd_vae.body_windows import make_batch
from bodysense_lab.papers.hmd_vae.export import InWorld, write_vae_onnx
from bodysense_lab.papers.hmd_vae.frames import BodyFrames, read_body_frames
from bodysense_lab.papers.hmd_vae.network import BodyVae, read_vae
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig, Model

Window = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def frames(waving_clip: Clip) -> BodyFrames:
    return read_body_frames([waving_clip])


def window(model: BodyVaeModel, frames: BodyFrames, last: int) -> Window:
    """Inputs of the network, and the rest offsets."""
    joints = [BODY.index(name) for name in model.card["reads"]]
    part = slice(last + 1 - model.frames, last + 1)
    return frames.position[part][:, joints], frames.rotation[part][:, joints], frames.rest_offset[0]


@pytest.mark.parametrize("trust", [0.0, 0.4, 1.0])
def test_the_file_is_the_network(small_vae: Path, frames: BodyFrames, trust: float) -> None:
    agree(load_body_vae(small_vae), read_vae(small_vae.with_suffix(".pt"))[0], frames, trust)


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1])
def test_the_other_models_files_are_theirs(tmp_path: Path, frames: BodyFrames, which: Model) -> None:
    torch.manual_seed(3)
    network = BodyVae(BodyVaeConfig(model=which, latent=4, width=16)).eval()
    write_vae_onnx(network, tmp_path / "net.onnx", {"expected_error": [0.05] * 22})
    agree(load_body_vae(tmp_path / "net.onnx"), network, frames, 1.0, 10)  # its weights are stored in bytes


def agree(model: BodyVaeModel, network: BodyVae, frames: BodyFrames, trust: float, times: float = 1) -> None:
    """Check that file and network give the same body for a window and noise, to `times` 0.1 mm and 0.06°."""
    position, rotation, offset = window(model, frames, 40)
    noise = np.random.default_rng(0).standard_normal(model.latent)
    root, local = model.body(position, rotation, trust, noise, offset)
    given = (position, rotation, np.array([trust]), noise, offset)
    with torch.no_grad():
        wanted = InWorld(network)(*(torch.tensor(value[None], dtype=torch.float32) for value in given))
    np.testing.assert_allclose(root, wanted[0][0].numpy(), atol=1e-4 * times)
    assert geodesic_angle(local, wanted[1][0].double().numpy()).max() < 1e-3 * times


def test_the_exported_mean_equals_that_of_validation(small_vae: Path, frames: BodyFrames) -> None:
    model = load_body_vae(small_vae)
    network, _ = read_vae(small_vae.with_suffix(".pt"))
    windows = frames.windows(model.frames)
    batch = make_batch(network.config, frames, windows, np.array([5]))
    with torch.no_grad():
        body = network.decode(network.posterior(batch.seen, batch.rest_offset)[0], batch.rest_offset)
    last = int(windows.frames([5])[0, -1])
    _, local = model.body(*window(model, frames, last)[:2], 1.0, np.zeros(model.latent), frames.rest_offset[0])
    assert geodesic_angle(local[1:], body.local[0, 1:].double().numpy()).max() < 1e-3


def test_the_world_may_turn(small_vae: Path, frames: BodyFrames) -> None:
    model = load_body_vae(small_vae)
    position, rotation, offset = (value.astype(float) for value in window(model, frames, 60))
    turn, shift = quaternion_exp(np.array([0.0, 2.0, 0.0])), np.array([3.0, 0.0, -1.0])
    noise = np.zeros(model.latent)
    root, local = model.body(position, rotation, 1.0, noise, offset)
    moved = quaternion_rotate(np.broadcast_to(turn, rotation.shape), position) + shift
    turned = quaternion_multiply(np.broadcast_to(turn, rotation.shape), rotation)
    other_root, other_local = model.body(moved, turned, 1.0, noise, offset)
    np.testing.assert_allclose(other_root, quaternion_rotate(turn, root) + shift, atol=1e-4)
    assert geodesic_angle(other_local[0], quaternion_multiply(turn, local[0])) < 1e-3
    assert geodesic_angle(other_local[1:], local[1:]).max() < 1e-3


def test_a_pelvis_is_not_tracked_by_a_device(tmp_path: Path) -> None:
    config = replace(BodyVaeConfig(latent=4, width=16, sequence_width=8), origin="pelvis")
    with pytest.raises(BodysenseError, match="needs to know where the pelvis is, which no headset does"):
        write_vae_onnx(BodyVae(config), tmp_path / "net.onnx", {})
    assert not list(tmp_path.iterdir())
