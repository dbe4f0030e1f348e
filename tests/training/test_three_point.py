"""Training of the three-point network: what episodes hold, what the loss asks for, and runs that go on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import geodesic_angle, quaternion_to_matrix
from bodysense.body.skeleton import BODY, LOWER_BODY, Skeleton, default_skeleton
from bodysense.data.augment import at_height
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.evaluation.metrics import joint_error, velocity_error
from bodysense.models.three_point_network import Answer, ThreePointConfig, ThreePointNetwork
from bodysense.training.body_network import Progress
from bodysense.training.three_point import (
    ThreePointSchedule,
    ThreePointWeights,
    three_point_loss,
    train_three_point,
    validate_three_point,
)
from bodysense.training.three_point_episodes import (
    Corpus,
    ThreePointBatch,
    ThreePointVariation,
    corpus_of,
    in_contact,
    make_three_point_episode,
    without_fingers,
    world_turn,
)

WEIGHTS = ThreePointWeights()


@pytest.fixture(scope="module")
def network() -> ThreePointNetwork:
    torch.manual_seed(0)
    return ThreePointNetwork(ThreePointConfig(hidden=16, branch=(32,), judge_branch=(8,)))


@pytest.fixture(scope="module")
def corpus(network: ThreePointNetwork, waving_clip: Clip) -> Corpus:
    """As recorded; mirrored at another rate; the head alone."""
    variations = (
        ThreePointVariation(),
        ThreePointVariation(mirrored=True, limb_spread=0.05, rates=(40.0, 50.0)),
        ThreePointVariation(hands=False),
    )
    rng = np.random.default_rng(0)
    return corpus_of([make_three_point_episode(waving_clip, network, one, rng) for one in variations])


def truth_of(batch: ThreePointBatch) -> Answer:
    """What the network should say."""
    logit = (batch.contact.float() - 0.5) * 40
    return Answer(quaternion_to_matrix(batch.rotation), batch.position, torch.full((*logit.shape[:2], 22), 1e-4), logit)


def test_an_episode_is_the_motion(corpus: Corpus, waving_clip: Clip) -> None:
    """In the world, at the wearer's size, its positions are those of the clip."""
    batch, skeleton = corpus.whole(0), waving_clip.pose.skeleton
    world = batch.position @ world_turn(batch.travel) + batch.travel[..., None, :3]
    truth, _ = forward_kinematics(waving_clip.pose)
    np.testing.assert_allclose(world[0].numpy() * skeleton.height / 1.7, truth[:, :22], atol=1e-5)
    assert (corpus.length[0], corpus.interval[0]) == (len(waving_clip), pytest.approx(1 / 30))
    assert 1 / 50 <= corpus.interval[1] <= 1 / 40
    assert corpus.minutes == pytest.approx(3 * 3 / 60, rel=0.02)


def test_the_truth_costs_nothing_and_all_else_does(network: ThreePointNetwork, corpus: Corpus) -> None:
    batch = corpus.whole(1)
    truth = truth_of(batch)
    terms = three_point_loss(network, truth, batch, WEIGHTS)
    parts = ("position", "rotation", "local", "velocity", "skate", "contact")
    assert max(float(terms[name]) for name in parts) < 1e-3
    assert float(terms["loss"]) == pytest.approx(float(sum(v for k, v in terms.items() if k != "loss")))
    noise = 0.02 * torch.randn(truth.position.shape, generator=torch.Generator().manual_seed(0))
    other = truth._replace(
        position=truth.position + noise, rotation=truth.rotation.roll(1, dims=-3), contact_logit=-truth.contact_logit
    )
    worse = three_point_loss(network, other, batch, WEIGHTS)
    assert all(float(worse[name]) > 10 * float(terms[name]) + 1e-3 for name in parts)


def test_frames_beyond_the_end_teach_nothing(network: ThreePointNetwork, corpus: Corpus) -> None:
    inside = corpus.batch(np.array([0]), np.array([80]), 10, np.array([True]))
    beyond = corpus.batch(np.array([0]), np.array([80]), 16, np.array([True]))
    assert beyond.valid.sum() == 10
    answers = []
    for batch in (inside, beyond):
        truth = truth_of(batch)
        answers.append(truth._replace(position=truth.position + 0.01 * batch.valid[..., None, None]))
        if batch is beyond:
            answers[-1].position[~batch.valid] += 5.0
    costs = [
        three_point_loss(network, answer, batch, WEIGHTS)
        for answer, batch in zip(answers, (inside, beyond), strict=True)
    ]
    for name in ("position", "rotation", "local", "velocity", "contact", "expected"):
        assert float(costs[0][name]) == pytest.approx(float(costs[1][name]), abs=1e-6), name


def test_lanes_carry_on_where_they_were(corpus: Corpus) -> None:
    lanes = corpus.lanes(4, 11, np.random.default_rng(0))
    before = next(lanes)
    assert before.begins.all()
    for _ in range(30):
        now = next(lanes)
        for lane in np.flatnonzero(~now.begins.numpy()):
            step = (now.travel[lane, 0, :3] - before.travel[lane, -1, :3]).norm()
            assert before.valid[lane].all() and step < 0.05
        before = now


@pytest.mark.parametrize("height", [1.5, 2.0])
def test_who_stands_is_in_contact_and_who_jumps_is_not(waving_clip: Clip, height: float) -> None:
    clip = at_height(without_fingers(waving_clip), height)
    skeleton = clip.pose.skeleton
    feet = skeleton.indices(["left_ankle", "right_ankle", "left_foot", "right_foot"])
    still = np.tile(forward_kinematics(clip.pose[:1])[0][:, feet], (30, 1, 1))
    still[..., 1] -= still[..., 1].min() - 0.005
    assert in_contact(still, skeleton, 30.0).all()
    assert not in_contact(still + np.array([0, 0.2, 0]), skeleton, 30.0).any()
    walking = still + np.linspace(0, 1, 30)[:, None, None] * np.array([0.0, 0, 2.0])
    assert not in_contact(walking, skeleton, 30.0).any()
    assert (in_contact(still, skeleton, 30.0) == in_contact(np.repeat(still, 3, axis=0), skeleton, 90.0)[::3]).all()


def test_losses_of_hands_are_of_every_kind(network: ThreePointNetwork, waving_clip: Clip) -> None:
    """Head alone, one hand, hands without orientation, gaps, nothing: each happens, and the truth is the same."""
    variation = ThreePointVariation(loses_hands=True)
    made = [make_three_point_episode(waving_clip, network, variation, np.random.default_rng(k)) for k in range(80)]
    known = [(episode.features[:, 20:22] > 0.5, episode.features[:, 18:20] > 0.5) for episode in made]
    kinds = {
        "head only": sum(not place.any() and not turn.any() for place, turn in known),
        "never one hand": sum(place.any() and not place.any(axis=0).all() for place, _ in known),
        "no orientation": sum(place.all() and not turn.any() for place, turn in known),
        "gaps": sum(place.any(axis=0).all() and not place.all() for place, _ in known),
        "nothing": sum(place.all() and turn.all() for place, turn in known),
    }
    assert all(kinds.values()) and sum(kinds.values()) == 80, kinds
    assert all(np.array_equal(one.position, made[0].position) for one in made)


def test_without_fingers_the_body_is_the_same(waving_clip: Clip) -> None:
    light = without_fingers(waving_clip)
    assert light.pose.skeleton.joints == BODY and light.pose.skeleton.height == waving_clip.pose.skeleton.height
    (one, turn), (two, turned) = (forward_kinematics(clip.pose) for clip in (light, waving_clip))
    np.testing.assert_allclose(one, two[:, default_skeleton().indices(light.pose.skeleton.points)], atol=1e-12)
    assert geodesic_angle(turn, turned[:, :22]).max() < 1e-7


def test_a_run_learns_and_goes_on(corpus: Corpus, tmp_path: Path) -> None:
    """The error falls; a run that was stopped goes on to the end; another configuration is refused."""
    schedule = ThreePointSchedule(steps=120, lanes=4, chunk=10, warm_up=5, learning_rate=5e-3, check_every=60)
    config = ThreePointConfig(hidden=16, branch=(32,), judge_branch=(8,))
    rows: list[Progress] = []

    def run(schedule: ThreePointSchedule) -> dict[str, float]:
        torch.manual_seed(0)
        network = ThreePointNetwork(config)
        start = validate_three_point(network, {"full": corpus})
        _, figures = train_three_point(network, schedule, corpus, {"full": corpus}, tmp_path / "a.ckpt", rows.append)
        assert figures["full_mpjpe_cm"] < 0.7 * start["full_mpjpe_cm"]
        return figures

    figures = run(schedule)
    assert [row.step for row in rows] == [60, 120]
    assert set(figures) == {f"full_{k}" for k in ("mpjpe_cm", "lower_cm", "upper_cm", "velocity_cm_s", "rotation_deg")}
    # Done already: what it returns is what was kept.
    assert run(schedule) == figures and len(rows) == 2
    with pytest.raises(BodysenseError, match=r"a\.ckpt belongs to another configuration \(schedule\.lanes: 4 → 8\)"):
        run(replace(schedule, lanes=8))


def test_validation_says_what_the_metrics_say(network: ThreePointNetwork, waving_clip: Clip) -> None:
    """Of one clip at the reference height, the figures are those of `evaluation.metrics`."""
    clip = at_height(waving_clip, 1.7)
    corpus = corpus_of([make_three_point_episode(clip, network, ThreePointVariation(), np.random.default_rng(0))])
    figures = validate_three_point(network, {"full": corpus})
    batch = corpus.whole(0)
    with torch.no_grad():
        said, _ = network.ask_twice(batch.features, network.begin(1))
        answer = network.answer(batch.prepared, *said)
        world = (answer.position @ world_turn(batch.travel) + batch.travel[..., None, :3])[0].double().numpy()
    truth = np.asarray(forward_kinematics(clip.pose)[0])[:, :22]
    error = joint_error(world, truth)
    assert figures["full_mpjpe_cm"] == pytest.approx(error.mean(), rel=1e-4)
    assert figures["full_lower_cm"] == pytest.approx(error[:, [BODY.index(j) for j in LOWER_BODY]].mean(), rel=1e-4)
    assert figures["full_velocity_cm_s"] == pytest.approx(velocity_error(world, truth, 30.0), rel=1e-2)


def test_a_pose_of_the_skeleton_is_needed(network: ThreePointNetwork, waving_clip: Clip) -> None:
    """A body without head or wrists cannot be seen."""
    pose, joints = waving_clip.pose, 7
    whole = pose.skeleton
    body = Skeleton(whole.joints[:joints], (), whole.parents[:joints], whole.rest_offset[:joints])
    clip = replace(waving_clip, pose=Pose(body, pose.root_position, pose.rotation[:, :joints]))
    with pytest.raises(BodysenseError, match="unknown joint"):
        make_three_point_episode(clip, network, ThreePointVariation(), np.random.default_rng(0))
