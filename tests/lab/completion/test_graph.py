"""The exported step: the same numbers as PyTorch's, for any number of people, and symmetric."""

from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.format import FORMAT
from bodysense.completion.network import Network, NetworkFormat
from bodysense.demo import packaged_performance
from bodysense.lab.completion.error_map import unchanged_errors
from bodysense.lab.completion.export import example_inputs, write_completion
from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense.lab.completion.graph import CompletionStep, Inputs, Outputs, State
from bodysense.lab.completion.network import CompletionConfig, CompletionNetwork

FRAMES = 40


@pytest.fixture(scope="module")
def step() -> CompletionStep:
    torch.manual_seed(3)
    body = CompletionNetwork(CompletionConfig(hidden=16, branch=16, judge_branch=8))
    fingers = FingerNetwork(FingerConfig(hidden=8, branch=8))
    return CompletionStep(body, fingers, unchanged_errors(), unchanged_errors()).eval()


def frames(people: int, mirrored: bool = False) -> list[Inputs]:
    """The packaged performance, seen by sensors that come and go, differently by each of some people."""
    clip = packaged_performance()
    skeleton = default_skeleton()
    position, rotation = (np.asarray(part[:FRAMES]) for part in forward_kinematics(clip.pose[:FRAMES]))
    rng = np.random.default_rng(5)
    seen = np.repeat(rng.uniform(size=(FRAMES // 10, people, 65)) < 0.4, 10, axis=0)
    turned = np.repeat(rng.uniform(size=(FRAMES // 10, people, 52)) < 0.3, 10, axis=0)
    seen[:, :, 15] = turned[:, :, 15] = True
    offset = clip.pose.skeleton.rest_offset.copy()
    if mirrored:
        swap = skeleton.mirror
        position, rotation = position[:, swap] * [-1, 1, 1], rotation[:, swap[:52]] * [1, 1, -1, -1]
        seen, turned, offset = seen[..., swap], turned[..., swap[:52]], offset[swap] * [-1, 1, 1]

    def every(values: np.ndarray) -> torch.Tensor:
        return torch.tensor(np.repeat(values[None], people, axis=0), dtype=torch.float32)

    made = []
    for t in range(FRAMES):
        has, has_turn = torch.tensor(seen[t]), torch.tensor(turned[t])
        made.append(
            example_inputs(people)._replace(
                position=every(position[t]) * has[..., None],
                rotation=torch.where(has_turn[..., None], every(rotation[t]), torch.tensor([1.0, 0, 0, 0])),
                has_position=has,
                has_rotation=has_turn,
                rest_offset=every(offset),
            )
        )
    return made


@torch.no_grad()
def run(step: CompletionStep, of: list[Inputs]) -> list[Outputs]:
    state, made = step.start(len(of[0].interval)), []
    for inputs in of:
        outputs, state = step(inputs, state)
        made.append(outputs)
    return made


def test_a_batch_is_each_alone(step: CompletionStep) -> None:
    whole = frames(3)
    together = run(step, whole)
    for k in range(3):
        alone = run(step, [Inputs(*(values[k : k + 1] for values in inputs)) for inputs in whole])
        for a, b in zip(together, alone, strict=True):
            assert torch.allclose(a.points[k], b.points[0], atol=2e-5)


def test_a_mirror_image_moves_as_one(step: CompletionStep) -> None:
    swap = torch.tensor(default_skeleton().mirror.copy())
    for a, b in zip(run(step, frames(2)), run(step, frames(2, mirrored=True)), strict=True):
        assert torch.allclose(a.points[:, swap] * torch.tensor([-1.0, 1, 1]), b.points, atol=1e-3)


def test_bones_are_rigid_and_the_head_is_where_it_is_measured(step: CompletionStep) -> None:
    parents = list(default_skeleton().parents[1:])
    for inputs, outputs in zip(frames(2), run(step, frames(2)), strict=True):
        bones = (outputs.points[:, 1:] - outputs.points[:, parents]).norm(dim=-1)
        assert torch.allclose(bones, inputs.rest_offset[:, 1:].norm(dim=-1), atol=1e-4)
        assert torch.allclose(outputs.points[:, 15], inputs.position[:, 15], atol=1e-4)
        feet = torch.tensor([7, 8, 10, 11, 53, 54])  # ankles, balls and toe tips
        free = ~inputs.has_position[:, feet].any(dim=1)
        assert (outputs.points[free][:, feet, 1] > -5e-3).all()


@pytest.mark.slow
def test_the_file_equals_pytorch(step: CompletionStep, tmp_path: Path) -> None:
    path = tmp_path / "step.onnx"
    write_completion(step, path, {"licence": "none"})
    network = Network.open(path, NetworkFormat(FORMAT, "completion network", "bodysense train completion"))
    for people in (1, 2, 5):
        of = frames(people)
        state = network.start(people)
        for inputs, wanted in zip(of, run(step, of), strict=True):
            got, state = network.step({name: value.numpy() for name, value in inputs._asdict().items()}, state)
            assert np.abs(got["points"] - wanted.points.numpy()).max() < 1e-4
            assert np.abs(got["confidence"] - wanted.confidence.numpy()).max() < 1e-4
        assert set(state) == {f"state_{name}" for name in State._fields}
