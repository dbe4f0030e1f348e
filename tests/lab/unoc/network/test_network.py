"""The body network: streaming is batching, the world may turn, move and grow, and what is hidden is not looked at."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense_lab.core.checkpoint import write_weights_file
from bodysense_lab.papers.unoc.learned import load_model
from bodysense_lab.papers.unoc.network.export import write_onnx
from bodysense_lab.papers.unoc.network.network import (
    PAPER,
    BodyNetwork,
    BodyNetworkConfig,
    PredictorState,
    TrackedBody,
    WorldPrediction,
    read_weights,
    tracked_of,
)

CARRIED = BodyNetworkConfig(hidden=16, branch=(16,), finger_branch=(8,), judge_branch=(8,))
WINDOWED = replace(PAPER, hidden=16, branch=(16,), judge_branch=(16,), window=5)
WORLD_AXES = replace(WINDOWED, frame="world")
FORMS = {
    "carried": CARRIED,
    "windowed": WINDOWED,
    "windowed, world axes": WORLD_AXES,
    "windowed headset": replace(CARRIED, window=3),
    "carried positions": replace(CARRIED, inputs="positions"),
    "carried lstm": replace(CARRIED, cell="lstm"),
    "carried rnn": replace(CARRIED, cell="rnn"),
    "convolutions": replace(WINDOWED, cell="tcn", window=9),
    "windowed, mask given": replace(WINDOWED, inputs="positions_and_mask", judges=()),
    "head-local fingers": replace(CARRIED, finger_origin="head"),
    "without skip": replace(WINDOWED, skip=False),
}
SMALL = BodyNetworkConfig(hidden=16, branch=(16,))  # of the fixture `small_network`
SKELETON = default_skeleton()
HEAD = SKELETON.index("head")


@pytest.fixture(scope="module")
def networks() -> dict[str, BodyNetwork]:
    torch.manual_seed(1)
    return {name: BodyNetwork(config, SKELETON).eval() for name, config in FORMS.items()}


def motion(frames: int, seed: int, batch: int = 1, hidden: float = 0.5) -> TrackedBody:
    """Points that wander about a standing body, hidden and seen at random; the head always known, and turning."""
    rng = np.random.default_rng(seed)
    standing, _ = forward_kinematics(standing_pose(SKELETON))
    wander = np.cumsum(rng.normal(scale=0.01, size=(batch, frames, len(SKELETON.points), 3)), axis=1)
    position = standing + wander
    angle = np.cumsum(rng.normal(scale=0.05, size=(batch, frames, 3)), axis=1) + rng.normal(size=(batch, 1, 3))
    visible = rng.uniform(size=position.shape[:-1]) > hidden
    visible[..., HEAD] = True
    return TrackedBody(
        position=torch.tensor(position, dtype=torch.float32),
        visible=torch.tensor(visible),
        head_position=torch.tensor(position[..., HEAD, :], dtype=torch.float32),
        head_rotation=torch.tensor(quaternion_exp(angle), dtype=torch.float32),
        interval=torch.tensor(rng.uniform(0.02, 0.05, size=(batch, frames)), dtype=torch.float32),
        bone_length=torch.tensor(SKELETON.bone_length * rng.uniform(0.9, 1.1, size=(batch, 1)), dtype=torch.float32),
        height=torch.tensor(SKELETON.extent * rng.uniform(0.9, 1.1, size=batch), dtype=torch.float32),
    )


def cut(tracked: TrackedBody, frames: slice) -> TrackedBody:
    """Some frames of a motion."""
    fixed = {"bone_length": tracked.bone_length, "height": tracked.height}
    return TrackedBody(
        **{name: value[:, frames] for name, value in tracked._asdict().items() if name not in fixed} | fixed
    )


@torch.no_grad()
def complete(
    network: BodyNetwork, tracked: TrackedBody, cuts: list[int] | None = None
) -> tuple[WorldPrediction, PredictorState]:
    """The whole motion, handed over in pieces that end at `cuts`."""
    batch, frames = tracked.visible.shape[:2]
    state, pieces = network.start(batch), []
    for begin, end in pairwise(sorted({0, *(cuts or []), frames})):
        piece, state = network(cut(tracked, slice(begin, end)), state)
        pieces.append(piece)
    return WorldPrediction(*(torch.cat(parts, dim=1) for parts in zip(*pieces, strict=True))), state


def assert_same(first: tuple[Tensor, ...], second: tuple[Tensor, ...], tolerance: float) -> None:
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a.numpy().astype(float), b.numpy().astype(float), atol=tolerance)


@pytest.mark.parametrize("form", ["carried", "windowed headset", "carried lstm", "convolutions"])
@settings(max_examples=6)
@given(seed=st.integers(0, 9999), hidden=st.floats(0, 1), data=st.data())
def test_pieces_are_the_whole(form: str, networks, seed: int, hidden: float, data: st.DataObject) -> None:
    frames = data.draw(st.integers(1, 14))
    tracked = motion(frames, seed, batch=2, hidden=hidden)
    cuts = data.draw(st.lists(st.integers(1, frames), max_size=frames))
    whole, end = complete(networks[form], tracked)
    pieces, end_of_pieces = complete(networks[form], tracked, cuts)
    assert_same(whole, pieces, 1e-5)
    assert_same(end, end_of_pieces, 1e-5)


def test_a_window_ends_at_its_frame(networks) -> None:
    """The output at a frame is the recurrent network's last output on that frame and the four before it.

    Before the beginning, the first frame is repeated.
    """
    network = networks["windowed"]
    features = torch.randn(2, 8, network.features, generator=torch.Generator().manual_seed(0))
    hidden, memory = network.recurrent(features, network.start(2).memory)
    padded = torch.cat([features[:, :1]] * 4 + [features], dim=1)
    for frame in range(8):
        last = network.recurrent.last(padded[:, frame : frame + 5])
        np.testing.assert_allclose(hidden[:, frame].detach().numpy(), last.detach().numpy(), atol=1e-6)
    assert torch.equal(memory, features[:, 3:])


@pytest.mark.parametrize("form", ["carried", "carried positions", "windowed, world axes", "head-local fingers"])
@settings(max_examples=6)
@given(
    seed=st.integers(0, 9999),
    yaw=st.floats(-np.pi, np.pi),
    shift=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
)
def test_the_answer_moves_with_the_world(
    form: str, networks, seed: int, yaw: float, shift: tuple[float, float]
) -> None:
    """Turned about +Y and shifted along the ground. World axes do not turn, so there only the shift."""
    tracked = motion(7, seed)
    turn = torch.tensor(quaternion_exp(np.array([0.0, 0.0 if FORMS[form].frame == "world" else yaw, 0.0]))).float()
    along = torch.tensor([shift[0], 0.0, shift[1]])
    moved = tracked._replace(
        position=quaternion_rotate(turn, tracked.position) + along,
        head_position=quaternion_rotate(turn, tracked.head_position) + along,
        head_rotation=quaternion_multiply(turn.expand_as(tracked.head_rotation), tracked.head_rotation),
    )
    here, there = complete(networks[form], tracked)[0], complete(networks[form], moved)[0]
    expected = quaternion_rotate(turn, here.position) + along
    np.testing.assert_allclose(there.position.numpy(), expected.numpy(), atol=1e-4)
    assert_same(here[1:], there[1:], 1e-4)


@pytest.mark.parametrize("form", ["carried", "without skip", "head-local fingers"])
@settings(max_examples=6)
@given(seed=st.integers(0, 9999), size=st.floats(0.6, 1.5))
def test_the_answer_grows_with_the_body(form: str, networks, seed: int, size: float) -> None:
    tracked = motion(6, seed)
    grown = tracked._replace(
        position=tracked.position * size,
        head_position=tracked.head_position * size,
        bone_length=tracked.bone_length * size,
        height=tracked.height * size,
    )
    here, there = complete(networks[form], tracked)[0], complete(networks[form], grown)[0]
    np.testing.assert_allclose(there.position.numpy(), size * here.position.numpy(), atol=1e-4)
    np.testing.assert_allclose(there.occluded.numpy(), here.occluded.numpy(), atol=1e-4)
    np.testing.assert_allclose(there.error.numpy(), size * here.error.numpy(), atol=1e-4)


@pytest.mark.parametrize("form", ["carried", "carried positions", "windowed, mask given"])
@settings(max_examples=6)
@given(seed=st.integers(0, 9999), garbage=st.floats(-1e6, 1e6), hidden=st.floats(0, 1))
def test_hidden_values_do_not_matter(form: str, networks, seed: int, garbage: float, hidden: float) -> None:
    tracked = motion(6, seed, hidden=hidden)
    spoilt = tracked._replace(position=torch.where(tracked.visible[..., None], tracked.position, garbage))
    first, state = complete(networks[form], tracked)
    second, other = complete(networks[form], spoilt)
    for a, b in zip((*first, *state), (*second, *other), strict=True):
        assert torch.equal(a, b)


def test_a_finger_counts_as_seen_only_with_its_wrist(networks) -> None:
    """Fingers are offsets from the wrist: without the wrist there is nothing to measure from."""
    tracked = motion(1, 0, hidden=0.0)
    tracked.visible[..., SKELETON.index("left_wrist")] = False
    _, state = complete(networks["carried"], tracked)
    seen = {name for name, here in zip(SKELETON.points, state.seen[0].tolist(), strict=True) if here}
    lost = {name for name in SKELETON.points if name.startswith("left_") and any(c.isdigit() for c in name)}
    lost |= {name for name in SKELETON.points if name.startswith("left_") and name.endswith("_tip")} | {"left_wrist"}
    assert set(SKELETON.points) - seen == lost


def test_an_untrained_change_of_zero_repeats_the_last_known(networks) -> None:
    """The network predicts a change of the last known offsets: if it is zero, they are the output."""
    network = BodyNetwork(CARRIED, SKELETON).eval()
    assert network.place_fingers is not None
    for parameter in [*network.place[-1].parameters(), *network.place_fingers[-1].parameters()]:
        torch.nn.init.zeros_(parameter)
    tracked = motion(1, 7, hidden=0.0)
    answer, _ = complete(network, tracked)
    np.testing.assert_allclose(answer.position.numpy(), tracked.position.numpy(), atol=1e-5)
    nothing = tracked._replace(visible=torch.zeros_like(tracked.visible))
    sized = SKELETON.with_offsets(SKELETON.rest_offset * (float(tracked.height) / SKELETON.extent))
    standing, _ = forward_kinematics(standing_pose(sized))
    turn = network.facing(tracked.head_rotation)[0][0, 0].numpy()
    yaw = np.array([0.0, np.arctan2(turn[1], turn[0]), 0.0])
    expected = quaternion_rotate(quaternion_exp(yaw), standing - standing[HEAD]) + tracked.head_position[0, 0].numpy()
    np.testing.assert_allclose(complete(network, nothing)[0].position[0, 0].numpy(), expected, atol=1e-5)


@pytest.mark.parametrize("rotation", [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
def test_a_head_upside_down_has_some_heading(networks, rotation: list[float]) -> None:
    """Turned by exactly π about a horizontal axis, it has no heading; the answer must be a body all the same."""
    tracked = motion(3, 2)._replace(head_rotation=torch.tensor(rotation).expand(1, 3, 4))
    turn, *_ = networks["carried"].facing(tracked.head_rotation)
    np.testing.assert_allclose(torch.linalg.norm(turn, dim=-1).numpy(), 1.0, atol=1e-6)
    assert_same(complete(networks["carried"], tracked)[0], complete(networks["carried"], tracked, [1, 2])[0], 1e-5)


@pytest.mark.parametrize("form", FORMS)
def test_gradients_are_finite(form: str, networks) -> None:
    network = networks[form]
    tracked = motion(8, 4, batch=2, hidden=0.9)
    completed, _ = network(tracked, network.start(2))
    torch.stack([part.square().mean() for part in completed]).sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().sum() > 0 or name.endswith("hh_l0"), name
        parameter.grad = None


def test_a_head_faces_where_its_rotation_says() -> None:
    """Against SciPy: heading, forward and up of a turn about +Y after a tilt."""
    network = BodyNetwork(SMALL, SKELETON)
    yaw = Rotation.from_euler("y", [[0.3], [-2.0], [3.0]])
    tilt = Rotation.from_euler("xz", [[0.5, 0.1], [-0.7, 0.4], [1.2, -0.3]])
    turned = torch.tensor((yaw * tilt).as_quat(scalar_first=True)[None], dtype=torch.float32)
    heading, into, vectors = network.facing(turned)
    angle = torch.atan2(heading[0, :, 1], heading[0, :, 0])
    w, y = turned[0, :, 0], turned[0, :, 2]
    np.testing.assert_allclose(np.exp(1j * angle.numpy()), np.exp(2j * np.arctan2(y.numpy(), w.numpy())), atol=1e-6)
    back = Rotation.from_euler("y", -angle.numpy()[:, None])
    np.testing.assert_allclose(into[0].mT.numpy(), back.as_matrix(), atol=1e-6)
    for row, axis in enumerate(([0, 0, 1], [0, 1, 0])):
        np.testing.assert_allclose(vectors[0, :, row].numpy(), (back * yaw * tilt).apply(axis), atol=1e-6)


def test_convolutions_see_their_window_and_nothing_else(networks) -> None:
    recurrent = networks["convolutions"].recurrent
    features = torch.randn(1, 9, recurrent.features, generator=torch.Generator().manual_seed(0), requires_grad=True)
    recurrent.last(features).sum().backward()
    assert features.grad is not None and (features.grad.abs().sum(dim=-1) > 0).all()


@pytest.mark.parametrize("window", [None, 5, 1])
def test_convolutions_need_a_power_of_three(window: int | None) -> None:
    with pytest.raises(BodysenseError, match="window of 3, 9, 27, 81"):
        BodyNetwork(replace(WINDOWED, cell="tcn", window=window), SKELETON)


@pytest.mark.parametrize("form", FORMS)
def test_weights_come_back(form: str, networks, tmp_path: Path) -> None:
    network, tracked = networks[form], motion(4, 1)
    write_weights_file(network, tmp_path / "a.pt", {})
    earlier = {"config": json.dumps(asdict(network.config)), "weights": network.state_dict()}  # without a card
    torch.save(earlier, tmp_path / "earlier.pt")
    for name in ("a.pt", "earlier.pt"):
        again = read_weights(tmp_path / name, SKELETON)
        assert again.config == network.config
        assert_same(complete(network, tracked)[0], complete(again, tracked)[0], 0.0)


def test_other_files_than_networks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="no such file; train it with `bodysense train unoc-tables`"):
        read_weights(tmp_path / "a.pt", SKELETON)
    (tmp_path / "a.pt").write_bytes(b"not a network")
    with pytest.raises(BodysenseError, match="not the weights of a network of UNOC's tables"):
        read_weights(tmp_path / "a.pt", SKELETON)


def test_an_observation_is_what_the_network_reads(waving_clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    tracked = tracked_of(seen, waving_clip.pose.skeleton)
    assert tracked.visible.shape == (1, len(waving_clip), len(SKELETON.points))
    np.testing.assert_array_equal(tracked.visible[0].numpy(), seen.has_position)
    visible = seen.has_position
    np.testing.assert_allclose(tracked.position[0].numpy()[visible], seen.position[visible], atol=1e-6)
    assert torch.isfinite(tracked.position).all()
    np.testing.assert_allclose(tracked.interval[0].numpy(), 1 / waving_clip.frame_rate, atol=1e-6)


# --- the exported file


def run_onnx(path: Path, tracked: TrackedBody) -> list[np.ndarray]:
    """Positions, probabilities and errors of the exported network, frame by frame, from the state in its card."""
    model = load_model(path)
    state, rows = model.start(), []
    for frame in range(tracked.visible.shape[1]):
        now = cut(tracked, slice(frame, frame + 1))
        answer, state = model.step({name: value.numpy() for name, value in now._asdict().items()}, state)
        rows.append([answer[name][0, 0] for name in ("completed", "occluded", "error")])
    return [np.stack(parts) for parts in zip(*rows, strict=True)]


@pytest.fixture(scope="module")
def exported(small_network: Path) -> tuple[Path, BodyNetwork, BodyNetwork]:
    """The file, the network that was exported, and the same with its large weights rounded to half precision."""
    torch.manual_seed(0)
    network = BodyNetwork(SMALL, SKELETON).eval()
    rounded = BodyNetwork(SMALL, SKELETON).eval()
    rounded.load_state_dict(
        {name: value.half().float() if value.numel() >= 4096 else value for name, value in network.state_dict().items()}
    )
    return small_network, network, rounded


@settings(max_examples=4)
@given(seed=st.integers(0, 9999), hidden=st.floats(0.2, 1))
def test_the_file_predicts_as_the_network(exported, seed: int, hidden: float) -> None:
    path, network, rounded = exported
    tracked = motion(50, seed, hidden=hidden)
    written = run_onnx(path, tracked)
    with torch.no_grad():
        exact, close = (complete(which, tracked)[0] for which in (rounded, network))
    for ours, theirs, tolerance in zip(exact, written, (1e-4, 1e-4, 1e-4), strict=True):
        np.testing.assert_allclose(theirs, ours[0].numpy(), atol=tolerance)
    np.testing.assert_allclose(written[0], close.position[0].numpy(), atol=2e-3)  # half precision's own error


def test_the_file_describes_itself(exported) -> None:
    path, network, _ = exported
    model = load_model(path)
    assert tuple(model.card["points"]) == SKELETON.points
    assert model.card["rate"] == 30.0
    assert model.card["licence"] == "Apache-2.0"
    stored: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in model.card["network"].items()
    }
    assert BodyNetworkConfig(**stored) == SMALL
    assert model.card["weights"] == sum(parameter.numel() for parameter in network.parameters())
    assert set(model.card["state"]) == {f"state_{name}" for name in PredictorState._fields}
    assert set(model.inputs) == {*TrackedBody._fields, *(f"state_{name}" for name in PredictorState._fields)}
    assert isinstance(model.session, onnxruntime.InferenceSession)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["windowed, world axes"])
def test_the_papers_forms_are_exported_too(form: str, networks, tmp_path: Path) -> None:
    write_onnx(networks[form], tmp_path / "a.onnx", {})
    tracked = motion(12, 3)
    expected, _ = complete(networks[form], tracked)
    for ours, theirs in zip(expected, run_onnx(tmp_path / "a.onnx", tracked), strict=True):
        np.testing.assert_allclose(theirs, ours[0].numpy(), atol=2e-3)
