"""Binary frames: a round trip, refusal of invalid ones, and the page's types."""

from __future__ import annotations

import importlib.util
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video import posture_constants
from bodysense.io.formats import protocol
from bodysense.io.formats.protocol import (
    PoseFrame,
    ProtocolError,
    SignalFrame,
    pose_layout,
    read_pose,
    read_signal,
    wire_accuracy,
    write_pose,
    write_signal,
    write_truth,
)
from bodysense_live.protocols.webxr import Placement, point_mapping, to_observation

ROOT = Path(__file__).parents[3]


def random_signal(seed: int, count: int) -> SignalFrame:
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    return SignalFrame(
        int(rng.integers(2**32)),
        float(rng.uniform(-1e6, 1e6)),
        rng.permutation(128)[:count].astype(np.uint8),
        rng.integers(0, 4, count).astype(np.uint8),
        rng.uniform(-10, 10, (count, 3)).astype(np.float32),
        (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).astype(np.float32),
        rng.integers(0, 2**16, count).astype(np.uint16),
    )


@given(st.integers(0, 2**32 - 1), st.integers(0, 128))
def test_signals_survive_a_round_trip(seed: int, count: int) -> None:
    frame = random_signal(seed, count)
    found = read_signal(write_signal(frame), 128)
    assert (found.sequence, found.time) == (frame.sequence, frame.time)
    for name in ("point", "has", "position", "rotation", "accuracy"):
        np.testing.assert_array_equal(getattr(found, name), getattr(frame, name))


def test_a_signal_without_accuracies_has_none() -> None:
    found = read_signal(write_signal(replace(random_signal(0, 5), accuracy=None)), 128)
    assert found.accuracy is not None and not found.accuracy.any()


@pytest.mark.parametrize("time", [1.7e9, -1e10])
def test_any_finite_seconds_are_a_time(time: float) -> None:
    assert read_signal(write_signal(replace(random_signal(0, 1), time=time)), 128).time == time


def test_accuracies_on_the_wire() -> None:
    metres = np.array([0.001, 0.00004, 0.0123456, 9.0, np.nan, np.inf])
    np.testing.assert_array_equal(wire_accuracy(metres), [10, 0, 123, 65535, 0, 65535])


def test_the_layout_is_the_documented_one() -> None:
    frame = SignalFrame(
        sequence=7,
        time=1.5,
        point=np.array([2], "u1"),
        has=np.array([3], "u1"),
        position=np.array([[1, 2, 3]], "f4"),
        rotation=np.array([[0, 1, 0, 0]], "f4"),
        accuracy=np.array([25], "u2"),
    )
    assert write_signal(frame) == struct.pack("<BBHId" + "BBH3f4f", 1, 0, 1, 7, 1.5, 2, 3, 25, 1, 2, 3, 0, 1, 0, 0)
    fields = pose_layout(52, 65).fields
    assert fields is not None
    offsets = {name: place[1] for name, place in fields.items()}
    assert offsets["root_position"] == 16 and offsets["rotation"] == 28
    assert offsets["expected_error"] == 28 + 16 * 52
    assert offsets["hidden"] == 28 + 16 * 52 + 4 * 65
    assert offsets["contact"] == 28 + 16 * 52 + 5 * 65
    assert offsets["microseconds"] == 28 + 16 * 52 + 5 * 65 + 4


def test_poses_survive_a_round_trip() -> None:
    rng, skeleton = np.random.default_rng(0), default_skeleton()
    joints, points = len(skeleton.joints), len(skeleton.points)
    hidden = rng.integers(0, 256, points) / 255
    contact = np.array([0, 51, 204, 255]) / 255
    root, rotation, error = rng.normal(size=3), rng.normal(size=(joints, 4)), rng.uniform(size=points)
    frame = PoseFrame(9, 2.25, root, rotation, error, hidden, contact)
    found = read_pose(write_pose(frame, 1234), points)
    assert (found.sequence, found.time, found.microseconds) == (9, 2.25, 1234)
    np.testing.assert_allclose(found.root_position, frame.root_position, rtol=1e-6)
    np.testing.assert_allclose(found.rotation, frame.rotation, rtol=1e-6)
    np.testing.assert_allclose(found.expected_error, frame.expected_error, rtol=1e-6)
    np.testing.assert_allclose(found.hidden, hidden)
    np.testing.assert_allclose(found.contact, contact)
    truth = read_pose(write_truth(frame), points)
    np.testing.assert_array_equal(truth.rotation, found.rotation)
    with pytest.raises(ProtocolError, match="take"):
        read_pose(write_pose(frame)[:-1], points)


@given(st.binary(max_size=400))
def test_any_bytes_are_a_frame_or_refused(data: bytes) -> None:
    try:
        read_signal(data, 3)
    except ProtocolError:
        return


@given(st.integers(0, 100), st.lists(st.tuples(st.integers(0, 111), st.integers(0, 255)), max_size=6))
def test_a_signal_that_is_read_is_usable(seed: int, changes: list[tuple[int, int]]) -> None:
    data = bytearray(write_signal(random_signal(seed, 3)))
    for place, value in changes:
        data[place] = value
    try:
        frame = read_signal(bytes(data), 128)
    except ProtocolError:
        return
    assert np.isfinite(frame.time)
    assert len(set(frame.point.tolist())) == len(frame.point) and (frame.point < 128).all()
    assert np.isfinite(frame.position[frame.has & 1 != 0]).all()
    np.testing.assert_allclose(np.linalg.norm(frame.rotation[frame.has & 2 != 0], axis=-1), 1, atol=0.011)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"point": [0, 0, 1]}, "names a point twice"),
        ({"point": [0, 1, 3]}, "number 3; the hello named 3"),
        ({"has": [4, 0, 0]}, "has 4"),
        ({"position": [[np.nan] * 3] * 3}, "not finite"),
        ({"position": [[0, np.inf, 0]] * 3}, "not finite"),
        ({"position": [[0, 1001, 0]] * 3}, "beyond 1000 m"),
        ({"rotation": [[0, 0, 0, 0]] * 3}, "unit length"),
        ({"rotation": [[3e38, 3e38, 0, 0]] * 3}, "unit length"),
        ({"rotation": [[np.nan, 0, 0, 0]] * 3}, "unit length"),
        ({"time": np.nan}, "nan s"),
        ({"time": 1e300}, "seconds"),
        ({"time": 1.7e12}, "not milliseconds"),
    ],
)
def test_invalid_values_are_refused(change: dict[str, Any], expected: str) -> None:
    fields: dict[str, Any] = {
        "sequence": 0,
        "time": 0.0,
        "point": np.arange(3),
        "has": np.full(3, 3),
        "position": np.zeros((3, 3)),
        "rotation": np.tile([1.0, 0, 0, 0], (3, 1)),
    }
    read_signal(write_signal(SignalFrame(**fields)), 3)
    broken: dict[str, Any] = {name: value if name == "time" else np.array(value) for name, value in change.items()}
    with pytest.raises(ProtocolError, match=expected):
        read_signal(write_signal(SignalFrame(**(fields | broken))), 3)


def test_values_whose_bit_is_clear_are_ignored() -> None:
    nothing = np.full((1, 4), np.nan)
    frame = SignalFrame(0, 0.0, np.array([0]), np.array([0]), nothing[:, :3], nothing)
    assert read_signal(write_signal(frame), 1).has[0] == 0


def test_a_signalling_nan_is_refused_without_a_warning() -> None:
    frame = SignalFrame(0, 0.0, np.array([0]), np.array([3]), np.zeros((1, 3)), np.array([[1, 0, 0, 0]]))
    data = bytearray(write_signal(frame))
    data[-16:-12] = bytes.fromhex("0100a07f")  # a signalling NaN
    with pytest.raises(ProtocolError, match="unit length"):
        read_signal(bytes(data), 1)
    data[17] = 0
    seen = to_observation(
        point_mapping(["head"], default_skeleton()), read_signal(bytes(data), 1), np.ones(1, bool), Placement(), 0.0
    )
    assert not seen.has_rotation.any()


def test_the_types_of_the_page_are_up_to_date() -> None:
    place = ROOT / "scripts" / "make_protocol_types.py"
    specification = importlib.util.spec_from_file_location("make_protocol_types", place)
    assert specification is not None and specification.loader is not None
    script = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(script)
    if not script.PLACE.parent.is_dir():
        pytest.skip("no sources of the page here")
    assert script.PLACE.read_text(encoding="utf-8") == script.text(), "run scripts/make_protocol_types.py"
    assert script.CONSTANTS.read_text(encoding="utf-8") == script.constants_text(), "run scripts/make_protocol_types.py"
    assert f"export const SEATED = {posture_constants.SEATED};" in script.constants_text()
    assert f"SIGNAL_HEAD_BYTES = {protocol.SIGNAL_HEAD.size};" in script.text()
