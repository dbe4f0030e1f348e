"""Text messages: a round trip, and errors in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import ProtocolError
from bodysense_live.server.message_text import changed, read_message, write_message
from bodysense_live.server.messages import (
    CLIENT,
    REGIONS,
    Calibrate,
    ClientMessage,
    Hello,
    Ping,
    Recentre,
    RecordSwitch,
    Replay,
    Resume,
    Settings,
    UpdateSettings,
)

OF_OTHERS = Settings(1.8, "seated", True, ("head", "arms"), 0.25, ("left_wrist",))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=12,
)


@pytest.mark.parametrize(
    "message",
    [
        Hello(1),
        Hello(1, ("headset",), 1.7, "me", OF_OTHERS, Resume("a", "b"), "replay"),
        UpdateSettings({"mirror": True, "height": None}),
        Recentre(),
        Calibrate(),
        RecordSwitch(False),
        Ping(1.5),
        Replay(True, 3.0, 0.5),
    ],
)
def test_messages_survive_a_round_trip(message: ClientMessage) -> None:
    assert read_message(write_message(message)) == message


@given(
    st.sampled_from([*CLIENT, "other"]),
    st.dictionaries(
        st.sampled_from([*vars(Hello(1)), "on", "time", "speed", "mirror", "regions"]),
        JSON,
        max_size=6,
    ),
)
def test_any_object_is_a_message_or_refused(kind: str, fields: dict[str, Any]) -> None:
    try:
        message = read_message(json.dumps({"version": 1, **fields, "type": kind}))
    except ProtocolError as error:
        assert "\n" not in str(error)
        return
    assert isinstance(message, CLIENT[kind])


@given(st.text(max_size=200))
def test_any_text_is_a_message_or_refused(text: str) -> None:
    try:
        read_message(text)
    except ProtocolError:
        return


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "not JSON"),
        ("[1]", "a JSON object"),
        ("{}", "type None"),
        ('{"type":"hello","version":2}', "messages of version 2; this server speaks version 1"),
        ('{"type":"hello"}', "messages of version None"),
        ('{"type":"jump"}', "type 'jump'; clients send hello"),
        ('{"type":"record"}', "'on' is missing"),
        ('{"type":"record","on":1}', "true or false"),
        ('{"type":"ping","time":NaN}', "not JSON"),
        ('{"type":"ping","time":1e400}', "a number"),
        ('{"type":"ping","time":true}', "a number"),
        ('{"type":"ping","time":' + "9" * 5000 + "}", "not JSON"),
        ('{"type":"hello","version":1,"points":"head"}', "a list"),
        ('{"type":"hello","version":1,"points":[' + ",".join(['"a"'] * 257) + "]}", "at most 256"),
        ('{"type":"hello","version":1,"name":"' + "x" * 65 + '"}', "at most 64 characters"),
        ('{"type":"settings","size":1}', "'size' is unknown; valid are height"),
        ('{"type":"settings","height":4}', "height 4 m"),
        ('{"type":"settings","smoothing":-1}', "smoothing -1 s"),
        ('{"type":"settings","regions":["tail"]}', "give one of torso, head, arms, fingers, legs, not 'tail'"),
        ("[" * 1000 + "]" * 1000, "levels deep"),
        ("[" * 100000, "levels deep"),
    ],
)
def test_errors_are_named(text: str, expected: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        read_message(text)
    assert expected in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_settings_that_are_not_named_are_unchanged() -> None:
    assert changed(OF_OTHERS, {"mirror": False}) == replace(OF_OTHERS, mirror=False)
    assert changed(OF_OTHERS, {"height": None}).height is None
    assert changed(Settings(), {"regions": list(REGIONS)}) == Settings()
    with pytest.raises(BodysenseError, match="height"):
        Settings(height=float("nan"))
