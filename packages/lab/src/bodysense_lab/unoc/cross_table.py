"""UNOC's Table 5: networks trained on one data set and tested on another. Left the body, right finger synthesis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from bodysense.io.resample import resample
from bodysense.metrics import joint_error
from bodysense.papers.fingers import FingerSynthesis
from bodysense.papers.point_model import PointModel
from bodysense.scoring import RATE, Tally, group_of
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.datasets import DataSet, describe, missing
from bodysense_lab.table import Cell, Report, cell, finite, ordering
from bodysense_lab.unoc.finger_scores import finger_offsets
from bodysense_lab.unoc.tables import Scores, better_last_known

Pair = tuple[str, str]  # trained on, tested on
SETS = ("UNOC", "TWH16.2M", "Mixamo")  # of the paper


def _matrix(text: str) -> dict[Pair, tuple[float, float]]:
    """RMSJPE/MPJPE, a row for each test set, a column for each training set and, where there is one, the input."""
    columns = (*SETS, "")
    result = {}
    for test, row in zip(SETS, text.strip().splitlines(), strict=True):
        for train, pair in zip(columns, row.split(), strict=False):
            rmsjpe, mpjpe = pair.split("/")
            result[train, test] = (float(rmsjpe), float(mpjpe))
    return result


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


def cross_report(
    trained: Sequence[str],
    tests: Sequence[DataSet],
    scores: Mapping[Pair, Scores],
    last_known: Mapping[str, Mapping[str, Scores]],
    fingers: Mapping[Pair, Tally] | None = None,
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
    rows: list[tuple[Cell, ...]] = []
    numbers: dict[str, float] = {}
    panels, remarks = [], []
    for part, title in (("body", "body, occluded"), ("body_and_finger", "both, occluded")):
        found = {
            pair: scores[pair].get(part, "occluded")
            for pair in product(trained, (data.name for data in tests))
            # Fingers are learned only from a set that has them.
            if part == "body" or {*pair} <= with_fingers
        }
        found = {pair: tally for pair, tally in found.items() if tally.count}
        inputs = {name: some.get(part, "occluded") for name, some in kept.items()}
        published = PUBLISHED_BODY if part == "body_and_finger" else {}
        rows += _rows(title, found, inputs, published)
        remarks += _remarks(title, found, inputs)
        key = {"body": "body", "body_and_finger": "all"}[part]
        for (train, test), tally in found.items():
            numbers |= _numbers(f"{_slug(train)}_to_{_slug(test)}_{key}_occluded", tally)
        for test, tally in inputs.items():
            numbers |= _numbers(f"last_known_on_{_slug(test)}_{key}_occluded", tally)
        panels += _panels(title, found, inputs, published)
    if fingers is not None:
        rows += _rows("finger synthesis", fingers, {}, PUBLISHED_FINGERS)
        remarks += _remarks("finger synthesis", fingers, {})
        for (train, test), tally in fingers.items():
            numbers |= _numbers(f"{_slug(train)}_to_{_slug(test)}_finger_synthesis", tally)
        panels += _panels("finger synthesis", fingers, {}, PUBLISHED_FINGERS)
    for data in tests:
        numbers |= {f"{_slug(data.name)}_{key}": value for key, value in kept[data.name].census.numbers().items()}
    return Report(
        name="unoc-table5",
        title="UNOC, Table 5: trained on one data set, tested on another",
        columns=(
            *("joints", "tested on", "trained on", "RMSJPE", "MPJPE"),
            *("last known RMSJPE", "last known MPJPE", "UNOC's RMSJPE", "UNOC's MPJPE", "UNOC's last known RMSJPE"),
        ),
        rows=tuple(rows),
        numbers=finite(numbers),
        data=(*(describe(data, kept[data.name].census) for data in tests), *missing(SETS, tests)),
        remarks=tuple(remarks),
        caption="cm. Over sitting, gestures, everyday motion and locomotion. Fingers count where both sets have them; "
        "rows without figures of ours are the paper's.",
        panels=tuple(panels),
    )


def synthesis_errors(sets: Sequence[DataSet], models: Mapping[str, PointModel]) -> dict[Pair, Tally]:
    """Errors (cm) of finger synthesis by (trained on, tested on), over the main categories with recorded fingers."""
    errors: dict[Pair, Tally] = {}
    for data in sets:
        scored = (clip for clip in data.clips() if clip.has_fingers and group_of(clip) == "main")
        for clip in (resample(clip, RATE) for clip in scored):
            truth = finger_offsets(clip)
            for train, model in models.items():
                method = FingerSynthesis(clip.pose.skeleton, model, half_life=0)
                placed, _ = method.step(clip.pose, clip.time, method.start())
                tally = errors.setdefault((train, data.name), Tally())
                tally.add(joint_error(placed[:, np.argsort(method.places)], truth), clip.person)
    return errors


def _rows(
    title: str,
    found: Mapping[Pair, Tally],
    inputs: Mapping[str, Tally],
    published: Mapping[Pair, tuple[float, float]],
) -> Iterator[tuple[Cell, ...]]:
    pairs = sorted({*found, *(pair for pair in published if pair[0])}, key=lambda pair: (pair not in found, pair[::-1]))
    for train, test in pairs:
        ours, known = found.get((train, test), Tally()), inputs.get(test, Tally())
        theirs, their_input = published.get((train, test), (None, None)), published.get(("", test), (None,))[0]
        figures = (cell(value) for tally in (ours, known) for value in (tally.rmsjpe, tally.mpjpe))
        yield (title, test, train, *figures, *theirs, their_input)


def _remarks(title: str, found: Mapping[Pair, Tally], inputs: Mapping[str, Tally]) -> Iterator[str]:
    for test in dict.fromkeys(test for _, test in found):
        named = {train: tally.named(train, "rmsjpe") for (train, other), tally in found.items() if other == test}
        rest = [one for train, one in named.items() if train != test]
        verdicts = []
        if test in named:
            verdicts.append(ordering(f"{title}, on {test}: its own network is the best", named[test], rest, "cm"))
        if test in inputs:
            known = [inputs[test].named("last known", "rmsjpe")]
            claim = "{}, on {}: the network of {} is better than the last known position"
            verdicts += [ordering(claim.format(title, test, one.name), one, known, "cm") for one in named.values()]
        yield from (verdict for verdict in verdicts if verdict is not None)


def _panels(
    title: str,
    found: Mapping[Pair, Tally],
    inputs: Mapping[str, Tally],
    published: Mapping[Pair, tuple[float, float]],
) -> Iterator[BarPanel]:
    """Ours, then, where the paper has the same, the paper's."""
    if found:
        pairs = sorted(found, key=lambda pair: pair[::-1])
        names = tuple(f"{train}\non {test}" for train, test in pairs)
        bars = [plain_bars("trained on → tested on", [cell(found[pair].rmsjpe) for pair in pairs])]
        bars.append(plain_bars("last known", [cell(inputs.get(test, Tally()).rmsjpe) for _, test in pairs]))
        bars.append(plain_bars("published", [published.get(pair, (None,))[0] for pair in pairs]))
        bars = [one for one in bars if np.isfinite(one.height).any()]
        yield BarPanel(title, names, tuple(bars), "RMSJPE, cm")


def _numbers(key: str, tally: Tally) -> dict[str, float]:
    return {f"{key}_rmsjpe_cm": tally.rmsjpe, f"{key}_mpjpe_cm": tally.mpjpe}


def _slug(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name.lower())
