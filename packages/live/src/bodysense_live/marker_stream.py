"""Live markers over the network: OSC messages by UDP, the newest frame wins (docs/gloves.md).

A frame is one message to `/bodysense/markers`: its time in seconds (a double), then for every marker that is seen its
name and x, y, z. No VRPN client can be installed from the Python package index; a VRPN client of one's own sends a
frame on with a few lines (`send_frame`).
"""

from __future__ import annotations

import math
import select
import socket
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from bodysense.body.glove import glove_points
from bodysense.body.hand import glove_marker
from bodysense.errors import BodysenseError
from bodysense.io.markers.raw_markers import MarkerFormat, RawMarkers, in_our_world, points_alone
from bodysense.io.osc import message_bytes, read_packet
from bodysense.observation import FARTHEST, Observation

ADDRESS = "/bodysense/markers"
PORT = 9123
LARGEST = 8192  # bytes of a message
_POLL = 0.1  # s within which a receiver that is closed stops


@dataclass(frozen=True)
class StreamCounts:
    """Counts of received messages by outcome."""

    frames: int  # good frames
    missed: int  # of these: replaced by a newer one before they were read
    dropped: int  # not a frame: malformed, too large or another address
    late: int  # time not after that of the previous frame


class MarkerReceiver:
    """Receives frames of markers while it is open: `with MarkerReceiver(('left', 'right')) as receiver: …`.

    `hands` are those whose gloves are wanted; other markers are left out. `form` has the sender's names, unit and
    axes, as for files. Port 0 takes any free port. Raises BodysenseError if the port is taken.
    """

    def __init__(
        self,
        hands: Sequence[str],
        form: MarkerFormat = MarkerFormat(),
        host: str = "127.0.0.1",
        port: int = PORT,
    ) -> None:
        self.points = tuple(name for hand in hands for name in glove_points(hand))
        self._form, self._wanted = form, (host, port)
        self._frame: Observation | None = None
        self._time = -math.inf
        self._counts = StreamCounts(0, 0, 0, 0)
        self._changed = threading.Condition()
        self._closing = threading.Event()

    def __enter__(self) -> Self:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        host, port = self._wanted
        try:
            self._socket.bind(self._wanted)
        except OSError as error:
            self._socket.close()
            raise BodysenseError(
                f"{host}:{port} cannot be listened on ({error.strerror}); choose another port"
            ) from None
        self._closing.clear()
        self._thread = threading.Thread(target=self._listen, name="markers", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.set()
        self._thread.join()
        self._socket.close()

    @property
    def address(self) -> tuple[str, int]:
        """Host and port that are listened on."""
        host, port = self._socket.getsockname()
        return host, port

    @property
    def counts(self) -> StreamCounts:
        """Counts of the messages until now."""
        with self._changed:
            return self._counts

    def wait(self, seconds: float) -> Observation | None:
        """Wait at most `seconds` for a frame that was not read yet, and return the newest (1, …); None without one."""
        with self._changed:
            self._changed.wait_for(lambda: self._frame is not None, seconds)
            frame, self._frame = self._frame, None
            return frame

    def take(self, message: bytes) -> None:
        """Take in one message, as it came from the network."""
        found = read_frame(message, self.points, self._form)
        with self._changed:
            counts = self._counts
            if found is None:
                self._counts = replace(counts, dropped=counts.dropped + 1)
            elif found.time[0] <= self._time:
                self._counts = replace(counts, late=counts.late + 1)
            else:
                missed = counts.missed + (self._frame is not None)
                self._counts = replace(counts, frames=counts.frames + 1, missed=missed)
                self._frame, self._time = found, float(found.time[0])
                self._changed.notify_all()

    def _listen(self) -> None:
        while not self._closing.is_set():
            ready, _, _ = select.select([self._socket], [], [], _POLL)
            if ready:
                try:
                    message = self._socket.recv(LARGEST + 1)
                except OSError:  # a sender that went away
                    continue
                self.take(message)


def read_frame(message: bytes, points: tuple[str, ...], form: MarkerFormat = MarkerFormat()) -> Observation | None:
    """The frame (1, P) of `points` in a message at the sender's time, names, unit and axes by `form`; None for none.

    `points` are our names of markers, as `glove_points` gives them; those that are not in the message are hidden.
    """
    values = _values(message)
    if values is None:
        return None
    now, *rest = values
    names, numbers = rest[::4], np.array([rest[k::4] for k in (1, 2, 3)], dtype=float).T.reshape(-1, 3)
    table = form.names or {}
    place = np.full((len(points), 3), np.nan)
    for name, at in zip(names, numbers, strict=True):
        ours = table.get(name, name)
        if ours in points:
            place[points.index(ours)] = at
    raw = RawMarkers(points, place[None], np.array([now]), 0.0)
    position = in_our_world(place, raw, form)
    with np.errstate(invalid="ignore"):
        position[~(np.abs(position).max(axis=1) < FARTHEST)] = np.nan
    return points_alone(points, position[None], np.array([now], dtype=float))


def send_frame(address: tuple[str, int], now: float, markers: Mapping[str, np.ndarray]) -> None:
    """Send one frame at `now` s: markers by name, (3,) each; hidden ones are left out."""
    seen = [value for name, place in markers.items() for value in (name, *map(float, place))]
    message = message_bytes(ADDRESS, "d" + len(markers) * "sfff", float(now), *seen)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(message, address)


def replay(address: tuple[str, int], observation: Observation, speed: float = 1.0) -> None:
    """Send the gloves' markers of a recording (T frames) at its own times, `speed` times as fast."""
    here = [(k, name) for k, name in enumerate(observation.points) if glove_marker(name)]
    begun = time.monotonic()
    for t, moment in enumerate(observation.time):
        wait = (moment - observation.time[0]) / speed - (time.monotonic() - begun)
        time.sleep(max(wait, 0.0))
        seen = {name: observation.position[t, k] for k, name in here if observation.has_position[t, k]}
        send_frame(address, float(moment), seen)


def _values(message: bytes) -> list[Any] | None:
    """Time, then names and numbers by turns, of a well-formed message; None otherwise."""
    found = read_packet(message) if len(message) <= LARGEST else ""
    if len(found) != 1 or isinstance(found, str) or found[0].address != ADDRESS:
        return None
    values = list(found[0].arguments)
    well_formed = (
        len(values) % 4 == 1
        and all(isinstance(name, str) for name in values[1::4])
        and all(_is_number(value) for k, value in enumerate(values) if k % 4 != 1)
        and len(set(values[1::4])) == len(values[1::4])
        and math.isfinite(values[0])  # type: ignore[arg-type]
    )
    return values if well_formed else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
