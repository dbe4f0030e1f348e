"""Training of arms and hands: losses, resumed runs, and the networks of the table."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from people.split import write_people

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import normalize, quaternion_canonical
from bodysense.io.clip import Clip
from bodysense_lab.core.fit import Progress, fit
from bodysense_lab.core.precision import layer_autocast
from bodysense_lab.data.augment import mirrored as mirrored_clip
from bodysense_lab.data.clips import clips_of
from bodysense_lab.papers.pahmt.camera_view import FRONT, sample_cameras, view, view_points
from bodysense_lab.papers.pahmt.export import mirrored, mirrored_rotations, write_arms_onnx
from bodysense_lab.papers.pahmt.features import Window, window_of
from bodysense_lab.papers.pahmt.network import ArmNetwork, read_arms
from bodysense_lab.papers.pahmt.options import ArmNetworkConfig, ArmSchedule, ArmTableTraining, VideoSimulation
from bodysense_lab.papers.pahmt.recordings import ArmBatch, ArmRecordings, make_batch, read_arm_recordings
from bodysense_lab.papers.pahmt.task import ArmTask, Pair, arm_loss, batch_of, validate_arms
from bodysense_lab.papers.pahmt.train import row_run, run_table

SMALL: dict[str, Any] = {
    "width": 16,
    "layers": 1,
    "heads": 2,
    "spatial_width": 8,
    "spatial_layers": 1,
    "spatial_heads": 2,
}
CONFIG = ArmNetworkConfig(kind="ahmt", **SMALL)


@pytest.fixture(scope="module")
def recordings(waving_clip: Clip) -> ArmRecordings:
    return read_arm_recordings([waving_clip, replace(waving_clip, name="bare", has_fingers=False)])


def batch(recordings: ArmRecordings, which: list[int]) -> ArmBatch:
    return make_batch(
        recordings, recordings.windows(fingers=None), np.array(which), VideoSimulation(), np.random.default_rng(0)
    )


@pytest.mark.parametrize("form", [{}, {"rotation": "6d"}, {"input": "hands"}])
def test_the_loss_of_the_truth_is_its_own_movement(recordings: ArmRecordings, form: dict[str, Any]) -> None:
    network, one = ArmNetwork(replace(CONFIG, **form)), batch(recordings, [0, 3])
    schedule = ArmSchedule(losses=("rotation", "smooth", "fk", "motion"), motion=1.0)
    truth = network.regressed(one.rotation[:, :, list(network.config.joints)])
    terms = arm_loss(network, truth, one, schedule)
    assert max(float(terms[name]) for name in ("rotation", "fk", "motion")) < 1e-4
    change = (truth[:, 1:] - truth[:, :-1]).abs().mean()
    assert float(terms["smooth"]) == pytest.approx(float(change), rel=1e-4) and change > 1e-4
    noise = 0.1 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    worse = arm_loss(network, truth + noise, one, schedule)
    assert all(float(worse[name]) > float(terms[name]) + 1e-3 for name in ("rotation", "smooth", "fk", "motion"))
    assert float(worse["rotation"]) == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=0.05)


def test_unrecorded_joints_get_no_gradient(recordings: ArmRecordings) -> None:
    network, one = ArmNetwork(CONFIG), batch(recordings, [-1])
    schedule = ArmSchedule(losses=("rotation", "smooth", "fk"))
    predicted = network.regressed(one.rotation).clone().requires_grad_()
    arm_loss(network, predicted + 0.1, one, schedule)["loss"].backward()
    assert predicted.grad is not None
    taught = (predicted.grad.abs().sum(dim=(0, 1, 3)) > 0).numpy()
    np.testing.assert_array_equal(taught, one.known[0].numpy())


def test_terms_are_switched_off(recordings: ArmRecordings) -> None:
    network, one = ArmNetwork(CONFIG), batch(recordings, [0])
    terms = arm_loss(network, network(one.window).detach(), one, ArmSchedule(losses=("rotation", "fk")))
    assert set(terms) == {"loss", "rotation", "fk"}
    assert float(terms["loss"]) == pytest.approx(float(terms["rotation"] + terms["fk"]))


def test_network_and_discriminator_have_separate_gradients(recordings: ArmRecordings) -> None:
    """The discriminator learns to separate recorded from predicted motion; the network's term does not train it."""
    torch.manual_seed(0)
    pair, one = Pair(ArmNetwork(replace(CONFIG, dropout=0.0))), batch(recordings, [0, 5])
    schedule = ArmSchedule(losses=("fk", "gan"), fk=0.0, gan=1.0)
    ArmTask(pair, schedule, recordings, recordings).loss(one, None)[0]["loss"].backward()
    gradients = [parameter.grad.clone() for parameter in pair.discriminator.parameters() if parameter.grad is not None]
    assert any(parameter.grad.abs().max() > 0 for parameter in pair.network.parameters() if parameter.grad is not None)
    pair.zero_grad()
    with torch.no_grad(), layer_autocast(torch.device("cpu")):
        predicted = pair.network(one.window).float()
    logits = [pair.discriminator(each) for each in (pair.network.regressed(one.rotation), predicted)]
    discriminator_loss = (
        torch.nn.functional.softplus(-logits[0]).mean() + torch.nn.functional.softplus(logits[1]).mean()
    ) / 2
    discriminator_loss.backward()
    for parameter, gradient in zip(pair.discriminator.parameters(), gradients, strict=True):
        torch.testing.assert_close(parameter.grad, gradient, atol=1e-5, rtol=1e-3)


def test_the_adversarial_term_is_the_cross_entropy_of_recorded(recordings: ArmRecordings) -> None:
    """Its term is the cross-entropy of 'recorded' for its output: small if the discriminator is deceived.

    The term is added to the loss, with this sign.
    """
    torch.manual_seed(0)
    pair, one = Pair(ArmNetwork(replace(CONFIG, dropout=0.0))), batch(recordings, [0, 5])
    task = ArmTask(pair, ArmSchedule(losses=("fk", "gan"), gan=0.05), recordings, recordings)
    last = pair.discriminator.layers[-1]
    terms = []
    for logit in (-4.0, 4.0):  # judged as estimated, and as recorded
        with torch.no_grad():
            for parameter, value in zip(last.parameters(), (0.0, logit), strict=True):
                parameter.fill_(value)
        parts = {name: float(term.detach()) for name, term in task.loss(one, None)[0].items()}
        assert parts["loss"] == pytest.approx(parts["fk"] + parts["gan"] + parts["told"])
        terms.append(parts["gan"])
    np.testing.assert_allclose(terms, 0.05 * np.log1p(np.exp([4.0, -4.0])), rtol=1e-5)


def test_batches_are_those_of_their_step(recordings: ArmRecordings) -> None:
    windows = recordings.windows()
    schedule = ArmSchedule(batch=4, without_hands=0.5)
    one, again, other = (batch_of(recordings, windows, schedule, step) for step in (3, 3, 4))
    assert torch.equal(one.window.hand, again.window.hand) and not torch.equal(one.window.hand, other.window.hand)
    assert one.known.all(dim=1).sum() == 2
    # In one epoch every window is drawn once.
    order = [
        batch_of(recordings, windows, ArmSchedule(batch=4, studio=VideoSimulation(begun=0)), step) for step in (1, 2, 3)
    ]
    first = torch.cat([one.rotation[:, 0].flatten(1) for one in order])
    assert len(torch.unique(first.abs().sort(dim=1).values.round(decimals=4), dim=0)) == 12


@pytest.mark.slow
def test_a_run_learns(recordings: ArmRecordings, tmp_path: Path) -> None:
    schedule = ArmSchedule(epochs=12, batch=4, halve_every=6, learning_rate=5e-3, check_every=12, average_decay=0.5)
    rows: list[Progress] = []
    torch.manual_seed(0)
    network = ArmNetwork(CONFIG)
    begin = validate_arms(network, recordings)["overall_m"]
    fit(ArmTask(Pair(network), schedule, recordings, recordings), tmp_path / "a.ckpt", rows.append)
    assert validate_arms(network, recordings)["overall_m"] < begin
    assert [row.step for row in rows] == [12, 24, 36]


@pytest.mark.slow
def test_the_exported_file_predicts_as_the_network(
    small_arms: Path, small_arms_weights: Path, recordings: ArmRecordings
) -> None:
    from bodysense.devices.video.arms import load_arms

    network, _ = read_arms(small_arms_weights)
    window = batch(recordings, [4]).window
    with torch.no_grad():  # plain and mirrored
        straight, turned = (network.quaternions(network(one)) for one in (window, mirrored(window)))
        turned = mirrored_rotations(turned)
        alike = torch.where((straight * turned).sum(dim=-1, keepdim=True) < 0, -turned, turned)
        wanted = normalize(straight + alike)[0].double().numpy()
    found = load_arms(small_arms).rotations({name: value[0].numpy() for name, value in window._asdict().items()})
    same = np.abs((found * wanted).sum(axis=-1))
    assert same.min() > np.cos(np.radians(0.25)) and (found[..., 0] >= 0).all()
    other = load_arms(small_arms).rotations(
        {name: value[0].numpy() for name, value in mirrored(window)._asdict().items()}
    )
    back = mirrored_rotations(torch.from_numpy(other)).numpy()
    assert np.abs((found * back).sum(axis=-1)).min() > 1 - 1e-5


def test_a_mirrored_window_is_what_the_camera_sees_of_the_mirror_image(
    waving_clip: Clip,
) -> None:
    windows = []
    for clip in (waving_clip, mirrored_clip(waving_clip)):
        points = view_points(clip.pose)[None, :32]
        windows.append(
            window_of(view(points, np.arange(32) / 30, sample_cameras(points[:, 16], np.random.default_rng(0), FRONT)))
        )
    straight, turned = (
        one._replace(torso=quaternion_canonical(one.torso)) for one in (mirrored(windows[0]), windows[1])
    )
    for name, ours, recorded in zip(Window._fields, straight, turned, strict=True):
        torch.testing.assert_close(ours, recorded, atol=1e-4, rtol=0, msg=name)
    recordings = [read_arm_recordings([clip]).rotation for clip in (waving_clip, mirrored_clip(waving_clip))]
    same = (mirrored_rotations(torch.from_numpy(recordings[0])) * torch.from_numpy(recordings[1])).sum(dim=-1).abs()
    assert float(same.min()) > 1 - 1e-5


def test_a_network_of_hands_alone_is_not_exported(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="a network of hands alone is not for video"):
        write_arms_onnx(ArmNetwork(replace(CONFIG, input="hands")), tmp_path / "hands.onnx", {})


@pytest.fixture
def folder(tmp_path: Path, waving_clip: Clip) -> Path:
    """People for training and validation."""
    return write_people(tmp_path / "data", {"train": [waving_clip, waving_clip], "val": [waving_clip]})


def test_the_table_is_trained_into_a_folder_once(folder: Path, tmp_path: Path) -> None:
    run = ArmTableTraining(
        data=folder,
        out=tmp_path / "table",
        config=ArmNetworkConfig(**SMALL),
        schedule=ArmSchedule(epochs=1, batch=8),
        networks=("cnn-hands", "ahmt"),
    )
    run_table(run, clips_of(run))
    assert {path.name for path in (tmp_path / "table").glob("*.pt")} == {"cnn-hands.pt", "ahmt.pt"}
    assert row_run(run, "cnn-hands").config.input == "hands" and row_run(run, "pahmt").config.kind == "pahmt"
    log = (tmp_path / "table" / "ahmt.jsonl").read_text()
    assert set(json.loads(log.splitlines()[-1])["terms"]) == {"loss", "rotation", "smooth", "fk", "gan", "told"}
    run_table(run, clips_of(run))
    assert (tmp_path / "table" / "ahmt.jsonl").read_text() == log
    other = replace(run, schedule=replace(run.schedule, epochs=2))
    with pytest.raises(BodysenseError, match=r"ahmt\.pt is of another configuration \(schedule\.epochs: 1 → 2\)"):
        run_table(replace(other, networks=("ahmt",)), clips_of(replace(other, networks=("ahmt",))))
    with pytest.raises(BodysenseError, match="unknown network 'lstm'; valid are cnn-hands"):
        run_table(replace(run, networks=("lstm",)), clips_of(replace(run, networks=("lstm",))))
