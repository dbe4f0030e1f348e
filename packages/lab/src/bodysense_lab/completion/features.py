"""The features of the completion network, of training sequences. The core computes them for a single frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.points import (
    ACCELERATED,
    BODY_POINTS,
    INPUT_POINTS,
    JOINTS,
    PLACED,
    READ,
    SPINNING,
    partners,
    reference_offsets,
)

# Per frame: what is read, and how many numbers it has.
WIDTHS = {
    "position": 3 * READ,
    "has_position": READ,
    "velocity": 3 * READ,
    "accuracy": READ,
    "axes": 6 * JOINTS,
    "has_rotation": JOINTS,
    "spin": 6 * len(SPINNING),
    "bones": 3 * PLACED,
    "certainty": PLACED,
    "interval": 1,
    # Features that networks of earlier releases do not read come last, so that their tables only lack columns.
    "acceleration": 3 * len(ACCELERATED),
    "has_acceleration": len(ACCELERATED),
}
SPIN_ROWS, AXIS_ROWS = 2 * len(SPINNING), 2 * JOINTS
MOVING = READ + SPIN_ROWS  # rows whose change since the frame before is read
ROWS = READ + MOVING + AXIS_ROWS
_FASTEST, _SWIFTEST = 5.0, 15.0  # m/s, and change of axes per second: larger values are clipped
_STRONGEST, _ACCELERATION_SCALE = 50.0, 0.1  # m/s², likewise; 10 m/s² is 1
_UNLIMITED = 1e9
_USUAL_INTERVAL = 1 / 30  # s
_BONE_SCALE, _CERTAINTY_SCALE = 20.0, 20.0  # 1/m: a deviation of 5 cm is 1


class Reading(NamedTuple):
    """Inputs of the features, in N frames.

    Rows are vectors in the world: places of the 27 points from the origin; the change since the frame before of these,
    and of the x axes, then the y axes, of `SPINNING`; the x axes, then the y axes, of the 22 joints.
    """

    rows: Tensor  # (N, 1, 104, 3)
    seen: Tensor  # (N, 104) whether each row is tracked: 1 or 0
    into: Tensor  # (N, 1, 3, 3) row vectors of the world @ this are those of the frame under the head
    size: Tensor  # (N, 1) the wearer's stature divided by the reference stature
    interval: Tensor  # (N, 1) s
    accuracy: Tensor  # (N, 27) m
    rest_offset: Tensor  # (N, 75) m
    certainty: Tensor  # (N, 25) m
    acceleration: Tensor  # (N, 1, 12, 3) m/s², world, of `ACCELERATED`, without gravity
    accelerated: Tensor  # (N, 12) whether each is measured: 1 or 0


class Features(nn.Module):
    """A reading as features: itself, and mirrored at the plane x = 0 of the frame under the head."""

    row_scale: Tensor
    row_constant: Tensor
    limit: Tensor
    usual_bones: Tensor
    place: Tensor
    scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        # Which factor each row is multiplied by: inverse size, inverse size times rate, rate, or 1.
        kinds = [0] * READ + [1] * READ + [2] * SPIN_ROWS + [3] * AXIS_ROWS
        scales = torch.eye(4)[kinds]
        limit = torch.tensor([_UNLIMITED, _FASTEST, _SWIFTEST, _UNLIMITED])[kinds]
        place = torch.tensor([column for name in WIDTHS for column in _columns(name)])
        factor = torch.tensor([scale for name in WIDTHS for scale in _scales(name)])
        image, sign = torch.tensor(mirror_places()), torch.tensor(mirror_signs())
        for name, values in (
            ("row_scale", scales[:, :3]),
            ("row_constant", scales[:, 3]),
            ("limit", limit[:, None].expand(-1, 3)),
            ("usual_bones", torch.tensor(reference_offsets(), dtype=torch.float32).flatten()),
            ("place", torch.cat([place, place[image]])),
            ("scale", torch.cat([factor, factor[image] * sign])),
        ):
            self.register_buffer(name, values.contiguous(), persistent=False)

    def forward(self, reading: Reading) -> Tensor:
        """Features (N, 2 F) of a body and of its mirror image."""
        smaller, rate = 1 / reading.size, 1 / reading.interval
        sizes = torch.cat([smaller, smaller * rate, rate], dim=-1)
        scale = reading.seen * nn.functional.linear(sizes, self.row_scale, self.row_constant)
        rows = (reading.rows @ reading.into) * scale.reshape(-1, 1, ROWS, 1)
        rows = torch.maximum(torch.minimum(rows, self.limit), -self.limit)
        accuracy = (torch.log(reading.accuracy) + 3 * math.log(10)) * reading.seen[:, :READ]
        bones = reading.rest_offset * smaller - self.usual_bones
        felt = (reading.acceleration @ reading.into) * (smaller * reading.accelerated).reshape(-1, 1, _FELT, 1)
        parts = [
            rows.reshape(-1, 3 * ROWS),
            reading.seen,
            accuracy,
            bones,
            reading.certainty,
            reading.interval,
            felt.clamp(-_STRONGEST, _STRONGEST).reshape(-1, 3 * _FELT),
            reading.accelerated,
        ]
        return torch.cat(parts, dim=-1).index_select(1, self.place) * self.scale


_FELT = len(ACCELERATED)
_STARTS = {"rows": 0, "seen": 3 * ROWS, "accuracy": 4 * ROWS}
_STARTS["bones"] = _STARTS["accuracy"] + READ
_STARTS["certainty"] = _STARTS["bones"] + 3 * PLACED
_STARTS["interval"] = _STARTS["certainty"] + PLACED
_STARTS["acceleration"] = _STARTS["interval"] + 1
_STARTS["has_acceleration"] = _STARTS["acceleration"] + 3 * _FELT


def _columns(name: str) -> list[int]:
    """Where the numbers of a kind of feature are in what `Features.forward` puts together."""

    def axes(first_row: int, count: int) -> list[int]:
        # Feature by feature: joint, component, axis.
        return [3 * (first_row + k * count + j) + c for j in range(count) for c in range(3) for k in range(2)]

    spins, joints = 2 * READ, READ + MOVING
    match name:
        case "position":
            return list(range(3 * READ))
        case "has_position":
            return list(range(_STARTS["seen"], _STARTS["seen"] + READ))
        case "velocity":
            return list(range(3 * READ, 6 * READ))
        case "spin":
            return axes(spins, len(SPINNING))
        case "axes":
            return axes(joints, JOINTS)
        case "has_rotation":
            return list(range(_STARTS["seen"] + joints, _STARTS["seen"] + joints + JOINTS))
        case _:
            return list(range(_STARTS[name], _STARTS[name] + WIDTHS[name]))


def _scales(name: str) -> list[float]:
    """Return the factors that scale the numbers of a kind of feature."""
    scale = {
        "accuracy": 1 / math.log(10),
        "bones": _BONE_SCALE,
        "certainty": _CERTAINTY_SCALE,
        "interval": 1 / _USUAL_INTERVAL,
        "acceleration": _ACCELERATION_SCALE,
    }.get(name, 1.0)
    if name == "bones":  # the pelvis has no parent
        return [0.0] * 3 + [scale] * (WIDTHS[name] - 3)
    return [scale] * WIDTHS[name]


def _mirror_parts() -> dict[str, tuple[list[int], list[float]]]:
    """For each kind of feature where its mirror image comes from, and with which sign."""

    def vectors(of: list[int]) -> tuple[list[int], list[float]]:
        return [3 * k + axis for k in of for axis in range(3)], [-1.0, 1.0, 1.0] * len(of)

    def axes(of: list[int]) -> tuple[list[int], list[float]]:
        # Rows x, y, z of two columns: a mirrored rotation changes the sign of its x row and of its x column.
        return [6 * k + part for k in of for part in range(6)], [1.0, -1.0, -1.0, 1.0, -1.0, 1.0] * len(of)

    def plain(of: list[int]) -> tuple[list[int], list[float]]:
        return of, [1.0] * len(of)

    points, joints, placed = partners(INPUT_POINTS), partners(BODY), partners(BODY_POINTS)
    accelerated = partners(ACCELERATED)
    return {
        "position": vectors(points),
        "has_position": plain(points),
        "velocity": vectors(points),
        "accuracy": plain(points),
        "axes": axes(joints),
        "has_rotation": plain(joints),
        "spin": axes(partners(SPINNING)),
        "bones": vectors(placed),
        "certainty": plain(placed),
        "interval": plain([0]),
        "acceleration": vectors(accelerated),
        "has_acceleration": plain(accelerated),
    }


def mirror_places() -> list[int]:
    """(F,) where each feature's mirror image is read."""
    places, first = [], 0
    for name, width in WIDTHS.items():
        places += [first + place for place in _mirror_parts()[name][0]]
        first += width
    return places


def mirror_signs() -> list[float]:
    """(F,) by what it is multiplied."""
    return [sign for name in WIDTHS for sign in _mirror_parts()[name][1]]
