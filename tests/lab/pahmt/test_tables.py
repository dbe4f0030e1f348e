"""PAHMT's Table 1: its measures and its rows."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.arms import ARM_JOINTS
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.data.datasets import DataSet
from bodysense_lab.papers.pahmt.errors import EVERY, table_errors
from bodysense_lab.papers.pahmt.options import FINGERS
from bodysense_lab.papers.pahmt.tables import arm_report, rows_in, score_arms


def turns(seed: int = 0) -> Rotation:
    return Rotation.from_rotvec(np.random.default_rng(seed).uniform(-0.9, 0.9, (6 * 38, 3)))


def quaternions(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat(canonical=True, scalar_first=True).reshape(6, 38, 4)


def test_rotation_errors_are_scipys() -> None:
    predicted, truth = turns(1), turns(2)
    arms = [k for k, name in enumerate(ARM_JOINTS) if k not in FINGERS]
    found = table_errors(quaternions(predicted), quaternions(truth), EVERY)
    angle = np.degrees((truth.inv() * predicted).magnitude()).reshape(6, 38)
    np.testing.assert_allclose(found["arms_deg"], angle[:, arms], atol=1e-6)
    np.testing.assert_allclose(found["fingers_deg"], angle[:, list(FINGERS)], atol=1e-6)
    component = np.abs(predicted.as_rotvec() - truth.as_rotvec()).mean(axis=-1).reshape(6, 38)
    np.testing.assert_allclose(found["arms"], component[:, arms], atol=1e-9)


def test_of_hands_alone_only_hands_are_measured() -> None:
    truth = quaternions(turns())
    whole = table_errors(quaternions(turns(3)), truth, EVERY)
    alone = table_errors(quaternions(turns(3))[:, list(FINGERS)], truth, FINGERS)
    assert set(alone) == {"hands_m", "fingers_deg"}
    for name, values in alone.items():
        np.testing.assert_allclose(values, whole[name], atol=1e-9)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, waving_clip: Clip) -> Path:
    path = tmp_path_factory.mktemp("motion")
    (path / "somebody").mkdir()
    write_bvh(path / "somebody" / "waving.bvh", replace(waving_clip, pose=waving_clip.pose[:50]))
    return path


def test_rows_are_scored_and_reported(folder: Path, small_arms_weights: Path, tmp_path: Path) -> None:
    for name in ("ahmt", "pahmt"):
        shutil.copy(small_arms_weights, tmp_path / f"{name}.pt")
    rows, data = rows_in(tmp_path, small_arms_weights), DataSet("mine", folder, "all")
    assert [row.name for row in rows] == ["ahmt", "pahmt", "ik", "shipped"]
    scored, census = score_arms(rows, data, 5, 1, lambda clip: None)
    assert census.clips == 1
    report = arm_report((scored, census), data)
    numbers = report.numbers
    # Equal weights have equal errors on equal windows.
    for measure in ("hands_m", "overall_m", "arms"):
        assert numbers[f"ahmt_{measure}"] == numbers[f"pahmt_{measure}"] > 0
    assert numbers["ahmt_overall_cm"] == pytest.approx(100 * numbers["ahmt_overall_m"])
    assert numbers["ik_overall_m"] < 0.02 < numbers["ahmt_overall_m"]
    assert len(report.rows) == 4 and {len(row) for row in report.rows} == {len(report.columns)}


def test_a_folder_without_networks(tmp_path: Path) -> None:
    with pytest.raises(
        BodysenseError, match="none of the table's networks in it; train them with `bodysense train arms-"
    ):
        rows_in(tmp_path)


def test_motion_without_hands(small_arms_weights: Path, waving_clip: Clip, tmp_path: Path) -> None:
    still = np.array(waving_clip.pose.rotation)
    still[:, 22:] = [1.0, 0, 0, 0]
    (tmp_path / "a").mkdir()
    write_bvh(tmp_path / "a" / "b.bvh", replace(waving_clip, pose=replace(waving_clip.pose, rotation=still)))
    shutil.copy(small_arms_weights, tmp_path / "ahmt.pt")
    with pytest.raises(BodysenseError, match="no clip with fingers of 32 frames"):
        score_arms(rows_in(tmp_path), DataSet("mine", tmp_path, "all"), 5, 1, lambda clip: None)
