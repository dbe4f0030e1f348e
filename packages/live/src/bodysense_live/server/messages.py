"""The text messages of the protocol as dataclasses, without I/O (docs/protocol.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

from bodysense.body.person import SHORTEST, TALLEST
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import MOST_POINTS, VERSION
from bodysense.tracking.calibration import TRACKER_JOINTS

Region = Literal["torso", "head", "arms", "fingers", "legs"]
Posture = Literal["standing", "seated"]
Source = Literal["replay", "vmc", "markers", "vmt", "vrchat", "slimevr", "solarxr", "camera"]
REGIONS: tuple[Region, ...] = get_args(Region)
LONGEST_NAME = 64  # characters
LONGEST_HALF_LIFE = 0.5  # s, of smoothing
SHORTEST_LENGTH, LONGEST_LENGTH = 0.02, 2.3  # m, between two joints
MOST_LENGTHS = 24  # of one wearer; the core takes 32, measured ones included
_DEEPEST_FLOOR = 10.0  # m


@dataclass(frozen=True)
class Worn:
    """Where a strapped tracker is worn."""

    tracker: str
    """Its name in the signal."""
    joint: str
    """The joint that carries it; empty: the tracker is ignored."""

    def __post_init__(self) -> None:
        if self.joint and self.joint not in TRACKER_JOINTS:
            raise BodysenseError(
                f"{self.tracker} on {self.joint!r}; a tracker is worn on {', '.join(TRACKER_JOINTS)}, or '' for none"
            )


@dataclass(frozen=True)
class KnownLength:
    """A known distance between two joints of the wearer in the T-pose."""

    start: str
    end: str
    metres: float

    def __post_init__(self) -> None:
        for joint in (self.start, self.end):
            if joint not in BODY:
                raise BodysenseError(f"a length from {joint!r}; valid are {', '.join(BODY)}")
        if not SHORTEST_LENGTH <= self.metres <= LONGEST_LENGTH:
            raise BodysenseError(
                f"{self.start} to {self.end}: {self.metres:g} m; "
                f"give metres between {SHORTEST_LENGTH:g} and {LONGEST_LENGTH:g}"
            )


@dataclass(frozen=True)
class Settings:
    """Settings of one session. A client may change each at any time."""

    height: float | None = None
    """Height of the wearer in m; null: it is inferred with the other proportions."""
    posture: Posture = "standing"
    """A seated wearer is displayed standing: the signal is raised until the head is at its standing height."""
    mirror: bool = False
    """Swap left and right in the answer, as in a mirror."""
    regions: tuple[Region, ...] = REGIONS
    """Regions that move; the others keep the standing pose."""
    smoothing: float = 0.0
    """Half-life in s of the smoothing of the whole body, 0 to 0.5; it delays the body by as much."""
    hidden: tuple[str, ...] = ()
    """Points of the signal to ignore."""
    floor: float = 0.0
    """Height of the floor in m, above y = 0."""
    hold_feet: bool = True
    """Hold standing feet in place, and keep feet above the floor."""
    lengths: tuple[KnownLength, ...] = ()
    """Known lengths of the wearer; the others are inferred."""
    worn: tuple[Worn, ...] = ()
    """Where trackers are worn, if not where their names say. Calibration adds the joints that it finds."""

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
        if len(self.lengths) > MOST_LENGTHS:
            raise BodysenseError(f"{len(self.lengths)} lengths; give at most {MOST_LENGTHS}")
        for name, values in (
            ("tracker", [one.tracker for one in self.worn]),
            ("joint", [one.joint for one in self.worn if one.joint]),
        ):
            twice = next((value for value in values if values.count(value) > 1), None)
            if twice is not None:
                raise BodysenseError(f"worn: the {name} {twice!r} is named twice; give it once")


@dataclass(frozen=True)
class Resume:
    """A session of an earlier connection."""

    session: str
    token: str


@dataclass(frozen=True)
class Hello:
    """The first message of a client."""

    version: int
    points: tuple[str, ...] = ()
    """Names of the signal's points, at most 128."""
    height: float | None = None
    """Shorthand for `settings.height`."""
    name: str = ""
    settings: Settings = Settings()
    resume: Resume | None = None
    watch: Source | None = None
    """One of the server's own inputs to watch, in place of a signal from the client."""
    follow: Resume | None = None
    """Another client's session to watch, with its `watch_token`."""


@dataclass(frozen=True)
class UpdateSettings:
    """Change the settings that are named; the others are unchanged."""

    settings: dict[str, Any]


@dataclass(frozen=True)
class Recentre:
    """Use the wearer's current position and heading as the origin, facing +Z."""


@dataclass(frozen=True)
class RecordSwitch:
    """Start or stop a recording on the server's disk, if the server allows it."""

    on: bool


@dataclass(frozen=True)
class Calibrate:
    """Measure height and tracker mounts during the next second, in which the wearer stands upright."""

    arms_out: bool = False
    """The arms are out to the sides; their reach is measured, too."""


@dataclass(frozen=True)
class Ping:
    """A request for a pong with the same time."""

    time: float


@dataclass(frozen=True)
class Replay:
    """Control the watched replay; values that are null are unchanged."""

    playing: bool | None = None
    time: float | None = None
    """Position in s from its beginning."""
    speed: float | None = None
    """Playback speed, 0.1 to 4."""


@dataclass(frozen=True)
class Welcome:
    """The answer to a hello, and to a change of settings."""

    session: str
    token: str
    """Token that resumes the session."""
    watch_token: str
    """Token with which others can watch the session."""
    name: str
    joints: tuple[str, ...]
    points: tuple[str, ...]
    """The joints, then the end sites."""
    parents: tuple[int, ...]
    """Index of every point's parent joint, -1 for the root."""
    rest_offset: tuple[tuple[float, float, float], ...]
    """Offset of every point from its parent in the T-pose, m."""
    height: float
    """Height of the body in m, from the floor to the crown."""
    signal: tuple[str, ...]
    """Names of the signal's points."""
    settings: Settings
    sources: tuple[Source, ...] = ()
    """The server's own inputs, values for `watch`."""
    recording: bool = False
    """Whether the server allows recordings."""
    length: float | None = None
    """Length of the watched replay in s."""
    resumed: bool = False
    version: int = VERSION


@dataclass(frozen=True)
class ProportionsChanged:
    """New proportions of the body, inferred or set, from the next pose on."""

    rest_offset: tuple[tuple[float, float, float], ...]
    """Offset of every point from its parent in the T-pose, m."""
    height: float
    """Height in m, from the floor to the crown."""


@dataclass(frozen=True)
class PlacementChanged:
    """A new placement of the signal's world in the body's: body = Ry(heading) · signal + offset."""

    offset: tuple[float, float, float]
    """m."""
    heading: float
    """rad, about +Y."""


@dataclass(frozen=True)
class Notice:
    """A line of text for the wearer."""

    text: str


@dataclass(frozen=True)
class ErrorMessage:
    """The reason for which the server closes the connection."""

    reason: str


@dataclass(frozen=True)
class Pong:
    """The answer to a ping."""

    time: float


ClientMessage = Hello | UpdateSettings | Recentre | RecordSwitch | Calibrate | Ping | Replay
ServerMessage = Welcome | ProportionsChanged | PlacementChanged | Notice | ErrorMessage | Pong
CLIENT: dict[str, type] = {
    "hello": Hello,
    "settings": UpdateSettings,
    "recentre": Recentre,
    "record": RecordSwitch,
    "calibrate": Calibrate,
    "ping": Ping,
    "replay": Replay,
}
SERVER: dict[str, type] = {
    "welcome": Welcome,
    "proportions": ProportionsChanged,
    "placed": PlacementChanged,
    "said": Notice,
    "error": ErrorMessage,
    "pong": Pong,
}
