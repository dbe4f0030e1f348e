"""Training of the finger network: sequences of a tiny corpus, kinematics of hands, losses, training, scores."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense_lab.completion.data.batches import HandBatch, SequenceBatch, assembled, collate
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.hands import DrawFingers, TrainingHands, hand_kinematics
from bodysense_lab.completion.data.points import HAND_JOINTS, HAND_POINTS
from bodysense_lab.completion.data.sensor_draws import FINGER_KINDS, FingerMasks, draw_fingers
from bodysense_lab.completion.data.sequence_draws import draw_hands
from bodysense_lab.completion.data.sequences import CAMERA, Sequence, SequenceAugmentation, make_sequence
from bodysense_lab.completion.data.training_bodies import TrainingBody, with_other_hands
from bodysense_lab.completion.networks.fingers import BENDING_POINTS, FingerConfig, FingerNetwork, finger_positions
from bodysense_lab.completion.score.finger_errors import finger_validation, last_known_fingers, mean_hand
from bodysense_lab.completion.score.finger_scores import finger_numbers, load_finger_network, score_fingers
from bodysense_lab.completion.train import train_fingers, without_person
from bodysense_lab.completion.training.losses import FingerLosses, finger_losses
from bodysense_lab.completion.training.options import FingerTraining
from bodysense_lab.completion.training.task import FingerTask, FingerTaskConfig
from bodysense_lab.core.fit import launch_fabric
from bodysense_lab.core.options import Schedule

SMALL = FingerTaskConfig(network=FingerConfig(16, 16), streams=4, chunk=12)
SKELETON = default_skeleton()


@pytest.fixture(scope="module")
def corpus() -> Corpus:
    """Return two clips of a waving body; the second has recorded fingers that bend with the wrists."""
    rng, length = np.random.default_rng(5), np.array([40, 90])
    frames = int(length.sum())
    swing = np.sin(np.arange(frames) / 9)[:, None]
    body = rng.normal(0, 0.2, (22, 3)) * swing[..., None]
    bend = np.zeros((int(length[1]), 30, 3))
    bend[:, :15, 2], bend[:, 15:, 2] = -0.7 - 0.5 * swing[40:], 0.7 + 0.5 * swing[40:]
    visible = np.zeros((frames, 65), dtype=bool)
    visible[:, HAND_POINTS.ravel()] = (np.arange(frames) % 30 < 20)[:, None]
    return Corpus(
        rotation=quaternion_exp(body).astype(np.float32),
        root=np.tile(np.array([0.0, 0.95, 0.0], dtype=np.float32), (frames, 1)),
        visible=visible,
        fingers=quaternion_exp(bend).astype(np.float32),
        rest_offset=np.tile(SKELETON.rest_offset.astype(np.float32), (2, 1, 1)),
        start=np.array([0, 40]),
        length=length,
        rate=np.array([30.0, 30.0]),
        finger_start=np.array([-1, 0]),
        name=np.array(["anna/walks", "anna/waves"]),
        category=np.array(["locomotion", "talk_gesture"]),
    )


def known_body() -> TrainingBody:
    return TrainingBody.fully_known(SKELETON.rest_offset.copy())


def sequence(corpus: Corpus, kind: str, augmentation: SequenceAugmentation | None = None) -> Sequence:
    return seen_by(corpus, partial(draw_fingers, kind), augmentation or SequenceAugmentation(known_body()))


def seen_by(corpus: Corpus, fingers: DrawFingers, augmentation: SequenceAugmentation) -> Sequence:
    """Return the sequence of the clip with fingers, with given masks of fingers."""
    return make_sequence(corpus, 1, replace(augmentation, sensors=CAMERA, fingers=fingers), np.random.default_rng(0))


def hands_of(one: Sequence) -> TrainingHands:
    assert one.hands is not None
    return one.hands


def batch_of(*sequences: Sequence) -> SequenceBatch:
    longest = max(len(one) for one in sequences)
    return collate([(one, 0) for one in sequences], longest, np.ones(len(sequences), dtype=bool))


def whole(*sequences: Sequence) -> HandBatch:
    hands = batch_of(*sequences).hands
    assert hands is not None
    return hands


def test_hand_kinematics_agrees_with_the_whole_body() -> None:
    """True positions and `finger_positions` agree with forward kinematics of the whole body."""
    rng = np.random.default_rng(1)
    rotation = quaternion_exp(rng.normal(0, 0.5, (7, 52, 3)))
    position, world = forward_kinematics(Pose(SKELETON, np.zeros((7, 3)), rotation))
    wrists = SKELETON.indices(["left_wrist", "right_wrist"])
    into = quaternion_conjugate(world[:, wrists])[:, :, None]
    expected = quaternion_rotate(into, position[:, HAND_POINTS] - position[:, wrists][:, :, None])
    offset = SKELETON.rest_offset[HAND_POINTS]
    turned, found = hand_kinematics(rotation[:, HAND_JOINTS], offset)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert float(geodesic_angle(turned, quaternion_multiply(into, world[:, HAND_JOINTS])).max()) < 1e-6
    found = finger_positions(torch.tensor(quaternion_to_matrix(turned))[None], torch.tensor(offset)[None])
    np.testing.assert_allclose(found[0], expected, atol=1e-6)
    assert len(BENDING_POINTS) == 15 and not any(
        SKELETON.points[HAND_POINTS[0, p]].endswith("1") for p in BENDING_POINTS
    )


@pytest.mark.parametrize("kind", list(FINGER_KINDS))
def test_hands_are_finite_and_of_their_shapes(corpus: Corpus, kind: str) -> None:
    whole_body = sequence(corpus, kind, SequenceAugmentation(known_body(), rate=45.0, noisy=True, free_wrists=True))
    one, frames = hands_of(whole_body), len(whole_body)
    assert frames == len(one) == 134 and whole_body.interval == pytest.approx(1 / 45)
    shapes = {name: value.shape for name, value in vars(one).items()}
    assert shapes == {
        "true_position": (frames, 2, 20, 3),
        "true_rotation": (frames, 2, 15, 4),
        "position": (frames, 2, 20, 3),
        "rotation": (frames, 2, 15, 4),
        "has_position": (frames, 2, 20),
        "has_rotation": (frames, 2, 15),
        "wrist": (frames, 2, 3),
        "wrist_rotation": (frames, 2, 4),
        "wrist_velocity": (frames, 2, 3),
        "rest_offset": (2, 20, 3),
    }
    assert all(np.isfinite(value).all() for value in vars(one).values())
    assert bool(one.has_position.any() or one.has_rotation.any()) == (kind != "nothing")


def test_tracked_values_without_noise_are_true(corpus: Corpus) -> None:
    one = hands_of(sequence(corpus, "tracked"))
    seen = one.has_position.all(axis=-1)
    assert seen.any()
    np.testing.assert_allclose(one.position[seen], one.true_position[seen], atol=2e-6)
    turned = one.has_rotation
    apart = geodesic_angle(one.rotation[turned].astype(float), one.true_rotation[turned].astype(float))
    assert not turned.any() or float(apart.max()) < 2e-3


def test_wrists_are_given_in_the_frame_under_the_head(corpus: Corpus) -> None:
    """Heading and place in the world have no effect."""
    spin = quaternion_exp(np.array([0.0, 1.1, 0.0]))
    elsewhere = replace(
        corpus,
        rotation=quaternion_multiply(spin, corpus.rotation.astype(float)).astype(np.float32),
        root=(quaternion_rotate(spin, corpus.root.astype(float)) + np.array([3.0, 0.0, -2.0])).astype(np.float32),
    )
    one, other = (hands_of(sequence(each, "tracked")) for each in (corpus, elsewhere))
    for name in ("wrist", "wrist_velocity", "true_position"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-4)
    apart = geodesic_angle(one.wrist_rotation.astype(float), other.wrist_rotation.astype(float))
    assert float(apart.max()) < 2e-3
    assert np.abs(one.wrist_velocity[1:] - np.diff(one.wrist, axis=0) * 30).max() < 3  # the head moves, too


def test_a_mirror_image_is_the_same_to_the_network(corpus: Corpus) -> None:
    """Mirrored motion swaps the hands: their features, losses and positions are those of the other hand."""
    # Random masks and noise are not mirrored, so track everything, exactly.
    one, other = (
        seen_by(corpus, everything, SequenceAugmentation(known_body(), mirrored=flip)) for flip in (False, True)
    )
    plain, image = (hands_of(each).true_position for each in (one, other))
    np.testing.assert_allclose(image[:, ::-1], plain * [-1.0, 1, 1], atol=1e-6)
    network = FingerNetwork(FingerConfig(16, 16)).eval()
    plain, mirrored = whole(one), whole(other)
    features = network.read(plain.signal)
    torch.testing.assert_close(features.flip(1), network.read(mirrored.signal), atol=2e-4, rtol=0)
    losses = []
    for batch in (plain, mirrored):
        rotation, error, _ = network(batch.signal, network.begin(1))
        losses.append(finger_losses(rotation, error, batch, FingerLosses()))
    assert float(losses[0]["loss"].detach()) == pytest.approx(float(losses[1]["loss"].detach()), abs=1e-5)


def test_backward_time_reverses_the_hands(corpus: Corpus) -> None:
    one, other = (
        hands_of(seen_by(corpus, everything, SequenceAugmentation(known_body(), backward=way))) for way in (False, True)
    )
    for name in ("true_position", "position", "wrist"):
        np.testing.assert_allclose(getattr(other, name)[::-1], getattr(one, name), atol=1e-5, err_msg=name)


def everything(visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingerMasks:
    del interval
    tracked = draw_fingers("nothing", visible, 1.0, rng)
    tracked.has_position[:], tracked.has_wrist[:] = True, True
    return tracked


def test_cameras_track_the_visible_hands_of_the_corpus(corpus: Corpus) -> None:
    one = hands_of(sequence(corpus, "camera"))
    assert not one.has_position[~corpus.visible[40:][:, HAND_POINTS]].any() or one.has_position.all(axis=-1).any()
    # A hand is seen as a whole.
    np.testing.assert_array_equal(one.has_position.any(axis=-1), one.has_position.all(axis=-1))


def test_varied_hands_are_symmetric_and_keep_the_body() -> None:
    body = known_body()
    other = with_other_hands(body, np.random.default_rng(3))
    assert other.known is other.true
    rest = np.setdiff1d(np.arange(65), HAND_POINTS.ravel())
    np.testing.assert_array_equal(other.true[rest], body.true[rest])
    np.testing.assert_allclose(other.true[HAND_POINTS[1]], other.true[HAND_POINTS[0]] * [-1.0, 1, 1])
    length = np.linalg.norm(other.true[HAND_POINTS[0]], axis=-1) / np.linalg.norm(body.true[HAND_POINTS[0]], axis=-1)
    assert 0.01 < np.std(length) < 0.1 and 0.7 < length.min() < length.max() < 1.3
    partly_known = with_other_hands(replace(body, certainty=np.full(65, 0.01)), np.random.default_rng(3))
    assert partly_known.known is body.known


def test_the_true_hand_has_only_the_loss_of_the_expected_error(corpus: Corpus) -> None:
    batch = whole(sequence(corpus, "nothing"), sequence(corpus, "camera"))
    small, large = (
        finger_losses(batch.true_rotation, torch.full(batch.true_position.shape[:-1], expected), batch, FingerLosses())
        for expected in (0.002, 0.02)
    )
    for name in ("rotation", "position", "velocity"):
        assert float(small[name]) < 1e-3
    assert float(small["error"]) < float(large["error"])
    assert float(small["loss"]) == pytest.approx(sum(float(small[name]) for name in small if name != "loss"))


def test_the_last_known_hand_is_exact_while_it_is_seen(corpus: Corpus) -> None:
    one = seen_by(corpus, seen_in_part, SequenceAugmentation(known_body()))
    hands = whole(one)
    position = finger_positions(last_known_fingers(mean_hand(corpus), hands), hands.signal.rest_offset)
    error = (position - hands.true_position).norm(dim=-1)[0]
    assert float(error[:20].max()) < 1e-5 and float(error[35:].mean()) > 1e-3
    true = hands_of(one).true_position
    np.testing.assert_allclose(error[25], np.linalg.norm(true[19] - true[25], axis=-1), atol=1e-5)


def seen_in_part(visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingerMasks:
    tracked = everything(visible, interval, rng)
    tracked.has_position[20:] = False
    return tracked


def test_the_mean_hand_of_still_hands_is_that_hand(corpus: Corpus) -> None:
    """If left and right hands are mirror images, their mean is that hand."""
    bend = np.zeros((90, 30, 3))
    bend[:, :15, 2], bend[:, 15:, 2] = -0.4, 0.4
    still = replace(corpus, fingers=quaternion_exp(bend).astype(np.float32))
    expected, _ = hand_kinematics(quaternion_exp(bend)[:1].reshape(1, 2, 15, 4), SKELETON.rest_offset[HAND_POINTS])
    np.testing.assert_allclose(mean_hand(still), quaternion_to_matrix(expected[0, 0]), atol=1e-5)


def test_a_few_steps_reduce_the_loss(corpus: Corpus) -> None:
    """The loss of hidden fingers falls, too: the network learns the mean hand of the corpus first."""
    torch.manual_seed(0)
    task = FingerTask(FingerNetwork(SMALL.network), SMALL, Schedule(), corpus, {})
    batch = batch_of(sequence(corpus, "nothing"), sequence(corpus, "camera"))
    optimizer = torch.optim.AdamW(task.network.parameters(), lr=1e-2)
    first, last = 0.0, 0.0
    for step in range(40):
        terms, memory = task.loss(batch, None)
        assert memory.shape == (1, 4, 16)
        optimizer.zero_grad()
        terms["loss"].backward()
        optimizer.step()
        last = float(terms["loss"].detach())
        first = last if step == 0 else first
    assert last < 0.6 * first


def test_training_writes_a_network_and_refuses_other_settings(
    corpus: Corpus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fabric = launch_fabric()
    checkpoint = tmp_path / "fingers.ckpt"
    schedule = Schedule(steps=4, warm_up=1, check_every=2)
    options = FingerTraining(data=tmp_path, out=checkpoint, schedule=schedule)
    network = train_fingers(options, fabric, lambda split: corpus, SMALL)
    again, task = load_finger_network(checkpoint)
    assert again.config == SMALL.network and task.left_out == ""
    for name, value in network.state_dict().items():
        torch.testing.assert_close(again.state_dict()[name], value)
    validation = finger_validation(corpus, corpus)
    figures = FingerTask(again, SMALL, Schedule(), corpus, validation).validate(again)
    assert figures["nothing_cm"] == pytest.approx(100 * validation["nothing"].baseline * figures["nothing_ratio"])
    with pytest.raises(BodysenseError, match=r"fingers\.ckpt.*another configuration"):
        train_fingers(replace(options, schedule=replace(schedule, steps=5)), fabric, lambda split: corpus, SMALL)
    with pytest.raises(BodysenseError, match="no such checkpoint"):
        load_finger_network(tmp_path / "none.ckpt")


def test_drawn_sequences_differ(corpus: Corpus) -> None:
    rng = np.random.default_rng(8)
    drawn = [draw_hands(corpus, 1, rng) for _ in range(12)]
    assert len({len(one) for one in drawn}) > 3 and len({float(hands_of(one).rest_offset.sum()) for one in drawn}) > 8
    assert len(BODY) == 22


def test_clips_without_fingers_are_not_drawn(corpus: Corpus) -> None:
    task = FingerTask(FingerNetwork(SMALL.network), SMALL, Schedule(), corpus, {})
    draw = task._sequence_sampler(np.random.default_rng(0))
    assert all(len(draw()) and draw().hands is not None for _ in range(5))
    assert assembled(next(task.batches(np.random.default_rng(0)))).valid.any()


def test_each_network_is_scored_on_the_person_it_left_out(corpus: Corpus) -> None:
    people = replace(
        corpus.select(np.array([1, 1])), name=np.array(["anna/waves", "bert/waves"]), category=np.array(["sit", "sit"])
    )
    task = replace(SMALL, left_out="bert")
    assert without_person(people, "bert").name.tolist() == ["anna/waves"]
    scores = score_fingers({"a": (FingerNetwork(SMALL.network).eval(), task)}, people, people)
    assert {one.sensors for one in scores} == {"camera", "nothing"} and all(one.ratio > 0 for one in scores)
    numbers = finger_numbers(scores)
    assert numbers["finger_occluded_ratio"] == pytest.approx(scores[0].ratio)
    assert numbers["finger_synthesised_ratio"] == pytest.approx(
        numbers["finger_synthesised_cm"] / numbers["finger_synthesised_baseline_cm"]
    )
    with pytest.raises(BodysenseError, match=r"--leave-out carl.*valid are anna, bert"):
        without_person(people, "carl")
