"""The core's networks: equal to those that are trained, whatever is tracked."""

from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.error_map import unchanged_errors
from bodysense_lab.completion.graph import CompletionStep
from bodysense_lab.completion.network import orthonormal
from bodysense_lab.completion.points import HEAD
from bodysense_lab.completion.state import Inputs, State
from bodysense_lab.completion.weights_file import read_safetensors, read_weights

from .network_library import BODY, TRACKED, NetworkLibrary, compiled, filled, open_library

WEIGHTS = Path(str(files("bodysense.weights") / "completion.safetensors"))
PEOPLE, FRAMES = 5, 25
WRISTS = slice(5, 11)  # of a memory: where the wrists were
SETS = (
    ("head", "left_wrist", "right_wrist"),
    ("head", "left_wrist", "right_wrist", "pelvis", "left_foot", "right_foot"),
    ("left_wrist", *(f"left_{finger}{k}" for finger in ("index", "middle", "ring", "pinky") for k in (1, 2, 3))),
    tuple(default_skeleton().points),
    ("left_hip", "right_hip", "spine1", "pelvis", "left_ankle", "right_shoulder", "left_shoulder"),
)


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("core"))


@pytest.fixture(scope="session")
def network(library: Path) -> NetworkLibrary:
    result, opened = open_library(library, WEIGHTS.read_bytes())
    assert result == 0 and opened is not None
    return opened


@lru_cache
def reference() -> CompletionStep:
    body, fingers = read_weights(WEIGHTS)
    step = CompletionStep(body, fingers, unchanged_errors(), unchanged_errors()).eval()
    tensors, _ = read_safetensors(WEIGHTS)
    errors = step.expected_errors
    inward = tensors["errors.inward.weight"] * tensors["errors.inward.weight.step"][:, None]
    for table, values in (
        (errors.inward, inward),
        (errors.inward_offset, tensors["errors.inward.bias"]),
        (errors.weight, tensors["errors.weight"]),
        (errors.offset, tensors["errors.bias"]),
    ):
        table.copy_(torch.tensor(values))
    return step


def motion(rng: np.random.Generator, rate: float) -> Pose:
    """Bodies (B, T) that swing all their joints, turn and walk."""
    skeleton = default_skeleton()
    time = np.arange(FRAMES) / rate
    swing = rng.normal(size=(PEOPLE, 1, 52, 3)) * 0.3
    phase = np.sin(2 * np.pi * (rng.uniform(0.1, 1.5, (PEOPLE, 1, 52, 1)) * time[:, None, None] + rng.random()))
    rotation = quaternion_multiply(standing_pose(skeleton).rotation, quaternion_exp(swing * phase))
    turn = quaternion_exp(np.array([0.0, 1, 0]) * (rng.normal(size=(PEOPLE, 1, 1)) * 3 + time[:, None]))
    rotation[..., 0, :] = quaternion_multiply(turn, rotation[..., 0, :])
    root = np.array([0.0, 0.95, 0]) + time[:, None] * rng.normal(size=(PEOPLE, 1, 3)) * [1, 0.1, 1]
    return Pose(skeleton, root, rotation)


def inputs_of(rng: np.random.Generator, rate: float, loss: float) -> list[Inputs]:
    """Frames of B people, each with a set of their own, of which points come and go."""
    pose = motion(rng, rate)
    places, turns = forward_kinematics(pose)
    tracked = np.array([[point in chosen for point in default_skeleton().points] for chosen in SETS])
    frames, hidden = list[Inputs](), rng.random((PEOPLE, 65)) < 0.3
    offset = default_skeleton().rest_offset * rng.uniform(0.9, 1.1, (PEOPLE, 1, 1))
    for t in range(FRAMES):
        hidden ^= rng.random(hidden.shape) < loss
        seen = tracked & ~hidden
        frames.append(
            Inputs(
                position=tensor(places[:, t] * seen[..., None]),
                rotation=tensor(turns[:, t]),
                has_position=torch.tensor(seen),
                has_rotation=torch.tensor(seen[:, :52] & (rng.random((PEOPLE, 52)) < 0.8)),
                accuracy=tensor(rng.uniform(5e-5, 0.03, (PEOPLE, 65))),
                interval=torch.full((PEOPLE,), 1 / rate),
                rest_offset=tensor(offset),
                certainty=tensor(rng.uniform(0, 0.03, (PEOPLE, 65))),
                floor=torch.full((PEOPLE,), 0.1),
                hold=torch.ones(PEOPLE),
            )
        )
    return frames


def tensor(values: np.ndarray) -> Tensor:
    return torch.tensor(np.ascontiguousarray(values), dtype=torch.float32)


def stepped(inputs: Inputs, state: State) -> tuple[dict[str, Any], State]:
    """A step of the reference, with what its parts read and gave."""
    step, parts = reference(), dict[str, Any]()
    hooks = [
        module.register_forward_hook(lambda _, given, gave, name=name: parts.update({name: (given, gave)}))
        for name, module in (
            ("frame", step.frame_finder),
            ("mirrored", step.mirrored),
            ("hands", step.hands),
            ("errors", step.expected_errors),
        )
    ]
    try:
        with torch.no_grad():
            outputs, state = step(inputs, state)
    finally:
        for hook in hooks:
            hook.remove()
    return {**parts, "outputs": outputs, "rows": state.rows}, state


@pytest.mark.parametrize(("rate", "loss"), [(30.0, 0.02), (120.0, 0.1), (65.0, 0.0)])
def test_predictions_are_those_of_the_trained_networks(network: NetworkLibrary, rate: float, loss: float) -> None:
    rng = np.random.default_rng(int(rate))
    memory, scratch = network.start(PEOPLE)
    state = reference().start(PEOPLE)
    worst = dict[str, float]()
    for inputs in inputs_of(rng, rate, loss):
        parts, state = stepped(inputs, state)
        (near, axes, masks, _, base, floor, _), frame = parts["frame"]
        base, near = base.reshape(-1, 3).numpy(), near[:, 0].numpy()
        near[:, HEAD] = 0  # a head that is not tracked moves with the points that are
        seen = filled(
            TRACKED,
            PEOPLE,
            {
                "base": 0.0,
                "interval": inputs.interval,
                "floor": floor,
                "has_position": inputs.has_position,
                "has_rotation": inputs.has_rotation,
                "implied": (masks[:, 65:] > 0.5) & ~inputs.has_rotation,
                "position": near + base[:, None],
                "rotation": axes.transpose(1, 2).numpy(),
                "accuracy": torch.where(inputs.has_position, inputs.accuracy, 1e4),
                "rest_offset": inputs.rest_offset,
                "deviation": inputs.certainty,
            },
        )
        under, predicted = network.predict(seen, memory, scratch)
        answer = parts["mirrored"][1]
        size = parts["mirrored"][0][0].size.numpy()
        rows = (answer.rows @ frame.back).reshape(PEOPLE, 45, 3)
        joints = orthonormal(torch.stack([rows[:, :22], rows[:, 22:44]], dim=-1)).transpose(-1, -2).numpy()
        head = rows[:, 44].numpy() * size + frame.floor.reshape(-1, 3).numpy() + base
        error = (torch.nn.functional.softplus(answer.error) + 0.002).numpy() * size
        compare(worst, "heading", np.stack([under["cosine"], under["sine"]], -1), frame.heading.numpy())
        compare(worst, "rotation", predicted["rotation"], joints)
        compare(worst, "head", predicted["head"], head)
        compare(worst, "contact", predicted["contact"], torch.sigmoid(answer.contact_logit).numpy())
        compare(worst, "error", predicted["error"], error)

        # The body that the reference makes of it, to which the hands are added.
        (of_body, place, top, *_), hands = parts["hands"]
        origin = base[:, None]
        body = np.zeros(PEOPLE, BODY)
        body["rotation"][:, :22] = of_body.transpose(1, 2).numpy()
        body["point"] = parts["outputs"].points.numpy()
        body["point"][:, [20, 21]] = place[:, 0].numpy() + origin
        body["point"][:, 15] = top[:, 0, 0].numpy() + origin[:, 0]
        finger_error = network.fingers(seen, under, body, memory, scratch)
        expected = (torch.nn.functional.softplus(hands.error) + 0.001).numpy()
        compare(worst, "finger error", finger_error, expected)
        after = state.rows[:, 0, :65].numpy()
        memory[:, WRISTS] = after[:, [20, 21]].reshape(PEOPLE, 6)  # the reference's arms may be too short
        from_wrist = body["point"][:, 22:52] - body["point"][:, [20] * 15 + [21] * 15]
        compare(worst, "fingers", from_wrist, after[:, 22:52] - after[:, [20] * 15 + [21] * 15])
        means, bounds = zip(
            *(
                network.errors(seen[k : k + 1], predicted[k : k + 1], finger_error[k], np.zeros(65, np.float32))
                for k in range(PEOPLE)
            ),
            strict=True,
        )
        compare(worst, "expected", np.log(means), parts["outputs"].confidence.log().numpy())
        compare(worst, "bound", np.log(bounds), parts["outputs"].bound.log().numpy())
    assert max(worst.values()) < 5e-4, worst


def compare(worst: dict[str, float], name: str, got: np.ndarray, wanted: np.ndarray) -> None:
    worst[name] = max(worst.get(name, 0.0), float(np.abs(np.asarray(got) - wanted).max()))
