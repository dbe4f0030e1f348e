"""Training sequences and training: shapes, retargeting, mirror images, lost sensors, averaged weights."""

from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.retarget import retarget
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY, INERTIAL_POINTS
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.headset_camera import see
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_rotate
from bodysense.io.datasets.splits import split_of
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.completion.data.batches import collate
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.corpus_cache import read_corpus
from bodysense_lab.completion.data.points import BODY_POINTS, HEAD, INPUT_POINTS, partners
from bodysense_lab.completion.data.sensor_draws import (
    KINDS,
    SensorMasks,
    draw_sensors,
    draw_without_head,
    loss_durations,
    lost_hand,
    rotation_only,
)
from bodysense_lab.completion.data.sequence_draws import draw_sequence
from bodysense_lab.completion.data.sequences import Sequence, SequenceAugmentation, make_sequence
from bodysense_lab.completion.data.training_bodies import TrainingBody
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.networks.weights_file import read_weights
from bodysense_lab.completion.train import completion_finger_network, train_completion
from bodysense_lab.completion.training.options import CompletionTraining
from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
from bodysense_lab.core.fit import launch_fabric, rate_at
from bodysense_lab.core.options import Schedule

FRAMES = 90
PACKAGED = Path(str(files("bodysense.weights") / "completion.safetensors"))


@pytest.fixture(scope="module")
def corpus() -> Corpus:
    clip = packaged_performance()
    pose = clip.pose[:FRAMES]
    return Corpus(
        rotation=forward_kinematics(pose)[1][:, : len(BODY)].astype(np.float32),
        root=pose.root_position.astype(np.float32),
        visible=see(pose).visible,
        fingers=np.zeros((0, 30, 4), dtype=np.float32),
        rest_offset=pose.skeleton.rest_offset[None].astype(np.float32),
        start=np.array([0]),
        length=np.array([FRAMES]),
        rate=np.array([clip.frame_rate]),
        finger_start=np.array([-1]),
        name=np.array(["performance"]),
        category=np.array(["everyday"]),
    )


def test_drawn_sequences_are_finite_and_of_their_shapes(corpus: Corpus) -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        one = draw_sequence(corpus, 0, rng)
        for name in ("true_position", "true_rotation", "position", "rotation", "anchor", "rest_offset", "acceleration"):
            assert np.isfinite(getattr(one, name)).all()
        assert one.true_position.shape == (len(one), len(BODY_POINTS), 3)
        assert one.position.shape == (len(one), len(INPUT_POINTS), 3)
        assert np.allclose(np.linalg.norm(one.rotation, axis=-1), 1, atol=1e-4)
        assert (one.accuracy > 0).all() and 0.8 < one.size < 1.3 and 1 / 145 < one.interval < 1 / 9


def _positions(one: SensorMasks) -> np.ndarray:
    return one.has_position


def _rotations(one: SensorMasks) -> np.ndarray:
    return one.has_rotation


def test_shares_of_sensors_sum_to_one_and_most_sequences_are_tracked() -> None:
    assert sum(KINDS.values()) == pytest.approx(1.0)
    rng, visible = np.random.default_rng(2), np.ones((60, len(INPUT_POINTS)), dtype=bool)
    drawn = [draw_sensors(visible, 1 / 30, rng) for _ in range(200)]
    assert np.mean([one.has_position.any() or one.has_rotation.any() for one in drawn]) > 0.95
    place, turn = ([mask(one)[:, HEAD].mean() for one in drawn] for mask in (_positions, _rotations))
    assert 0.7 < np.mean(place) < 0.95 and 0.7 < np.mean(turn) < 0.97


def test_heads_of_training_lose_their_position_their_rotation_or_both() -> None:
    """Every combination occurs, for whole sequences and for parts of them."""
    rng, visible = np.random.default_rng(3), np.ones((300, len(INPUT_POINTS)), dtype=bool)
    whole, parts = set(), set()
    for _ in range(1500):
        one = draw_sensors(visible, 1 / 30, rng)
        states = {*zip(one.has_position[:, HEAD].tolist(), one.has_rotation[:, HEAD].tolist(), strict=True)}
        (whole if len(states) == 1 else parts).update(states)
    assert whole == parts == {(True, True), (True, False), (False, True), (False, False)}


@pytest.mark.parametrize("joint", ["head", "pelvis", None])
def test_the_frame_under_the_head_turns_with_the_best_known_heading(corpus: Corpus, joint: str | None) -> None:
    """Like the core: the head's rotation, else the pelvis's, else the line from right to left ankle."""
    position, rotation = np.zeros(27, dtype=bool), np.zeros(22, dtype=bool)
    ankles = [BODY.index(f"{side}_ankle") for side in ("left", "right")]
    position[ankles] = True
    if joint == "head":
        rotation[[HEAD, 0]] = True
    elif joint == "pelvis":
        rotation[0] = True
    one = fixed_sequence(corpus, corpus.rest_offset[0].astype(float), False, position, rotation)
    if joint is None:
        line = one.true_position[:, ankles[0]] - one.true_position[:, ankles[1]]
        heading = np.arctan2(-line[:, 2], line[:, 0])
    else:
        ahead = quaternion_rotate(one.true_rotation[:, BODY.index(joint)].astype(float), np.array([0.0, 0.0, 1.0]))
        side = quaternion_rotate(one.true_rotation[:, BODY.index(joint)].astype(float), np.array([1.0, 0.0, 0.0]))
        heading = np.arctan2(ahead[:, 0] - side[:, 2], ahead[:, 2] + side[:, 0])
    apart = np.arctan2(one.anchor[:, 1], one.anchor[:, 0]) - heading
    assert np.abs(np.sin(apart)).max() < 1e-3 and (np.cos(apart) > 0).all()
    away = np.linalg.norm(one.anchor[:, 2:] - one.true_position[:, HEAD][:, [0, 2]], axis=-1)
    assert 0.001 < away.max() < 0.3, "the position of a head that is not tracked has the errors of an estimate"


def fixed_sequence(
    corpus: Corpus, offset: np.ndarray, mirrored: bool, position: np.ndarray, rotation: np.ndarray
) -> Sequence:
    def sensors(visible: np.ndarray, interval: float, rng: np.random.Generator) -> SensorMasks:
        frames = len(visible)
        has_position, has_rotation = np.tile(position, (frames, 1)), np.tile(rotation, (frames, 1))
        has_acceleration = rotation_only(has_position, has_rotation)
        return SensorMasks(has_position, has_rotation, has_acceleration)

    body = TrainingBody.fully_known(offset)
    return make_sequence(
        corpus, 0, SequenceAugmentation(body, sensors=sensors, mirrored=mirrored), np.random.default_rng(0)
    )


def test_a_sequence_moves_as_the_retargeted_clip(corpus: Corpus) -> None:
    """Retargeting in training agrees with `body.retarget`."""
    clip = packaged_performance()
    offset = sample_bodies("train", 1)[0]
    everything = np.ones(len(INPUT_POINTS), dtype=bool)
    one = fixed_sequence(corpus, offset, False, everything, np.ones(len(BODY), dtype=bool))
    pose = clip.pose[:FRAMES]
    pose = retarget(Pose(pose.skeleton, pose.root_position, pose.rotation), pose.skeleton.with_offsets(offset))
    places = pose.skeleton.indices(BODY_POINTS)
    assert np.abs(forward_kinematics(pose)[0][:, places] - one.true_position).max() < 0.02


def test_backward_time_reverses_the_sequence(corpus: Corpus) -> None:
    offset = sample_bodies("train", 1)[0]
    body = TrainingBody.fully_known(offset)
    ways = [
        make_sequence(corpus, 0, SequenceAugmentation(body, backward=way), np.random.default_rng(3))
        for way in (False, True)
    ]
    for name in ("true_position", "true_rotation", "contact", "position", "rotation", "acceleration"):
        forward, backward = (getattr(one, name) for one in ways)
        np.testing.assert_allclose(backward[::-1], forward, atol=1e-5, err_msg=name)
    assert np.linalg.norm(np.diff(ways[0].true_position, axis=0), axis=-1).max() > 0.01, "the body does not move"


def test_features_of_a_mirror_image_are_mirrored(corpus: Corpus) -> None:
    rng = np.random.default_rng(4)
    position, rotation = (rng.uniform(size=len(names)) < 0.6 for names in (INPUT_POINTS, BODY))
    position[HEAD] = rotation[HEAD] = True
    offset = sample_bodies("train", 1)[0]
    swap = [np.array(partners(names)) for names in (INPUT_POINTS, BODY)]
    pair = [
        fixed_sequence(corpus, offset, False, position, rotation),
        fixed_sequence(corpus, offset, True, position[swap[0]], rotation[swap[1]]),
    ]
    network = CompletionNetwork(CompletionConfig(hidden=8, branch=8, judge_branch=8))
    plain, mirrored = (collate([(one, 0)], 40, np.ones(1, dtype=bool)).signal for one in pair)
    assert torch.allclose(network.read_both(plain)[:, :, 1], network.read(mirrored), atol=1e-4)


def task_of(corpus: Corpus, schedule: Schedule = Schedule()) -> CompletionTask:
    torch.manual_seed(0)
    config = CompletionTaskConfig(CompletionConfig(hidden=24, branch=24, judge_branch=8), streams=6, chunk=16)
    one = fixed_sequence(
        corpus, corpus.rest_offset[0].astype(float), False, np.ones(27, dtype=bool), np.ones(22, dtype=bool)
    )
    watched = {"everything": [collate([(one, 0)], len(one), np.ones(1, dtype=bool))]}
    return CompletionTask(CompletionNetwork(config.network), config, schedule, corpus, watched)


def test_learning_lowers_the_loss(corpus: Corpus) -> None:
    task = task_of(corpus)
    batch = next(task.batches(np.random.default_rng(3)))
    optimizer = torch.optim.AdamW(task.network.parameters(), lr=3e-3)
    losses = []
    for _ in range(15):
        terms, _ = task.loss(batch, None)
        optimizer.zero_grad()
        terms["loss"].backward()
        optimizer.step()
        losses.append(float(terms["loss"].detach()))
    assert losses[-1] < 0.9 * losses[0]


def test_the_rate_rises_then_falls() -> None:
    schedule = Schedule(steps=1000, warm_up=100)
    rates = [rate_at(schedule, step) for step in (1, 100, 550, 1000)]
    assert rates[0] < rates[1] == schedule.learning_rate > rates[2] > rates[3] > 0


def test_training_loses_hands_for_measured_durations() -> None:
    rng = np.random.default_rng(3)
    seconds = loss_durations(200_000, rng)
    assert np.median(seconds) == pytest.approx(0.1, abs=0.03)
    assert (seconds < 0.2).mean() == pytest.approx(0.61, abs=0.03)
    assert (seconds > 1.0).mean() == pytest.approx(0.11, abs=0.03)
    assert np.quantile(seconds, 0.99) == pytest.approx(6.7, rel=0.25)
    assert seconds.max() <= 17.0
    lost = np.stack([[lost_hand(900, 1 / 30, rng) for _ in range(2)] for _ in range(200)])
    both, either = lost.all(axis=1).mean(), lost.mean()
    assert 0.02 < either < 0.3
    assert both < 0.5 * either  # one is lost without the other


def test_free_wrists_turn_and_arms_do_not(corpus: Corpus) -> None:
    offset = corpus.rest_offset[0].astype(float)
    body = TrainingBody.fully_known(offset)
    still, turned = (
        make_sequence(corpus, 0, SequenceAugmentation(body, free_wrists=free_wrists), np.random.default_rng(seed))
        for free_wrists, seed in ((False, 1), (True, 1))
    )
    wrists = [BODY.index(f"{side}_wrist") for side in ("left", "right")]
    arms = [k for k in range(len(BODY)) if k not in wrists]
    assert np.array_equal(still.true_rotation[:, arms], turned.true_rotation[:, arms])
    assert np.array_equal(still.true_position[:, : len(BODY)], turned.true_position[:, : len(BODY)])
    bend = np.degrees(geodesic_angle(still.true_rotation, turned.true_rotation))
    assert np.ptp(bend[:, wrists], axis=0).min() > 5
    assert np.abs(np.diff(bend[:, wrists], axis=0)).max() < 15  # smooth
    distance = np.linalg.norm(still.position - turned.position, axis=-1).max(axis=0)
    knuckles = [INPUT_POINTS.index(f"{side}_knuckles") for side in ("left", "right")]
    assert distance[knuckles].min() > 0.01


def test_inertial_sensors_measure_the_acceleration_of_bones(corpus: Corpus) -> None:
    one = fixed_sequence(
        corpus, corpus.rest_offset[0].astype(float), False, np.arange(27) == HEAD, np.ones(22, dtype=bool)
    )
    assert not one.has_acceleration[:4].any() and one.has_acceleration[4:].all()
    elbow, wrist = (one.true_position[:, BODY.index(f"right_{name}")].astype(float) for name in ("elbow", "wrist"))
    place = elbow + 0.8 * (wrist - elbow)
    wanted = (place[4:] - 2 * place[2:-2] + place[:-4]) * (1 / (2 * one.interval)) ** 2
    assert np.allclose(one.acceleration[4:, INERTIAL_POINTS.index("right_elbow")], wanted, atol=0.02)
    assert np.abs(wanted).max() > 0.5


@pytest.mark.slow
def test_keep_averages_weights_and_updates_leave_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`keep` 0.25 averages a quarter of the initial with three quarters of the trained weights."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    clip = packaged_performance()
    for split in ("train", "val"):
        person = next(name for name in map(str, range(99)) if split_of(name) == split)
        (tmp_path / "data" / person).mkdir(parents=True)
        write_bvh(tmp_path / "data" / person / "moving.bvh", replace(clip, pose=clip.pose[:FRAMES]))
    run = CompletionTraining(
        data=tmp_path / "data",
        out=tmp_path / "net.safetensors",
        begin_with=PACKAGED,
        schedule=Schedule(steps=1, warm_up=1, average_decay=0.0),
    )
    earlier = read_weights(PACKAGED)[0].state_dict()
    data, fabric = partial(read_corpus, run.data), launch_fabric(1, 1)
    trained = train_completion(run, fabric, data).state_dict()
    mixed = train_completion(replace(run, keep=0.25), fabric, data).state_dict()
    assert any((trained[name] - earlier[name]).abs().max() > 1e-4 for name in trained)
    for name in trained:
        torch.testing.assert_close(mixed[name], 0.25 * earlier[name] + 0.75 * trained[name])

    # A training of updates changes no other weight.
    updated = train_completion(replace(run, run=tmp_path / "updates", update_rank=16), fabric, data).state_dict()
    changed = {name for name, values in updated.items() if not torch.equal(values, earlier.get(name, values * 0))}
    assert changed and all(name.startswith("updates.") for name in changed)
    with pytest.raises(BodysenseError, match=r"--update-rank 32: .* has updates of rank 16; give that"):
        train_completion(replace(run, update_rank=32), fabric, data)

    # A training of all weights begins with the updates, too, of a file or of a checkpoint.
    whole = replace(run, run=tmp_path / "whole", begin_with=tmp_path / "updates" / "completion.ckpt")
    again = train_completion(whole, fabric, data).state_dict()
    assert again.keys() == trained.keys() == updated.keys()
    far, near = (sum(float((again[name] - one[name]).abs().sum()) for name in again) for one in (earlier, updated))
    assert near < far and not any(torch.equal(again[name], updated[name]) for name in again)


def test_updates_without_begin_with_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"--update-rank 16: updates of which network\? Give --begin-with, too"):
        CompletionTraining(data=tmp_path, out=tmp_path / "a.safetensors", update_rank=16)
    with pytest.raises(BodysenseError, match="--update-rank 20: not a multiple of 16"):
        CompletionTraining(data=tmp_path, out=tmp_path / "a.safetensors", begin_with=PACKAGED, update_rank=20)


def test_updates_are_trained_on_heads_that_are_not_tracked() -> None:
    rng, visible = np.random.default_rng(4), np.ones((60, len(INPUT_POINTS)), dtype=bool)
    drawn = [draw_without_head(visible, 1 / 30, rng) for _ in range(100)]
    assert not any((one.has_position & np.pad(one.has_rotation, ((0, 0), (0, 5))))[:, HEAD].all() for one in drawn)


def test_without_steps_fingers_are_those_of_begin_with(tmp_path: Path) -> None:
    run = CompletionTraining(data=tmp_path, out=tmp_path / "net.safetensors", begin_with=PACKAGED, finger_steps=0)
    data = partial(read_corpus, run.data)
    kept = completion_finger_network(run, launch_fabric(1, 1), data).state_dict()
    assert all(torch.equal(kept[name], one) for name, one in read_weights(PACKAGED)[1].state_dict().items())
    for other in (replace(run, begin_with=None), replace(run, backward=True)):
        relaxed = completion_finger_network(other, launch_fabric(1, 1), data)
        assert not any(last.any() for last in relaxed.branch[-1].parameters())


def test_keep_without_begin_with_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"--keep 0\.5 is a share of earlier weights; give --begin-with, too"):
        CompletionTraining(data=tmp_path, out=tmp_path / "a.safetensors", keep=0.5)
