"""Random kinds of signals: each of the 27 input points has a position, a rotation, both, or no sensor.

Training, evaluation and tests draw from this module, with different seeds and ranges. Named sets, such as those of
inertial suits, and a single position are members of the space.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Literal, get_args

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import INERTIAL_SETS, SENSOR_SETS, SensorSet
from bodysense_lab.completion.data.points import INPUT_POINTS, KNUCKLES, SIDES, WRISTS

Family = Literal["named", "suit", "any", "positions", "rotations", "alone"]
FAMILIES: tuple[Family, ...] = get_args(Family)
Quantity = Literal["both", "position", "rotation"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

_UPPER = ("head", "spine3", "collar", "shoulder", "elbow", "wrist")
_LOWER = ("pelvis", "hip", "knee", "ankle")
_KNUCKLE_JOINTS = ("index1", "middle1", "ring1", "pinky1")


@dataclass(frozen=True)
class SignalRanges:
    """Distribution of kinds of signals."""

    shares: Mapping[Family, float]  # of the families
    density: tuple[float, float]  # share of the points that have a sensor, from and to
    head: float  # share of sets of the family `any` whose head has a sensor
    acceleration: float  # share of sets whose sensors with rotation only have accelerations


# Training and tests differ in their ranges, so that a test is not a draw from training.
TRAINING_SIGNALS = SignalRanges(
    {"named": 0.24, "suit": 0.24, "any": 0.34, "positions": 0.07, "rotations": 0.05, "alone": 0.06},
    density=(0.05, 0.8),
    head=0.6,
    acceleration=0.8,
)
TEST_SIGNALS = SignalRanges(
    {"named": 0.2, "suit": 0.15, "any": 0.35, "positions": 0.1, "rotations": 0.1, "alone": 0.1},
    density=(0.1, 0.65),
    head=0.5,
    acceleration=0.6,
)


def draw_signal(rng: np.random.Generator, ranges: SignalRanges) -> SensorSet:
    """Draw a set of sensors, with at least one, on `INPUT_POINTS`.

    `left_knuckles` and `right_knuckles` stand for the first joints of four fingers; `observed_set` names these.
    """
    family = FAMILIES[int(rng.choice(len(FAMILIES), p=[ranges.shares.get(name, 0.0) for name in FAMILIES]))]
    carried: dict[str, Quantity] = {}
    while not carried:
        carried = _draw_carried(family, rng, ranges)
    if family == "named":
        return SensorSet(*_split(carried), acceleration=True)
    return SensorSet(*_split(carried), acceleration=bool(rng.uniform() < ranges.acceleration))


def observed_set(sensors: SensorSet) -> SensorSet:
    """Return the set with the joints of the skeleton instead of the knuckles."""
    position: list[str] = []
    for name in sensors.position:
        side = name.partition("_")[0]
        position += [f"{side}_{joint}" for joint in _KNUCKLE_JOINTS] if name in KNUCKLES else [name]
    return SensorSet(tuple(position), sensors.rotation, sensors.camera, sensors.acceleration)


def signal_masks(sensors: SensorSet) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of positions (27,) and rotations (22,), bool. Wrist and knuckles together imply a rotation."""
    position, rotation = np.isin(INPUT_POINTS, sensors.position), np.isin(BODY, sensors.rotation)
    for wrist, knuckles in zip(WRISTS, KNUCKLES, strict=True):
        rotation[wrist] |= position[wrist] & position[INPUT_POINTS.index(knuckles)]
    return position, rotation


def _draw_carried(family: Family, rng: np.random.Generator, ranges: SignalRanges) -> dict[str, Quantity]:
    """Draw the quantity of each point that has a sensor."""
    share = rng.uniform(*ranges.density)
    if family == "named":
        names = list(INERTIAL_SETS)
        sensors = SENSOR_SETS[names[int(rng.integers(len(names)))]]
        carried: dict[str, Quantity] = dict.fromkeys(sensors.rotation, "rotation")
        for name in sensors.position:
            carried[name] = "both" if name in carried else "position"
        return carried
    if family == "suit":
        drawn, share = rng.uniform(), rng.uniform(0.4, 1.0)
        parts = _UPPER if drawn < 0.2 else _LOWER if drawn < 0.45 else (*_UPPER, *_LOWER)
        chosen = [part for part in parts if rng.uniform() < share]
        joints = ((part,) if part in BODY else (f"{side}_{part}" for side in SIDES) for part in chosen)
        return dict.fromkeys(chain.from_iterable(joints), "rotation")
    if family == "positions":
        return dict.fromkeys((name for name in INPUT_POINTS if rng.uniform() < share), "position")
    if family == "rotations":
        return dict.fromkeys((name for name in BODY if rng.uniform() < share), "rotation")
    if family == "alone":
        name = INPUT_POINTS[int(rng.integers(len(INPUT_POINTS)))] if rng.uniform() < 0.5 else "head"
        return {name: "position" if rng.uniform() < 0.7 else _draw_quantity(name, rng)}
    carried: dict[str, Quantity] = {}
    for name in INPUT_POINTS:
        if rng.uniform() < share:
            carried[name] = _draw_quantity(name, rng)
    carried.pop("head", None)
    if rng.uniform() < ranges.head:
        carried["head"] = _draw_quantity("head", rng)
    return carried


def _draw_quantity(name: str, rng: np.random.Generator) -> Quantity:
    return QUANTITIES[int(rng.integers(len(QUANTITIES)))] if name in BODY else "position"


def _split(carried: Mapping[str, Quantity]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the points with a position and those with a rotation."""
    position = tuple(name for name, quantity in carried.items() if quantity != "rotation")
    return position, tuple(name for name, quantity in carried.items() if quantity != "position")
