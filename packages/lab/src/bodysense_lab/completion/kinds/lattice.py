"""Lattice of sensor sets: pairs of a set and the same set with one more sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense_lab.completion.data.points import INPUT_POINTS
from bodysense_lab.completion.data.signal_kinds import TEST_SIGNALS, draw_signal

Kind = Literal["position and rotation", "position", "rotation"]
KINDS: tuple[Kind, ...] = ("position and rotation", "position", "rotation")


def with_sensor(sensors: SensorSet, name: str, kind: Kind) -> SensorSet:
    """Return the set with one more sensor, of a point and a kind."""
    return SensorSet(
        sensors.position if kind == "rotation" else (*sensors.position, name),
        sensors.rotation if kind == "position" else (*sensors.rotation, name),
        sensors.camera,
        sensors.acceleration,
    )


@dataclass(frozen=True)
class Edge:
    """An edge of the lattice of sensor sets: a set, and the set with one more sensor."""

    fewer: SensorSet
    more: SensorSet
    sensor: str  # the point of the sensor that is added
    kind: Kind


# Parts with sensors in sets with a headset, in addition to the head; left and right are separate sensors.
LATTICE_PARTS = ("pelvis", "spine3", "knee", "elbow", "ankle", "hip", "shoulder")
_HEADSET_SHARE = 0.5  # share of sets with a headset's pose and worn sensors; others are any kind of signal
_WRISTS_SHARE, _BOTH_SIDES_SHARE, _MOST = 0.85, 0.8, 0.7  # shares: sets with wrists, pairs; highest share of parts
_HEAD_SHARE = 0.25  # share of sets without the head's whole pose to which the head is added
_KIND_SHARES = (0.5, 0.25, 0.25)  # of `KINDS`


def random_edges(count: int = 200, rng: np.random.Generator | None = None) -> tuple[Edge, ...]:
    """Draw edges of the lattice, from sets with a headset and from sets of any kind (`signal_kinds`).

    Without `rng`, the same edges are drawn each time.
    """
    rng = rng or np.random.default_rng(2026)
    edges: list[Edge] = []
    while len(edges) < count:
        fewer = _headset(rng) if rng.uniform() < _HEADSET_SHARE else draw_signal(rng, TEST_SIGNALS)
        added = [(name, kind) for name in INPUT_POINTS for kind in _missing_kinds(fewer, name)]
        of_head = [one for one in added if one[0] == "head"]
        if of_head and rng.uniform() < _HEAD_SHARE:
            added = of_head
        if added:
            names = list(dict.fromkeys(name for name, _ in added))
            name = names[int(rng.integers(len(names)))]
            kinds = _missing_kinds(fewer, name)
            kind = kinds[int(rng.integers(len(kinds)))]
            edges.append(Edge(fewer, with_sensor(fewer, name, kind), name, kind))
    return tuple(edges)


def _missing_kinds(sensors: SensorSet, name: str) -> tuple[Kind, ...]:
    """Return the kinds of sensors that tell something new about a point."""
    has_position, has_rotation = name in sensors.position, name in sensors.rotation or name not in BODY
    if has_position or has_rotation:
        return () if has_position and has_rotation else ("rotation",) if has_position else ("position",)
    return KINDS


def _headset(rng: np.random.Generator) -> SensorSet:
    """Draw a headset, mostly with both wrists, and any other parts with any kind of sensor."""
    sensors = SENSOR_SETS["head"]
    if rng.uniform() < _WRISTS_SHARE:
        sensors = SENSOR_SETS["three_point"]
    share = rng.uniform(0, _MOST)
    for part in LATTICE_PARTS:
        if rng.uniform() < share:
            kind = KINDS[int(rng.choice(len(KINDS), p=_KIND_SHARES))]
            names = (part,) if part in ("pelvis", "spine3") else (f"left_{part}", f"right_{part}")
            if rng.uniform() >= _BOTH_SIDES_SHARE:
                names = (names[int(rng.integers(len(names)))],)
            for name in names:
                sensors = with_sensor(sensors, name, kind)
    return sensors
