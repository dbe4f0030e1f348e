"""UNOC's Tables 2 to 4: the paper's network, other networks and ablations, next to the published figures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from bodysense_lab.core.score_table import (
    Claim,
    Published,
    ScoreColumn,
    ScoreRow,
    ScoreTable,
    claim,
    pairs,
    score_report,
)
from bodysense_lab.core.table import Report
from bodysense_lab.data.datasets import DataSet, describe_data, missing_data_remarks
from bodysense_lab.papers.unoc.network.variants import VARIANTS
from bodysense_lab.papers.unoc.score.kept_scores import Scores, better_last_known

At = tuple[str, str]  # part of the body, share of joints
OWN_NAMES = {
    "last_known": "last known",
    "constant_velocity": "constant velocity",
    "best": "shipped, before IK",
    "tracker": "shipped",
}
NAMES = OWN_NAMES | {name: variant.title for name, variant in VARIANTS.items()}
PLACES: dict[At, ScoreRow] = {
    **{
        (part, share): ScoreRow(f"{label}, {share}", f"{key}_{share}")
        for part, label, key in (
            ("body", "body", "body"),
            ("finger", "fingers", "finger"),
            ("body_and_finger", "both", "all"),
        )
        for share in ("occluded", "all")
    },
    ("parent_body", "all"): ScoreRow("bones, body", "parent_body"),
    ("parent_all", "all"): ScoreRow("bones, both", "parent_all"),
    ("bone_body", "all"): ScoreRow("bone lengths, body", "bone_body"),
    ("bone_all", "all"): ScoreRow("bone lengths, both", "bone_all"),
}
FIGURES = (
    ScoreColumn("RMSJPE", "error", "rmsjpe", "{method}_{place.key}_rmsjpe_cm", bounded=True),
    ScoreColumn("MPJPE", "error", "mpjpe", "{method}_{place.key}_mpjpe_cm", bounded=True),
)
_BODY: At = ("body", "occluded")
_FINGERS: At = ("finger", "occluded")
_BOTH: At = ("body_and_finger", "occluded")
_ALL: At = ("body", "all")


def _claim(text: str, lower: str, higher: Collection[str], at: At = _BODY, figure: int = 0) -> Claim:
    """A claim on methods at one place."""
    return claim(text, NAMES, at, lower, *higher, figure=figure)


def _table(
    number: str,
    title: str,
    rows: tuple[At, ...],
    published: Mapping[str, str],
    claims: tuple[Claim, ...],
    extra: tuple[str, ...] = (),
    **more: Any,
) -> ScoreTable:
    """A table with rows as the paper prints them, 'RMSJPE/MPJPE' of every place; `extra` are methods of ours."""
    methods = {method: NAMES[method] for method in (*published, *extra)}
    cells = {(at, method): pair for method, row in published.items() for at, pair in zip(rows, pairs(row), strict=True)}
    return ScoreTable(
        f"unoc-table{number}",
        f"UNOC, Table {number}: {title}",
        ("joints", "network"),
        PLACES,
        methods,
        FIGURES,
        caption="cm. Body: shoulders to feet, in the world; fingers from their wrist, but with the body in the world. "
        "Over sitting, gestures, everyday motion and locomotion; other motion stands in columns of its own. "
        "Low and high: 95 % by bootstrap over people.",
        published=(Published(("UNOC's RMSJPE", "UNOC's MPJPE"), cells),),
        claims=claims,
        rows=rows,
        bounded=0,
        **more,
    )


_PLACES: tuple[At, ...] = tuple(list(PLACES)[:6])
_LOSS_PLACES: tuple[At, ...] = (_BODY, _ALL, ("parent_body", "all"), ("parent_all", "all"))
_RIVALS = ("rnn", "lstm", "tcn")
_ABLATED = ("no_parent", "no_bone", "no_parent_no_bone")

TABLE_2 = _table(
    "2",
    "recurrent networks and convolutions",
    _PLACES,
    {
        "gru": "5.9/4.0 4.3/3.1 4.1/3.0 2.0/1.2 9.3/5.9 5.3/3.3",
        "last_known": "13.1/8.5 7.4/2.7 5.0/3.2 2.2/0.6 15.9/9.6 7.6/2.2",
        "rnn": "6.1/4.2 4.6/3.3 4.4/3.2 2.2/1.3 10.1/6.3 5.9/3.7",
        "lstm": "6.4/4.2 4.5/3.2 4.3/3.0 2.1/1.3 10.2/6.1 5.8/3.6",
        "tcn": "6.2/4.2 4.9/3.7 4.4/3.2 2.2/1.4 10.3/6.4 6.2/4.1",
    },
    (
        _claim("The GRU is the best network at hidden joints of the body", "gru", _RIVALS),
        _claim("The GRU is the best network at hidden fingers", "gru", _RIVALS, _FINGERS),
        _claim("The GRU is the best network at both", "gru", _RIVALS, _BOTH),
        _claim("The GRU is better than the last known position at hidden joints of the body", "gru", ("last_known",)),
        _claim("The same at hidden fingers", "gru", ("last_known",), _FINGERS),
        _claim("The same at both", "gru", ("last_known",), _BOTH),
        _claim(
            "Over all joints of the body the last known position has the smaller mean error",
            *("last_known", ("gru",), _ALL, 1),
        ),
        _claim("Not in the paper: the shipped predictor is better than its GRU at hidden joints", "best", ("gru",)),
    ),
    extra=("constant_velocity", "best", "tracker"),
)
TABLE_3 = _table(
    "3",
    "forms of the network",
    _PLACES,
    {
        "gru": "5.9/4.0 4.3/3.1 4.1/3.0 2.0/1.2 9.3/5.9 5.3/3.3",
        "head_local": "6.4/4.6 4.7/3.5 4.4/3.5 2.7/2.2 9.3/6.1 5.3/3.3",
        "no_skip": "6.0/4.2 4.5/3.4 4.1/3.0 2.1/1.3 9.5/6.2 5.7/3.7",
        "window_9": "6.1/4.2 4.4/3.2 4.2/3.0 2.0/1.2 9.5/6.0 5.5/3.5",
        "window_81": "6.3/4.3 4.6/3.3 4.3/3.0 2.1/1.2 10.3/6.2 5.8/3.6",
        "hidden_1024": "5.8/3.9 4.2/3.0 4.3/3.0 2.0/1.2 9.3/5.9 5.3/3.3",
    },
    (
        _claim("Skip connections help at hidden joints of the body", "gru", ("no_skip",)),
        _claim("Skip connections help over all joints of the body", "gru", ("no_skip",), _ALL),
        _claim("Fingers are better measured from the wrist, hidden ones", "gru", ("head_local",), _FINGERS),
        _claim("Fingers are better measured from the wrist, all of them", "gru", ("head_local",), ("finger", "all")),
        _claim("27 frames are better than 9 and 81", "gru", ("window_9", "window_81")),
        _claim("A hidden state of 1024 is a little better for the body", "hidden_1024", ("gru",)),
        _claim("A hidden state of 1024 is worse for hidden fingers", "gru", ("hidden_1024",), _FINGERS),
    ),
)
TABLE_4 = _table(
    "4",
    "losses",
    _LOSS_PLACES,
    {
        "gru": "5.9/4.0 4.3/3.1 0.90/0.61 0.51/0.34",
        "no_occlusion": "6.2/4.2 4.4/3.2 0.92/0.63 0.54/0.37",
        "no_parent": "6.0/4.1 4.4/3.2 0.91/0.65 0.53/0.37",
        "no_bone": "6.0/4.0 4.3/3.1 1.06/0.71 0.59/0.39",
        "no_parent_no_bone": "6.0/4.0 4.4/3.2 1.17/0.79 0.62/0.39",
    },
    (
        _claim("Predicting the occlusion helps at hidden joints of the body", "gru", ("no_occlusion",)),
        _claim("With all losses the bones of the body are the best", "gru", _ABLATED, ("parent_body", "all")),
        _claim("With all losses the bones of body and fingers are the best", "gru", _ABLATED, ("parent_all", "all")),
        _claim(
            "Without both losses of bones they are the worst",
            *("no_bone", ("no_parent_no_bone",), ("parent_body", "all")),
        ),
    ),
    change_from="gru",
    digits=2,
)


def network_report(table: ScoreTable, scores: Mapping[str, Scores], data: DataSet) -> Report:
    """Return a table of the methods in `scores`, the last known ones of which are 'last_known_<frame>' there."""
    frame = better_last_known(scores)
    scores = {**scores, "last_known": scores[f"last_known_{frame}"]}
    cells = {
        (group, (part, share), method, "error"): tally
        for method in dict.fromkeys((*table.methods, "last_known"))
        if method in scores
        for (group, part, share), tally in scores[method].tallies.items()
    }
    census = next(iter(scores.values())).census
    remarks = []
    if "last_known" in table.methods:
        remarks.append(f"Last known positions are kept in the frame in which they are better here: {frame}.")
    if "best" in table.methods:
        remarks.append(
            "In the shipped predictor's output joints that are seen are where they were measured, before IK."
        )
    return score_report(
        table, cells, census, (describe_data(data, census), *missing_data_remarks(("UNOC",), [data])), remarks
    )
