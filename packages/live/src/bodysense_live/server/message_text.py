"""JSON of the text messages: written from dataclasses, and read into them or refused with a reason."""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import lru_cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import VERSION, ProtocolError
from bodysense_live.server.messages import (
    CLIENT,
    LONGEST_NAME,
    SERVER,
    ClientMessage,
    ServerMessage,
    Settings,
    UpdateSettings,
)

_DEEPEST = 6  # levels of brackets
_LONGEST_LIST = 256
_NAMES = {kind: name for name, kind in (CLIENT | SERVER).items()}


def write_message(message: ClientMessage | ServerMessage) -> str:
    """Return a message as JSON."""
    body = message.settings if isinstance(message, UpdateSettings) else vars(message)
    return json.dumps({"type": _NAMES[type(message)], **body}, separators=(",", ":"), default=vars)


def read_message(text: str) -> ClientMessage:
    """Return a client's message. Raises ProtocolError, with the reason, for an invalid text."""
    value = _parsed(text)
    if not isinstance(value, dict):
        raise ProtocolError("a text message is a JSON object with a 'type'")
    kind = value.pop("type", None)
    if not isinstance(kind, str) or kind not in CLIENT:
        raise ProtocolError(f"a message of type {_short(kind)}; clients send {', '.join(CLIENT)}")
    if kind == "hello" and value.get("version") != VERSION:
        raise ProtocolError(
            f"messages of version {_short(value.get('version'))}; this server speaks version {VERSION}: "
            "load its page again, or use its client"
        )
    if kind == "settings":
        changed(Settings(), value)  # refuse invalid values now
        return UpdateSettings(value)
    return _built(CLIENT[kind], value, kind)


def changed(settings: Settings, values: dict[str, Any]) -> Settings:
    """Return settings with some replaced, by their names in JSON. Raises ProtocolError for wrong values."""
    hints = _hints(Settings)
    unknown = [name for name in values if name not in hints]
    if unknown:
        raise ProtocolError(f"settings: {_short(unknown[0])} is unknown; valid are {', '.join(hints)}")
    return _made(replace, settings, **{k: _value(hints[k], v, f"settings.{k}") for k, v in values.items()})


def _parsed(text: str) -> Any:
    depth = deepest = 0
    for character in text if text.count("[") + text.count("{") > _DEEPEST else "":
        depth += (character in "[{") - (character in "]}")
        deepest = max(deepest, depth)
    if deepest > _DEEPEST:
        raise ProtocolError(f"JSON is nested {deepest} levels deep; at most {_DEEPEST} are allowed")
    try:
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise ProtocolError("a text message is not JSON") from None


def _no_number(name: str) -> None:
    raise ValueError(name)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "…"


def _made(make: Any, *arguments: Any, **values: Any) -> Any:
    try:
        return make(*arguments, **values)
    except ProtocolError:
        raise
    except BodysenseError as error:
        raise ProtocolError(str(error)) from None


@lru_cache(maxsize=64)
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _built(kind: type, value: Any, where: str) -> Any:
    """Return a dataclass from a JSON object. Unknown fields are from later versions, and ignored."""
    if not isinstance(value, dict):
        raise ProtocolError(f"{where}: give an object, not {_short(value)}")
    hints = _hints(kind)
    missing = [f.name for f in fields(kind) if f.default is MISSING and f.name not in value]
    if missing:
        raise ProtocolError(f"{where}: {missing[0]!r} is missing")
    return _made(kind, **{k: _value(hints[k], v, f"{where}.{k}") for k, v in value.items() if k in hints})


def _value(hint: Any, value: Any, where: str) -> Any:
    """Return a JSON value as a value of type `hint`."""
    if get_origin(hint) in (UnionType, Union):
        if value is None and NoneType in get_args(hint):
            return None
        return _value(next(kind for kind in get_args(hint) if kind is not NoneType), value, where)
    if is_dataclass(hint):
        return _built(hint, value, where)  # type: ignore[arg-type]
    if get_origin(hint) is tuple:
        if not isinstance(value, list) or len(value) > _LONGEST_LIST:
            raise ProtocolError(f"{where}: give a list of at most {_LONGEST_LIST}")
        return tuple(_value(get_args(hint)[0], entry, where) for entry in value)
    if get_origin(hint) is Literal:
        if not isinstance(value, str) or value not in get_args(hint):
            raise ProtocolError(f"{where}: give one of {', '.join(get_args(hint))}, not {_short(value)}")
        return value
    if hint is str:
        if not isinstance(value, str) or len(value) > LONGEST_NAME:
            raise ProtocolError(f"{where}: give a text of at most {LONGEST_NAME} characters, not {_short(value)}")
        return value
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    good = isinstance(value, bool) if hint is bool else is_number and (hint is float or isinstance(value, int))
    if not good or (hint is float and not abs(value) < 1e15) or (hint is int and not abs(value) < 2**53):
        raise ProtocolError(f"{where}: give {'true or false' if hint is bool else 'a number'}, not {_short(value)}")
    number = hint(value)
    assert math.isfinite(number)
    return number
