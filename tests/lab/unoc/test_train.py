"""The whole run of `bodysense train body-gru`, on a folder small enough for a test."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from people.split import write_people

from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.io.clip import Clip
from bodysense_lab.data.augment import mirrored
from bodysense_lab.data.clips import clips_of
from bodysense_lab.papers.unoc import train
from bodysense_lab.papers.unoc.learned import Learned, load_model
from bodysense_lab.papers.unoc.network.network import PAPER
from bodysense_lab.papers.unoc.options import BodyTraining
from bodysense_lab.papers.unoc.train import augmentation_of, train_body


@pytest.fixture
def folder(tmp_path: Path, waving_clip: Clip) -> Path:
    short = replace(waving_clip, pose=waving_clip.pose[:1])
    learned = [waving_clip, mirrored(waving_clip), short]
    return write_people(tmp_path / "data", {"train": learned, "val": [waving_clip]})


def options_for(data: Path, out: Path) -> BodyTraining:
    return BodyTraining(
        data=data,
        out=out,
        form="shipped",
        steps=2,
        epochs=1,
        window_stride=4,
        lanes=3,
        chunk=10,
        finger_passes=0,
        passes=2,
        hidden=8,
        finger_share=0.3,
        seed=1,
        threads=1,
        devices=1,
        licence="Apache-2.0",
        data_note="somebody who waves",
    )


@pytest.mark.slow
@pytest.mark.usefixtures("in_threads")
def test_a_run_writes_a_network_that_tracks(
    folder: Path, tmp_path: Path, waving_clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the paper's form, with a window of 5 frames instead of 27: the export writes a step for each."""
    monkeypatch.setattr(train, "PAPER", replace(PAPER, window=5))
    run = replace(options_for(folder, tmp_path / "net.onnx"), form="paper")
    train_body(run, clips_of(run))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "net.ckpt", "net.jsonl", "net.onnx"]
    model = load_model(tmp_path / "net.onnx")
    assert model.card["training_data"] == "somebody who waves"
    assert (model.card["form"], model.card["seed"], model.card["network"]["window"]) == ("paper", 1, 5)
    assert set(model.card["validation"]) == {
        f"{part}_occluded_rmsjpe_cm" for part in ("body", "body_known", "finger", "finger_known")
    }
    log = [json.loads(line) for line in (tmp_path / "net.jsonl").read_text().splitlines()]
    assert log[-1]["step"] == log[-1]["steps"]
    learned = Learned(model, waving_clip.pose.skeleton)
    estimate, _ = learned.step(observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)[:5], learned.start())
    assert np.isfinite(estimate.position).all()
    # Repeated, the command trains nothing, and the file keeps its validation figures.
    train_body(run, clips_of(run))
    assert load_model(tmp_path / "net.onnx").card == model.card


def test_augmentations_of_the_passes() -> None:
    assert [augmentation_of(k, shipped=True).mirrored for k in range(4)] == [False, True, False, True]
    assert augmentation_of(0, shipped=True).limb_spread == 0.0 < augmentation_of(1, shipped=True).limb_spread
    assert (
        augmentation_of(2, shipped=False).limb_spread
        == augmentation_of(2, shipped=False).hand_dropouts_per_minute
        == 0.0
    )
