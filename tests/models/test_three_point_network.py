"""The three-point network: frame by frame as in one go, indifferent to place, heading and size; its fast geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from bodysense.body.body_joints import body_skeleton
from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.rotation import (
    geodesic_angle,
    matrix_to_quaternion,
    quaternion_exp,
    quaternion_to_matrix,
    sixd_to_matrix,
)
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.data.augment import at_height, mirrored, turned
from bodysense.data.clip import Clip
from bodysense.models.recurrent import Recurrent
from bodysense.models.three_point_network import (
    NEVER,
    Completed,
    State,
    ThreePointConfig,
    ThreePointNetwork,
    Tracked,
    tracked_of,
)
from bodysense.occlusion.dropout import hide
from bodysense.occlusion.three_point import HEAD_ONLY, observe

SKELETON = default_skeleton()


@pytest.fixture(scope="module")
def network() -> ThreePointNetwork:
    """Nobody trained it; double precision, so that what must agree does."""
    torch.manual_seed(0)
    return ThreePointNetwork(ThreePointConfig(hidden=24, branch=(16,), judge_branch=(16,))).double().eval()


def seen(clip: Clip, hidden: np.ndarray | None = None) -> Tracked:
    """What is tracked of a clip; hands are hidden where `hidden` (T, 2) says so."""
    observation = observe(clip.pose, clip.time)
    if hidden is not None:
        observation = hide(observation, np.concatenate([np.zeros((len(clip), 1), dtype=bool), hidden], axis=1))
    tracked = tracked_of(observation, clip.pose.skeleton)
    return Tracked(*(value.double() if value.is_floating_point() else value for value in tracked))


def frames(tracked: Tracked, key: slice) -> Tracked:
    return tracked._replace(**{name: getattr(tracked, name)[:, key] for name in Tracked._fields[:5]})


def complete(network: ThreePointNetwork, tracked: Tracked, state: State | None = None) -> tuple[Completed, State]:
    with torch.no_grad():
        return network(tracked, network.start(len(tracked.height)) if state is None else state)


@settings(max_examples=15, deadline=None)
@given(hidden=npst.arrays(bool, (20, 2)), cut=st.integers(1, 19))
def test_frames_in_pieces_are_the_whole(
    network: ThreePointNetwork, waving_clip: Clip, hidden: np.ndarray, cut: int
) -> None:
    """Whatever is lost when, and wherever the pieces begin; a single frame takes another way than many."""
    tracked = seen(replace(waving_clip, pose=waving_clip.pose[:20]), hidden)
    whole, last = complete(network, tracked)
    first, state = complete(network, frames(tracked, slice(0, cut)))
    rest = [first]
    for t in range(cut, 20):
        one, state = complete(network, frames(tracked, slice(t, t + 1)), state)
        rest.append(one)
    for name in Completed._fields:
        pieces = torch.cat([getattr(one, name) for one in rest], dim=1)
        torch.testing.assert_close(pieces, getattr(whole, name), rtol=1e-9, atol=1e-9)
    for name in State._fields:
        torch.testing.assert_close(getattr(state, name), getattr(last, name), rtol=1e-9, atol=1e-9)


def test_a_batch_is_its_sequences(network: ThreePointNetwork, waving_clip: Clip) -> None:
    one, two = seen(waving_clip), seen(at_height(waving_clip, 1.9), np.ones((90, 2), dtype=bool))
    both = Tracked(*(torch.cat(pair) for pair in zip(one, two, strict=True)))
    together, _ = complete(network, both)
    for k, alone in enumerate((one, two)):
        torch.testing.assert_close(together.position[k : k + 1], complete(network, alone)[0].position)


@pytest.mark.parametrize("yaw", [0.7, 3.0])
def test_the_answer_turns_and_moves_with_the_world(network: ThreePointNetwork, waving_clip: Clip, yaw: float) -> None:
    """A turn about the vertical and a place on the floor change nothing else."""
    before, _ = complete(network, seen(waving_clip))
    moved = turned(waving_clip, yaw)
    shift = np.array([3.0, 0.0, -2.0])
    moved = replace(moved, pose=replace(moved.pose, root_position=moved.pose.root_position + shift))
    after, _ = complete(network, seen(moved))
    turn = torch.tensor(quaternion_to_matrix(quaternion_exp(np.array([0.0, yaw, 0.0]))))
    # The observation was rounded to single precision.
    expected = before.position @ turn.T + torch.tensor(shift)
    torch.testing.assert_close(after.position, expected, atol=1e-5, rtol=0)


def test_a_mirrored_body_gets_the_mirrored_answer(network: ThreePointNetwork, waving_clip: Clip) -> None:
    """Also of a hand that is lost, and of contact and expected error."""
    lost = np.zeros((90, 2), dtype=bool)
    lost[30:60, 0] = True
    here, _ = complete(network, seen(waving_clip, lost))
    there, _ = complete(network, seen(mirrored(waving_clip), lost[:, ::-1]))
    swap = [BODY.index(name) for name in (_other_side(name) for name in BODY)]
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(there.position[:, :, swap] * flip, here.position, atol=1e-5, rtol=0)
    turn = there.rotation[:, :, swap] * torch.tensor([1.0, 1.0, -1.0, -1.0], dtype=torch.float64)
    assert geodesic_angle(turn.numpy(), here.rotation.numpy()).max() < 1e-4
    torch.testing.assert_close(there.error[:, :, swap], here.error, atol=1e-5, rtol=0)
    torch.testing.assert_close(there.contact[:, :, [1, 0, 3, 2]], here.contact, atol=1e-5, rtol=0)


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


@pytest.mark.parametrize("height", [1.45, 2.05])
def test_a_larger_body_gets_the_same_answer_larger(
    network: ThreePointNetwork, waving_clip: Clip, height: float
) -> None:
    size = height / waving_clip.pose.skeleton.height
    before, _ = complete(network, seen(waving_clip))
    after, _ = complete(network, seen(at_height(waving_clip, height)))
    torch.testing.assert_close(after.position, before.position * size, atol=1e-5, rtol=0)
    torch.testing.assert_close(after.error, before.error * size, atol=1e-5, rtol=0)


def test_head_and_hands_are_as_measured_and_bones_the_wearers(network: ThreePointNetwork, waving_clip: Clip) -> None:
    tracked = seen(waving_clip)
    completed, _ = complete(network, tracked)
    points = [BODY.index(name) for name in ("head", "left_wrist", "right_wrist")]
    torch.testing.assert_close(completed.position[:, :, points[0]], tracked.position[:, :, 0])
    angle = geodesic_angle(completed.rotation[:, :, points].numpy(), tracked.rotation.numpy())
    assert angle.max() < 1e-5
    body = body_skeleton(SKELETON)
    pose = Pose(body, completed.root[0].numpy(), local_rotation(body, completed.rotation[0].numpy()))
    np.testing.assert_allclose(forward_kinematics(pose)[0], completed.position[0].numpy(), atol=1e-6)


def test_a_lost_hand_stays_with_the_head_and_its_clock_runs(network: ThreePointNetwork, waving_clip: Clip) -> None:
    hidden = np.zeros((90, 2), dtype=bool)
    hidden[30:, 0] = True
    _, at_loss = complete(network, frames(seen(waving_clip), slice(0, 30)))
    _, later = complete(network, seen(waving_clip, hidden))
    torch.testing.assert_close(later.offset[:, 0], at_loss.offset[:, 0])
    assert not torch.allclose(later.offset[:, 1], at_loss.offset[:, 1], atol=1e-3)
    torch.testing.assert_close(later.unseen, torch.tensor([[60 / 30, 0.0]]).double(), atol=1e-5, rtol=0)
    never = tracked_of(observe(waving_clip.pose, waving_clip.time, HEAD_ONLY), SKELETON)
    _, alone = complete(network, Tracked(*(v.double() if v.is_floating_point() else v for v in never)))
    assert alone.unseen.min() >= NEVER


def test_what_is_hidden_is_not_read(network: ThreePointNetwork, waving_clip: Clip) -> None:
    hidden = np.tile([True, False], (90, 1))
    tracked = seen(waving_clip, hidden)
    other = tracked._replace(position=tracked.position.clone(), rotation=tracked.rotation.clone())
    other.position[:, :, 1], other.rotation[:, :, 1] = 7.0, torch.tensor([0.0, 1.0, 0.0, 0.0]).double()
    torch.testing.assert_close(complete(network, tracked)[0].position, complete(network, other)[0].position)


@settings(max_examples=50, deadline=None)
@given(npst.arrays(float, (5, 4), elements=st.floats(-1, 1)), npst.arrays(float, (5, 6), elements=st.floats(-2, 2)))
@example(np.eye(5, 4), np.tile([1e-12, 1e-12, 1e-12, 0.0, 1.0, 0.0], (5, 1)))
def test_fast_geometry_is_that_of_the_house(network: ThreePointNetwork, rotation: np.ndarray, axes: np.ndarray) -> None:
    """Quaternions of matrices and rotations of two columns, half turns among them."""
    rotation[0] = [0.0, 1.0, 0.0, 0.0]
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    rotation = np.where(length > 0.1, rotation / np.maximum(length, 0.1), [1.0, 0.0, 0.0, 0.0])
    matrix = quaternion_to_matrix(rotation)
    fast = network.quaternions(torch.tensor(matrix)).numpy()
    assert geodesic_angle(fast, matrix_to_quaternion(matrix)).max() < 1e-7
    assert (fast[:, 0] >= 0).all()
    across = np.linalg.norm(np.cross(axes[:, :3], axes[:, 3:]), axis=-1)
    good = across > 0.05 * np.linalg.norm(axes[:, :3], axis=-1)
    built = network.upright(torch.tensor(axes)).numpy()
    np.testing.assert_allclose(built[good], sixd_to_matrix(axes)[good], atol=1e-5)


def test_upside_down_has_an_answer(network: ThreePointNetwork, waving_clip: Clip) -> None:
    """A head without a heading: the frame is the world's."""
    tracked = seen(waving_clip)
    tracked.rotation[:, :, 0] = torch.tensor([0.0, 0.0, 0.0, 1.0]).double()
    completed, _ = complete(network, tracked)
    assert all(torch.isfinite(value).all() for value in completed)
    torch.testing.assert_close(network.facing(tracked.rotation[:, :1, 0])[0, 0], torch.eye(3).double())


@pytest.mark.parametrize("cell", ["gru", "lstm", "rnn"])
def test_layers_stack(cell: str) -> None:
    """Two layers: a frame at a time is the whole, and the first layer alone is PyTorch's own."""
    torch.manual_seed(0)
    recurrent = Recurrent(cell, 5, 4, None, layers=2)  # type: ignore[arg-type]
    features = torch.randn(3, 7, 5)
    whole, last = recurrent(features, recurrent.start(3))
    memory, single = recurrent.start(3), []
    for t in range(7):
        hidden, memory = recurrent(features[:, t : t + 1], memory)
        single.append(hidden)
    torch.testing.assert_close(torch.cat(single, dim=1), whole)
    torch.testing.assert_close(memory, last)
    torch.testing.assert_close(recurrent.layer(features)[0], whole)
