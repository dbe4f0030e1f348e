"""The text messages of the protocol: dataclasses, no I/O (docs/protocol.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

from bodysense.body.person import SHORTEST, TALLEST
from bodysense.errors import BodysenseError
from bodysense.io.protocol import MOST_POINTS, VERSION

Region = Literal["torso", "head", "arms", "fingers", "legs"]
Posture = Literal["standing", "seated"]
Source = Literal["replay", "vmc", "markers", "vmt", "vrchat", "slimevr", "solarxr"]
REGIONS: tuple[Region, ...] = get_args(Region)
LONGEST_NAME = 64  # characters
LONGEST_HALF_LIFE = 0.5  # s, of smoothing
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
        if not 0 <= self.smoothing <= LONGEST_HALF_LIFE:
            raise BodysenseError(
                f"smoothing {self.smoothing:g} s; give a half-life between 0 and {LONGEST_HALF_LIFE:g} s"
            )
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
    follow: Resume | None = None
    """Another client's session to be shown, with its `watch_token`."""


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
    watch_token: str
    """With which others can watch it."""
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
class Notice:
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
ServerMessage = Welcome | ProportionsChanged | Placed | Notice | Refused | Pong
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
    "said": Notice,
    "error": Refused,
    "pong": Pong,
}
