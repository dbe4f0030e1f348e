"""Choice of glove settings on hands that no table scores: half-lives of offsets, and of angles of inertial sensors.

The hands are drawn from the hand shape space with a separate seed. Their motion is recorded, from the validation split,
or synthesised. A value is scored by the mean of its errors over all durations, and the best is chosen. Of
offsets it is the longest half-life within 2 % of the best: real hands differ more from those of training than drawn
ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from bodysense.body.hands.hand import FINGERS
from bodysense.body.hands.hand_family import GlovedHand, draw_hand
from bodysense.devices.gloves.gap_fillers import NetworkGapFiller
from bodysense.devices.gloves.hands import HandsSettings, load_glove_models
from bodysense.devices.gloves.inertial import InertialSettings
from bodysense_lab.core.table import Report, cell, finite
from bodysense_lab.data.datasets import describe_data
from bodysense_lab.papers.two_hands.score.fusion import SCORED, SECONDS, STRIDE, fused_errors
from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED
from bodysense_lab.papers.two_hands.score.scores import ALONE, SYNTHETIC_SECONDS, GloveTable, HandTask
from bodysense_lab.papers.two_hands.trials import (
    DURATIONS,
    LAST,
    HandErrors,
    Trials,
    cut,
    hide_some,
    marker_error,
    together,
)
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion

CHOICE_SEED = 31  # of the drawn hands; no table uses it
HIDDEN_MARKERS = (1, 4)
LOST_FINGERS = 3


@dataclass(frozen=True)
class Candidates:
    """Candidate values of one setting."""

    title: str
    values: tuple[float | None, ...]
    default: float | None
    seconds: tuple[float, ...]  # s for which markers are hidden
    within: float = 0.0  # share over the least error; the longest half-life within it is chosen


CANDIDATES = {
    "fading": Candidates(
        "half-life of a hidden marker's offset, s",
        (1.0, 2.0, 4.0, 8.0, 16.0, None),
        HandsSettings().fading,
        DURATIONS,
        0.02,
    ),
    "aside": Candidates(
        "half-life of abduction and twist, s", (0.3, 1.0, 3.0, 10.0), InertialSettings().aside, SECONDS
    ),
}


def measure_settings(task: HandTask) -> HandErrors:
    """Errors, cm, under (setting, value, seconds)."""
    means, models = HandErrors(task.person), load_glove_models()
    rng = np.random.default_rng([CHOICE_SEED, crc32(task.motions[0].name.encode())])
    pairs = [(motion, draw_hand(rng)) for motion in task.motions]
    if task.group == SYNTHESISED:  # synthesise the motion, too
        pairs = [(synthesize_hand(hand.skeleton, SYNTHETIC_SECONDS, rng), hand) for _, hand in pairs]
    trials = _joined(pairs, LAST, rng)
    for count in HIDDEN_MARKERS if trials is not None else ():
        assert trials is not None
        hidden = hide_some(len(trials), count, rng)
        for value in CANDIDATES["fading"].values:
            filler = NetworkGapFiller(models.markers, trials.hands, trials.gloves, value)
            for seconds, error in zip(DURATIONS, marker_error(trials, hidden, filler), strict=True):
                means.add(("fading", value, seconds), error)
    longer = _joined(pairs, SCORED, rng)
    if longer is not None:
        lost, seed = hide_some(len(longer), LOST_FINGERS, rng, len(FINGERS)), int(rng.integers(2**31))
        for value in CANDIDATES["aside"].values:
            hands = replace(ALONE, inertial=InertialSettings(aside=value or np.inf))
            errors = fused_errors(longer, lost, models, np.random.default_rng(seed), hands)
            for seconds, error in zip(SECONDS, errors, strict=True):
                means.add(("aside", value, seconds), error)
    return means


def _joined(
    pairs: Sequence[tuple[HandMotion, GlovedHand]], last: Sequence[int], rng: np.random.Generator
) -> Trials | None:
    """Return trials of motions on their hands; None if all motions are too short."""
    parts = [cut([motion], STRIDE, rng, hand, last) for motion, hand in pairs]
    found = [part for part in parts if part is not None]
    return together(found) if found else None


def settings_report(table: GloveTable) -> Report:
    """Report the mean errors of every value, and the best value."""
    rows, numbers, remarks = [], {}, []
    for name, candidates in CANDIDATES.items():
        means = {}
        for value in candidates.values:
            errors = [table.means.mean(name, value, seconds) for seconds in candidates.seconds]
            known = [error for error in errors if np.isfinite(error)]
            means[value] = float(np.mean(known)) if known else np.inf
            rows.append((candidates.title, value_text(value), *map(cell, errors), cell(means[value])))
            numbers[f"{name}_{value_text(value)}_cm"] = means[value]
        chosen = choose(means, candidates.within)
        numbers[f"{name}_chosen_s"] = np.inf if chosen is None else chosen
        held = (
            "is the default"
            if chosen == candidates.default
            else f"is not the default, {value_text(candidates.default)}"
        )
        remarks.append(f"{candidates.title}: {value_text(chosen)} is chosen and {held}.")
    made = f"Hands drawn with seed {CHOICE_SEED}."
    return Report(
        name="gloves-settings",
        title="Settings of gloves, chosen on hands that are in no table",
        columns=("setting", "value", *(f"duration {k + 1}" for k in range(len(DURATIONS))), "mean"),
        rows=tuple(rows),
        numbers=finite(numbers) | table.census.numbers(),
        data=(made,) if table.data is None else (describe_data(table.data, table.census), made),
        remarks=tuple(remarks),
        caption=f"Mean error, cm: of hidden markers, {HIDDEN_MARKERS[0]} or {HIDDEN_MARKERS[1]}, after "
        f"{', '.join(f'{seconds:g}' for seconds in DURATIONS)} s; of {LOST_FINGERS} fingers with sensors and hidden "
        f"markers, after {', '.join(f'{seconds:g}' for seconds in SECONDS)} s.",
        digits=3,
    )


def choose(means: Mapping[float | None, float], within: float) -> float | None:
    """Return the last value, in order of half-lives, whose error is at most a share `within` over the least."""
    least = min(means.values())
    return [value for value, error in means.items() if error <= (1 + within) * least][-1]


def value_text(value: float | None) -> str:
    """Return a value in a table; None keeps all of an offset."""
    return "kept" if value is None else f"{value:g}"
