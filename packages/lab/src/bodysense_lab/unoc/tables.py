"""UNOC's Tables 2 to 4: the paper's network, other networks and ablations, next to the published figures.

Scores of a method on a data set are kept in a file, so that no table counts them twice.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from bodysense.files import written_beside
from bodysense.intervals import Named
from bodysense.scoring import GROUPS, KNOWN, Measure, Tally
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.datasets import Census, DataSet, describe, missing
from bodysense_lab.table import Cell, Report, bounds, cell, finite, ordering, surely

FORMAT = 2  # of the files; another number makes them be counted again
Parts = dict[tuple[str, str, str], Tally]  # by category group, part of the body, share of joints


@dataclass(frozen=True)
class Scores:
    """Errors (cm) of one method by group of categories, part of the body, and share of the joints."""

    tallies: Parts = field(repr=False)
    census: Census

    def get(self, part: str, share: str, group: str = "main") -> Tally:
        """One cell; empty where nothing was counted."""
        return self.tallies.get((group, part, share), Tally())


def scores_path(folder: Path, method: str, data: DataSet) -> Path:
    """Return the file of a method's scores, next to the network."""
    return folder / f"{method}.{data.label}.scores.json"


def identity_of(data: DataSet, stride: int, file: Path | None, settings: str = "") -> dict[str, Any]:
    """Return the settings that scores depend on; `file` is the network's."""
    stat = file.stat() if file is not None else None
    return {
        "format": FORMAT,
        "data": str(data.path.resolve()),
        "split": data.split,
        "quick": data.quick,
        "stride": stride,
        "file": [stat.st_size, stat.st_mtime_ns] if stat is not None else None,
        "settings": settings,
    }


def write_scores(path: Path, scores: Scores, identity: Mapping[str, Any]) -> None:
    """Write scores with what they depend on."""
    tallies = {"/".join(key): _sums(tally) for key, tally in scores.tallies.items()}
    census = asdict(scores.census) | {"people": sorted(scores.census.people)}
    with written_beside(path) as beside:
        kept = {"identity": identity, "census": census, "tallies": tallies}
        beside.write_text(json.dumps(kept, indent=1), encoding="utf-8")


def read_scores(path: Path, identity: Mapping[str, Any]) -> Scores | None:
    """Return the scores of a file, or None without a file of this identity."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return None
        tallies: Parts = {}
        for key, sums in kept["tallies"].items():
            group, part, share = key.split("/")
            people = {person: Tally(*of_person) for person, of_person in sums["people"].items()}
            tallies[group, part, share] = Tally(*sums["all"], people=people)
        return Scores(tallies, Census(**kept["census"] | {"people": frozenset(kept["census"]["people"])}))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _sums(tally: Tally) -> dict[str, Any]:
    people = {person: [one.count, one.total, one.squared] for person, one in tally.people.items()}
    return {"all": [tally.count, tally.total, tally.squared], "people": people}


def better_last_known(scores: Mapping[str, Scores]) -> str:
    """The frame of `KNOWN` whose baseline, 'last_known_…', has the smaller error of hidden body joints (RMSJPE)."""

    def error(frame: str) -> float:
        one = scores[f"last_known_{frame}"]
        groups = [group for group, part, _ in one.tallies if part == "body"]
        return one.get("body", "occluded", "main" if "main" in groups else groups[0]).rmsjpe

    return min(KNOWN, key=error)


Place = tuple[str, str]  # part of the body, share of joints
MEASURES: tuple[Measure, ...] = ("rmsjpe", "mpjpe")
OWN_NAMES = {
    "last_known": "last known",
    "constant_velocity": "constant velocity",
    "best": "shipped, before IK",
    "tracker": "shipped",
}
PARTS = {
    "body": "body",
    "finger": "fingers",
    "body_and_finger": "both",
    "parent_body": "bones, body",
    "parent_all": "bones, both",
    "bone_body": "bone lengths, body",
    "bone_all": "bone lengths, both",
}
KEYS = {"body_and_finger": "all", **{part: part for part in PARTS if part != "body_and_finger"}}  # in flat objects


@dataclass(frozen=True)
class Claim:
    """That one method has the smaller error than others, somewhere in a table."""

    text: str
    lower: str
    higher: tuple[str, ...]
    place: Place = ("body", "occluded")
    measure: Measure = "rmsjpe"


@dataclass(frozen=True)
class NetworkTable:
    """One of the tables: its cells, what was published for them, and what the paper reads from them."""

    name: str
    title: str
    places: tuple[Place, ...]
    published: Mapping[str, Mapping[Place, tuple[float, float]]]  # RMSJPE and MPJPE, cm, by method
    claims: tuple[Claim, ...]
    extra: tuple[str, ...] = ()  # methods of ours that the paper does not have
    change_from: str | None = None  # the method to which changes are relative
    digits: int = 1

    @property
    def methods(self) -> tuple[str, ...]:
        """Every method, in order."""
        return (*self.published, *self.extra)

    def only(self, methods: Collection[str]) -> NetworkTable:
        """The table of these methods alone, and what is read from them."""
        published = {name: row for name, row in self.published.items() if name in methods}
        claims = tuple(one for one in self.claims if {one.lower, *one.higher} <= set(methods))
        extra = tuple(name for name in self.extra if name in methods)
        return replace(self, published=published, claims=claims, extra=extra)


def _rows(places: tuple[Place, ...], **rows: str) -> dict[str, dict[Place, tuple[float, float]]]:
    """Rows as the paper prints them: 'RMSJPE/MPJPE' of every place."""

    def pair(text: str) -> tuple[float, float]:
        rmsjpe, mpjpe = text.split("/")
        return float(rmsjpe), float(mpjpe)

    return {name: dict(zip(places, map(pair, row.split()), strict=True)) for name, row in rows.items()}


_PLACES = tuple((part, share) for part in ("body", "finger", "body_and_finger") for share in ("occluded", "all"))
_LOSS_PLACES = (("body", "occluded"), ("body", "all"), ("parent_body", "all"), ("parent_all", "all"))
_RIVALS = ("rnn", "lstm", "tcn")

TABLE_2 = NetworkTable(
    "unoc-table2",
    "UNOC, Table 2: recurrent networks and convolutions",
    _PLACES,
    _rows(
        _PLACES,
        gru="5.9/4.0 4.3/3.1 4.1/3.0 2.0/1.2 9.3/5.9 5.3/3.3",
        last_known="13.1/8.5 7.4/2.7 5.0/3.2 2.2/0.6 15.9/9.6 7.6/2.2",
        rnn="6.1/4.2 4.6/3.3 4.4/3.2 2.2/1.3 10.1/6.3 5.9/3.7",
        lstm="6.4/4.2 4.5/3.2 4.3/3.0 2.1/1.3 10.2/6.1 5.8/3.6",
        tcn="6.2/4.2 4.9/3.7 4.4/3.2 2.2/1.4 10.3/6.4 6.2/4.1",
    ),
    (
        Claim("The GRU is the best network at hidden joints of the body", "gru", _RIVALS),
        Claim("The GRU is the best network at hidden fingers", "gru", _RIVALS, ("finger", "occluded")),
        Claim("The GRU is the best network at both", "gru", _RIVALS, ("body_and_finger", "occluded")),
        Claim("The GRU is better than the last known position at hidden joints of the body", "gru", ("last_known",)),
        Claim("The same at hidden fingers", "gru", ("last_known",), ("finger", "occluded")),
        Claim("The same at both", "gru", ("last_known",), ("body_and_finger", "occluded")),
        Claim(
            "Over all joints of the body the last known position has the smaller mean error",
            *("last_known", ("gru",), ("body", "all"), "mpjpe"),
        ),
        Claim("Not in the paper: the shipped predictor is better than its GRU at hidden joints", "best", ("gru",)),
    ),
    extra=("constant_velocity", "best", "tracker"),
)
TABLE_3 = NetworkTable(
    "unoc-table3",
    "UNOC, Table 3: forms of the network",
    _PLACES,
    _rows(
        _PLACES,
        gru="5.9/4.0 4.3/3.1 4.1/3.0 2.0/1.2 9.3/5.9 5.3/3.3",
        head_local="6.4/4.6 4.7/3.5 4.4/3.5 2.7/2.2 9.3/6.1 5.3/3.3",
        no_skip="6.0/4.2 4.5/3.4 4.1/3.0 2.1/1.3 9.5/6.2 5.7/3.7",
        window_9="6.1/4.2 4.4/3.2 4.2/3.0 2.0/1.2 9.5/6.0 5.5/3.5",
        window_81="6.3/4.3 4.6/3.3 4.3/3.0 2.1/1.2 10.3/6.2 5.8/3.6",
        hidden_1024="5.8/3.9 4.2/3.0 4.3/3.0 2.0/1.2 9.3/5.9 5.3/3.3",
    ),
    (
        Claim("Skip connections help at hidden joints of the body", "gru", ("no_skip",)),
        Claim("Skip connections help over all joints of the body", "gru", ("no_skip",), ("body", "all")),
        Claim(
            "Fingers are better measured from the wrist, hidden ones", "gru", ("head_local",), ("finger", "occluded")
        ),
        Claim("Fingers are better measured from the wrist, all of them", "gru", ("head_local",), ("finger", "all")),
        Claim("27 frames are better than 9 and 81", "gru", ("window_9", "window_81")),
        Claim("A hidden state of 1024 is a little better for the body", "hidden_1024", ("gru",)),
        Claim("A hidden state of 1024 is worse for hidden fingers", "gru", ("hidden_1024",), ("finger", "occluded")),
    ),
)
TABLE_4 = NetworkTable(
    "unoc-table4",
    "UNOC, Table 4: losses",
    _LOSS_PLACES,
    _rows(
        _LOSS_PLACES,
        gru="5.9/4.0 4.3/3.1 0.90/0.61 0.51/0.34",
        no_occlusion="6.2/4.2 4.4/3.2 0.92/0.63 0.54/0.37",
        no_parent="6.0/4.1 4.4/3.2 0.91/0.65 0.53/0.37",
        no_bone="6.0/4.0 4.3/3.1 1.06/0.71 0.59/0.39",
        no_parent_no_bone="6.0/4.0 4.4/3.2 1.17/0.79 0.62/0.39",
    ),
    (
        Claim("Predicting the occlusion helps at hidden joints of the body", "gru", ("no_occlusion",)),
        Claim(
            "With all losses the bones of the body are the best",
            *("gru", ("no_parent", "no_bone", "no_parent_no_bone"), ("parent_body", "all")),
        ),
        Claim(
            "With all losses the bones of body and fingers are the best",
            *("gru", ("no_parent", "no_bone", "no_parent_no_bone"), ("parent_all", "all")),
        ),
        Claim(
            "Without both losses of bones they are the worst",
            *("no_bone", ("no_parent_no_bone",), ("parent_body", "all")),
        ),
    ),
    change_from="gru",
    digits=2,
)


def network_report(table: NetworkTable, scores: Mapping[str, Scores], data: DataSet) -> Report:
    """A table of these networks. `scores` has every method, the last known ones under 'last_known_<frame>'."""
    frame = better_last_known(scores)
    scores = {**scores, "last_known": scores[f"last_known_{frame}"]}
    census = next(iter(scores.values())).census
    groups = [g for g in GROUPS[1:] if any(scores[m].get(*table.places[0], g).count for m in table.methods)]
    change = ("change, %", "UNOC's change, %") if table.change_from else ()
    published = ("UNOC's RMSJPE", "UNOC's MPJPE")
    ours = ("RMSJPE", "MPJPE", "RMSJPE low", "high")
    columns = ("joints", "network", *ours, *published, *change, *(f"{g} RMSJPE" for g in groups))
    return Report(
        name=table.name,
        title=table.title,
        columns=columns,
        rows=tuple(_table_rows(table, scores, groups)),
        numbers=_numbers(table, scores) | census.numbers(),
        data=(describe(data, census), *missing(("UNOC",), [data])),
        remarks=tuple(_remarks(table, scores, frame)),
        caption="cm. Body: shoulders to feet, in the world; fingers from their wrist, but with the body in the world. "
        "Over sitting, gestures, everyday motion and locomotion; other motion stands in columns of its own. "
        "Low and high: 95 % by bootstrap over people.",
        digits=table.digits,
        panels=tuple(_panels(table, scores)),
    )


def joints_of(place: Place) -> str:
    """As a table prints them."""
    part, share = place
    return PARTS[part] if part.startswith(("parent", "bone")) else f"{PARTS[part]}, {share}"


def name_of(method: str) -> str:
    """As a table prints it."""
    from bodysense_lab.unoc.variants import VARIANTS

    return OWN_NAMES[method] if method in OWN_NAMES else VARIANTS[method].title


def numbers_of(scores: Scores, method: str, parts: Mapping[str, str] = KEYS) -> dict[str, float]:
    """'<method>_<part>_<share>_<measure>_cm', of other categories than the main ones with their group behind it."""
    result = {}
    for (group, part, share), tally in scores.tallies.items():
        if part not in parts:
            continue
        key = f"{method}_{parts[part]}" + ("" if part.startswith(("parent", "bone")) else f"_{share}")
        for measure in MEASURES:
            name = f"{key}_{measure}_cm" + ("" if group == "main" else f"_{group}")
            result |= {name: getattr(tally, measure)} | surely({name: tally.interval(measure)})
    return finite(result)


def _table_rows(table: NetworkTable, scores: Mapping[str, Scores], groups: list[str]) -> Iterator[tuple[Cell, ...]]:
    for place in table.places:
        start = None if table.change_from is None else table.change_from
        for method in table.methods:
            tally, published = scores[method].get(*place), table.published.get(method, {}).get(place)
            change: list[Cell] = []
            if start is not None:
                before, before_published = scores[start].get(*place).rmsjpe, table.published[start][place][0]
                change.append(cell(100 * (tally.rmsjpe / before - 1) if before else math.nan))
                change.append(None if published is None else 100 * (published[0] / before_published - 1))
            others = (cell(scores[method].get(*place, group).rmsjpe) for group in groups)
            sure = bounds(tally.interval("rmsjpe"))
            figures = (cell(tally.rmsjpe), cell(tally.mpjpe), *sure, *(published or (None, None)))
            if any(figure is not None for figure in figures[:2]):
                yield (joints_of(place), name_of(method), *figures, *change, *others)


def _numbers(table: NetworkTable, scores: Mapping[str, Scores]) -> dict[str, float]:
    result: dict[str, float] = {}
    for method in dict.fromkeys((*table.methods, "last_known")):
        result |= numbers_of(scores[method], method)
    return result


def _remarks(table: NetworkTable, scores: Mapping[str, Scores], frame: str) -> Iterator[str]:
    for claim in table.claims:

        def named(method: str, claim: Claim = claim) -> Named:
            return scores[method].get(*claim.place).named(name_of(method), claim.measure)

        verdict = ordering(claim.text, named(claim.lower), [named(method) for method in claim.higher], "cm")
        if verdict is not None:
            yield verdict
    if "last_known" in table.methods:
        yield f"Last known positions are kept in the frame in which they are better here: {frame}."
    if table.extra:
        yield "In the shipped predictor's output joints that are seen are where they were measured, before IK."


def _panels(table: NetworkTable, scores: Mapping[str, Scores]) -> Iterator[BarPanel]:
    for place in table.places:
        ours = [cell(scores[method].get(*place).rmsjpe) for method in table.methods]
        if any(value is not None for value in ours):
            published = [table.published.get(method, {}).get(place, (None,))[0] for method in table.methods]
            bars = (plain_bars("ours", ours), plain_bars("published (UNOC)", published))
            groups = tuple(name_of(method) for method in table.methods)
            yield BarPanel(joints_of(place), groups, bars, "RMSJPE, cm")
