"""The text messages of the protocol: dataclasses and JSON, no I/O (docs/protocol.md)."""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import lru_cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from bodysense.body.person import SHORTEST, TALLEST
from bodysense.errors import BodysenseError
from bodysense.serve.protocol import MOST_POINTS, VERSION, ProtocolError

Region = Literal["torso", "head", "arms", "fingers", "legs"]
Posture = Literal["standing", "seated"]
Source = Literal["replay", "vmc", "markers", "vmt", "vrchat", "slimevr"]
REGIONS: tuple[Region, ...] = get_args(Region)
LONGEST_NAME = 64  # characters
_DEEPEST = 6  # brackets within one another
_LONGEST_LIST = 256
_SLOWEST = 0.5  # s, of smoothing
_DEEPEST_FLOOR = 10.0  # m


@dataclass(frozen=True)
class Settings:
    """How one person is set up; a client may change each at any time, and keeps them."""

    height: float | None = None
    """Of the person, m; where null, proportions are inferred from what is tracked."""
    posture: Posture = "standing"
    """Somebody who is seated is shown standing: their signal is raised by as much as their head is too low."""
    mirror: bool = False
    """Left and right are swapped in the answer, as in a mirror."""
    regions: tuple[Region, ...] = REGIONS
    """What is driven; everything else stays as in standing."""
    smoothing: float = 0.0
    """Half-life in s of a smoother after everything else, 0 to 0.5; as much later is the answer."""
    hidden: tuple[str, ...] = ()
    """Points of the signal that are not looked at."""
    floor: float = 0.0
    """m, of the floor over y = 0."""
    hold_feet: bool = True
    """Feet that stand are held where they are, and none is under the floor."""

    def __post_init__(self) -> None:
        if self.height is not None and not SHORTEST <= self.height <= TALLEST:
            raise BodysenseError(
                f"height {self.height:g} m is not a person's; give metres between {SHORTEST:g} and {TALLEST:g}"
            )
        if not abs(self.floor) <= _DEEPEST_FLOOR:
            raise BodysenseError(f"floor {self.floor:g} m; give a height between ±{_DEEPEST_FLOOR:g} m")
        if not 0 <= self.smoothing <= _SLOWEST:
            raise BodysenseError(f"smoothing {self.smoothing:g} s; give a half-life between 0 and {_SLOWEST:g} s")
        if len(self.hidden) > MOST_POINTS:
            raise BodysenseError(f"{len(self.hidden)} hidden points; a signal has at most {MOST_POINTS}")


@dataclass(frozen=True)
class Resume:
    """The session that a client had before its connection broke."""

    session: str
    token: str


@dataclass(frozen=True)
class Hello:
    """The first message of a client."""

    version: int
    points: tuple[str, ...] = ()
    """Names of the points of its signal, at most 128."""
    height: float | None = None
    """Short for `settings.height`."""
    name: str = ""
    settings: Settings = Settings()
    resume: Resume | None = None
    watch: Source | None = None
    """The server's own input to be shown, instead of a signal of the client."""


@dataclass(frozen=True)
class Change:
    """`settings`: the settings to be changed; those that are not named stay."""

    settings: dict[str, Any]


@dataclass(frozen=True)
class Recentre:
    """Where the wearer stands now, and faces, is the middle, facing +Z."""


@dataclass(frozen=True)
class RecordSwitch:
    """Begin or end a recording on the server's disk, which must allow it."""

    on: bool


@dataclass(frozen=True)
class Calibrate:
    """The wearer stands upright for one second from now: height and how trackers are worn are taken from it."""

    arms_out: bool = False
    """To the sides: then the reach of the arms is taken as well."""


@dataclass(frozen=True)
class Ping:
    """Answered by a pong with the same time."""

    time: float


@dataclass(frozen=True)
class Replay:
    """Drive a replay that is watched: what is null stays."""

    playing: bool | None = None
    time: float | None = None
    """s from its beginning."""
    speed: float | None = None
    """0.1 to 4 times as fast."""


@dataclass(frozen=True)
class Welcome:
    """The answer to a hello, and to a change of the settings."""

    session: str
    token: str
    """With which the session can be resumed."""
    name: str
    joints: tuple[str, ...]
    points: tuple[str, ...]
    """The joints, then the end sites."""
    parents: tuple[int, ...]
    """Of every point: the joint that it hangs on, -1 for the root."""
    rest_offset: tuple[tuple[float, float, float], ...]
    """m, of every point from its parent in the T-pose."""
    height: float
    """m, from the floor to the crown, of this body."""
    signal: tuple[str, ...]
    """Names of the points of the signal."""
    settings: Settings
    sources: tuple[Source, ...] = ()
    """The server's own inputs, for `watch`."""
    recording: bool = False
    """Whether the server records on its disk where it is asked to."""
    length: float | None = None
    """s, of a replay that is watched."""
    resumed: bool = False
    version: int = VERSION


@dataclass(frozen=True)
class ProportionsChanged:
    """The body has other proportions from the next pose on: they were inferred, or told."""

    rest_offset: tuple[tuple[float, float, float], ...]
    """m, of every point from its parent in the T-pose."""
    height: float
    """m, from the floor to the crown."""


@dataclass(frozen=True)
class Placed:
    """How the signal's world is moved into the body's: body = Ry(heading) · signal + offset."""

    offset: tuple[float, float, float]
    """m."""
    heading: float
    """rad, about +Y."""


@dataclass(frozen=True)
class Said:
    """Something for the person to read."""

    text: str


@dataclass(frozen=True)
class Refused:
    """Why the server closes the connection."""

    reason: str


@dataclass(frozen=True)
class Pong:
    """The answer to a ping."""

    time: float


ClientMessage = Hello | Change | Recentre | RecordSwitch | Calibrate | Ping | Replay
ServerMessage = Welcome | ProportionsChanged | Placed | Said | Refused | Pong
CLIENT: dict[str, type] = {
    "hello": Hello,
    "settings": Change,
    "recentre": Recentre,
    "record": RecordSwitch,
    "calibrate": Calibrate,
    "ping": Ping,
    "replay": Replay,
}
SERVER: dict[str, type] = {
    "welcome": Welcome,
    "proportions": ProportionsChanged,
    "placed": Placed,
    "said": Said,
    "error": Refused,
    "pong": Pong,
}
_NAMES = {kind: name for name, kind in (CLIENT | SERVER).items()}


def write_message(message: ClientMessage | ServerMessage) -> str:
    """The text of a message."""
    body = message.settings if isinstance(message, Change) else vars(message)
    return json.dumps({"type": _NAMES[type(message)], **body}, separators=(",", ":"), default=vars)


def read_message(text: str) -> ClientMessage:
    """The message of a client. Raises ProtocolError for text that is none, saying what is wrong with it."""
    value = _parsed(text)
    if not isinstance(value, dict):
        raise ProtocolError("a text message is a JSON object with a 'type'")
    kind = value.pop("type", None)
    if not isinstance(kind, str) or kind not in CLIENT:
        raise ProtocolError(f"a message of type {_short(kind)}; clients send {', '.join(CLIENT)}")
    if kind == "hello" and value.get("version") != VERSION:
        raise ProtocolError(
            f"protocol version {_short(value.get('version'))}; this server speaks {VERSION}: use its client"
        )
    if kind == "settings":
        changed(Settings(), value)  # so that what is wrong is said now
        return Change(value)
    return _built(CLIENT[kind], value, kind)


def changed(settings: Settings, values: dict[str, Any]) -> Settings:
    """Settings of which some are replaced, by their names in JSON. Raises ProtocolError for what is none."""
    hints = _hints(Settings)
    unknown = [name for name in values if name not in hints]
    if unknown:
        raise ProtocolError(f"settings: {_short(unknown[0])} is none; there are {', '.join(hints)}")
    return _made(replace, settings, **{k: _value(hints[k], v, f"settings.{k}") for k, v in values.items()})


def _parsed(text: str) -> Any:
    depth = deepest = 0
    for character in text if text.count("[") + text.count("{") > _DEEPEST else "":
        depth += (character in "[{") - (character in "]}")
        deepest = max(deepest, depth)
    if deepest > _DEEPEST:
        raise ProtocolError(f"JSON of {deepest} lists within one another; {_DEEPEST} are enough")
    try:
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise ProtocolError("a text message that is not JSON") from None


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
    """A dataclass from a JSON object; fields that it does not know are for later versions and are left out."""
    if not isinstance(value, dict):
        raise ProtocolError(f"{where}: give an object, not {_short(value)}")
    hints = _hints(kind)
    missing = [f.name for f in fields(kind) if f.default is MISSING and f.name not in value]
    if missing:
        raise ProtocolError(f"{where}: {missing[0]!r} is missing")
    return _made(kind, **{k: _value(hints[k], v, f"{where}.{k}") for k, v in value.items() if k in hints})


def _value(hint: Any, value: Any, where: str) -> Any:
    """A JSON value as a field of type `hint`."""
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
            raise ProtocolError(f"{where}: {_short(value)} is none of {', '.join(get_args(hint))}")
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
