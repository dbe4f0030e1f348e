"""Fixtures: observations from dictionaries, small untrained networks, and a folder of short motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense_lab.data.datasets import DataSet

from ..conftest import ExportedOnce

Seen = Mapping[str, Sequence[float]]
MakeObservation = Callable[..., Observation]


@pytest.fixture(scope="session")
def make_observation() -> MakeObservation:
    """Return a function that makes an observation from a dictionary of positions for each frame.

    Points that a dictionary lacks are hidden. `turn` has the head's rotation in each frame.
    """

    def make(
        frames: Sequence[Seen], time: Sequence[float], turn: Sequence[Sequence[float]] | None = None
    ) -> Observation:
        points = tuple(dict.fromkeys(["head", *(name for frame in frames for name in frame)]))
        position, rotation = (
            np.full((len(frames), len(points), 3), np.nan),
            np.full((len(frames), len(points), 4), np.nan),
        )
        for t, frame in enumerate(frames):
            for name, place in frame.items():
                position[t, points.index(name)] = place
            if turn is not None:
                rotation[t, 0] = turn[t]
        seen, turned = np.isfinite(position[..., 0]), np.isfinite(rotation[..., 0])
        accuracy = np.full(seen.shape, 0.001)
        return check_observation(
            Observation(points, position, rotation, seen, turned, accuracy, np.array(time, dtype=float))
        )

    return make


@pytest.fixture(scope="session")
def untrained_gloves(exported_once: ExportedOnce) -> Path:
    """Return a folder with both networks of gloves, small and untrained."""
    import torch

    from bodysense_lab.papers.two_hands.network import (
        JointNetwork,
        JointNetworkConfig,
        MarkerNetwork,
        MarkerNetworkConfig,
    )
    from bodysense_lab.papers.two_hands.train import write_glove_network

    torch.manual_seed(0)
    markers, joints = MarkerNetwork(MarkerNetworkConfig((16,))), JointNetwork(JointNetworkConfig((16,)))
    exported_once("gloves/glove_markers.onnx", lambda path: write_glove_network(markers, path, {}))
    return exported_once("gloves/glove_joints.onnx", lambda path: write_glove_network(joints, path, {})).parent


@pytest.fixture
def data(tmp_path: Path, waving_clip: Clip) -> DataSet:
    """Return a folder of two short clips of two people."""
    for person, frames in (("anna", slice(0, 40)), ("ben", slice(30, 62))):
        (tmp_path / "motion" / person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / person / "a.bvh", replace(waving_clip, pose=waving_clip.pose[frames]))
    return DataSet("motion", tmp_path / "motion", "all")


@pytest.fixture(scope="session")
def small_vae(exported_once: ExportedOnce) -> Path:
    """HMD-VAE's model 2, small and untrained, exported; its weights are next to it as .pt."""
    import torch

    from bodysense_lab.core.checkpoint import write_weights_file
    from bodysense_lab.papers.hmd_vae.export import write_vae_onnx
    from bodysense_lab.papers.hmd_vae.network import BodyVae
    from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig

    torch.manual_seed(0)
    card = {"identity": "{}", "licence": "Apache-2.0", "training_data": "nothing", "expected_error": [0.05] * 22}
    card |= {"validation_position_cm": 9.0, "within_position_cm": 8.0}
    network = BodyVae(BodyVaeConfig(model=2, latent=4, blocks=1, width=16, sequence_width=8, length=8)).eval()
    for name, parameter in network.named_parameters():
        if name.endswith("gate"):
            torch.nn.init.constant_(parameter, 0.5)  # else the blocks do nothing

    def write(path: Path) -> None:
        write_weights_file(network, path.with_suffix(".pt"), card)
        write_vae_onnx(network, path, card)

    return exported_once("vae/model2.onnx", write)


@pytest.fixture(scope="session")
def small_arms_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """PAHMT's weights, small and never trained (.pt)."""
    import torch

    from bodysense_lab.core.checkpoint import write_weights_file
    from bodysense_lab.papers.pahmt.network import ArmNetwork
    from bodysense_lab.papers.pahmt.options import ArmNetworkConfig

    torch.manual_seed(0)
    config = ArmNetworkConfig(
        width=16,
        layers=1,
        heads=2,
        spatial_width=8,
        spatial_layers=1,
        spatial_heads=2,
        rotation="6d",
        more_inputs=True,
        from_directions=True,
        from_palms=True,
    )
    network = ArmNetwork(config).eval()
    with torch.no_grad():  # so that rotations differ from frame to frame
        list(network.head.parameters())[-2].mul_(20.0)
    card = {"identity": "{}", "licence": "Apache-2.0", "training_data": "nothing"}
    card |= {"validation": {"overall_m": 0.05, "hands_m": 0.02}}
    path = tmp_path_factory.mktemp("arms") / "arms.pt"
    write_weights_file(network, path, card)
    return path


@pytest.fixture(scope="session")
def small_arms(exported_once: ExportedOnce, small_arms_weights: Path) -> Path:
    """Export the network, which takes half a minute: for slow tests."""
    from bodysense_lab.papers.pahmt.export import write_arms_onnx
    from bodysense_lab.papers.pahmt.network import read_arms

    def write(path: Path) -> None:
        network, card = read_arms(small_arms_weights)
        write_arms_onnx(network.eval(), path, card)

    return exported_once("arms/arms.onnx", write)


@pytest.fixture(scope="session")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every network of UNOC's tables, tiny."""
    import torch

    from bodysense_lab.core.checkpoint import write_weights_file
    from bodysense_lab.papers.unoc.network.network import BodyNetwork
    from bodysense_lab.papers.unoc.network.variants import VARIANTS

    folder = tmp_path_factory.mktemp("networks")
    torch.manual_seed(0)
    for name, variant in VARIANTS.items():
        config = replace(variant.config, hidden=8, branch=(8,), judge_branch=(8,))
        write_weights_file(BodyNetwork(config, default_skeleton()), folder / f"{name}.pt", {})
    return folder
