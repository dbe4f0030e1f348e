"""Live markers over the network: OSC messages by UDP (docs/gloves.md).

A frame is one message to `/bodysense/markers`: its time in seconds (a double), then name and x, y, z of every visible
marker. The Python package index has no VRPN client; your own VRPN client can forward frames with `write_frame`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from bodysense.io.formats.osc import message_bytes, read_packet
from bodysense.io.markers.raw_markers import MarkerFormat, RawMarkers, convert_world, points_alone
from bodysense.observing.checks import FARTHEST
from bodysense.observing.observation import Observation

ADDRESS = "/bodysense/markers"
LARGEST = 8192  # bytes of a message


def read_frame(message: bytes, points: tuple[str, ...], form: MarkerFormat = MarkerFormat()) -> Observation | None:
    """Return the frame (1, P) of `points` in a message, at the sender's time; None for a malformed message.

    `points` are our names of markers, as in `glove_points`. Markers that are not in the message are hidden. `form`: the
    sender's names, unit and axes.
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
    position = convert_world(place, raw, form)
    with np.errstate(invalid="ignore"):
        position[~(np.abs(position).max(axis=1) < FARTHEST)] = np.nan
    return points_alone(points, position[None], np.array([now], dtype=float))


def write_frame(now: float, markers: Mapping[str, np.ndarray]) -> bytes:
    """Return the message of one frame at `now` s. `markers`: visible markers by name, (3,) each."""
    seen = [value for name, place in markers.items() for value in (name, *map(float, place))]
    return message_bytes(ADDRESS, "d" + len(markers) * "sfff", float(now), *seen)


def _values(message: bytes) -> list[Any] | None:
    """Return time, then name and coordinates of each marker; None for a malformed message."""
    found = read_packet(message) if len(message) <= LARGEST else ""
    if len(found) != 1 or isinstance(found, str) or found[0].address != ADDRESS:
        return None
    values = list(found[0].arguments)
    well_formed = (
        len(values) % 4 == 1
        and all(isinstance(name, str) for name in values[1::4])
        and all(type(value) in (int, float) for k, value in enumerate(values) if k % 4 != 1)
        and len(set(values[1::4])) == len(values[1::4])
        and math.isfinite(values[0])  # type: ignore[arg-type]
    )
    return values if well_formed else None
