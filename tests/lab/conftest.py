"""Fixtures: observations from dictionaries, small networks of gloves, and a folder of short motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.observing.observation import Observation, check_observation
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
