"""The networks of arms and hands: features, parts, shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import scaled_dot_product_attention

from bodysense.errors import BodysenseError
from bodysense_lab.papers.pahmt.features import Window, held
from bodysense_lab.papers.pahmt.network import ArmNetwork, Attention, Convolutions, read_arms
from bodysense_lab.papers.pahmt.options import ArmNetworkConfig, Input, Kind
from bodysense_lab.papers.pahmt.task import Discriminator

SMALL: dict[str, Any] = {
    "width": 16,
    "layers": 1,
    "heads": 2,
    "spatial_width": 8,
    "spatial_layers": 1,
    "spatial_heads": 2,
}


def window(batch: int = 2, frames: int = 32, seed: int = 0) -> Window:
    draw = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(batch, frames, *shape, generator=draw)

    return Window(
        arm=torch.nn.functional.normalize(normal(2, 2, 3), dim=-1),
        has_arm=normal(2) > -1,
        torso=torch.nn.functional.normalize(normal(4), dim=-1),
        has_torso=normal() > -1,
        hand=normal(2, 21, 2),
        has_hand=normal(2) > -1,
    )


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("cnn", {}),
        ("cnn", {"input": "hands"}),
        ("ahmt", {"rotation": "6d", "more_inputs": True}),
        ("pahmt", {"rotation": "6d", "from_directions": True, "from_palms": True}),
    ],
)
def test_every_form_answers_with_rotations(kind: Kind, more: dict[str, Any]) -> None:
    network = ArmNetwork(ArmNetworkConfig(kind=kind, **more, **SMALL)).eval()
    predicted = network(window())
    joints = 30 if more.get("input") == "hands" else 38
    assert predicted.shape == (2, 32, joints, 6 if "rotation" in more else 3)
    turns = network.quaternions(predicted)
    torch.testing.assert_close(turns.norm(dim=-1), torch.ones(2, 32, joints))
    assert Discriminator(network.config)(predicted).shape == (2, 8)


@pytest.mark.parametrize("input", ["hands", "arms-hands"])
def test_hands_may_be_anywhere_and_of_any_size(input: Input) -> None:
    """Without our additional inputs, the network's input does not change if a hand moves or grows in the picture."""
    network, seen = ArmNetwork(ArmNetworkConfig(input=input, **SMALL)), window()
    moved = seen._replace(hand=seen.hand * torch.tensor([0.3, 2.0])[:, None, None, None, None] + 0.7)
    torch.testing.assert_close(network.points(moved), network.points(seen), atol=1e-4, rtol=1e-4)
    points = network.points(seen)[:, :, -42:].unflatten(2, (2, 21))
    centred = points[seen.has_hand]
    size = (centred.amax(dim=1) - centred.amin(dim=1)).amax(dim=-1)
    torch.testing.assert_close(size, torch.ones(len(size)))
    assert (centred[:, 0] == 0).all() and (points[..., 2] == 0).all()


def test_arms_are_in_the_torsos_axes() -> None:
    """If person and camera turn together, only the camera's own values change."""
    from scipy.spatial.transform import Rotation

    seen = window()
    seen = seen._replace(has_torso=torch.ones_like(seen.has_torso))
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7])
    arm = torch.tensor(turn.apply(seen.arm.reshape(-1, 3)).reshape(seen.arm.shape), dtype=torch.float32)
    torso = turn * Rotation.from_quat(seen.torso.reshape(-1, 4), scalar_first=True)
    quaternion = torch.tensor(torso.as_quat(scalar_first=True).reshape(seen.torso.shape), dtype=torch.float32)
    network = ArmNetwork(ArmNetworkConfig(**SMALL))
    torch.testing.assert_close(network.points(seen._replace(arm=arm, torso=quaternion)), network.points(seen))


def test_missing_points_do_not_change_the_prediction() -> None:
    network, seen = ArmNetwork(ArmNetworkConfig(more_inputs=True, **SMALL)).eval(), window()
    other = window(seed=1)
    changed = seen._replace(
        arm=torch.where(seen.has_arm[..., None, None], seen.arm, other.arm),
        torso=torch.where(seen.has_torso[..., None], seen.torso, other.torso),
        hand=torch.where(seen.has_hand[..., None, None], seen.hand, other.hand),
    )
    assert not torch.equal(changed.hand, seen.hand)
    torch.testing.assert_close(network(changed), network(seen))


def test_lost_points_keep_their_last_value() -> None:
    """Compare with a loop over frames."""
    rng = np.random.default_rng(0)
    values, known = rng.standard_normal((3, 20, 2, 5)), rng.random((3, 20, 2)) < 0.4
    wanted = np.zeros_like(values)
    for b, n in np.ndindex(3, 2):
        last = np.zeros(5)
        for t in range(20):
            last = values[b, t, n] if known[b, t, n] else last
            wanted[b, t, n] = last
    np.testing.assert_array_equal(held(torch.tensor(values), torch.tensor(known)).numpy(), wanted)


def test_attention_is_pytorchs() -> None:
    torch.manual_seed(0)
    layer, x = Attention(12, 3, 2, 0.0), torch.randn(4, 7, 12)
    read = layer.before(x)
    parts = (part.reshape(4, 7, 3, 4).transpose(1, 2) for part in (layer.ask(read), *layer.look(read).chunk(2, dim=-1)))
    attended = scaled_dot_product_attention(*parts).transpose(1, 2).reshape(4, 7, 12)
    after = x + layer.tell(attended)
    wanted = after + layer.back(torch.relu(layer.forth(layer.between(after))))
    torch.testing.assert_close(layer(x), wanted)
    torch.testing.assert_close(layer(x, 1), wanted[:, :1])


def test_the_branch_over_joints_sees_one_frame_and_every_joint() -> None:
    network = ArmNetwork(ArmNetworkConfig(kind="pahmt", **SMALL)).eval()
    points = network.points(window(batch=1)).requires_grad_()
    assert network.beside is not None
    network.beside(points)[0, 5].sum().backward()
    assert points.grad is not None
    reached = points.grad.abs().sum(dim=-1)[0] > 0
    assert reached[5].all() and not reached[:5].any() and not reached[6:].any()


def test_the_body_over_time_sees_every_frame() -> None:
    for kind in ("cnn", "ahmt"):
        network = ArmNetwork(ArmNetworkConfig(kind=kind, **SMALL)).eval()
        points = network.points(window(batch=1)).requires_grad_()
        network.body(points)[0, 15].sum().backward()
        assert points.grad is not None and (points.grad.abs().sum(dim=(0, 2, 3)) > 0).sum() >= 31, kind
    assert isinstance(ArmNetwork(ArmNetworkConfig(kind="cnn", **SMALL)).body, Convolutions)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 30}, "width 30 must be a multiple of 8 heads"),
        ({"kind": "cnn", "frames": 24}, "frames is 24; give at least 2, and a multiple of 16 for a cnn"),
        ({"input": "hands", "more_inputs": True}, "more_inputs are of arms"),
        ({"from_directions": True}, "from_directions needs input 'arms-hands' and rotation '6d'"),
        ({"from_palms": True}, "from_palms needs from_directions"),
    ],
)
def test_impossible_networks_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        ArmNetworkConfig(**change)


def test_weights_are_read_back_and_others_refused(small_arms_weights: Path, tmp_path: Path) -> None:
    network, card = read_arms(small_arms_weights)
    assert network.config.more_inputs and card["validation"] == {"overall_m": 0.05, "hands_m": 0.02}
    with pytest.raises(BodysenseError, match="no such file; train it with `bodysense train arms`"):
        read_arms(tmp_path / "none.pt")
    (tmp_path / "text.pt").write_text("no weights")
    with pytest.raises(BodysenseError, match=r"text\.pt: not the weights of arms"):
        read_arms(tmp_path / "text.pt")
