"""Training of a glove's networks: drawn batches, falling losses, and resumed runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.hands.glove import default_glove, marker_positions, template
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.hands.hand_family import draw_hand
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.gloves.networks import known_shapes, load_joint_network, load_marker_network, size_ratios
from bodysense.errors import BodysenseError
from bodysense_lab.core.fit import fit
from bodysense_lab.papers.two_hands.drawing import (
    JointTask,
    MarkerTask,
    draw_markers,
    finger_points,
    hide,
    in_hand,
    registered,
    turned_to,
)
from bodysense_lab.papers.two_hands.frames import GloveFrames, frames_of, join
from bodysense_lab.papers.two_hands.given_shapes import EXACT, UNKNOWN, draw_shapes
from bodysense_lab.papers.two_hands.network import (
    PAPER_JOINTS,
    JointNetwork,
    JointNetworkConfig,
    MarkerNetwork,
    MarkerNetworkConfig,
)
from bodysense_lab.papers.two_hands.task import GloveSchedule, GloveTask
from bodysense_lab.papers.two_hands.train import write_glove_network
from bodysense_lab.papers.two_hands.trials import FINGER_POINTS
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion

SMALL = GloveSchedule(steps=60, batch=64, learning_rate=4e-3, check_every=30, warm_up=5, average_decay=0.8)


@pytest.fixture(scope="module")
def hand() -> Skeleton:
    return draw_hand(np.random.default_rng(3)).skeleton


@pytest.fixture(scope="module")
def motion(hand: Skeleton) -> HandMotion:
    return synthesize_hand(hand, 8.0, np.random.default_rng(4), 30.0)


@pytest.fixture(scope="module")
def frames(motion: HandMotion) -> GloveFrames:
    return frames_of(motion)


def test_frames_are_the_motion_from_the_wrist_at_one_size(
    motion: HandMotion, hand: Skeleton, frames: GloveFrames
) -> None:
    ratio = size_ratios([hand])[0]
    markers = marker_positions(default_glove(), motion.pose)
    points, _ = forward_kinematics(motion.pose)
    for ours, true in ((frames.markers, markers), (frames.points, points)):
        # From the wrist in its axes: distances between points stay.
        between = np.linalg.norm(true[:, 3:] - true[:, :-3], axis=-1) / ratio
        assert np.allclose(np.linalg.norm(ours[:, 3:] - ours[:, :-3], axis=-1), between, atol=1e-6)
    assert np.abs(frames.points[:, 0]).max() == 0


def test_joined_motions_keep_their_own_hands(frames: GloveFrames, motion: HandMotion) -> None:
    other = frames_of(motion, draw_hand(np.random.default_rng(8)))
    both = join([frames, other])
    assert len(both) == 2 * len(frames)
    assert np.array_equal(both.rest[both.motion[-1]], other.rest[0])
    assert np.array_equal(both.rest[both.motion[0]], frames.rest[0])
    assert np.array_equal(both.markers[len(frames) :], other.markers)
    with pytest.raises(BodysenseError, match="no motion with fingers"):
        join([])


def test_numbers_of_hidden_markers_follow_their_shares() -> None:
    hidden = hide(20_000, (0.70, 0.17, 0.08, 0.05), np.random.default_rng(1))
    counts = np.bincount(hidden.sum(axis=1), minlength=5)[1:] / len(hidden)
    assert np.allclose(counts, [0.70, 0.17, 0.08, 0.05], atol=0.01)
    assert np.allclose(hidden.mean(axis=0), hidden.mean(), atol=0.02)  # every marker as often


def test_registration_by_known_markers_equals_scipy(frames: GloveFrames, hand: Skeleton) -> None:
    from scipy.spatial.transform import Rotation

    markers = frames.markers[[0, 100]].astype(float)
    hidden = np.zeros((2, 9), dtype=bool)
    hidden[:, [1, 5]] = True
    goal = np.broadcast_to(frames.template[0], markers.shape)
    made = registered(markers, hidden, np.zeros((2, 87)), goal)
    assert np.allclose(frames.template[0], template(default_glove(), hand) / size_ratios([hand])[0])
    for row in range(2):
        known = ~hidden[row]
        middle, aim = markers[row][known].mean(axis=0), goal[row][known].mean(axis=0)
        turn = Rotation.align_vectors(goal[row][known] - aim, markers[row][known] - middle)[0]
        expected = turn.apply(markers[row] - middle) + aim
        assert np.allclose(made.all[row].reshape(9, 3), expected, atol=1e-6)
        assert not made.seen[row].reshape(9, 3)[hidden[row]].any()
        assert np.allclose(made.seen[row].reshape(9, 3)[known], expected[known], atol=1e-6)


def test_drawn_frames_are_of_one_motion_with_the_same_markers_hidden(frames: GloveFrames) -> None:
    drawn = draw_markers(frames, 50, (0.5, 0.5), 0.0, np.random.default_rng(1))
    assert torch.equal(drawn.hidden[0], drawn.hidden[1])
    assert torch.equal(drawn.hand[0], drawn.hand[1])
    again = draw_markers(frames, 50, (0.5, 0.5), 0.0, np.random.default_rng(1))
    assert torch.equal(drawn.seen, again.seen)


def test_true_angles_give_the_true_points_of_fingers(frames: GloveFrames) -> None:
    """The angles of a synthesised hand determine its finger points; the finger rotation is the identity."""
    points = finger_points(torch.from_numpy(frames.angles), *_of(frames))
    assert np.allclose(points, frames.points, atol=1e-5)
    turned = turned_to(points, torch.from_numpy(frames.markers))
    places = default_hand().indices(FINGER_POINTS)
    assert np.allclose(turned.flatten(1, 2), frames.points[:, places], atol=1e-4)


def test_a_turned_finger_points_at_its_marker(frames: GloveFrames) -> None:
    points = finger_points(torch.from_numpy(frames.angles) + 0.1, *_of(frames))
    turned = turned_to(points, torch.from_numpy(frames.markers)).numpy()
    glove, hand = default_glove(), default_hand()
    for place, finger in enumerate(("thumb", "index", "middle", "ring", "pinky")):
        base = frames.points[:, hand.index(f"{finger}1")]
        marker = frames.markers[:, glove.markers.index(f"{finger}_tip")]
        a, b = turned[:, place, 2] - base, marker - base
        cosine = (a * b).sum(axis=-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
        assert cosine.min() > 1 - 1e-5


def test_inputs_of_the_joint_network_do_not_depend_on_the_place_of_the_hand(frames: GloveFrames) -> None:
    rows = np.arange(20)
    markers, points, flat = frames.markers[rows], frames.points[rows], frames.template[frames.motion[rows]]
    here, joints = in_hand(markers, points, flat)
    assert np.allclose(here, markers, atol=1e-6)  # it is at its wrist already
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    there, moved = in_hand(markers @ turn + 0.3, points @ turn + 0.3, flat)
    assert np.allclose(here, there, atol=1e-5)
    assert np.allclose(joints, moved, atol=1e-5)


def _of(frames: GloveFrames) -> tuple[torch.Tensor, torch.Tensor]:
    """Resting offsets and axes of every frame."""
    return torch.from_numpy(frames.rest[frames.motion]), torch.from_numpy(frames.axes[frames.motion])


def test_shapes_are_exact_or_have_an_error_or_are_unknown(motion: HandMotion) -> None:
    worn = draw_hand(np.random.default_rng(8))
    frames = frames_of(motion, worn)
    shapes = draw_shapes(frames, np.zeros(4000, dtype=int), np.random.default_rng(1))
    exact = np.abs(shapes.rest - frames.rest).max(axis=(1, 2)) < 1e-6
    nothing = ~shapes.shape.any(axis=1)
    assert exact.mean() == pytest.approx(EXACT, abs=0.03)
    assert nothing.mean() == pytest.approx(UNKNOWN, abs=0.03)
    assert np.allclose(shapes.shape[exact], known_shapes([worn.skeleton], [worn.glove])[0], atol=1e-6)
    assert np.allclose(shapes.scale[exact], 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["markers", "paper joints"])
def test_losses_fall(name: str, frames: GloveFrames, tmp_path: Path) -> None:
    torch.manual_seed(0)
    if name == "markers":
        task: GloveTask = MarkerTask(MarkerNetwork(MarkerNetworkConfig((32,))), SMALL, frames, frames, {})
    else:
        network = JointNetwork(replace(PAPER_JOINTS, layers=(32, 32)))
        task = JointTask(network, replace(SMALL, squared=True, average_decay=0.0, patience=2), frames, frames, {})

    def loss() -> float:
        task.network.eval()
        with torch.no_grad():
            return float(task.loss(np.random.default_rng(9), None)[0]["loss"])

    before = loss()
    figures = fit(task, tmp_path / "one.ckpt", lambda progress: None)
    assert loss() < 0.85 * before
    assert task.validate(task.network) == pytest.approx(figures, rel=1e-5)  # the best weights are in it


def test_the_learning_rate_is_halved_without_progress(frames: GloveFrames, tmp_path: Path) -> None:
    class Stuck(GloveTask):
        def loss(self, batch: np.random.Generator, memory: None) -> tuple[dict[str, torch.Tensor], None]:
            return {"loss": sum((p.sum() * 0 for p in self.network.parameters()), torch.zeros(()))}, None

        def validate(self, network: torch.nn.Module) -> dict[str, float]:
            return {"error_cm": 1.0}

    schedule = replace(SMALL, steps=140, check_every=20, patience=2)
    network = MarkerNetwork(MarkerNetworkConfig((4,)))
    fit(Stuck(network, schedule, frames, frames, {}), tmp_path / "one.ckpt", lambda progress: None)
    best = torch.load(tmp_path / "one.ckpt", weights_only=True)["best"]
    assert best["factor"] == 0.125  # one check that is best, then six without progress


@pytest.mark.parametrize("name", ["markers", "joints"])
def test_the_file_predicts_as_the_network_for_any_number_of_hands(
    name: str, frames: GloveFrames, exported_once: Callable[[str, Callable[[Path], None]], Path]
) -> None:
    torch.manual_seed(0)
    network = MarkerNetwork(MarkerNetworkConfig()) if name == "markers" else JointNetwork(JointNetworkConfig())
    path = exported_once(f"glove_{name}.onnx", lambda path: write_glove_network(network, path, {"licence": "none"}))
    load = load_marker_network if name == "markers" else load_joint_network
    loaded = load(path)
    assert loaded.network.card["licence"] == "none"
    assert path.stat().st_size < 1e6
    for count in (1, 2, 17):
        markers = torch.from_numpy(frames.markers[:count]).flatten(-2)
        markers[0, :3] = 0.0
        shape = draw_shapes(frames, np.zeros(count, dtype=int), np.random.default_rng(count)).shape
        hand = torch.from_numpy(shape)
        with torch.no_grad():
            expected = network.eval()(markers, hand).numpy()
        shapes = loaded.run(markers.numpy(), hand.numpy())
        assert shapes.shape == expected.shape
        # Half precision of weights, of numbers of the size of 0.1 m and of 0.5 rad.
        assert np.abs(shapes - expected).max() < (2e-4 if name == "markers" else 4e-3)


def default_hand() -> Skeleton:
    return hand_skeleton(default_skeleton(), "left")
