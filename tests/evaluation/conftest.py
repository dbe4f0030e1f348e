"""Networks of the tables that nobody trained, and folders of short motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bodysense.data.bvh import write_bvh
from bodysense.data.clip import Clip
from bodysense.evaluation.datasets import DataSet

MakeData = Callable[..., DataSet]


@pytest.fixture
def data(tmp_path: Path, waving_clip: Clip) -> DataSet:
    """Two short clips of two people."""
    for person, frames in (("anna", slice(0, 40)), ("ben", slice(30, 62))):
        (tmp_path / "motion" / person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / person / "a.bvh", replace(waving_clip, pose=waving_clip.pose[frames]))
    return DataSet("motion", tmp_path / "motion", "all")
