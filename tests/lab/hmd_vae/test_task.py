"""Training of HMD-VAE: batches are windows, mirrors mirror, the loss falls, runs go on or are refused."""

from __future__ import annotations

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from lightning_fabric import Fabric
from people.split import person_of, write_people

from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense.io.clip import Clip
from bodysense_lab.core.checkpoint import write_weights_file
from bodysense_lab.core.fit import Progress, fit, rate_at
from bodysense_lab.data.augment import mirrored as mirrored_clip
from bodysense_lab.papers.hmd_vae import train as trainings
from bodysense_lab.papers.hmd_vae.body_vae import load_body_vae
from bodysense_lab.papers.hmd_vae.body_windows import VaeBatch, make_batch, mirrored
from bodysense_lab.papers.hmd_vae.frames import BodyFrames, read_body_frames
from bodysense_lab.papers.hmd_vae.listed_clips import vae_clips_of
from bodysense_lab.papers.hmd_vae.network import BodyVae, read_vae
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig, VaeRun, VaeSchedule
from bodysense_lab.papers.hmd_vae.task import VaeTask, joint_errors
from bodysense_lab.papers.hmd_vae.train import sweep_configs, sweep_name

SMALL = BodyVaeConfig(latent=4, width=16, sequence_width=8, length=8)
SCHEDULE = VaeSchedule(steps=4, batch=8, check_every=2)


@pytest.fixture(scope="module")
def frames(waving_clip: Clip) -> BodyFrames:
    return read_body_frames([waving_clip, mirrored_clip(waving_clip)])


@pytest.fixture
def folder(tmp_path: Path, waving_clip: Clip) -> Path:
    learned = [waving_clip, mirrored_clip(waving_clip)]
    return write_people(tmp_path / "data", {"train": learned, "val": [waving_clip]})


def same(ours: VaeBatch, theirs: VaeBatch) -> None:
    """Joints at the same places, turned the same."""
    for a, b in ((ours.seen, theirs.seen), (ours.truth, theirs.truth)):
        np.testing.assert_allclose(a.position.numpy(), b.position.numpy(), atol=1e-4)
        matrices = (quaternion_to_matrix(one.rotation).numpy() for one in (a, b))
        np.testing.assert_allclose(*matrices, atol=1e-4)


@pytest.mark.parametrize("model", [0, 1, 2])
def test_a_batch_is_windows(frames: BodyFrames, model: int) -> None:
    network = BodyVae(replace(SMALL, model=model))
    windows = frames.windows(8)
    batch = make_batch(network.config, frames, windows, np.array([3, 20]))
    joints = 22 if model == 0 else 3
    assert batch.seen.position.shape == (2, network.config.frames, joints, 3)
    head = [BODY.index("head")] if model == 0 else [0]
    np.testing.assert_allclose(  # the last frame that is seen is the frame that is answered
        batch.seen.position[:, -1, head].numpy(), batch.truth.position[:, [BODY.index("head")]].numpy(), atol=1e-6
    )
    np.testing.assert_allclose(batch.seen.position[:, -1, head][..., [0, 2]].numpy(), 0, atol=1e-5)
    np.testing.assert_allclose(batch.rest_offset.numpy(), frames.rest_offset[windows.clip[[3, 20]]])


@pytest.mark.parametrize(("model", "origin"), [(0, "pelvis"), (2, "head")])
def test_the_mirror_is_the_mirrored_clip(frames: BodyFrames, model: int, origin: str) -> None:
    network = BodyVae(replace(SMALL, model=model, origin=origin))
    windows = frames.windows(8)
    count = len(windows) // 2  # the second clip is the first in the mirror
    which = np.arange(count)
    plain = make_batch(network.config, frames, windows, which)
    turned = mirrored(network.config, plain, torch.ones(count, dtype=torch.bool))
    same(turned, make_batch(network.config, frames, windows, which + count))
    same(mirrored(network.config, turned, torch.ones(count, dtype=torch.bool)), plain)
    same(mirrored(network.config, plain, torch.zeros(count, dtype=torch.bool)), plain)


def train(
    frames: BodyFrames, tmp_path: Path, config: BodyVaeConfig, schedule: VaeSchedule
) -> tuple[BodyVae, list[Progress]]:
    torch.manual_seed(1)
    reports: list[Progress] = []
    windows = frames.windows(config.length)
    fabric = Fabric(accelerator="cpu", devices=1)
    network = BodyVae(config)
    task = VaeTask(network, schedule, frames, windows, (frames, windows))
    fit(task, tmp_path / "net.ckpt", reports.append, fabric)
    return network, reports


@pytest.mark.slow
def test_the_loss_falls(frames: BodyFrames, tmp_path: Path) -> None:
    schedule = VaeSchedule(steps=60, batch=16, check_every=20, average_decay=0.8)
    network, reports = train(frames, tmp_path, replace(SMALL, model=2), schedule)
    assert reports[-1].terms["loss"] < 0.5 * reports[0].terms["loss"]
    windows = frames.windows(8)
    before = joint_errors(BodyVae(network.config), frames, windows).mean()
    assert joint_errors(network, frames, windows).mean() < 0.5 * before


def test_every_window_is_drawn_once_an_epoch(frames: BodyFrames) -> None:
    network, windows = BodyVae(replace(SMALL, model=1)), frames.windows(8)
    schedule = replace(SCHEDULE, batch=7, mirrored=False)
    drawn = VaeTask(network, schedule, frames, windows, (frames, windows)).batches(np.random.default_rng(1))
    place = np.concatenate([next(drawn).truth.position.numpy() for _ in range(len(windows) // 7)])
    assert len(np.unique(place.round(5), axis=0)) == len(place)


def test_one_cycle_goes_up_and_down() -> None:
    rates = [rate_at(VaeSchedule(steps=1000), step) for step in range(1, 1001)]
    assert np.argmax(rates) == 99 and max(rates) == pytest.approx(VaeSchedule().learning_rate)
    assert rates[-1] == pytest.approx(0.001 * max(rates)) and min(rates) > 0


def test_the_grids() -> None:
    assert len(sweep_configs(SMALL, "all")) == 150 and len(sweep_configs(SMALL, "few")) == 20
    one = sweep_configs(SMALL, "one")
    assert [config.model for config in one] == [0, 1, 2, 3, 4]
    assert len({sweep_name(config) for config in sweep_configs(SMALL, "all")}) == 150


def test_names_in_a_sweep_include_other_settings() -> None:
    config = BodyVaeConfig()
    assert sweep_name(config) == "model2-beta0.01-latent30-blocks3"
    assert sweep_name(replace(config, origin="pelvis", samples=4)) == f"{sweep_name(config)}-pelvis-samples4"
    assert sweep_name(replace(config, samples=2)) == f"{sweep_name(config)}-samples2"


def run_vae(run: VaeRun) -> None:
    """Train a network on the motion that its run names."""
    trainings.run_vae(run, vae_clips_of(run))


def run_sweep(run: VaeRun, configs: list[BodyVaeConfig]) -> None:
    """Train the networks of a sweep on the motion that its run names."""
    trainings.run_sweep(run, configs, vae_clips_of(run))


def test_written_weights_can_be_loaded(folder: Path, tmp_path: Path) -> None:
    run = VaeRun(data=folder, out=tmp_path / "net.pt", config=replace(SMALL, model=0), schedule=SCHEDULE, threads=1)
    run_vae(run)
    network, card = read_vae(tmp_path / "net.pt")
    assert network.config == run.config
    assert card["steps"] == 4 and len(card["expected_error"]) == 22
    before = (tmp_path / "net.pt").read_bytes()
    run_vae(run)
    assert (tmp_path / "net.pt").read_bytes() == before  # trained already
    with pytest.raises(BodysenseError, match=r"net\.pt is of another configuration \(schedule.steps: 4 → 5\)"):
        run_vae(replace(run, schedule=replace(SCHEDULE, steps=5)))


@pytest.mark.slow
def test_a_run_exports(folder: Path, tmp_path: Path) -> None:
    run_vae(
        VaeRun(data=folder, out=tmp_path / "net.onnx", config=replace(SMALL, model=1), schedule=SCHEDULE, threads=1)
    )
    model, (network, card) = load_body_vae(tmp_path / "net.onnx"), read_vae(tmp_path / "net.pt")
    assert model.card["validation"] == {"position_cm": card["validation_position_cm"]}
    assert model.latent == network.config.latent


@pytest.mark.slow
def test_a_sweep_keeps_what_is_there(folder: Path, tmp_path: Path) -> None:
    run = VaeRun(data=folder, out=tmp_path / "sweep", config=SMALL, schedule=replace(SCHEDULE, steps=2), threads=1)
    run_sweep(run, sweep_configs(SMALL, "one")[:2])
    first = (tmp_path / "sweep" / f"{sweep_name(replace(SMALL, model=0))}.pt").read_bytes()
    run_sweep(run, sweep_configs(SMALL, "one"))
    assert (tmp_path / "sweep" / f"{sweep_name(replace(SMALL, model=0))}.pt").read_bytes() == first
    with (tmp_path / "sweep" / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["model"] for row in rows] == ["0", "1", "2", "3", "4"]
    decoders = [read_vae(tmp_path / "sweep" / f"{row['network']}.pt")[0].decoder.state_dict() for row in rows]
    for name, value in decoders[0].items():
        assert torch.equal(decoders[3][name], value) and torch.equal(decoders[4][name], value)
    with pytest.raises(BodysenseError, match=r"is of another configuration \(schedule.batch: 8 → 9\)"):
        run_sweep(replace(run, schedule=replace(run.schedule, batch=9)), sweep_configs(SMALL, "one"))


def test_a_network_of_other_data_is_not_kept(folder: Path, tmp_path: Path) -> None:
    run = VaeRun(data=folder, out=tmp_path / "net.pt", config=replace(SMALL, model=1), schedule=SCHEDULE, threads=1)
    run_vae(run)
    listing = tmp_path / "split.txt"
    listing.write_text("".join(f"{path.relative_to(folder).as_posix()} train\n" for path in folder.rglob("*.bvh")))
    with pytest.raises(BodysenseError, match=r"another configuration \(source.split_file: None → [0-9a-f]{12}\)"):
        run_vae(replace(run, split_file=listing))
    moved = shutil.copytree(folder, tmp_path / "moved")
    with pytest.raises(BodysenseError, match=r"another configuration \(source.data: .*/data → .*/moved\)"):
        run_vae(replace(run, data=moved))
    (tmp_path / "net.pt").unlink()  # half finished: the checkpoint is there
    theirs = folder / person_of("train")
    shutil.copy(theirs / "1.bvh", theirs / "2.bvh")
    learned = "source.learned.frames: 180 → 270, source.learned.sequences: 2 → 3"
    with pytest.raises(BodysenseError, match=rf"net\.ckpt belongs to another configuration \({learned}\)"):
        run_vae(run)


def test_a_sweep_checks_decoder_and_data(folder: Path, tmp_path: Path) -> None:
    run = VaeRun(data=folder, out=tmp_path / "sweep", config=SMALL, schedule=replace(SCHEDULE, steps=2), threads=1)
    configs = [one for one in sweep_configs(SMALL, "one") if one.model in (0, 3)]
    run_sweep(run, configs)
    zero, three = (run.out / f"{sweep_name(config)}.pt" for config in configs)
    torch.manual_seed(9)
    write_weights_file(BodyVae(replace(SMALL, model=0)), zero, read_vae(zero)[1])
    with pytest.raises(BodysenseError, match=r"model3.* is of another configuration \(source.decoder: "):
        run_sweep(run, configs)
    for path in (zero, zero.with_suffix(".ckpt")):
        path.unlink()
    before = three.read_bytes()
    run_sweep(run, configs)  # the same decoder comes out again, and what was trained with it is kept
    assert three.read_bytes() == before
    theirs = folder / person_of("train")
    shutil.copy(theirs / "1.bvh", theirs / "2.bvh")
    with pytest.raises(
        BodysenseError, match=r"model0.* is of another configuration \(source.learned.frames: 180 → 270"
    ):
        run_sweep(run, sweep_configs(SMALL, "one"))


def test_a_sweep_into_a_bad_place(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    configs = sweep_configs(SMALL, "one")[:1]
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        run = VaeRun(data=folder, out=out, config=SMALL, schedule=SCHEDULE)
        with pytest.raises(BodysenseError, match=rf"^{out}: no folder can be made there .*; choose another --out$"):
            run_sweep(run, configs)
    with pytest.raises(BodysenseError):
        run_sweep(VaeRun(data=tmp_path / "gone", out=tmp_path / "sweep", config=SMALL, schedule=SCHEDULE), configs)
    assert not (tmp_path / "sweep").exists()


def test_a_published_list_holds_out_its_own(folder: Path, tmp_path: Path) -> None:
    listing = tmp_path / "split.txt"
    names = [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*.bvh"))]
    listing.write_text("".join(f"{name} train\n" for name in names))
    run_vae(
        VaeRun(
            data=folder,
            out=tmp_path / "net.pt",
            config=replace(SMALL, model=1),
            schedule=SCHEDULE,
            split_file=listing,
            threads=1,
        )
    )
    card = read_vae(tmp_path / "net.pt")[1]
    assert card["validation_position_cm"] == card["within_position_cm"]
