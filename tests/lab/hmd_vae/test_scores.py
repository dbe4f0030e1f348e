"""Scores of HMD-VAE: each measure follows its equation, and claims follow the numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.body_joints import body_pose
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_log
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.quality.metrics import jitter, rotation_error, velocity_error
from bodysense_lab.core.checkpoint import write_weights_file
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet
from bodysense_lab.papers.hmd_vae.frames import BodyFrames, read_body_frames
from bodysense_lab.papers.hmd_vae.network import BodyVae
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig
from bodysense_lab.papers.hmd_vae.scores import JOINTS, Scored, answers, measures, over_sequences, score_vae, vaes_in
from bodysense_lab.papers.hmd_vae.tables import best_of, metrics_report, vae_report
from bodysense_lab.papers.hmd_vae.task import joint_errors

SMALL = BodyVaeConfig(latent=4, width=16, sequence_width=8)
HEAD = BODY.index("head")


@pytest.fixture(scope="module")
def frames(waving_clip: Clip) -> BodyFrames:
    return read_body_frames([waving_clip])


def test_each_measure_is_its_equation(waving_clip: Clip) -> None:
    rng = np.random.default_rng(0)
    pose = body_pose(waving_clip.pose)
    position, rotation = forward_kinematics(pose)
    truth = position - position[:, [HEAD]]
    ours = truth + 0.03 * rng.standard_normal(truth.shape)
    local = pose.rotation[::-1]
    found = measures(ours, local, position, rotation)
    for part, names in JOINTS.items():
        chosen = [BODY.index(name) for name in names]
        a, b = ours[:, chosen], truth[:, chosen]
        assert found[f"{part}_position_cm"].mean() == pytest.approx(100 * np.linalg.norm(a - b, axis=-1).mean())
        assert found[f"{part}_velocity_cm_s"].mean() == pytest.approx(velocity_error(a, b, 30.0))
        bend = (a[2:] - 2 * a[1:-1] + a[:-2]) * 900  # eqs. 11, 12
        assert found[f"{part}_acceleration_m_s2"].mean() == pytest.approx(np.abs(bend).sum(axis=-1).mean())
    assert found["rotation_deg"].mean() == pytest.approx(rotation_error(local, pose.rotation), rel=1e-6)
    assert found["mpjre_component_deg"].mean() == pytest.approx(
        np.degrees(np.abs(quaternion_log(local) - quaternion_log(pose.rotation))).mean(), rel=1e-6
    )
    assert found["jitter"].mean() == pytest.approx(jitter(ours + position[:, [HEAD]], 30.0))
    nine, all_22 = found["lower_position_cm"].mean(), found["full_position_cm"].mean()
    assert (9 * nine + 13 * found["upper_position_cm"].mean()) / 22 == pytest.approx(all_22)


def test_sequences_are_four_frames_apart() -> None:
    values = np.arange(80.0)
    np.testing.assert_allclose(over_sequences(values, 64), [values[k : k + 64].mean() for k in (0, 4, 8, 12, 16)])
    assert len(over_sequences(values[:63], 64)) == 0


@pytest.mark.parametrize("origin", ["pelvis"])
def test_scores_equal_those_of_validation(frames: BodyFrames, tmp_path: Path, origin: str) -> None:
    torch.manual_seed(0)
    network = BodyVae(replace(SMALL, model=2, origin=origin)).eval()
    card = {"validation_position_cm": 1.0, "within_position_cm": 1.0}
    write_weights_file(network, tmp_path / "net.pt", card)
    scored = score_vae("net", tmp_path / "net.pt", frames)
    wanted = 100 * float(joint_errors(network, frames, frames.windows(16, stride=1)).mean())
    assert scored.get("full_position_cm") == pytest.approx(wanted, rel=1e-4)
    assert math.isnan(scored.get("full_position_cm", "sport"))


def test_answers_do_not_depend_on_the_batch(frames: BodyFrames) -> None:
    torch.manual_seed(0)
    network = BodyVae(replace(SMALL, model=2)).eval()
    windows = frames.windows(16, stride=1)
    whole, _ = answers(network, frames, windows)
    one, _ = answers(network, frames, replace(windows, start=windows.start[30:31], clip=windows.clip[30:31]))
    np.testing.assert_allclose(whole[30], one[0], atol=1e-5)
    np.testing.assert_allclose(whole[:, HEAD], 0, atol=1e-6)


def test_an_exported_network_has_the_scores_of_its_weights(frames: BodyFrames, small_vae: Path) -> None:
    (path,) = vaes_in(small_vae).values()
    exported, weights = (score_vae("net", one, frames) for one in (path, small_vae.with_suffix(".pt")))
    for measure in ("full_position_cm", "legs_velocity_cm_s", "rotation_deg"):
        assert exported.get(measure) == pytest.approx(weights.get(measure), rel=1e-2)
    assert exported.config == weights.config and exported.card["validation_position_cm"] == 9.0


def test_models_0_are_not_scored(frames: BodyFrames, tmp_path: Path) -> None:
    card = {"validation_position_cm": 1.0}
    write_weights_file(BodyVae(replace(SMALL, model=0)), tmp_path / "zero.pt", card)
    with pytest.raises(BodysenseError, match="no trained model 1 to 4 in it"):
        vaes_in(tmp_path)
    write_weights_file(BodyVae(replace(SMALL, model=1)), tmp_path / "one.pt", card)
    assert list(vaes_in(tmp_path)) == ["one"]


def made_up(model: int, blocks: int, legs: float, validation: float = 1.0, origin: str = "head") -> Scored:
    """A network with these errors of the legs, in every measure, and half of them of the full body."""
    tallies = Tallies()
    for part, value in (("legs", legs), ("full", legs / 2)):
        for measure in ("position_cm", "velocity_cm_s", "acceleration_m_s2", "truth_acceleration_m_s2"):
            for name in (measure, f"{measure}_sequences"):
                tallies["main", f"{part}_{name}"] = tally = Tally()
                tally.add(np.array([value]))
    config = BodyVaeConfig(model=model, blocks=blocks, origin=origin)  # type: ignore[arg-type]
    card = {"validation_position_cm": validation, "within_position_cm": 0.5}
    return Scored(f"{model}-{blocks}", config, card, tallies)


def test_remarks_state_whether_claims_hold(tmp_path: Path) -> None:
    shallow = [made_up(model, 3, legs) for model, legs in ((1, 8.0), (2, 7.0), (3, 9.0), (4, 9.5))]
    deep = [made_up(model, 6, legs, 0.9) for model, legs in ((1, 6.0), (2, 5.0), (3, 9.9), (4, 9.0))]
    pelvis = made_up(1, 3, 0.5, 0.1, "pelvis")
    report = vae_report([*shallow, *deep, pelvis], Census(), DataSet("made up", tmp_path))
    text = "\n".join(report.remarks)
    # The deep network of each model is better in validation, so claims are about it.
    assert "History helps the position, from scratch: holds (model 2 5.00, model 1 6.00 cm)" in text
    assert "At equal settings it holds in 2 of 2." in text
    assert "History helps the position, pretrained: holds (model 4 9.00, model 3 9.90 cm)" in text
    assert "smoothly, static: does not hold against model 1 (model 3 9.90, model 1 6.00 m/s²)" in text
    pretrained_history = next(line for line in report.remarks if "History helps the velocity, pretrained" in line)
    assert pretrained_history.endswith("At equal settings it holds in 1 of 2.")
    assert "six blocks have a lower position error than three: in 3 of 4 pairs" in text
    assert report.numbers["model1_legs_position_cm"] == 6.0
    assert report.numbers["pelvis_model1_legs_position_cm"] == 0.5
    assert report.numbers["paper_best_mpjpe_cm"] == 2.5  # not the one that knows where the pelvis is
    assert {len(row) for row in report.rows} == {len(report.columns)}


def test_the_best_is_chosen_without_the_test_people() -> None:
    worse_in_test = made_up(2, 6, 9.0, 0.5)
    assert best_of([made_up(2, 3, 1.0, 0.6), worse_in_test]) == {("head", 2): worse_in_test}


def test_published_figures_are_in_the_table(tmp_path: Path) -> None:
    report = metrics_report([made_up(1, 3, 2.0)], Census(), DataSet("made up", tmp_path))
    rows = {row[1]: row for row in report.rows}
    assert rows["HMD-VAE (as quoted)"][2:5] == (4.11, 6.83, 37.99)  # facts of AGRoL's table (Du et al. 2023)
    assert rows["1 static"][3] == 1.0
    assert {len(row) for row in report.rows} == {len(report.columns)}


def test_short_clips_are_not_counted(tmp_path: Path, waving_clip: Clip) -> None:
    from bodysense_lab.papers.hmd_vae.scores import read_test

    for name, length in (("long", 90), ("short", 40)):
        write_bvh(tmp_path / f"{name}.bvh", replace(waving_clip, pose=waving_clip.pose[:length]))
    advanced: list[str] = []
    frames, census = read_test(DataSet("set", tmp_path, "all"), lambda clip: advanced.append(clip.name))
    assert (len(frames), census.clips, len(advanced)) == (1, 1, 2)
