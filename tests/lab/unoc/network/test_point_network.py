"""Networks that place points: streaming is batching, the world may turn and grow, the file is the network."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense_lab.papers.formats import PointNetworkTask
from bodysense_lab.papers.unoc.network.export import write_point_network
from bodysense_lab.papers.unoc.network.point_network import (
    FINGERS,
    PAPER_FINGERS,
    PAPER_UPPER_BODY,
    UPPER_BODY,
    PointNetwork,
    PointNetworkConfig,
    TrackedPoints,
    bones,
)
from bodysense_lab.papers.unoc.point_model import WARM_UP, PointRunner, load_point_model
from bodysense_lab.papers.unoc.sequences.point_sequences import tracked_of

SKELETON = default_skeleton()
FORMS: dict[str, tuple[PointNetworkTask, PointNetworkConfig]] = {
    "fingers": ("fingers", replace(FINGERS, hidden=16, branch=(16,))),
    "fingers, paper": ("fingers", replace(PAPER_FINGERS, hidden=16, branch=(16,), window=4)),
    "upper body": ("upper-body", replace(UPPER_BODY, hidden=16, branch=(16,), judge_branch=(8,))),
    "upper body, paper": ("upper-body", replace(PAPER_UPPER_BODY, hidden=16, branch=(16,), window=4)),
}


@pytest.fixture(scope="module")
def networks() -> dict[str, PointNetwork]:
    torch.manual_seed(1)
    return {name: PointNetwork(config, SKELETON).eval() for name, (_, config) in FORMS.items()}


def moving(clip: Clip, frames: int, seed: int) -> Pose:
    """Some frames of a clip, somewhere and facing anywhere."""
    rng = np.random.default_rng(seed)
    first = int(rng.integers(len(clip) - frames))
    return clip.pose[first : first + frames]


@torch.no_grad()
def placed(network: PointNetwork, tracked: TrackedPoints, size: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Positions and errors; handed over `size` frames at a time."""
    memory, out = network.start(1), []
    frames = tracked.position.shape[1]
    for begin in range(0, frames, size or frames):
        piece = slice(begin, begin + (size or frames))
        position, error, memory = network(
            tracked._replace(position=tracked.position[:, piece], rotation=tracked.rotation[:, piece]), memory
        )
        out.append((position[0].numpy(), error[0].numpy()))
    return np.concatenate([one for one, _ in out]), np.concatenate([one for _, one in out])


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=4)
@given(seed=st.integers(0, 999), frames=st.integers(1, 12), size=st.integers(1, 5))
def test_pieces_are_the_whole(form: str, networks, waving_clip: Clip, seed: int, frames: int, size: int) -> None:
    tracked, _ = tracked_of(moving(waving_clip, frames, seed), networks[form])
    for whole, pieces in zip(placed(networks[form], tracked), placed(networks[form], tracked, size), strict=True):
        np.testing.assert_allclose(whole, pieces, atol=1e-5)


@pytest.mark.parametrize("form", ["fingers, paper", "upper body, paper"])
def test_a_window_forgets_what_is_before_it(form: str, networks, waving_clip: Clip) -> None:
    tracked, _ = tracked_of(waving_clip.pose[:20], networks[form])
    late = tracked._replace(position=tracked.position[:, 8:], rotation=tracked.rotation[:, 8:])
    np.testing.assert_allclose(placed(networks[form], tracked)[0][11:], placed(networks[form], late)[0][3:], atol=1e-5)


@pytest.mark.parametrize("form", ["fingers", "upper body"])
def test_a_state_that_is_carried_remembers(form: str, networks, waving_clip: Clip) -> None:
    tracked, _ = tracked_of(waving_clip.pose[:20], networks[form])
    late = tracked._replace(position=tracked.position[:, 8:], rotation=tracked.rotation[:, 8:])
    assert np.abs(placed(networks[form], tracked)[0][8] - placed(networks[form], late)[0][0]).max() > 1e-4


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=4)
@given(seed=st.integers(0, 999), yaw=st.floats(-np.pi, np.pi))
def test_the_answer_turns_and_moves_with_the_body(
    form: str, networks, waving_clip: Clip, seed: int, yaw: float
) -> None:
    pose = moving(waving_clip, 6, seed)
    turn, along = quaternion_exp(np.array([0.0, yaw, 0.0])), np.array([1.5, 0.0, -2.0])
    rotation = pose.rotation.copy()
    rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
    moved = Pose(SKELETON, quaternion_rotate(turn, pose.root_position) + along, rotation)
    here, there = (placed(networks[form], tracked_of(one, networks[form])[0]) for one in (pose, moved))
    np.testing.assert_allclose(there[0], quaternion_rotate(turn, here[0].astype(float)) + along, atol=1e-4)
    np.testing.assert_allclose(there[1], here[1], atol=1e-4)


@pytest.mark.parametrize("form", ["fingers", "upper body, paper"])
@settings(max_examples=4)
@given(seed=st.integers(0, 999), height=st.floats(1.0, 2.4))
def test_the_answer_grows_with_the_body(form: str, networks, waving_clip: Clip, seed: int, height: float) -> None:
    pose = moving(waving_clip, 6, seed)
    size = height / SKELETON.height
    grown = Pose(SKELETON.scaled(height), pose.root_position * size, pose.rotation)
    here, there = (placed(networks[form], tracked_of(one, networks[form])[0]) for one in (pose, grown))
    np.testing.assert_allclose(there[0], size * here[0], atol=1e-4)
    np.testing.assert_allclose(there[1], size * here[1], atol=1e-4)


@pytest.mark.parametrize("form", FORMS)
def test_targets_are_the_truth(form: str, networks, waving_clip: Clip) -> None:
    """Offsets in the network's frame, placed in the world again, are the positions they were made from."""
    network = networks[form]
    tracked, truth = tracked_of(waving_clip.pose[:5], network)
    offset = network.offsets(truth, tracked) * network.size(tracked)[:, None, :, None]
    np.testing.assert_allclose(network.place_in_world(offset, tracked).numpy(), truth.numpy(), atol=1e-5)


@pytest.mark.parametrize("form", FORMS)
def test_bones_have_the_wearers_lengths(form: str, networks, waving_clip: Clip) -> None:
    """The truth's vectors between the ends of bones are as long as the skeleton's bones: ends are found rightly."""
    from bodysense_lab.papers.unoc.point_task import _bones

    network = networks[form]
    tracked, truth = tracked_of(waving_clip.pose[:5], network)
    offset = network.offsets(truth, tracked) * network.size(tracked)[:, None, :, None]
    known = network.prepare(tracked).known * SKELETON.extent / 1.7
    vectors = _bones(offset, known, *bones(network.config, SKELETON))
    length = SKELETON.bone_length[network.bone_points]
    np.testing.assert_allclose(np.linalg.norm(vectors[0].numpy(), axis=-1), np.tile(length, (5, 1)), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["fingers", "upper body, paper"])
def test_the_file_is_the_network(form: str, networks, waving_clip: Clip, tmp_path: Path) -> None:
    """Half precision moves nothing by more than a millimetre."""
    network = networks[form]
    write_point_network(network, tmp_path / "a.onnx", FORMS[form][0], {"licence": "Apache-2.0"})
    model = load_point_model(FORMS[form][0], tmp_path / "a.onnx")
    assert (model.reads, model.places) == (network.config.reads, network.config.places)
    runner = PointRunner(model, SKELETON)
    tracked, _ = tracked_of(waving_clip.pose[:12], network)
    frames = [0] * WARM_UP + list(range(12))  # a file begins with repetitions of its first frame
    warmed = tracked._replace(position=tracked.position[:, frames], rotation=tracked.rotation[:, frames])
    expected, state = [values[WARM_UP:] for values in placed(network, warmed)], runner.start()
    for t in range(12):
        position, error, state = runner.step(
            tracked.position[0, t].numpy(), tracked.rotation[0, t].numpy(), t / 30, state
        )
        np.testing.assert_allclose(position, expected[0][t], atol=1e-3)
        np.testing.assert_allclose(error, expected[1][t], atol=1e-3)
