"""OSC: exchange with python-osc, and refusal of malformed packets with a reason."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.osc_packet import OscPacket

from bodysense.io.formats.osc import (
    DATAGRAM,
    DEEPEST,
    LARGEST,
    MOST_MESSAGES,
    Message,
    bundled,
    message_bytes,
    read_packet,
)

TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20)
VALUE = st.one_of(
    st.tuples(st.just("i"), st.integers(-(2**31), 2**31 - 1)),
    st.tuples(st.just("h"), st.integers(-(2**63), 2**63 - 1)),
    st.tuples(st.just("f"), st.floats(width=32, allow_nan=False)),
    st.tuples(st.just("d"), st.floats(allow_nan=False)),
    st.tuples(st.just("s"), TEXT),
    st.tuples(st.just("b"), st.binary(min_size=1, max_size=20)),  # python-osc does not support empty blobs
)
VALUES = st.lists(VALUE, max_size=12)


def by_the_library(address: str, values: list[tuple[str, Any]]) -> bytes:
    builder = OscMessageBuilder(address)
    for tag, value in values:
        builder.add_arg(value, tag)
    return builder.build().dgram


@given(TEXT, VALUES)
def test_python_osc_and_our_reader_read_each_others_packets(path: str, values: list[tuple[str, Any]]) -> None:
    address, tags = f"/{path}", "".join(tag for tag, _ in values)
    theirs = by_the_library(address, values)
    assert read_packet(theirs) == (Message(address, tuple(value for _, value in values)),)
    ours = message_bytes(address, tags, *(value for _, value in values))
    assert len(ours) % 4 == 0
    read = OscMessage(ours)
    assert (read.address, read.params) == (address, [value for _, value in values])


@settings(max_examples=25)
@given(st.lists(st.tuples(TEXT, VALUES), max_size=4), st.integers(0, DEEPEST - 1))
def test_bundles_in_bundles(messages: list[tuple[str, list[tuple[str, Any]]]], depth: int) -> None:
    content: Any = None
    for level in range(depth + 1):
        builder = OscBundleBuilder(IMMEDIATELY)
        for path, values in messages:
            inner = OscMessageBuilder(f"/{level}{path}")
            for tag, value in values:
                inner.add_arg(value, tag)
            builder.add_content(inner.build())
        if content is not None:
            builder.add_content(content)
        content = builder.build()
    found = read_packet(content.dgram)
    wanted = [(m.message.address, m.message.params) for m in OscPacket(content.dgram).messages]
    assert [(one.address, list(one.arguments)) for one in found if isinstance(one, Message)] == wanted


@given(st.lists(st.integers(0, 400), max_size=40))
def test_messages_are_distributed_over_datagrams(sizes: list[int]) -> None:
    messages = [message_bytes("/m", "ib", k, bytes(size + 1)) for k, size in enumerate(sizes)]
    packets = bundled(messages)
    assert all(len(packet) <= DATAGRAM for packet in packets)
    order = [m.message.params[0] for packet in packets for m in OscPacket(packet).messages]
    assert order == list(range(len(sizes)))
    assert sum(map(len, packets)) == sum(4 + len(message) for message in messages) + 16 * len(packets)


def nested(depth: int) -> bytes:
    packet = message_bytes("/a", "i", 1)
    for _ in range(depth):
        packet = b"#bundle\0" + bytes(8) + struct.pack(">i", len(packet)) + packet
    return packet


REFUSED = {
    "": "no address",
    "hello": "no address",
    "/no_end": "a text has no end",
    "/a\0\0fff\0": "no types",
    "/a\0\0,x\0\0": "the type 'x' is not read here",
    "/a\0\0,[]\0": "the type '[' is not read here",
    "/a\0\0,i\0\0": "a number is cut off",
    "/a\0\0,s\0\0abcd": "a text has no end",
    "/a\0\0,b\0\0\xff\xff\xff\xff": "a blob says that -1 bytes follow",
    "/a\0\0,b\0\0\0\0\0\x09": "a blob says that 9 bytes follow",
    "/\xff\xfe\0": "a text is not UTF-8",
    "#bundle\0abc": "a bundle is cut off",
    "#bundle\0\0\0\0\0\0\0\0\0\xff\xff\xff\xfc": "a bundle says that -4 bytes follow, but 0 do",
    "#bundle\0\0\0\0\0\0\0\0\0\0\0\0\0": "a bundle says that 0 bytes follow, but 0 do",
    "#bundle\0\0\0\0\0\0\0\0\0\x7f\xff\xff\xff": "a bundle says that 2147483647 bytes follow, but 0 do",
    "#bundle\0\0\0\0\0\0\0\0\0\0": "a number is cut off",
}


@pytest.mark.parametrize("packet", REFUSED)
def test_malformed_packets_are_refused_with_a_reason(packet: str) -> None:
    found = read_packet(packet.encode("latin-1"))
    assert isinstance(found, str)
    assert found.startswith(REFUSED[packet])


def test_packets_that_are_too_large_are_refused() -> None:
    assert read_packet(nested(DEEPEST)) == (Message("/a", (1,)),)
    assert read_packet(nested(DEEPEST + 1)) == f"bundles lie more than {DEEPEST} deep"
    assert read_packet(nested(800)) == f"bundles lie more than {DEEPEST} deep"
    crowd = bundled([message_bytes("/a", "")] * MOST_MESSAGES, LARGEST)
    assert len(crowd) == 1 and len(read_packet(crowd[0])) == MOST_MESSAGES
    crowd = bundled([message_bytes("/a", "")] * (MOST_MESSAGES + 1), LARGEST)
    assert read_packet(crowd[0]) == f"more than {MOST_MESSAGES} messages"
    assert read_packet(bytes(LARGEST + 1)) == f"{LARGEST + 1} bytes are no datagram"
    assert isinstance(read_packet(message_bytes("/a", 5000 * "i", *range(5000))), str)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(packet: bytes) -> None:
    for start in (b"", b"/a\0\0,", b"#bundle\0" + bytes(8)):
        assert isinstance(read_packet(start + packet), str | tuple)


def test_broken_packets_are_read_or_refused() -> None:
    """Packets with changed, removed and inserted bytes are read or refused, without an exception."""
    random = np.random.default_rng(3)
    good = bundled([message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "HMD", *np.arange(7.0)) for _ in range(4)])[0]
    answers = []
    for _ in range(3000):
        packet = bytearray(good)
        for place in random.integers(0, len(packet), random.integers(1, 6)):
            packet[place] = random.integers(256)
        cut = int(random.integers(len(packet) + 1))
        answers.append(read_packet(bytes(packet[:cut] if random.random() < 0.3 else packet)))
    kinds = {isinstance(answer, str) for answer in answers}
    assert kinds == {True, False}
