"""Marker sets of gloves: the segment and approximate position of each marker.

`glove_sets/` has the packaged sets. Other sets are .toml or .json files of the same form (docs/gloves.md).
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from math import cos, pi, sin
from pathlib import Path
from reprlib import repr as brief
from typing import Any

from bodysense.body.hands.hand import FINGERS, HAND_JOINTS, Side, point_beyond
from bodysense.errors import BodysenseError
from bodysense.files import read_text

STANDARD = "bodysense"  # name of the set that the networks are trained on
FEWEST = 4  # least number of markers in a set, one of them on the back of the hand
HAND = "hand"  # name of the segment that the wrist carries
_SIDES: tuple[Side, Side] = ("left", "right")
_SIDE_LETTERS = {"left": "L", "right": "R"}  # default
_ACCURACY, _PLATE_ACCURACY = 0.006, 0.03  # m: defaults for a marker, and for a marker of a plate
_PLATE_AT, _RING = (0.06, 0.03, 0.0), 0.02  # m: middle of a plate from the wrist, and its markers' distance from there
_ROW = {"label", "name", "is", "segment", "near", "along", "offset", "accuracy"}
_PLATE_ROW = {"labels", "offset", "accuracy"}
_SEGMENTS, _KNUCKLES = (HAND, *HAND_JOINTS[1:]), tuple(f"{finger}1" for finger in FINGERS)


@dataclass(frozen=True)
class GloveMarker:
    """A marker of a set and its position on a hand of 19.5 cm."""

    name: str  # last part of the point's name, '<hand>_glove_<name>'
    labels: Mapping[Side, str]  # labels in files
    segment: str  # the joint that carries it
    near: str  # point of the hand from which the offset is measured
    along: float  # distance from that point, as a share of the segment
    offset: tuple[float, float, float]  # m, in addition: along the segment, out of its back, toward the thumb
    accuracy: tuple[float, float, float]  # m, standard deviations along the same axes


@dataclass(frozen=True, eq=False)
class GloveSet:
    """The markers of a glove."""

    name: str
    markers: tuple[GloveMarker, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the markers."""
        return tuple(marker.name for marker in self.markers)

    @property
    def on_hand(self) -> tuple[int, ...]:
        """Indices of the markers on the back of the hand."""
        return tuple(place for place, marker in enumerate(self.markers) if marker.segment == "wrist")

    def points(self, labels: Iterable[str]) -> dict[str, str]:
        """Return points '<hand>_glove_<name>' by a file's labels in the set; a prefix such as 'Anna:' is ignored."""
        ours = {
            plain(label): f"{side}_glove_{marker.name}"
            for marker in self.markers
            for side, label in marker.labels.items()
        }
        return {label: ours[plain(label)] for label in labels if plain(label) in ours}


@lru_cache(maxsize=1)
def packaged_sets() -> dict[str, GloveSet]:
    """Return the packaged sets by name, the standard one first."""
    folder = files("bodysense.body.hands.glove_sets")
    names = [entry.name for entry in folder.iterdir() if entry.name.endswith(".toml")]
    found: dict[str, GloveSet] = {}
    for name in sorted(names, key=lambda name: (name != f"{STANDARD}.toml", name)):
        one = parse_set(tomllib.loads(folder.joinpath(name).read_text(encoding="utf-8")), name, found.get(STANDARD))
        found[one.name] = one
    return found


def standard_set() -> GloveSet:
    """Return the set that the networks are trained on."""
    return packaged_sets()[STANDARD]


def read_set(place: str | Path) -> GloveSet:
    """Return a set by its packaged name, or from a file, .toml or .json. Raises BodysenseError for anything else."""
    if str(place) in packaged_sets():
        return packaged_sets()[str(place)]
    path = Path(place)
    if path.suffix.lower() not in (".toml", ".json") or not path.is_file():
        known = ", ".join(packaged_sets())
        raise BodysenseError(f"{place}: no marker set; give a .toml or .json file (docs/gloves.md), or one of {known}")
    text = read_text(path)
    try:
        stored = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise BodysenseError(f"{path}: not {path.suffix[1:].upper()} ({error}); see docs/gloves.md") from None
    return parse_set(stored, str(path), standard_set())


def parse_set(stored: Any, place: str, standard: GloveSet | None) -> GloveSet:
    """Parse a stored set; markers with `is` have positions of the `standard` set.

    `place` names the file in messages. Raises BodysenseError that names the row and the fix.
    """
    if not isinstance(stored, dict) or not isinstance(stored.get("name"), str):
        raise BodysenseError(f'{place}: a marker set has a name and markers: name = "mine" (docs/gloves.md)')
    _check_keys(stored, {"name", "sides", "markers", "plates"}, place)
    sides = stored.get("sides", _SIDE_LETTERS)
    if not (isinstance(sides, dict) and sides and set(sides) <= set(_SIDES) and _texts(sides.values())):
        raise BodysenseError(
            f'{place}: sides are {brief(sides)}; give the letter of each side in labels: {{left = "L", right = "R"}}'
        )
    rows = []
    for number, row in enumerate(_rows(stored, "plates", place), start=1):
        rows += _plate(row, number, sides, f"{place}: plate {number}")
    for number, row in enumerate(_rows(stored, "markers", place), start=1):
        rows.append(_marker(row, sides, standard, f"{place}: marker {number}"))
    if len(rows) < FEWEST or not any(row.segment == "wrist" for row in rows):
        raise BodysenseError(
            f"{place}: {len(rows)} markers; a hand needs {FEWEST} at least, one of them on the segment {HAND!r}"
        )
    for names in (
        [row.name for row in rows],
        *([plain(row.labels[side]) for row in rows if side in row.labels] for side in _SIDES),
    ):
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise BodysenseError(f"{place}: {twice[0]!r} is used twice; give every marker its own name and label")
    return GloveSet(stored["name"], tuple(rows))


def _marker(row: dict, sides: Mapping[str, str], standard: GloveSet | None, place: str) -> GloveMarker:
    _check_keys(row, _ROW, place)
    labels = _labels(row.get("label"), sides, place)
    if "is" in row:
        known = {} if standard is None else {marker.name: marker for marker in standard.markers}
        if row["is"] not in list(known):
            raise BodysenseError(f"{place}: is {brief(row['is'])}; valid are {', '.join(known)}")
        same = known[row["is"]]
        return GloveMarker(same.name, labels, same.segment, same.near, same.along, same.offset, same.accuracy)
    segment = row.get("segment")
    if segment not in _SEGMENTS:
        raise BodysenseError(f"{place}: segment {brief(segment)}; valid are {', '.join(_SEGMENTS)}")
    near, along = row.get("near", "wrist" if segment == HAND else segment), row.get("along", 0.0)
    points = ("wrist", *_KNUCKLES) if segment == HAND else (segment, point_beyond(segment))
    if near not in points:
        raise BodysenseError(f"{place}: near {brief(near)}; of the segment {segment!r} valid are {', '.join(points)}")
    if not (_is_number(along) and 0 <= along <= 1) or (along and (segment == HAND or near != segment)):
        raise BodysenseError(
            f"{place}: along {brief(along)}; give 0 to 1, from a finger's joint to the next, or use offset"
        )
    if along == 1:
        near, along = point_beyond(segment), 0.0
    name = row.get("name", _name(row["label"]))
    if not isinstance(name, str) or not re.fullmatch(r"[a-z0-9_]+", name) or "_glove_" in name:
        raise BodysenseError(f'{place}: name {brief(name)}; give small letters and digits: name = "index_nail"')
    return GloveMarker(
        name=name,
        labels=labels,
        segment="wrist" if segment == HAND else segment,
        near=near,
        along=float(along),
        offset=_three(row.get("offset", (0.0, 0.0, 0.0)), "offset", place),
        accuracy=_accuracy(row.get("accuracy", _ACCURACY), place),
    )


def _plate(row: dict, number: int, sides: Mapping[str, str], place: str) -> list[GloveMarker]:
    """Return the markers of a rigid plate. Calibration measures its shape; its position is approximate."""
    _check_keys(row, _PLATE_ROW, place)
    labels = row.get("labels")
    if not isinstance(labels, list) or len(labels) < 3:
        raise BodysenseError(f'{place}: labels {brief(labels)}; a plate has three markers or more: ["*_P1", "*_P2", …]')
    offset = _three(row.get("offset", _PLATE_AT), "offset", place)
    accuracy = _accuracy(row.get("accuracy", _PLATE_ACCURACY), place)
    rows = []
    for k, label in enumerate(labels, start=1):
        turn = 2 * pi * k / len(labels)  # in a ring, for simulation
        at = offset[0] + _RING * cos(turn), offset[1], offset[2] + (1 + k / 10) * _RING * sin(turn)
        rows.append(
            GloveMarker(f"plate{number}_{k}", _labels(label, sides, place), "wrist", "wrist", 0.0, at, accuracy)
        )
    return rows


def _labels(label: Any, sides: Mapping[str, str], place: str) -> dict[Side, str]:
    """Return a marker's labels by side, from a text with '*' for the side's letter or from a table of both sides."""
    if isinstance(label, dict) and label and set(label) <= set(_SIDES) and _texts(label.values()):
        return {side: label[side] for side in _SIDES if side in label}
    if isinstance(label, str) and plain(label) and ("*" in label or len(sides) == 1):
        return {side: label.replace("*", sides[side]) for side in _SIDES if side in sides}
    raise BodysenseError(
        f'{place}: label {brief(label)}; put * in place of the side, "*_IDX", or give both: '
        '{left = "M1", right = "M7"}'
    )


def _rows(stored: dict, key: str, place: str) -> list[dict]:
    rows = stored.get(key, [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise BodysenseError(f"{place}: {key} must be a list of tables, [[{key}]] (docs/gloves.md)")
    return rows


def _check_keys(row: dict, valid: set[str], place: str) -> None:
    unknown = [key for key in row if key not in valid]
    if unknown:
        raise BodysenseError(f"{place}: {unknown[0]!r} is unknown; valid are {', '.join(sorted(valid))}")


def _three(value: Any, what: str, place: str) -> tuple[float, float, float]:
    if isinstance(value, list | tuple) and len(value) == 3 and all(_is_number(one) and abs(one) < 0.3 for one in value):
        return float(value[0]), float(value[1]), float(value[2])
    raise BodysenseError(f"{place}: {what} {brief(value)}; give three numbers in metres, each less than 0.3")


def _accuracy(value: Any, place: str) -> tuple[float, float, float]:
    three = _three([value] * 3 if _is_number(value) else value, "accuracy", place)
    if min(three) <= 0:
        raise BodysenseError(f"{place}: accuracy {brief(value)}; it must be positive, in metres: 0.005")
    return three


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e6 < value < 1e6


def _texts(values: Iterable[Any]) -> bool:
    return all(isinstance(value, str) and value for value in values)


def _name(label: Any) -> str:
    """Return a marker's name made from its label without the side."""
    text = label.replace("*", " ") if isinstance(label, str) else next(iter(label.values()))
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_") or "marker"


def plain(label: str) -> str:
    """Normalise a label: 'Anna:L_IAS' → 'lias'."""
    return re.sub(r"[^a-z0-9]", "", label.rpartition(":")[2].lower())
