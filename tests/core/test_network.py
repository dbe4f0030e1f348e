"""The core's networks: equal to those that are trained, whatever is tracked."""

from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rotation import normalize, quaternion_exp, quaternion_multiply, quaternion_to_matrix
from bodysense.body.skeleton import default_skeleton
from bodysense.observation import STRAPPED
from bodysense_lab.completion.error_map import unchanged_errors
from bodysense_lab.completion.graph import CompletionStep
from bodysense_lab.completion.network import orthonormal
from bodysense_lab.completion.points import HEAD
from bodysense_lab.completion.state import Inputs, State
from bodysense_lab.completion.weights_file import read_safetensors, read_weights, safetensors_bytes

from .network_library import BODY, PREDICTION, TRACKED, NetworkLibrary, compiled, filled, open_library

WEIGHTS = Path(str(files("bodysense.weights") / "completion.safetensors"))
PEOPLE, FRAMES = 5, 25
CARRYING = [default_skeleton().index(name) for name in STRAPPED]
LEFT_WRIST = default_skeleton().index("left_wrist")
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
def reference(file: Path) -> CompletionStep:
    body, fingers = read_weights(file)
    step = CompletionStep(body, fingers, unchanged_errors(), unchanged_errors()).eval()
    tensors, _ = read_safetensors(file)
    errors = step.expected_errors
    inward = tensors["errors.inward.weight"] * tensors["errors.inward.weight.step"][:, None]
    errors.inward.copy_(torch.tensor(inward))
    errors.inward_offset.copy_(torch.tensor(tensors["errors.inward.bias"]))
    errors.weight.copy_(torch.tensor(tensors["errors.weight"]))
    errors.offset.copy_(torch.tensor(tensors["errors.bias"]))
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
                acceleration=tensor(20 * rng.normal(size=(PEOPLE, 12, 3))),
                has_acceleration=torch.tensor(rng.random((PEOPLE, 12)) < 0.5),
                floor=torch.full((PEOPLE,), 0.1),
                hold=torch.ones(PEOPLE),
            )
        )
    return frames


def tensor(values: np.ndarray) -> Tensor:
    return torch.tensor(np.ascontiguousarray(values), dtype=torch.float32)


def stepped(step: CompletionStep, inputs: Inputs, state: State) -> tuple[dict[str, Any], State]:
    """A step of the reference, with what its parts read and gave."""
    parts = dict[str, Any]()
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


@pytest.mark.parametrize("accelerated", [False, True])
@pytest.mark.parametrize(("rate", "loss"), [(30.0, 0.02), (120.0, 0.1), (65.0, 0.0)])
def test_predictions_are_those_of_the_trained_networks(
    library: Path, tmp_path_factory: pytest.TempPathFactory, rate: float, loss: float, accelerated: bool
) -> None:
    rng, file = np.random.default_rng(int(rate)), WEIGHTS
    if accelerated:
        file = tmp_path_factory.mktemp("wide") / "completion.safetensors"
        file.write_bytes(changed_file(wider(48, np.random.default_rng(1))))
    step, (_, network) = reference(file), open_library(library, file.read_bytes())
    assert network is not None
    memory, scratch = network.start(PEOPLE)
    state = step.start(PEOPLE)
    worst = dict[str, float]()
    for inputs in inputs_of(rng, rate, loss):
        parts, state = stepped(step, inputs, state)
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
        seen["acceleration"][:, CARRYING], seen["has_acceleration"][:, CARRYING] = (
            inputs.acceleration.numpy(),
            inputs.has_acceleration.numpy(),
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
        compare(worst, "unlike", np.log(predicted["unlike"]), answer.apart.log().numpy())

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
    assert max(worst.values()) < 1e-3, worst


def compare(worst: dict[str, float], name: str, got: np.ndarray, wanted: np.ndarray) -> None:
    worst[name] = max(worst.get(name, 0.0), float(np.abs(np.asarray(got) - wanted).max()))


def scene(rng: np.random.Generator, people: int) -> np.ndarray:
    """What is tracked of people: anything, of whom some points are seen."""
    out = np.zeros(people, TRACKED)
    out["interval"] = 1 / 72
    out["position"] = rng.normal(size=(people, 65, 3))
    out["has_position"] = rng.random((people, 65)) < 0.4
    out["has_rotation"] = rng.random((people, 52)) < 0.4
    out["rotation"] = quaternion_to_matrix(normalize(rng.normal(size=(people, 52, 4)))).mT
    out["accuracy"] = rng.uniform(1e-4, 0.1, (people, 65))
    out["rest_offset"] = default_skeleton().rest_offset
    return out


def completed(network: NetworkLibrary, frames: list[np.ndarray]) -> list[np.ndarray]:
    """All that the networks give for frames of B people, frame by frame."""
    memory, scratch = network.start(len(frames[0]))
    out = []
    for seen in frames:
        under, predicted = network.predict(seen, memory, scratch)
        body = np.zeros(len(seen), BODY)
        body["rotation"][:, :22], body["point"] = predicted["rotation"], seen["position"]
        error = network.fingers(seen, under, body, memory, scratch)
        parts = (under, predicted, body, error)
        out.append(
            np.concatenate([np.ascontiguousarray(part).view(np.uint8).reshape(len(seen), -1) for part in parts], 1)
        )
    return out


def test_people_together_are_completed_as_each_alone(network: NetworkLibrary) -> None:
    rng = np.random.default_rng(3)
    frames = [scene(rng, 35) for _ in range(3)]
    together = completed(network, frames)
    for person in (0, 1, 16, 34):
        for got, wanted in zip(completed(network, [frame[[person]] for frame in frames]), together, strict=True):
            np.testing.assert_array_equal(got[0], wanted[person])


def test_memories_of_fast_devices_wait(network: NetworkLibrary) -> None:
    seen = scene(np.random.default_rng(4), 1)
    seen["interval"] = 1 / 120
    memory, scratch = network.start(1)
    kept = list[bool]()
    for _ in range(5):
        before = memory[:, -300:].copy()
        under, _ = network.predict(seen, memory, scratch)
        network.fingers(seen, under, np.zeros(1, BODY), memory, scratch)
        kept.append(bool((memory[:, -300:] == before).all()))
    assert kept == [False, True, False, True, False]


def test_a_measured_point_errs_at_least_by_how_far_it_is_off(network: NetworkLibrary) -> None:
    seen, off = scene(np.random.default_rng(6), 1), np.zeros(65, np.float32)
    seen["has_position"], seen["accuracy"] = True, 0.01
    off[7] = 0.2
    predicted = filled(PREDICTION, 1, {"error": 0.1, "unlike": 0.1})
    confidence, bound = network.errors(seen, predicted, np.full(40, 0.01, np.float32), off)
    assert confidence[7] == np.float32(0.2) and confidence[8] == np.float32(0.01)
    assert (bound > confidence).all()


OK, DAMAGED, FOREIGN, NEWER, INCOMPLETE = range(5)


@lru_cache
def parts_of_the_file() -> tuple[dict[str, np.ndarray], dict[str, str]]:
    return read_safetensors(WEIGHTS)


def changed_file(tensors: dict[str, np.ndarray | None], **metadata: str) -> bytes:
    whole, card = parts_of_the_file()
    kept = {name: values for name, values in {**whole, **tensors}.items() if values is not None}
    return safetensors_bytes(kept, {**card, **metadata})


def wider(columns: int, rng: np.random.Generator | None = None) -> dict[str, np.ndarray | None]:
    """Tables that read more features: those have no weight, or any."""
    whole, _ = parts_of_the_file()
    names = ("body.recurrent.weight_ih_l0", "body.turn_branch.0.weight", "body.judge_branch.0.weight")
    most = 0 if rng is None else 20
    more = {
        name: (rng or np.random.default_rng()).integers(-most, most + 1, (len(whole[name]), columns)) for name in names
    }
    return {name: np.concatenate([whole[name], more[name].astype(np.int8)], axis=1) for name in names}


@pytest.mark.parametrize(
    ("file", "result"),
    [
        (lambda: changed_file({}), OK),
        (lambda: changed_file(wider(48)), OK),  # accelerations
        (lambda: changed_file(wider(47)), NEWER),
        (lambda: changed_file({"errors.bias": None}), INCOMPLETE),
        (lambda: changed_file({"errors.bias": np.zeros(49, np.float32)}), INCOMPLETE),
        (lambda: changed_file({"shape.mean": np.zeros((65, 3), np.float32)}), INCOMPLETE),
        (lambda: changed_file({"body.recurrent.weight_hh_l1": np.zeros((1536, 512), np.float32)}), INCOMPLETE),
        (lambda: changed_file({}, format="bodysense-completion-3"), NEWER),
        (lambda: changed_file({}, format="bodysense-completion-1"), FOREIGN),
        (lambda: changed_file({}, format="bodysense-completion-2x"), FOREIGN),
        (lambda: safetensors_bytes({"weight": np.zeros(3, np.float32)}, {"format": "pt"}), FOREIGN),
        (lambda: safetensors_bytes({"weight": np.zeros(3, np.float32)}, {}), FOREIGN),
        (lambda: changed_file({})[:-1], DAMAGED),
        (lambda: changed_file({})[:3000], DAMAGED),
        (lambda: b"", DAMAGED),
        (lambda: b"\x08\x00\x00\x00\x00\x00\x00\x00[1,2,3]]", DAMAGED),
        (lambda: b"\xff" * 100, DAMAGED),
        (WEIGHTS.with_name("arms.onnx").read_bytes, DAMAGED),
    ],
)
def test_files_are_opened_or_refused(library: Path, file: Callable[[], bytes], result: int) -> None:
    assert open_library(library, file())[0] == result


def test_accelerations_that_nobody_measures_change_nothing(library: Path, network: NetworkLibrary) -> None:
    _, wide = open_library(library, changed_file(wider(48)))
    assert wide is not None
    frames = [scene(np.random.default_rng(7), 2) for _ in range(2)]
    for got, wanted in zip(completed(wide, frames), completed(network, frames), strict=True):
        np.testing.assert_array_equal(got, wanted)


@given(st.integers(0, 8 + 6000), st.integers(0, 255), st.integers(0, 2**32 - 1))
@settings(max_examples=300)
def test_any_header_is_opened_or_refused(library: Path, at: int, byte: int, seed: int) -> None:
    """Bytes of the header are changed, and the file is cut."""
    rng, file = np.random.default_rng(seed), bytearray(WEIGHTS.read_bytes())
    file[at] = byte
    for place in rng.integers(8, 6000, rng.integers(0, 4)):
        file[place] = rng.choice(list(b'{}[],:"0129- '))
    result, _ = open_library(library, bytes(file[: rng.choice([len(file), 2000, at])]))
    assert result in (OK, DAMAGED, FOREIGN, NEWER, INCOMPLETE)
