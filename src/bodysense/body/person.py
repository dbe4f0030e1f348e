"""Persons: proportions of a wearer, their uncertainty, and mounts of trackers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from reprlib import repr as brief
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.shape import SHORTEST as SHORTEST_ADULT
from bodysense.body.shape import TALLEST as TALLEST_ADULT
from bodysense.body.shape import Measured, ShapeEstimate, shape_space
from bodysense.body.shape import stature as stature_of
from bodysense.body.skeleton import Skeleton, skeleton_from_table
from bodysense.errors import BodysenseError, expect
from bodysense.files import read_json, written_beside
from bodysense.geometry.rigid import RigidTransform

if TYPE_CHECKING:
    from bodysense.body.hands.hand_family import GlovedHand

FORMAT = "bodysense-person-1"
_FIX = "give a person's file, as Person.save writes it"
SHORTEST, TALLEST = 1.0, 2.3  # m; heights of a person
SOLE = 0.05  # m; largest height of a skeleton's lowest point above the sole
SENSOR = "_imu"  # suffix of a joint that carries an inertial sensor
CROWN, FLOOR = "crown", "floor"  # ends of a height, in a file
EXACT_DEVIATION = 0.001  # m; standard deviation of a length that is given without one
HEIGHT_DEVIATION = 0.025  # m; of a height that is given without one: hair, shoes, the time of day, a rounded memory


@dataclass(frozen=True, eq=False, init=False)
class Person:
    """Known properties of the wearer.

    `Person()` is the likeliest adult, `Person(height=1.8)` the likeliest of that height, `Person(skeleton)` a person of
    known proportions, `Person(lengths={…})` the likeliest with those lengths.
    """

    skeleton: Skeleton  # likeliest proportions of the wearer
    bone_deviation: np.ndarray = field(repr=False)  # (P,) m, standard deviation of each bone's length; 0: exact
    # T_joint_tracker by the joint that carries the tracker. Inertial sensors, of which only the rotation is known, have
    # the name of the joint and the suffix `SENSOR`.
    mounts: Mapping[str, RigidTransform]
    # Evidence for the proportions; a running tracker adds its own measurements.
    height: Measured | None
    lengths: Mapping[tuple[str, str], Measured]
    hands: Mapping[str, GlovedHand]  # 'left' and 'right', if their gloves were calibrated

    def __init__(
        self,
        skeleton: Skeleton | None = None,
        *,
        height: Measured | float | None = None,
        bone_deviation: np.ndarray | None = None,
        mounts: Mapping[str, RigidTransform] | None = None,
        lengths: Mapping[tuple[str, str], Measured | float] | None = None,
        hands: Mapping[str, GlovedHand] | None = None,
    ) -> None:
        """Make a person from a known skeleton, from a height or lengths, or without any of them.

        Args:
            skeleton: the wearer's proportions, if they are known.
            height: stature in metres, from the floor to the crown, without shoes. A plain number is known to 2.5 cm, so
                that measured points count more; `Measured(1.75, 0.001)` is known to 1 mm.
            lengths: distances between two points of the T-pose, by the points' names: `{("left_hip", "left_knee"):
                0.43}`, metres. A plain number is known to 1 mm.
            bone_deviation: standard deviation (P,), metres, of the length of every point's bone; 0 for all points
                of a known skeleton.
            hands: hands by side, 'left' and 'right', from a calibration of their gloves; they replace the skeleton's.
            mounts: T_joint_tracker of trackers, by the joint that carries each.
        """
        if skeleton is not None:
            expect(skeleton, Skeleton, "Person", "a Skeleton, or a height in metres as Person(height=1.75)")
        stature = None if height is None else _measured(height, "height")
        known = {pair: _measured(value, f"distance {'–'.join(pair)}") for pair, value in (lengths or {}).items()}
        if skeleton is None:
            estimate, scale = _estimate(known, stature)
            skeleton = estimate.skeleton
            if scale != 1.0:
                skeleton = skeleton.with_offsets(scale * skeleton.rest_offset)
            if bone_deviation is None:
                bone_deviation = scale * estimate.bone_deviation
        elif bone_deviation is None and (stature is not None or known):
            raise BodysenseError(
                "person: both a skeleton and a height or lengths were given; give one of them, "
                "or skeleton.scaled(height)"
            )
        for side, hand in (hands or {}).items():
            if side not in ("left", "right"):
                raise BodysenseError(f"person: the hand {side!r}; it is 'left' or 'right'")
            from bodysense.body.hands.hand_family import body_with_hand

            skeleton = body_with_hand(skeleton, side, hand)
        if not SHORTEST - SOLE <= skeleton.height <= TALLEST:
            raise BodysenseError(
                f"person: a skeleton {skeleton.height:g} m high; people are {SHORTEST} to {TALLEST} m, "
                "give offsets in metres"
            )
        count = len(skeleton.points)
        deviation = np.zeros(count) if bone_deviation is None else np.array(bone_deviation, dtype=np.float64)
        if deviation.shape != (count,):
            raise BodysenseError(f"person: deviations {deviation.shape}; give one for each of the {count} points")
        if not (np.isfinite(deviation) & (deviation >= 0)).all():
            bad = int(np.argmin(np.isfinite(deviation) & (deviation >= 0)))
            raise BodysenseError(
                f"person: the deviation of {skeleton.points[bad]!r} is {deviation[bad]:g} m; give 0 or more metres"
            )
        deviation.setflags(write=False)
        for joint in mounts or {}:
            if joint.removesuffix(SENSOR) not in skeleton.joints:
                skeleton.index(joint)  # names the nearest
                raise BodysenseError(f"person: a tracker worn on {joint!r}, which is no joint; name its parent")
        object.__setattr__(self, "skeleton", skeleton)
        object.__setattr__(self, "bone_deviation", deviation)
        object.__setattr__(self, "mounts", dict(mounts or {}))
        object.__setattr__(self, "height", stature)
        object.__setattr__(self, "lengths", known)
        object.__setattr__(self, "hands", dict(hands or {}))

    def __repr__(self) -> str:
        known = "known proportions" if self.is_known else "inferred" if self.height is None else "known height"
        trackers = f", trackers on {', '.join(self.mounts)}" if self.mounts else ""
        hands = f", hands calibrated: {', '.join(self.hands)}" if self.hands else ""
        return f"Person({self.stature:.2f} m, {known}{trackers}{hands})"

    @cached_property
    def stature(self) -> float:
        """Likeliest height in metres of the crown above the soles."""
        return float(stature_of(self.skeleton.rest_offset))

    @cached_property
    def is_known(self) -> bool:
        """Whether all proportions are known exactly."""
        return not self.bone_deviation.any()

    @classmethod
    def known(cls, skeleton: Skeleton) -> Person:
        """Return a person whose proportions are known exactly."""
        return cls(skeleton)

    @classmethod
    def likeliest(
        cls,
        lengths: Mapping[tuple[str, str], Measured | float] | None = None,
        height: Measured | float | None = None,
    ) -> Person:
        """Return the likeliest person given a few lengths and a stature (as for the constructor)."""
        return cls(height=height, lengths=lengths)

    def with_mounts(self, mounts: Mapping[str, RigidTransform]) -> Person:
        """Add mounts of trackers; mounts of other joints are unchanged."""
        return Person(
            self.skeleton,
            height=self.height,
            bone_deviation=self.bone_deviation,
            mounts={**self.mounts, **mounts},
            lengths=self.lengths,
            hands=self.hands,
        )

    def with_skeleton(self, skeleton: Skeleton) -> Person:
        """Replace the skeleton by one that was fitted to measurements; all else is unchanged."""
        return Person(
            skeleton,
            height=self.height,
            bone_deviation=self.bone_deviation,
            mounts=self.mounts,
            lengths=self.lengths,
            hands=self.hands,
        )

    def save(self, path: str | Path) -> None:
        """Write a JSON file that `load` reads."""
        with written_beside(path) as beside:
            beside.write_text(self.to_json(), encoding="utf-8")

    def to_json(self) -> str:
        """Return the text of the file that `save` writes."""
        skeleton, joints = self.skeleton, len(self.skeleton.joints)
        rows = [
            {
                "name": name,
                "parent": None if parent < 0 else skeleton.points[parent],
                "offset": offset.tolist(),
                "deviation": float(deviation),
            }
            for name, parent, offset, deviation in zip(
                skeleton.points, skeleton.parents, skeleton.rest_offset, self.bone_deviation, strict=True
            )
        ]
        mounts = [
            {"joint": joint, "translation": mount.translation.tolist(), "rotation": mount.rotation.tolist()}
            for joint, mount in self.mounts.items()
        ]
        known = [
            {"start": start, "end": end, "length": value.value, "deviation": value.deviation}
            for (start, end), value in self.lengths.items()
        ]
        if self.height is not None:
            known.append(
                {"start": CROWN, "end": FLOOR, "length": self.height.value, "deviation": self.height.deviation}
            )
        hands = [_hand_row(side, hand) for side, hand in self.hands.items()]
        tables = {"joints": rows[:joints], "end_sites": rows[joints:], "known": known, "mounts": mounts}
        tables |= {"hands": hands} if hands else {}
        parts = [f'"format": "{FORMAT}"', '"units": "metres; quaternions w, x, y, z"']
        for name, table in tables.items():
            text = ",\n  ".join(map(json.dumps, table))  # a row a line
            parts.append(f'"{name}": [\n  {text}\n]' if text else f'"{name}": []')
        return "{\n" + ",\n".join(parts) + "\n}\n"

    @classmethod
    def load(cls, path: str | Path) -> Person:
        """Read a file that `save` wrote. Raises BodysenseError for any other file."""
        return cls._from_stored(read_json(path, _FIX), str(path))

    @classmethod
    def from_json(cls, text: str, name: str = "the text") -> Person:
        """Read a text of `to_json`. Raises BodysenseError, beginning with `name`, for any other text."""
        try:
            stored = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise BodysenseError(f"{name} is not JSON ({error}); {_FIX}") from None
        return cls._from_stored(stored, name)

    @classmethod
    def _from_stored(cls, stored: Any, name: str) -> Person:
        version = stored.get("format") if isinstance(stored, dict) else None
        if version != FORMAT:
            raise BodysenseError(f"{name}: format {brief(version)}; it must be {FORMAT!r}, as Person.save writes it")
        try:
            return cls._from_tables(stored)
        except BodysenseError as error:
            raise BodysenseError(f"{name}: {error}") from None

    @classmethod
    def _from_tables(cls, stored: dict) -> Person:
        joints = _rows(stored, "joints", {"name": 0, "parent": 0, "offset": 3, "deviation": 1})
        end_sites = _rows(stored, "end_sites", {"name": 0, "parent": 0, "offset": 3, "deviation": 1})
        known = _rows(stored, "known", {"start": 0, "end": 0, "length": 1, "deviation": 1})
        lengths = {(row["start"], row["end"]): Measured(row["length"], row["deviation"]) for row in known}
        height = lengths.pop((CROWN, FLOOR), None)
        mounts = _rows(stored, "mounts", {"joint": 0, "translation": 3, "rotation": 4})
        mounts_by_joint: dict[str, RigidTransform] = {}
        for row in mounts:
            if row["joint"] in mounts_by_joint:
                raise BodysenseError(f"two rows of 'mounts' are of {row['joint']!r}; remove one")
            mounts_by_joint[row["joint"]] = RigidTransform(np.array(row["translation"]), np.array(row["rotation"]))
        deviation = np.array([row["deviation"] for row in joints + end_sites], dtype=np.float64)
        skeleton = skeleton_from_table(joints, end_sites)
        hands: dict[str, GlovedHand] = {}
        for row in _hand_rows(stored) if "hands" in stored else []:
            from bodysense.body.hands.hand_family import hand_from_arrays

            points, axes, markers = (
                np.array(row[name]).reshape(-1, size) for name, size in (("points", 3), ("axes", 4), ("markers", 3))
            )
            hands[row["side"]] = hand_from_arrays(points, axes, markers, row.get("sitting", ()))
        return cls(
            skeleton, height=height, bone_deviation=deviation, mounts=mounts_by_joint, lengths=lengths, hands=hands
        )


def _measured(value: Measured | float, what: str) -> Measured:
    """Return a length with its deviation. Raises BodysenseError for an impossible height."""
    expect(value, (Measured, float, int, np.number), f"person: {what}", "a number of metres, such as 1.75")
    usual = HEIGHT_DEVIATION if what == "height" else EXACT_DEVIATION
    length = value if isinstance(value, Measured) else Measured(float(value), usual)
    if what == "height" and not SHORTEST <= length.value <= TALLEST:
        raise BodysenseError(
            f"person: height {length.value:g} m; people are {SHORTEST} to {TALLEST} m high, give metres"
        )
    return length


def _estimate(lengths: Mapping[tuple[str, str], Measured], height: Measured | None) -> tuple[ShapeEstimate, float]:
    """Return the likeliest shape, and the scale for its skeleton.

    People outside the statures of the shape space get the proportions of its tallest or shortest adults, scaled.
    """
    space = shape_space()
    if height is None:
        return space.likeliest(lengths), 1.0
    scale = height.value / float(np.clip(height.value, SHORTEST_ADULT, TALLEST_ADULT))

    def smaller(length: Measured) -> Measured:
        return Measured(length.value / scale, length.deviation / scale)

    smaller_lengths = {pair: smaller(length) for pair, length in lengths.items()}
    return space.likeliest(smaller_lengths, smaller(height), is_stated=True), scale


def _hand_row(side: str, hand: GlovedHand) -> dict[str, Any]:
    """Return a row of 'hands' of a person's file."""
    from bodysense.body.hands.hand_family import hand_arrays, marker_attachments

    row: dict[str, Any] = {name: values.ravel().tolist() for name, values in hand_arrays(hand).items()}
    sitting = marker_attachments(hand)
    return {"side": side, **row} | ({"sitting": sitting} if sitting else {})


def _rows(stored: dict, table: str, columns: Mapping[str, int]) -> list[dict]:
    """Return the checked rows of a table of a person's file. `columns`: 0 for a text, else the count of numbers."""
    rows = stored.get(table)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise BodysenseError(f"{table!r} must be a list of rows with {', '.join(columns)}")
    for number, row in enumerate(rows, start=1):
        for column, size in columns.items():
            if column not in row:
                raise BodysenseError(
                    f"row {number} of {table!r}: {column!r} is missing; rows have {', '.join(columns)}"
                )
            value = row[column]
            if size:
                valid = _are_numbers(value, size)
            else:
                valid = isinstance(value, str) or (value is None and (table, column) == ("joints", "parent"))
            if not valid:
                wanted = "a text" if size == 0 else f"{size} finite numbers" if size > 1 else "a finite number"
                raise BodysenseError(f"row {number} of {table!r}: {column!r} is {brief(value)}; it must be {wanted}")
    return rows


def _hand_rows(stored: dict) -> list[dict]:
    """Return the rows of 'hands'. The number of markers is that of `sitting`, nine if it is omitted."""
    found = []
    for row in _rows(stored, "hands", {"side": 0}):
        sitting = row.get("sitting", [])
        well_formed = isinstance(sitting, list) and all(
            isinstance(one, list) and all(isinstance(name, str) for name in one) for one in sitting
        )
        if not well_formed:
            raise BodysenseError(
                f"'sitting' of a hand is {brief(sitting)}; it has a name, a point and a joint a marker"
            )
        columns = {"side": 0, "points": 63, "axes": 60, "markers": 3 * (len(sitting) or 9)}
        found += _rows({"hands": [row]}, "hands", columns)
    return found


def _are_numbers(value: Any, size: int) -> bool:
    """Whether a value of JSON is a finite number (size 1) or a list of `size` such numbers, all plausible."""
    values = [value] if size == 1 else value
    return (
        isinstance(values, list)
        and len(values) == size
        and all(isinstance(v, (int, float)) and not isinstance(v, bool) and abs(v) < 1e6 for v in values)
    )
