"""Heads of which a rotation or a place alone is tracked."""

import json
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.observing.observation import HEADSET_ACCURACY, Observation, accuracy_like
from bodysense.tracking.model import load_completion
from bodysense.tracking.tracker import Tracker
from bodysense_lab.completion.networks.weights_file import read_safetensors, safetensors_bytes

PACKAGED = Path(str(files("bodysense.weights") / "completion.safetensors"))
FRAMES, WALKING, TURN = 150, 15, np.array([0.0, np.pi / 2, 0.0])
JOINTS = ("pelvis", "spine3", *(f"{side}_{name}" for side in ("left", "right") for name in ("wrist", "ankle", "knee")))
KINDS = st.sampled_from(("nothing", "place", "rotation", "both"))


@cache
def walker(turned: bool = False) -> tuple[Pose, np.ndarray, np.ndarray]:
    """A walking body of 5 s with world positions and rotations, toward another side if `turned`."""
    clip = packaged_performance()
    pose = clip.pose[WALKING : WALKING + FRAMES]
    if turned:
        turn = quaternion_exp(TURN)
        rotation = np.array(pose.rotation)
        rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
        pose = Pose(pose.skeleton, quaternion_rotate(turn, pose.root_position), rotation)
    position, rotation = forward_kinematics(pose)
    return pose, np.asarray(position), np.asarray(rotation)


def observed(kinds: dict[str, str], turned: bool = False) -> Observation:
    """Return signals of the walker in which each of these points has a position, a rotation, both or neither."""
    pose, position, rotation = walker(turned)
    names, index = tuple(kinds), pose.skeleton.indices(list(kinds))
    has = [np.tile([kind in (one, "both") for kind in kinds.values()], (FRAMES, 1)) for one in ("place", "rotation")]
    accuracy = accuracy_like(has[0], HEADSET_ACCURACY)
    return Observation(names, position[:, index], rotation[:, index], has[0], has[1], accuracy, np.arange(FRAMES) / 30)


def completed(observation: Observation, tracker: Tracker | None = None) -> np.ndarray:
    tracker = tracker or Tracker(Person(walker()[0].skeleton))
    return tracker.step(observation, tracker.start())[0].points


def error(kinds: dict[str, str], turned: bool = False) -> float:
    """Mean error (m) of the joints, from the pelvis."""
    pose, truth, _ = walker(turned)
    points, body = completed(observed(kinds, turned)), pose.skeleton.indices(BODY)
    off = points[:, body] - points[:, :1] - truth[:, body] + truth[:, :1]
    return float(np.linalg.norm(off, axis=-1).mean())


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Tracker:
    """A tracker whose network has not learned heads that are turned but have no place."""
    tensors, card = read_safetensors(PACKAGED)
    path = tmp_path_factory.mktemp("earlier") / "network.safetensors"
    path.write_bytes(safetensors_bytes(tensors, card | {"reads_unplaced_head": "false"}))
    return Tracker(Person(walker()[0].skeleton), network=load_completion(path))


@given(kinds=st.fixed_dictionaries({name: KINDS for name in JOINTS}))
def test_earlier_networks_do_not_read_the_rotation_of_a_head_without_a_place(
    earlier: Tracker, kinds: dict[str, str]
) -> None:
    with_rotation, without = (
        completed(observed(kinds | {"head": kind})[:30], earlier) for kind in ("rotation", "nothing")
    )
    body = walker()[0].skeleton.indices(BODY)
    np.testing.assert_allclose(with_rotation[:, body], without[:, body], atol=1e-5)


def test_for_earlier_networks_a_head_that_loses_its_place_alone_is_lost(earlier: Tracker) -> None:
    seen = observed({"head": "both", "left_wrist": "both", "right_wrist": "both"})
    place, turn = seen.has_position.copy(), seen.has_rotation.copy()
    place[60:90, 0] = turn[60:90, 0] = False
    points = [
        completed(replace(seen, has_position=place, has_rotation=kept), earlier) for kept in (seen.has_rotation, turn)
    ]
    body = walker()[0].skeleton.indices(BODY)
    np.testing.assert_allclose(points[0][:90, body], points[1][:90, body], atol=1e-5)


def test_the_rotation_of_a_head_without_a_place_helps() -> None:
    """Random signals, with and without it: the body is better with it in most of them, and in the mean."""
    rng = np.random.default_rng(2)
    kinds = [
        dict(zip(JOINTS, rng.choice(["nothing", "rotation", "both"], len(JOINTS)), strict=True)) for _ in range(24)
    ]
    with_rotation, without = (
        np.array([error(one | {"head": kind}) for one in kinds]) for kind in ("rotation", "nothing")
    )
    assert with_rotation.mean() < 0.97 * without.mean()
    assert (with_rotation < 1.05 * without).mean() > 0.72  # measured: 0.79; 0.74 of 96 signals


def test_a_tracked_rotation_of_a_head_is_output() -> None:
    tracker, seen = Tracker(Person(walker()[0].skeleton)), observed({"head": "rotation", "pelvis": "both"})
    estimate, _ = tracker.step(seen, tracker.start())
    turned = np.asarray(forward_kinematics(estimate.pose)[1])[:, walker()[0].skeleton.index("head")]
    assert np.abs(np.sum(turned * seen.rotation[:, 0], axis=-1)).min() > 0.9999


def test_a_network_that_has_learned_unplaced_heads_reads_them(tmp_path: Path) -> None:
    tensors, card = read_safetensors(PACKAGED)
    points = {}
    for name, learned in (("learned", {"reads_unplaced_head": "true"}), ("not", {"reads_unplaced_head": "false"})):
        (tmp_path / name).write_bytes(safetensors_bytes(tensors, card | learned))
        network = load_completion(tmp_path / name)
        assert network.card["reads_unplaced_head"] is json.loads(learned["reads_unplaced_head"])
        tracker = Tracker(Person(walker()[0].skeleton), network=network)
        points[name] = completed(observed({"head": "rotation", "pelvis": "both"}), tracker)
    assert np.abs(points["learned"] - points["not"])[:, : len(BODY)].max() > 0.05


@pytest.mark.parametrize("turned", [False, True])
def test_the_place_of_a_head_alone_is_that_of_somebody_upright(turned: bool) -> None:
    points = completed(observed({"head": "place"}, turned))
    skeleton = walker()[0].skeleton
    shoulders = points[:, skeleton.indices(["left_shoulder", "right_shoulder"]), 1].min()
    assert points[:, skeleton.indices(["left_wrist", "right_wrist"]), 1].max() < shoulders
    assert points[:, skeleton.indices(["left_ankle", "right_ankle"]), 1].min(axis=-1).max() < 0.2


@pytest.mark.parametrize("more", [{"spine3": "rotation"}, {"left_ankle": "place", "right_ankle": "place"}])
@pytest.mark.parametrize("turned", [False, True])
def test_a_placed_head_faces_as_the_body(more: dict[str, str], turned: bool) -> None:
    assert error({"head": "place", **more}, turned) < 0.078


@pytest.mark.parametrize("turned", [False, True])
def test_a_placed_head_faces_where_it_goes(turned: bool) -> None:
    """Without a course a body that walks aside would be turned by a quarter."""
    assert error({"head": "place"}, turned) < 0.1
