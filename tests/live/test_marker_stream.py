"""Live markers on the loopback: the newest frame wins, and nothing that comes in breaks the receiver."""

from __future__ import annotations

import socket
import struct
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.glove import glove_points
from bodysense.errors import BodysenseError
from bodysense.io.markers.raw_markers import MarkerFormat
from bodysense.io.osc import bundled, message_bytes
from bodysense.observation import Observation
from bodysense_live.marker_stream import (
    ADDRESS,
    LARGEST,
    MarkerReceiver,
    StreamCounts,
    read_frame,
    replay,
    send_frame,
)

BOTH = ("left", "right")


def wait_for(receiver: MarkerReceiver, messages: int) -> StreamCounts:
    """What became of so many messages, once they are all in."""
    until = time.monotonic() + 5
    while time.monotonic() < until:
        counts = receiver.counts
        if counts.frames + counts.dropped + counts.late >= messages:
            return counts
        time.sleep(0.005)
    raise AssertionError(f"{messages} messages were sent, {receiver.counts} came")


def test_a_recording_comes_through(hidden_gloves: Observation) -> None:
    with MarkerReceiver(BOTH, port=0) as receiver:
        frames: list[Observation] = []
        sender = threading.Thread(target=replay, args=(receiver.address, hidden_gloves[:12], 2.0))
        sender.start()
        while (frame := receiver.wait(2.0)) is not None and len(frames) < 11:
            frames.append(frame)
        sender.join()
        assert receiver.counts.dropped == receiver.counts.late == 0
    assert frames
    for frame in frames:
        t = int(np.flatnonzero(hidden_gloves.time == frame.time[0])[0])
        assert frame.points == hidden_gloves.points
        np.testing.assert_array_equal(frame.has_position[0], hidden_gloves.has_position[t])
        np.testing.assert_allclose(frame.position[0], hidden_gloves.position[t], atol=1e-6, equal_nan=True)


def test_the_newest_frame_wins() -> None:
    with MarkerReceiver(("left",), port=0) as receiver:
        for k in range(5):
            send_frame(receiver.address, k / 60, {"left_glove_wrist": np.array([k, 0.0, 0.0])})
        assert wait_for(receiver, 5) == StreamCounts(frames=5, missed=4, dropped=0, late=0)
        frame = receiver.wait(0.0)
        assert frame is not None and frame.time[0] == 4 / 60
        assert frame.position[0, frame.points.index("left_glove_wrist"), 0] == 4
        assert frame.has_position.sum() == 1
        assert receiver.wait(0.01) is None


def test_late_frames_and_those_of_the_same_time_are_counted() -> None:
    with MarkerReceiver(("left",), port=0) as receiver:
        for now in (1.0, 1.0, 0.5, 1.1):
            send_frame(receiver.address, now, {})
        counts = wait_for(receiver, 4)
        assert counts.frames == 2 and counts.late == 2


def test_names_unit_and_axes_of_the_sender() -> None:
    form = MarkerFormat(names={"LMIF": "left_glove_index_tip"}, unit="mm", up="z", left_handed=True)
    with MarkerReceiver(("left",), form, port=0) as receiver:
        send_frame(receiver.address, 0.0, {"LMIF": np.array([1000.0, 2000.0, 3000.0]), "other": np.zeros(3)})
        frame = receiver.wait(2.0)
    assert frame is not None
    np.testing.assert_allclose(frame.position[0, frame.points.index("left_glove_index_tip")], [-1.0, 3.0, -2.0])


def test_packets_that_are_no_frame_are_dropped(hidden_gloves: Observation) -> None:
    from pythonosc.osc_message_builder import OscMessageBuilder

    def message(address: str, *values: object) -> bytes:
        builder = OscMessageBuilder(address)
        for value in values:
            builder.add_arg(value)  # type: ignore[arg-type]
        return builder.build().dgram

    packets = [
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
    ]
    with (
        MarkerReceiver(BOTH, port=0) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        for packet in packets:
            sender.sendto(packet, receiver.address)
        assert wait_for(receiver, len(packets)) == StreamCounts(frames=0, missed=0, dropped=len(packets), late=0)
        send_frame(receiver.address, 0.0, {"left_glove_wrist": np.ones(3)})
        frame = receiver.wait(2.0)
        assert frame is not None and frame.has_position.sum() == 1


@given(packet=st.binary(max_size=200) | st.binary(max_size=60).map(lambda tail: b"/bodysense/markers\0\0,d" + tail))
def test_no_packet_breaks_the_receiver(packet: bytes) -> None:
    receiver = MarkerReceiver(("left",))
    receiver.take(packet)
    assert sum((receiver.counts.frames, receiver.counts.dropped, receiver.counts.late)) == 1


def test_positions_that_are_no_number_are_hidden() -> None:
    receiver = MarkerReceiver(("left",))
    name = b"left_glove_wrist\0\0\0\0"
    for value in (np.nan, np.inf, 1e9):
        receiver.take(
            b"/bodysense/markers\0\0,dsfff\0\0"
            + struct.pack(">d", float(np.isnan(value)))
            + name
            + struct.pack(">fff", 0.0, value, 0.0)
        )
    frame = receiver.wait(0.0)
    assert receiver.counts.dropped == 0 and frame is not None
    assert not frame.has_position.any() and np.isnan(frame.position).all()


def test_a_frame_is_read_without_a_receiver() -> None:
    points = glove_points("left") + glove_points("right")
    message = message_bytes(ADDRESS, "dsfff", 2.5, "right_glove_wrist", 0.5, 1.0, 1.5)
    for packet in (message, bundled([message])[0]):
        frame = read_frame(packet, points)
        assert frame is not None and frame.points == points and frame.time.tolist() == [2.5]
        assert np.flatnonzero(frame.has_position).tolist() == [points.index("right_glove_wrist")]
        np.testing.assert_array_equal(frame.position[frame.has_position], [[0.5, 1.0, 1.5]])
    assert read_frame(b"hello", points) is None
    assert read_frame(bundled([message, message])[0], points) is None  # a frame is one message


def test_a_port_that_is_taken() -> None:
    with MarkerReceiver(("left",), port=0) as receiver:
        other = MarkerReceiver(("left",), port=receiver.address[1])
        with pytest.raises(BodysenseError, match=r"cannot be listened on .* choose another port"), other:
            pass
    assert len(glove_points("left")) == len(receiver.points)
