"""Messages of live markers: a round trip, and malformed packets."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.hands.glove import glove_points
from bodysense.io.formats.osc import bundled, message_bytes
from bodysense.io.markers.raw_markers import MarkerFormat
from bodysense.observing.observation import Observation
from bodysense_live.protocols.marker_stream import ADDRESS, LARGEST, read_frame, write_frame

LEFT = glove_points("left")


def test_a_recording_is_transmitted_unchanged(hidden_gloves: Observation) -> None:
    for t in range(12):
        seen = hidden_gloves.has_position[t]
        names = [name for name, is_seen in zip(hidden_gloves.points, seen, strict=True) if is_seen]
        places = dict(zip(names, hidden_gloves.position[t][seen], strict=True))
        frame = read_frame(write_frame(float(hidden_gloves.time[t]), places), hidden_gloves.points)
        assert frame is not None and frame.time[0] == hidden_gloves.time[t]
        np.testing.assert_array_equal(frame.has_position[0], seen)
        np.testing.assert_allclose(frame.position[0], hidden_gloves.position[t], atol=1e-6, equal_nan=True)


def test_names_unit_and_axes_of_the_sender() -> None:
    form = MarkerFormat(names={"LMIF": "left_glove_index_tip"}, unit="mm", up="z", left_handed=True)
    places = {"LMIF": np.array([1000.0, 2000.0, 3000.0]), "other": np.zeros(3)}
    frame = read_frame(write_frame(0.0, places), LEFT, form)
    assert frame is not None
    np.testing.assert_allclose(frame.position[0, frame.points.index("left_glove_index_tip")], [-1.0, 3.0, -2.0])


def message(address: str, *values: object) -> bytes:
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value)  # type: ignore[arg-type]
    return builder.build().dgram


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        b"hello",
        b"/bodysense/markers",
        bytes(LARGEST + 1),
        message("/other", 0.0, "left_glove_wrist", 0.0, 0.0, 0.0),
        message(ADDRESS),
        message(ADDRESS, 0.0, "left_glove_wrist", 0.0, 0.0),
        message(ADDRESS, "0.0", "left_glove_wrist", 0.0, 0.0, 0.0),
        message(ADDRESS, 0.0, 1.0, 0.0, 0.0, 0.0),
        message(ADDRESS, 0.0, "left_glove_wrist", True, 0.0, 0.0),
        message(ADDRESS, float("nan"), "left_glove_wrist", 0.0, 0.0, 0.0),
        message(ADDRESS, 0.0, *("left_glove_wrist", 0.0, 0.0, 0.0) * 2),
        bundled([write_frame(0.0, {}), write_frame(1.0, {})])[0],  # a frame is one message
    ],
    ids=range(13),
)
def test_malformed_packets_are_dropped(packet: bytes) -> None:
    assert read_frame(packet, LEFT) is None


@given(packet=st.binary(max_size=200) | st.binary(max_size=60).map(lambda tail: b"/bodysense/markers\0\0,d" + tail))
def test_the_reader_never_raises(packet: bytes) -> None:
    found = read_frame(packet, LEFT)
    assert found is None or found.points == LEFT


def test_nan_positions_are_hidden() -> None:
    name = b"left_glove_wrist\0\0\0\0"
    for value in (np.nan, np.inf, 1e9):
        head = b"/bodysense/markers\0\0,dsfff\0\0" + struct.pack(">d", 0.0) + name
        frame = read_frame(head + struct.pack(">fff", 0.0, value, 0.0), LEFT)
        assert frame is not None
        assert not frame.has_position.any() and np.isnan(frame.position).all()


def test_a_frame_is_a_message_or_a_bundle_of_one() -> None:
    points = LEFT + glove_points("right")
    alone = message_bytes(ADDRESS, "dsfff", 2.5, "right_glove_wrist", 0.5, 1.0, 1.5)
    assert alone == write_frame(2.5, {"right_glove_wrist": np.array([0.5, 1.0, 1.5])})
    for packet in (alone, bundled([alone])[0]):
        frame = read_frame(packet, points)
        assert frame is not None and frame.points == points and frame.time.tolist() == [2.5]
        assert np.flatnonzero(frame.has_position).tolist() == [points.index("right_glove_wrist")]
        np.testing.assert_array_equal(frame.position[frame.has_position], [[0.5, 1.0, 1.5]])
