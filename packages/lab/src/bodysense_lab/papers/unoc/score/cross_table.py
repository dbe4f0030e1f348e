"""UNOC's Table 5: networks trained on one data set and tested on another. Left the body, right finger synthesis."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bodysense.io.resample import resample
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.score_table import (
    Claim,
    Compared,
    Published,
    ScoreColumn,
    ScoreRow,
    ScoreTable,
    pairs,
    score_report,
)
from bodysense_lab.core.scoring import RATE, Tally, group_of
from bodysense_lab.core.table import Report
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import DataSet, describe_data, missing_data_remarks
from bodysense_lab.papers.unoc.fingers import FingerSynthesis
from bodysense_lab.papers.unoc.point_model import PointModel
from bodysense_lab.papers.unoc.score.finger_scores import finger_offsets
from bodysense_lab.papers.unoc.score.kept_scores import Scores, better_last_known

Pair = tuple[str, str]  # trained on, tested on
SETS = ("UNOC", "TWH16.2M", "Mixamo")  # of the paper
BODY, BOTH, FINGERS = "body, occluded", "both, occluded", "finger synthesis"
Cells = dict[tuple[str, Pair, str, str], Tally]  # by group, (joints, tested on), trained on and measure
_KEYS = {BODY: "body_occluded", BOTH: "all_occluded", FINGERS: "finger_synthesis"}


def _matrix(text: str) -> dict[Pair, tuple[float, ...]]:
    """RMSJPE/MPJPE, a row for each test set, a column for each training set and, where there is one, the input."""
    return {
        (train, test): pair
        for test, row in zip(SETS, text.strip().splitlines(), strict=True)
        for train, pair in zip((*SETS, ""), pairs(row), strict=False)
    }


PUBLISHED_BODY = _matrix("""
9.3/5.9 15.6/10.3 13.2/8.2 15.9/9.6
8.2/6.1 5.8/2.8 10.3/8.3 9.1/6.0
22.4/14.6 28.8/19.2 17.8/11.3 23.1/14.7
""")
PUBLISHED_FINGERS = _matrix("""
1.5/0.8 2.9/1.5 2.3/1.3
2.1/1.1 1.5/0.7 1.9/1.1
3.0/1.6 4.1/1.9 2.0/1.1
""")
PUBLISHED = {BOTH: PUBLISHED_BODY, FINGERS: PUBLISHED_FINGERS}


def cross_report(
    trained: Sequence[str],
    tests: Sequence[DataSet],
    scores: Mapping[Pair, Scores],
    last_known: Mapping[str, Mapping[str, Scores]],
    fingers: Mapping[tuple, Tally] | None = None,
) -> Report:
    """The table of every pair.

    Args:
        trained: names of the sets on which networks were trained.
        tests: the sets on which they were tested.
        scores: of each pair's network.
        last_known: by test set, the scores of the baselines 'last_known_<frame>'.
        fingers: errors (cm) of finger synthesis, if any.
    """
    kept = {name: some[f"last_known_{better_last_known(some)}"] for name, some in last_known.items()}
    with_fingers = {name for name, some in kept.items() if some.census.finger_clips}
    cells: Cells = {}
    for joints, part in ((BODY, "body"), (BOTH, "body_and_finger")):
        for data in tests:
            known = kept[data.name].get(part, "occluded")
            for train in trained:
                tally = scores[train, data.name].get(part, "occluded")
                # Fingers are learned only from a set that has them.
                if tally.count and (part == "body" or {train, data.name} <= with_fingers):
                    cells["main", (joints, data.name), _slug(train), "error"] = tally
                    cells["main", (joints, data.name), _slug(train), "known"] = known
    for (train, test), tally in (fingers or {}).items():
        cells["main", (FINGERS, test), _slug(train), "error"] = tally
    table = _table({*(data.name for data in tests), *SETS}, {*trained, *SETS}, cells, fingers is not None)
    numbers = {
        f"last_known_on_{_slug(name)}_{_KEYS[joints]}_{measure}_cm": getattr(some.get(part, "occluded"), measure)
        for name, some in kept.items()
        for joints, part in ((BODY, "body"), (BOTH, "body_and_finger"))
        for measure in ("rmsjpe", "mpjpe")
        if some.get(part, "occluded").count
    }
    for name, some in kept.items():
        numbers |= {f"{_slug(name)}_{key}": value for key, value in some.census.numbers().items()}
    about = (*(describe_data(data, kept[data.name].census) for data in tests), *missing_data_remarks(SETS, tests))
    return score_report(table, cells, None, about, numbers=numbers)


def _table(tests: Collection[str], trained: Collection[str], cells: Cells, fingers: bool) -> ScoreTable:
    """The table of data sets by name."""
    parts = (BODY, BOTH, FINGERS) if fingers else (BODY, BOTH)
    published = {
        ((joints, test), _slug(train)): (*PUBLISHED[joints].get((train, test), (None, None)), last_known)
        for joints in parts
        for test in SETS
        for train in trained
        if joints in PUBLISHED
        for last_known in (PUBLISHED[joints].get(("", test), (None,))[0],)
    }
    names = {_slug(train): train for train in sorted(trained)}
    return ScoreTable(
        name="unoc-table5",
        title="UNOC, Table 5: trained on one data set, tested on another",
        axes=("joints", "tested on", "trained on"),
        places={
            (joints, test): ScoreRow((joints, test), f"{_slug(test)}_{_KEYS[joints]}")
            for joints in parts
            for test in sorted(tests)
        },
        methods=names,
        figures=(
            ScoreColumn("RMSJPE", "error", "rmsjpe", "{method}_to_{place.key}_rmsjpe_cm"),
            ScoreColumn("MPJPE", "error", "mpjpe", "{method}_to_{place.key}_mpjpe_cm"),
            ScoreColumn("last known RMSJPE", "known", "rmsjpe"),
            ScoreColumn("last known MPJPE", "known", "mpjpe"),
        ),
        caption="cm. Over sitting, gestures, everyday motion and locomotion. Fingers count where both sets have them; "
        "rows without figures of ours are the paper's.",
        published=(Published(("UNOC's RMSJPE", "UNOC's MPJPE", "UNOC's last known RMSJPE"), published),),
        claims=tuple(claim for joints in parts for claim in _claims(joints, names, cells)),
        published_rows=True,
    )


def _claims(joints: str, names: Mapping[str, str], cells: Cells) -> Iterator[Claim]:
    """Whether a network is the best on its own set, and each is better than the last known position."""
    found = [(place, train) for _, place, train, measure in cells if measure == "error" and place[0] == joints]
    for place in dict.fromkeys(place for place, _ in found):
        test = place[1]
        networks = [Compared(names[train], place, train) for at, train in found if at == place]
        rest = tuple(one for one in networks if one.name != test)
        for own in networks:
            if own.name == test:
                yield Claim(f"{joints}, on {test}: its own network is the best", own, rest)
        for one in networks if joints != FINGERS else ():
            text = f"{joints}, on {test}: the network of {one.name} is better than the last known position"
            yield Claim(text, one, (replace(one, name="last known", figure=2),))


def synthesis_errors(sets: Sequence[DataSet], models: Mapping[str, PointModel]) -> Tallies:
    """Errors (cm) of finger synthesis by (trained on, tested on), over the main categories with recorded fingers."""
    errors = Tallies()
    for data in sets:
        scored = (clip for clip in data.clips() if clip.has_fingers and group_of(clip) == "main")
        for clip in (resample(clip, RATE) for clip in scored):
            truth = finger_offsets(clip)
            for train, model in models.items():
                method = FingerSynthesis(clip.pose.skeleton, model, half_life=0)
                predicted, _ = method.step(clip.pose, clip.time, method.start())
                error = joint_error(predicted[:, np.argsort(method.places)], truth)
                errors.add((train, data.name), error, clip.person)
    return errors


def _slug(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name.lower())
