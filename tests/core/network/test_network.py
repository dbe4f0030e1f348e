"""The core's networks: people together, memories of fast devices, and which files are opened."""

from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import normalize, quaternion_exp, quaternion_to_matrix
from bodysense_lab.completion.networks.weights_file import read_safetensors, safetensors_bytes

from ..twin.points import HEAD, rest_height
from .library import BODY, PREDICTION, TRACKED, NetworkLibrary, filled, open_library

WEIGHTS = Path(str(files("bodysense.weights") / "completion.safetensors"))


@pytest.fixture(scope="session")
def network(networks_file: Path) -> NetworkLibrary:
    result, opened = open_library(networks_file, WEIGHTS.read_bytes())
    assert result == 0 and opened is not None
    return opened


def scene(rng: np.random.Generator, people: int) -> np.ndarray:
    """Draw any tracked points of several people."""
    out = np.zeros(people, TRACKED)
    out["interval"] = 1 / 72
    out["position"] = rng.normal(size=(people, 65, 3))
    out["knuckle"] = rng.normal(size=(people, 2, 4, 3))
    out["has_knuckles"] = rng.random((people, 2)) < 0.5
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


def test_bounds_grow_with_heads_that_are_low_or_tilted(network: NetworkLibrary) -> None:
    """Alone: expected errors stay what the map makes of the prediction."""
    predicted, own = filled(PREDICTION, 1, {"error": 0.1, "unlike": 0.1}), default_skeleton().rest_offset
    seen = scene(np.random.default_rng(6), 1)
    seen["rest_offset"], seen["floor"], seen["has_position"], seen["has_rotation"] = own, 0.0, False, False
    seen["has_position"][0, HEAD] = seen["has_rotation"][0, HEAD] = True
    tall = rest_height(own, HEAD)

    def errors(height: float, tilt: float) -> tuple[np.ndarray, np.ndarray]:
        seen["position"][0, HEAD] = [0, height * tall, 0]
        seen["rotation"][0, HEAD] = quaternion_to_matrix(quaternion_exp(np.array([tilt, 0.0, 0.0]))).T
        return network.errors(seen, predicted, np.full(40, 0.01, np.float32), np.zeros(65, np.float32))

    expected, least = errors(1.0, 0.0)
    before = least
    for height, tilt in ((0.9, 0.3), (0.7, 0.3), (0.6, 0.3), (0.4, 0.3), (0.4, 1.0), (0.2, 1.6)):
        found, bound = errors(height, tilt)
        np.testing.assert_array_equal(found, expected)
        hidden = np.arange(22) != HEAD
        grown = (bound / before)[:22][hidden]
        assert (grown > 1.04).all() if (height, tilt) != (0.9, 0.3) else (grown == 1).all()
        before = bound
    assert (before / least).max() < 2.5


OK, DAMAGED, FOREIGN, NEWER, INCOMPLETE = range(5)


@lru_cache
def parts_of_the_file() -> tuple[dict[str, np.ndarray], dict[str, str]]:
    return read_safetensors(WEIGHTS)


def changed_file(tensors: Mapping[str, np.ndarray | None], **metadata: str) -> bytes:
    whole, card = parts_of_the_file()
    kept = {name: values for name, values in {**whole, **tensors}.items() if values is not None}
    return safetensors_bytes(kept, {**card, **metadata})


_FIRST_LAYERS = (
    "body.recurrent.weight_ih_l0",
    *(f"body.{name}.weight" for name in ("turn_branch.0", "judge_branch.0")),
    *(f"body.updates.{name}.0.weight" for name in ("input_l0", "turn_branch")),
)


def narrow(further: int = 0) -> dict[str, np.ndarray | None]:
    """Tables of a network that reads no accelerations, with `further` columns of zeros."""
    whole, _ = parts_of_the_file()
    return {name: np.pad(whole[name][:, :-48], ((0, 0), (0, further))) for name in _FIRST_LAYERS}


def wider(columns: int) -> dict[str, np.ndarray | None]:
    """Tables that read more features."""
    whole, _ = parts_of_the_file()
    return {name: np.pad(whole[name], ((0, 0), (0, columns))) for name in _FIRST_LAYERS}


@pytest.mark.parametrize(
    ("file", "result"),
    [
        (lambda: changed_file({}), OK),
        (lambda: changed_file(narrow()), OK),  # no accelerations
        (lambda: changed_file(wider(1)), NEWER),
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
def test_files_are_opened_or_refused(networks_file: Path, file: Callable[[], bytes], result: int) -> None:
    assert open_library(networks_file, file())[0] == result


RANK = 16
UPDATED = {"input_l0": (1536, 537), "state_l0": (1536, 512), "input_l1": (1536, 512), "state_l1": (1536, 512)} | {
    "turn_branch": (512, 1049)
}


def updates(rank: int = RANK, **changed: int) -> dict[str, np.ndarray]:
    """Random updates of a rank; `changed`: ranks of some products."""
    rng, out = np.random.default_rng(8), dict[str, np.ndarray]()
    for name, (rows, columns) in UPDATED.items():
        own = changed.get(name, rank)
        for part, shape in enumerate(((own, columns), (rows, own))):
            out[f"body.updates.{name}.{part}.weight"] = rng.integers(-127, 128, shape).astype(np.int8)
            out[f"body.updates.{name}.{part}.weight.step"] = np.full(shape[0], 3e-4, np.float32)
    return out


def test_updates_act_on_people_whose_heads_are_not_tracked(networks_file: Path) -> None:
    """People with a tracked head are completed as without updates. Each product changes the others of a batch."""
    none = dict.fromkeys(updates())
    (_, plain), (_, updated) = (open_library(networks_file, changed_file(parts)) for parts in (none, updates()))
    assert plain is not None and updated is not None
    rng = np.random.default_rng(9)
    frames = [scene(rng, 6) for _ in range(3)]
    for seen in frames:
        seen["has_position"][:, HEAD], seen["has_rotation"][:, HEAD] = [1, 1, 0, 1, 0, 1], [1, 1, 1, 0, 0, 1]
        seen["implied"][:, HEAD] = False
    both = [completed(one, frames) for one in (updated, plain)]
    for own, other in zip(*both, strict=True):
        differs = (own != other).any(axis=1)
        assert differs.tolist() == [False, False, True, True, True, False]
    for name in UPDATED:
        zeros = {key: np.zeros_like(value) for key, value in updates().items() if name in key}
        _, one = open_library(networks_file, changed_file(updates() | zeros))
        assert one is not None
        last = completed(one, frames)[-1]
        assert (last != both[0][-1]).any(axis=1).tolist() == [False, False, True, True, True, False]


@pytest.mark.parametrize(
    ("tables", "result"),
    [
        (updates(), OK),
        (updates(32), OK),
        (updates(20), INCOMPLETE),  # not whole groups of rows
        (updates(16, state_l1=32), INCOMPLETE),  # of two ranks
        (updates() | {"body.updates.turn_branch.1.weight": None}, INCOMPLETE),
        (updates() | {"body.updates.input_l0.0.weight": np.zeros((16, 536), np.int8)}, INCOMPLETE),
    ],
)
def test_updates_are_of_one_rank_in_whole_groups(
    networks_file: Path, tables: Mapping[str, np.ndarray | None], result: int
) -> None:
    assert open_library(networks_file, changed_file(tables))[0] == result


def test_accelerations_without_weights_change_nothing(networks_file: Path) -> None:
    (_, without), (_, unheard) = (open_library(networks_file, changed_file(narrow(more))) for more in (0, 48))
    assert without is not None and unheard is not None
    frames = [scene(np.random.default_rng(7), 2) for _ in range(2)]
    for got, wanted in zip(completed(unheard, frames), completed(without, frames), strict=True):
        np.testing.assert_array_equal(got, wanted)


@given(st.integers(0, 8 + 6000), st.integers(0, 255), st.integers(0, 2**32 - 1))
def test_any_header_is_opened_or_refused(networks_file: Path, at: int, byte: int, seed: int) -> None:
    """Bytes of the header are changed, and the file is cut."""
    rng, file = np.random.default_rng(seed), bytearray(WEIGHTS.read_bytes())
    file[at] = byte
    for place in rng.integers(8, 6000, rng.integers(0, 4)):
        file[place] = rng.choice(list(b'{}[],:"0129- '))
    result, _ = open_library(networks_file, bytes(file[: rng.choice([len(file), 2000, at])]))
    assert result in (OK, DAMAGED, FOREIGN, NEWER, INCOMPLETE)
