"""Networks of the tables that nobody trained, and folders of short motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from bodysense.body.skeleton import default_skeleton
from bodysense.data.bvh import write_bvh
from bodysense.data.clip import Clip
from bodysense.evaluation.datasets import DataSet
from bodysense.models.body_network import BodyNetwork, write_weights
from bodysense.models.variants import VARIANTS

MakeData = Callable[..., DataSet]


@pytest.fixture(scope="session")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every network of the tables, tiny."""
    folder = tmp_path_factory.mktemp("networks")
    torch.manual_seed(0)
    for name, variant in VARIANTS.items():
        config = replace(variant.config, hidden=8, branch=(8,), judge_branch=(8,))
        write_weights(BodyNetwork(config, default_skeleton()), folder / f"{name}.pt")
    return folder


@pytest.fixture
def data(tmp_path: Path, waving_clip: Clip) -> DataSet:
    """Two short clips of two people."""
    for person, frames in (("anna", slice(0, 40)), ("ben", slice(30, 62))):
        (tmp_path / "motion" / person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / person / "a.bvh", replace(waving_clip, pose=waving_clip.pose[frames]))
    return DataSet("motion", tmp_path / "motion", "all")
