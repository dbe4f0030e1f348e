"""Numbers and durations of hidden markers of gloves, for one hand and two (two-hands, Figs 13 and 14).

A ring of cameras looks at the hands (`devices.simulated.camera_ring`). For one hand the other one is removed, so that
both cases have equal motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bodysense.body.hands.glove import MARKERS
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.devices.simulated.glove import visible
from bodysense.geometry.gaps import runs
from bodysense_lab.core.scoring import GROUPS, suffix_of
from bodysense_lab.core.table import Cell, Report, cell, finite
from bodysense_lab.data.datasets import Census, DataSet, describe_data
from bodysense_lab.papers.two_hands.score.hand_pairs import HandPair
from bodysense_lab.synthesis.motion import RATE

Setting = Literal["one", "each", "both"]
SETTINGS: dict[Setting, str] = {"one": "one hand", "each": "each of two hands", "both": "both hands"}
SHORT = 0.36  # s: 90 % of the paper's spans are shorter (section 6.1.1)
PUBLISHED_SHORT = 0.90
# Shares of one, two … hidden markers in frames with one to four of them (Fig. 13); the network is trained with these.
PUBLISHED_AT_ONCE = (0.70, 0.17, 0.08, 0.05)
SYNTHESISED_PIECES = 12


@dataclass(frozen=True, eq=False)
class MarkerHiding:
    """Numbers and spans of hidden markers in a recording."""

    at_once: np.ndarray  # (N + 1,) s with 0 to N of N markers hidden
    spans: np.ndarray  # (S,) s: lengths of the spans that begin and end within the recording

    def __add__(self, other: MarkerHiding) -> MarkerHiding:
        return MarkerHiding(self.at_once + other.at_once, np.concatenate([self.spans, other.spans]))

    @property
    def shares(self) -> np.ndarray:
        """(N + 1,) share of the time with 0 to N markers hidden."""
        return self.at_once / self.at_once.sum()

    @property
    def hidden(self) -> float:
        """Share of the time that a marker is hidden, mean over markers."""
        return float(self.shares @ np.arange(len(self.shares)) / (len(self.shares) - 1))

    def shorter(self, seconds: float) -> float:
        """Return the share of spans below `seconds`; NaN if there are no spans."""
        return float((self.spans < seconds).mean()) if len(self.spans) else float("nan")


class Hidings(dict[Setting, MarkerHiding]):
    """Hidden markers by setting."""

    def merge(self, other: Hidings) -> None:
        """Add the counts of another."""
        for setting, more in other.items():
            self[setting] += more


Counted = Mapping[str, Mapping[Setting, MarkerHiding]]  # by GROUPS


def count_hidden(seen: np.ndarray, rate: float) -> MarkerHiding:
    """Count in one recording `seen` (T, N) bool at `rate` Hz."""
    hidden = ~seen
    spans = [end - begin for row in hidden.T for begin, end in runs(row) if begin and end < len(row)]
    at_once = np.bincount(hidden.sum(axis=1), minlength=seen.shape[1] + 1)
    return MarkerHiding(at_once / rate, np.array(spans, dtype=float) / rate)


def count_pair(pair: HandPair, rng: np.random.Generator, cameras: CameraRing) -> Hidings:
    """Count in one recording; nothing of it is drawn by `rng`."""
    del rng
    both = visible(pair.hands, cameras, pair.body)
    alone = [visible({name: hand}, cameras, pair.body) for name, hand in pair.hands.items()]
    one, each = (
        count_hidden(first, RATE) + count_hidden(second, RATE)
        for first, second in (alone, np.split(both, [len(MARKERS)], axis=1))
    )
    return Hidings({"one": one, "each": each, "both": count_hidden(both, RATE)})


def numbers_of(counted: Counted) -> dict[str, float]:
    """'{one,each,both}_hidden_share', '_any_share', '_several_share' (three or more), '_<n>_share' of the time with n

    markers hidden, '_short_share' of the spans below 0.36 s, '_median_s' and '_mean_s' of the spans; of other motions
    than main ones with '_sport', '_dance', '_other' behind them.
    """
    numbers: dict[str, float] = {}
    for group, settings in counted.items():
        suffix = suffix_of(group)
        for setting, hiding in settings.items():
            rows = {f"{n}_share": float(share) for n, share in enumerate(hiding.shares)}
            rows |= {"hidden_share": hiding.hidden, "any_share": float(hiding.shares[1:].sum())}
            rows |= {"several_share": float(hiding.shares[3:].sum()), "short_share": hiding.shorter(SHORT)}
            spans = hiding.spans if len(hiding.spans) else np.array([np.nan])
            rows |= {"median_s": float(np.median(spans)), "mean_s": float(spans.mean())}
            numbers |= {f"{setting}_{key}{suffix}": value for key, value in rows.items()}
    return finite(numbers)


def occlusion_report(counted: Counted, cameras: CameraRing, data: DataSet | None, census: Census) -> Report:
    """Return the table; without a data set, of synthesised motion."""
    minutes = sum(settings["both"].at_once.sum() for settings in counted.values()) / 60
    synthesised = f"Synthesised motion of two hands, {minutes:.1f} minutes; no body stands in the way."
    main = counted.get("main") or next(iter(counted.values()))
    heights = " and ".join(f"{height:+g}" for height in cameras.heights)
    ring = (
        f"{cameras.count} cameras, {cameras.radius:g} m from the hands, {heights} m above them; a marker is found "
        f"where {cameras.least} see it within {cameras.beam:g}° of the way that it faces."
    )
    return Report(
        name="gloves-occlusion",
        title="Two hands, Figs 13 and 14: hidden markers of gloves",
        columns=("motion", "", *SETTINGS.values(), "published, one hand"),
        rows=tuple(row for group in GROUPS if group in counted for row in _rows(group, counted[group])),
        numbers=numbers_of(counted) | (census.numbers() if data else {"minutes": minutes}),
        data=(describe_data(data, census) if data else synthesised, ring),
        remarks=tuple(_remarks(main)),
        caption="Share of the time, %; of the spans in which a marker is hidden, %; their median, s. One hand: the "
        f"other is taken away. Both hands: of {2 * len(MARKERS)} markers. At {RATE:g} Hz.",
    )


def _rows(group: str, settings: Mapping[Setting, MarkerHiding]) -> Iterator[tuple[Cell, ...]]:
    columns = [settings[setting] for setting in SETTINGS]
    yield (group, "no marker hidden", *(100 * float(one.shares[0]) for one in columns), None)
    for n in range(1, 5):
        yield (group, f"{n} hidden at once", *(100 * float(one.shares[n]) for one in columns), None)
    yield (group, "5 or more hidden", *(100 * float(one.shares[5:].sum()) for one in columns), None)
    few = [one.at_once[1:5].sum() for one in columns]
    for n, published in enumerate(PUBLISHED_AT_ONCE, start=1):
        shares = (100 * float(one.at_once[n] / most) if most else None for one, most in zip(columns, few, strict=True))
        yield (group, f"{n}, where 1 to 4 are", *shares, 100 * published)
    shorter = [cell(100 * one.shorter(SHORT)) for one in columns]
    yield (group, f"spans below {SHORT:g} s", *shorter, 100 * PUBLISHED_SHORT)
    yield (group, "median span, s", *(float(np.median(one.spans)) if len(one.spans) else None for one in columns), None)


def _remarks(main: Mapping[Setting, MarkerHiding]) -> Iterator[str]:
    one, each, both = (main[setting] for setting in SETTINGS)
    several = [100 * float(hiding.shares[3:].sum()) for hiding in (one, each, both)]
    holds = "holds" if several[2] > several[0] else "does not hold"
    yield (
        f"More than two markers are hidden more often with two hands: {holds} (one hand {several[0]:.1f} %, each of "
        f"two {several[1]:.1f} %, both {several[2]:.1f} % of the time)."
    )
    if len(one.spans) and len(each.spans):
        means = [float(hiding.spans.mean()) for hiding in (one, each)]
        longer = "holds" if means[1] > means[0] else "does not hold"
        yield f"For longer, too: {longer} (mean span: one hand {means[0]:.2f} s, each of two {means[1]:.2f} s)."
        share = 100 * one.shorter(SHORT)
        yield f"Spans below {SHORT:g} s: {share:.0f} % with one hand, published {100 * PUBLISHED_SHORT:.0f} %."
