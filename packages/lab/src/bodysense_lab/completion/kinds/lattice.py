"""Lattice of sensor sets: pairs of a set and the same set with one more sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bodysense.devices.simulated.sensors import SENSOR_SETS, WRISTS, SensorSet

Kind = Literal["position and rotation", "position", "rotation"]
KINDS: tuple[Kind, ...] = ("position and rotation", "position", "rotation")


def with_sensor(sensors: SensorSet, name: str, kind: Kind) -> SensorSet:
    """Return the set with one more sensor, of a point and a kind."""
    return SensorSet(
        sensors.position if kind == "rotation" else (*sensors.position, name),
        sensors.rotation if kind == "position" else (*sensors.rotation, name),
        sensors.camera,
    )


@dataclass(frozen=True)
class Edge:
    """An edge of the lattice of sensor sets: a set, and the set with one more sensor."""

    fewer: SensorSet
    more: SensorSet
    sensor: str  # the point of the sensor that is added
    kind: Kind


# Parts with sensors in the lattice, in addition to the head; left and right are separate sensors.
LATTICE_PARTS = ("pelvis", "spine3", "knee", "elbow", "ankle", "hip", "shoulder")
_WRISTS_SHARE, _BOTH_SIDES_SHARE, _MOST = 0.85, 0.8, 0.7  # shares: sets with wrists, pairs; highest share of parts
_KIND_SHARES = (0.5, 0.25, 0.25)  # of `KINDS`


def random_edges(count: int = 200, rng: np.random.Generator | None = None) -> tuple[Edge, ...]:
    """Draw edges of the lattice: the head's pose, mostly both wrists, and any other parts with any kind of sensor.

    Without `rng`, the same edges are drawn each time.
    """
    rng = rng or np.random.default_rng(2026)
    edges: list[Edge] = []
    while len(edges) < count:
        fewer = _random_set(rng)
        left_out = [name for name in (*WRISTS, *_lattice_joints()) if name not in fewer.points]
        if left_out:
            name, kind = left_out[int(rng.integers(len(left_out)))], _random_kind(rng)
            edges.append(Edge(fewer, with_sensor(fewer, name, kind), name, kind))
    return tuple(edges)


def _random_set(rng: np.random.Generator) -> SensorSet:
    sensors = SENSOR_SETS["head"]
    if rng.uniform() < _WRISTS_SHARE:
        sensors = SENSOR_SETS["three_point"]
    share = rng.uniform(0, _MOST)
    for part in LATTICE_PARTS:
        if rng.uniform() < share:
            kind, names = _random_kind(rng), _joints_of(part)
            if rng.uniform() >= _BOTH_SIDES_SHARE:
                names = (names[int(rng.integers(len(names)))],)
            for name in names:
                sensors = with_sensor(sensors, name, kind)
    return sensors


def _random_kind(rng: np.random.Generator) -> Kind:
    return KINDS[int(rng.choice(len(KINDS), p=_KIND_SHARES))]


def _joints_of(part: str) -> tuple[str, ...]:
    return (part,) if part in ("pelvis", "spine3") else (f"left_{part}", f"right_{part}")


def _lattice_joints() -> tuple[str, ...]:
    return tuple(name for part in LATTICE_PARTS for name in _joints_of(part))
