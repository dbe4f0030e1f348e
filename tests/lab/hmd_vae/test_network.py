"""HMD-VAE: its likelihood is a geodesic, its encoder does not see where it stands, its decoder keeps bones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate, quaternion_to_matrix
from bodysense_lab.papers.hmd_vae.body_windows import Joints, frame_of, seen_from
from bodysense_lab.papers.hmd_vae.network import (
    BodyVae,
    OverTime,
    kl_divergence,
    pretrained,
    read_vae,
    squared_distance,
)
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig, Origin

SMALL = BodyVaeConfig(latent=4, width=16, sequence_width=8, length=8)
HEAD = BODY.index("head")


def draw(rng: np.random.Generator, *shape: int) -> Joints:
    """Joints anywhere, turned anyhow."""
    turn = rng.standard_normal((*shape, 4))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    return Joints(torch.tensor(rng.standard_normal((*shape, 3))), torch.tensor(turn))


def network(config: BodyVaeConfig) -> BodyVae:
    torch.manual_seed(2)
    made = BodyVae(config).double()
    for name, parameter in made.named_parameters():
        if name.endswith("gate"):
            torch.nn.init.constant_(parameter, 0.5)
    return made


def offsets(made: BodyVae, count: int) -> Tensor:
    return torch.tensor(np.array(made.skeleton.rest_offset)).expand(count, -1, -1)


def scipy_rotation(q: Tensor) -> Rotation:
    return Rotation.from_quat(q.numpy().reshape(-1, 4), scalar_first=True)


@settings(max_examples=20)
@given(seed=st.integers(0, 9999), anchor=st.sampled_from([0, HEAD]))
def test_the_likelihood_is_a_distance_and_an_angle(seed: int, anchor: int) -> None:
    rng = np.random.default_rng(seed)
    ours, truth = draw(rng, 3, 22), draw(rng, 3, 22)
    config = replace(SMALL, position_deviation=0.5, angle_deviation=0.3)
    relative = ours.position - ours.position[:, [anchor]]
    got = squared_distance(config, relative, ours.rotation, truth, anchor)
    moved = (relative - (truth.position - truth.position[:, [anchor]])).numpy()
    turn = (scipy_rotation(ours.rotation).inv() * scipy_rotation(truth.rotation)).magnitude().reshape(3, 22)
    wanted = (np.linalg.norm(moved, axis=-1) / 0.5) ** 2 + (turn / 0.3) ** 2
    np.testing.assert_allclose(got.numpy(), wanted, rtol=1e-9)


@settings(max_examples=20)
@given(seed=st.integers(0, 9999))
def test_the_likelihood_is_left_invariant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ours, truth = draw(rng, 4, 22), draw(rng, 4, 22)
    by = draw(rng, 1, 1)

    def moved(joints: Joints) -> Joints:
        turn = by.rotation.expand_as(joints.rotation)
        return Joints(
            quaternion_rotate(turn, joints.position) + by.position, quaternion_multiply(turn, joints.rotation)
        )

    def distance(a: Joints, b: Joints) -> np.ndarray:
        return squared_distance(SMALL, a.position - a.position[:, [HEAD]], a.rotation, b, HEAD).numpy()

    np.testing.assert_allclose(distance(moved(ours), moved(truth)), distance(ours, truth), rtol=1e-8)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("angle", [0.0, 1e-9, np.pi - 1e-4, np.pi])
def test_gradients_are_finite_where_angles_are_special(angle: float, dtype: torch.dtype) -> None:
    turn = quaternion_exp(torch.tensor([[[0.6, 0.0, 0.8]]], dtype=torch.float64) * angle).to(dtype)
    turn = turn.expand(1, 22, 4).clone().requires_grad_()
    still = torch.zeros(1, 22, 3, dtype=dtype, requires_grad=True)
    upright = torch.tensor([1.0, 0, 0, 0], dtype=dtype).expand(1, 22, 4)
    value = squared_distance(SMALL, still, turn, Joints(torch.zeros_like(still), upright), HEAD).sum()
    value.backward()
    assert turn.grad is not None and still.grad is not None
    assert torch.isfinite(turn.grad).all() and torch.isfinite(still.grad).all()
    assert float(value.detach()) == pytest.approx(22 * (angle / SMALL.angle_deviation) ** 2, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("model", [0, 1, 2])
def test_the_whole_loss_has_finite_gradients(model: int) -> None:
    made = network(replace(SMALL, model=model))
    seen = draw(np.random.default_rng(1), 5, made.config.frames, len(made.config.reads))
    truth = draw(np.random.default_rng(2), 5, 22)
    made.negative_elbo(seen, truth, offsets(made, 5))["loss"].backward()
    gradients = [parameter.grad for parameter in made.parameters()]
    assert all(one is not None and torch.isfinite(one).all() for one in gradients)


@settings(max_examples=20)
@given(seed=st.integers(0, 9999))
def test_the_divergence_is_that_of_torch(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mean, log_variance = (torch.tensor(rng.standard_normal((3, 7))) for _ in range(2))
    normal = torch.distributions.Normal
    wanted = torch.distributions.kl_divergence(
        normal(mean, torch.exp(log_variance / 2)), normal(torch.zeros_like(mean), torch.ones_like(mean))
    ).sum(dim=-1)
    np.testing.assert_allclose(kl_divergence(mean, log_variance).numpy(), wanted.numpy(), rtol=1e-9)


def test_samples_are_averaged() -> None:
    made = network(replace(SMALL, model=1, samples=3, beta=0.5))
    seen, truth = draw(np.random.default_rng(3), 4, 1, 3), draw(np.random.default_rng(4), 4, 22)
    offset = offsets(made, 4)
    terms = made.negative_elbo(seen, truth, offset, torch.Generator().manual_seed(5))
    noise = torch.randn(3, 4, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    mean, log_variance = made.posterior(seen, offset)
    alone = []
    for one in noise:
        body = made.decode(mean + torch.exp(log_variance / 2) * one, offset)
        distance = squared_distance(made.config, made.from_anchor(body.position), body.rotation, truth, HEAD)
        alone.append(float(distance.sum(dim=-1).mean().detach()) / 2)
    assert float(terms["likelihood"].detach()) == pytest.approx(np.mean(alone))
    divergence = float(kl_divergence(mean, log_variance).mean().detach())
    assert float(terms["loss"].detach()) == pytest.approx(np.mean(alone) + 0.5 * divergence)


@settings(max_examples=15)
@given(seed=st.integers(0, 9999), origin=st.sampled_from(["head", "pelvis"]))
def test_inputs_do_not_depend_on_place_and_heading(seed: int, origin: Origin) -> None:
    rng = np.random.default_rng(seed)
    body = draw(rng, 2, 5, 22)
    yaw, shift = rng.uniform(-3, 3), rng.uniform(-5, 5, 3)
    if origin == "head":
        shift[1] = 0  # heights over the floor are seen
    turn = quaternion_exp(torch.tensor([0.0, yaw, 0.0], dtype=torch.float64)).expand_as(body.rotation)
    other = Joints(
        quaternion_rotate(turn, body.position) + torch.tensor(shift), quaternion_multiply(turn, body.rotation)
    )
    place = BODY.index(origin)

    def seen(joints: Joints) -> Joints:
        return seen_from(frame_of(origin, joints.position[:, :, place], joints.rotation[:, :, place]), joints)

    ours, theirs = seen(body), seen(other)
    np.testing.assert_allclose(ours.position.numpy(), theirs.position.numpy(), atol=1e-9)
    matrices = (quaternion_to_matrix(one.rotation).numpy() for one in (ours, theirs))
    np.testing.assert_allclose(*matrices, atol=1e-9)


def test_the_two_origins() -> None:
    body = draw(np.random.default_rng(0), 2, 5, 22)
    for origin in ("head", "pelvis"):
        place = BODY.index(origin)
        frame = frame_of(origin, body.position[:, :, place], body.rotation[:, :, place])
        joint = seen_from(frame, body).position[:, :, place]
        if origin == "pelvis":
            np.testing.assert_allclose(joint.numpy(), 0, atol=1e-12)  # in every frame
        else:
            wanted = np.zeros((2, 3))
            wanted[:, 1] = body.position[:, -1, place, 1].numpy()
            np.testing.assert_allclose(joint[:, -1].numpy(), wanted, atol=1e-12)


@pytest.mark.parametrize("model", [1, 2])
def test_a_taller_body_is_a_taller_skeleton(model: int) -> None:
    made = network(replace(SMALL, model=model))
    seen, offset = draw(np.random.default_rng(6), 3, made.config.frames, 3), offsets(made, 3)
    mean, _ = made.posterior(seen, offset)
    taller, _ = made.posterior(Joints(1.2 * seen.position, seen.rotation), 1.2 * offset)
    np.testing.assert_allclose(taller.detach().numpy(), mean.detach().numpy(), atol=1e-9)
    body = made.decode(mean, 1.2 * offset)
    bone = body.position[:, 1:] - body.position[:, list(made.skeleton.parents[1:])]
    length = bone.norm(dim=-1).detach().numpy()
    np.testing.assert_allclose(length, np.broadcast_to(1.2 * made.skeleton.bone_length[1:], length.shape), rtol=1e-9)


def test_half_of_the_frames_are_every_second_to_the_last() -> None:
    torch.manual_seed(0)
    every, second = OverTime(6), OverTime(6, stride=2)
    second.load_state_dict(every.state_dict())
    x = torch.randn(2, 8, 6)
    np.testing.assert_allclose(second(x).detach().numpy(), every(x)[:, 1::2].detach().numpy(), atol=1e-6)


def test_a_convolution_depends_on_the_frame() -> None:
    torch.manual_seed(0)
    layer, x = OverTime(6), torch.ones(1, 8, 6)
    inside = layer(x)[0, 2:-2].detach()
    assert float((inside[1:] - inside[:-1]).abs().min()) > 1e-4  # the same frame everywhere, and yet not the same


@pytest.mark.parametrize("length", [5, 16])
def test_any_length_of_history(length: int) -> None:
    made = network(replace(SMALL, model=2, length=length, blocks=4))
    seen = draw(np.random.default_rng(7), 2, length, 3)
    before = made.posterior(seen, offsets(made, 2))[0]
    changed = seen.position.clone()
    changed[:, 0] += 0.1
    after = made.posterior(Joints(changed, seen.rotation), offsets(made, 2))[0]
    assert before.shape == (2, 4)
    assert float((after - before).detach().abs().max()) > 1e-6  # the oldest frame counts


def test_a_reused_decoder_is_frozen() -> None:
    whole = network(replace(SMALL, model=0)).float()
    made = pretrained(replace(SMALL, model=4), whole)
    before = {name: value.clone() for name, value in made.state_dict().items()}
    optimizer = torch.optim.AdamW([p for p in made.parameters() if p.requires_grad], lr=0.1, weight_decay=0.1)
    seen = Joints(*(value.float() for value in draw(np.random.default_rng(8), 3, 8, 3)))
    truth = Joints(*(value.float() for value in draw(np.random.default_rng(9), 3, 22)))
    made.negative_elbo(seen, truth, offsets(made, 3).float())["loss"].backward()
    optimizer.step()
    for name, value in made.state_dict().items():
        if name.startswith("decoder"):
            assert torch.equal(value, whole.state_dict()[name])
    assert not torch.equal(made.state_dict()["encoder.layers.0.weight"], before["encoder.layers.0.weight"])


def test_a_decoder_must_fit() -> None:
    whole = network(replace(SMALL, model=0))
    with pytest.raises(BodysenseError, match="has latent 4, not 5; train both with the same latent"):
        pretrained(replace(SMALL, model=3, latent=5), whole)
    with pytest.raises(BodysenseError, match="has origin head, not pelvis"):
        pretrained(replace(SMALL, model=3, origin="pelvis"), whole)
    with pytest.raises(BodysenseError, match="the decoder is of model 1; give that of a trained model 0"):
        pretrained(replace(SMALL, model=3), network(replace(SMALL, model=1)))


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"gone\.pt: no such file; train it"):
        read_vae(tmp_path / "gone.pt")
    (tmp_path / "text.pt").write_text("not weights")
    with pytest.raises(BodysenseError, match=r"text\.pt: not the weights of a body VAE"):
        read_vae(tmp_path / "text.pt")


def test_impossible_configurations_are_refused() -> None:
    with pytest.raises(BodysenseError, match="beta must be 0 or more"):
        replace(SMALL, beta=-1.0)
