"""Training of networks that place points: batches, losses, resuming, and keeping the best average."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from people.split import write_people
from scipy.spatial.transform import Rotation

from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip
from bodysense_lab.core.fit import Progress, Report, fit
from bodysense_lab.data.clips import clips_of
from bodysense_lab.papers.unoc.network.point_network import (
    FINGERS,
    UPPER_BODY,
    PointNetwork,
    PointNetworkConfig,
    PointPrediction,
)
from bodysense_lab.papers.unoc.options import FingersTraining
from bodysense_lab.papers.unoc.point_model import load_point_model
from bodysense_lab.papers.unoc.point_task import PointSchedule, PointTask, point_loss, validate_points
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, with_bent_wrists
from bodysense_lab.papers.unoc.sequences.point_sequences import PointSequence, collate, make_point_sequence, windows
from bodysense_lab.papers.unoc.train import train_points as run_points

SMALL = replace(UPPER_BODY, hidden=8, branch=(8,), judge_branch=(8,))
SMALL_FINGERS = replace(FINGERS, hidden=8, branch=(8,), dropout=0.0)
SCHEDULE = PointSchedule(steps=12, batch=3, chunk=5, warm_up=2, check_every=4)


def network(config: PointNetworkConfig = SMALL) -> PointNetwork:
    torch.manual_seed(2)
    return PointNetwork(config, default_skeleton())


@pytest.fixture(scope="module")
def sequences(waving_clip: Clip) -> list[PointSequence]:
    rng = np.random.default_rng(0)
    augmented = (Augmentation(), Augmentation(mirrored=True, limb_spread=0.05, wrist_bend=0.3))
    return [make_point_sequence(waving_clip, network(), augmentation, rng) for augmentation in augmented]


def train_points(
    model: PointNetwork,
    schedule: PointSchedule,
    sequences: list[PointSequence],
    validation: list[PointSequence],
    checkpoint: Path,
    report: Report,
) -> tuple[PointNetwork, float]:
    figures = fit(PointTask(model, schedule, sequences, validation), checkpoint, report)
    return model, figures["rmsjpe_cm"]


def test_a_window_ends_at_its_frame_and_repeats_the_first_before_it(sequences: list[PointSequence]) -> None:
    batch = collate([(sequences[0], -3)], 5, np.ones(1, dtype=bool))
    np.testing.assert_array_equal(batch.features[0].numpy(), sequences[0].features[[0, 0, 0, 0, 1]])
    drawn = next(windows(sequences, 5, 64, np.random.default_rng(0)))
    assert drawn.features.shape[:2] == (64, 5) and bool(drawn.valid[:, -1].all())


def test_the_truth_costs_nothing_and_terms_add_up(sequences: list[PointSequence]) -> None:
    """By a loop over frames and joints, with the paper's weights."""
    model, batch = network(), collate([(sequences[0], 84)], 10, np.ones(1, dtype=bool))
    missed = torch.randn(batch.offset.shape, generator=torch.Generator().manual_seed(0)) * 0.02
    answer = PointPrediction(batch.offset + missed, torch.full(batch.offset.shape[:-1], 0.03))
    terms = point_loss(model, answer, batch, SCHEDULE)
    distance = [float(torch.linalg.norm(missed[0, t, k])) for t in range(6) for k in range(11)]  # 6 of 10 are valid
    assert float(terms["position"]) == pytest.approx(10 * np.mean(distance), rel=1e-4)
    expected = [d / 0.03 + np.log(0.03) for d in distance]
    assert float(terms["expected"]) == pytest.approx(0.01 * np.mean(expected), rel=1e-2)
    assert float(terms["loss"]) == pytest.approx(sum(float(v) for k, v in terms.items() if k != "loss"), rel=1e-5)
    truth = point_loss(model, PointPrediction(batch.offset, answer.error), batch, SCHEDULE)
    for name in ("position", "parent", "bone"):
        assert float(truth[name]) == pytest.approx(0, abs=1e-4)


def test_a_squared_distance_has_the_mean_as_its_optimum(waving_clip: Clip) -> None:
    """The best single prediction of 0, 0 and 3 cm is 1 cm, or 0 for the Euclidean distance."""
    model = network(SMALL_FINGERS)
    sequence = make_point_sequence(waving_clip, model, Augmentation(), np.random.default_rng(0))
    batch = collate([(sequence, 0)], 3, np.ones(1, dtype=bool))
    truth = batch.offset[:, :1].expand_as(batch.offset).clone()
    truth[0, 2] += 0.03
    best = {}
    for distance in ("squared", "euclidean"):
        schedule = replace(SCHEDULE, distance=distance)
        costs = {}
        for shift in (0.0, 0.01, 0.02):
            answer = PointPrediction(truth[:, :1].expand_as(truth) + shift, torch.ones(truth.shape[:-1]))
            costs[shift] = float(point_loss(model, answer, batch._replace(offset=truth), schedule)["position"])
        best[distance] = min(costs, key=lambda shift: costs[shift])
    assert best == {"squared": 0.01, "euclidean": 0.0}


def test_training_learns_and_keeps_the_best(sequences: list[PointSequence], tmp_path: Path) -> None:
    reports: list[Progress] = []
    model = network()
    before = validate_points(model, sequences)
    schedule = replace(SCHEDULE, steps=60, check_every=10, learning_rate=1e-2)
    model, score = train_points(model, schedule, sequences, sequences, tmp_path / "a.ckpt", reports.append)
    assert score == pytest.approx(validate_points(model, sequences)) and score < 0.7 * before
    assert score == min(report.validation["rmsjpe_cm"] for report in reports)


def test_only_wrists_that_were_not_recorded_are_bent(waving_clip: Clip) -> None:
    pose = waving_clip.pose
    left, right = pose.skeleton.index("left_wrist"), pose.skeleton.index("right_wrist")
    rotation = pose.rotation.copy()
    swing = np.linspace(0, 0.5, len(waving_clip))[:, None] * [0, 0, 1]
    rotation[:, right] = Rotation.from_rotvec(swing).as_quat(scalar_first=True)
    clip = replace(waving_clip, pose=replace(pose, rotation=rotation))
    bent = with_bent_wrists(clip, 0.3, np.random.default_rng(0)).pose.rotation
    same = [joint for joint in range(rotation.shape[1]) if joint != left]
    np.testing.assert_array_equal(bent[:, same], rotation[:, same])
    turn = Rotation.from_quat(bent[:, left], scalar_first=True).as_rotvec()
    assert 0.05 < np.linalg.norm(turn, axis=1).mean() < 1.0
    assert np.abs(np.diff(turn, axis=0)).max() < 0.2, "slowly"


@pytest.mark.slow
@pytest.mark.usefixtures("in_threads")
def test_a_whole_run(waving_clip: Clip, tmp_path: Path) -> None:
    """From files to a network that loads; one person of each split."""
    clip, out = replace(waving_clip, pose=waving_clip.pose[:12]), tmp_path / "net.onnx"
    data = write_people(tmp_path / "data", {"train": [clip], "val": [clip]})
    run = FingersTraining(data=data, out=out, steps=2, threads=1, licence="CC0-1.0", data_note="waving")
    run_points(run, clips_of(run))
    card = load_point_model("fingers", out).card
    assert (card["licence"], card["training_data"], card["form"]) == ("CC0-1.0", "waving", "shipped")
    rows = [json.loads(line) for line in out.with_suffix(".jsonl").read_text().splitlines()]
    assert rows[-1]["step"] == 2 and rows[-1]["validation"]["rmsjpe_cm"] > 0
