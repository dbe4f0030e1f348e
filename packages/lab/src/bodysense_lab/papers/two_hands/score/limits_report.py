"""The table of the limits of the paper's gloves (`limits`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense_lab.core.scoring import GROUPS
from bodysense_lab.core.table import Cell, Report, finite
from bodysense_lab.data.datasets import Census, DataSet, describe_data
from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED
from bodysense_lab.papers.two_hands.score.limits import COUNTED, JUMP, SPIKES, TOUCHING, Findings
from bodysense_lab.synthesis.motion import RATE


class LimitLine(NamedTuple):
    """A row: the limit, its figure, and the keys of the truth, of the output without rejection, and of the output."""

    limit: str
    figure: str
    keys: tuple[str | None, str | None, str | None]
    factor: float = 1.0


def _both(limit: str, figure: str, key: str, factor: float = 1.0, truth: bool = True) -> LimitLine:
    return LimitLine(limit, figure, (f"{key}_truth" if truth else None, None, f"{key}_output"), factor)


LINES = (
    _both("hands in each other", "frames, %", "mutual_penetrating_share", 100),
    _both("hands in each other", "mean depth in these, mm", "mutual_penetration_mm"),
    _both("hands in each other", "deepest, mm", "mutual_deepest_mm"),
    _both("fingers in their own hand", "frames, %", "own_penetrating_share", 100),
    _both("fingers in their own hand", "mean depth in these, mm", "own_penetration_mm"),
    _both("fingers in their own hand", "deepest, mm", "own_deepest_mm"),
    _both("fingertips that touch", "gap, mm", "touch_gap_mm"),
    _both("fingertips that touch", "of these still touch, %", "touch_kept_share", 100),
    _both("thumb and index that touch", "gap, mm", "pinch_gap_mm"),
    _both("thumb and index that touch", "error of the gap, mm", "pinch_error_mm", truth=False),
    _both("all points", "mean error, cm", "error_cm", truth=False),
    _both("jumps", "largest, mm", "largest_jump_mm", truth=False),
    _both("jumps", "frames, %", "jump_share", 100, truth=False),
    _both("changes of the error", "largest, mm a frame", "largest_error_step_mm", truth=False),
    _both("changes of the error", "frames above 5 mm, %", "error_step_share", 100, truth=False),
    *(
        LimitLine(
            "wrong markers",
            f"mean error with {100 * share:g} % of them, cm",
            (None, f"spikes_{100 * share:g}_error_cm_believed", f"spikes_{100 * share:g}_error_cm_rejected"),
        )
        for share in SPIKES
    ),
    LimitLine("markers without names", "named rightly, of those seen, %", (None, None, "label_accuracy_share"), 100),
    LimitLine("markers without names", "named wrongly, of those seen, %", (None, None, "label_wrong_share"), 100),
)


def limits_report(
    found: Mapping[str, Findings], cameras: CameraRing, data: DataSet | None, census: Census, seconds: float
) -> Report:
    """Return the table of `found`: by group of categories, and as `SYNTHESISED` of `seconds` s of synthesised motion.

    Numbers: `{own,mutual,any}_penetrating_share_…`, of the frames, `…_penetration_mm_…`, mean depth in these, and
    `…_deepest_mm_…`; `touch_gap_mm_…`, `touch_kept_share_…` and `pinch_gap_mm_…`, `pinch_error_mm_…` of fingertips
    that touch in truth; `error_cm_…`; `largest_jump_mm_…` and `jump_share_…`, of the frames, and of changes of the
    error `largest_error_step_mm_…` and `error_step_share_…`: each with 'truth' or 'output'.
    `spikes_{0,1,5}_error_cm_{believed,rejected}`; `label_accuracy_share` and `label_wrong_share`.
    Keys of other than the main motion end in '_sport', '_dance' or '_other', those of synthesised hands begin with
    'synthesised_'.
    """
    numbers = {group: one.numbers() for group, one in found.items()}
    places = [group for group in (*GROUPS, SYNTHESISED) if group in numbers]
    sentences = [f"Synthesised motion of two hands, {seconds / 60:.1f} minutes; no body stands in the way."]
    if data is not None:
        sentences = [describe_data(data, census), *sentences]
    heights = " and ".join(f"{height:+g}" for height in cameras.heights)
    sentences.append(f"{cameras.count} cameras, {cameras.radius:g} m from the hands, {heights} m above them.")
    rows: list[tuple[Cell, ...]] = []
    for place in places:
        for line in LINES:
            values = [None if key is None else numbers[place].get(key) for key in line.keys]
            if any(one is not None for one in values):
                cells = (None if one is None else line.factor * one for one in values)
                rows.append((place, line.limit, line.figure, *cells))
    return Report(
        name="gloves-limits",
        title="Two hands: its limits",
        columns=("motion", "limit", "figure", "truth", "without rejection", "output"),
        rows=tuple(rows),
        numbers=finite(_flat(numbers)) | (census.numbers() if data else {}),
        data=tuple(sentences),
        remarks=tuple(_remarks(numbers)),
        remarks_title="What is reached",
        caption=f"At {RATE:g} Hz. A penetration is deeper than {1000 * COUNTED:g} mm beyond what flesh gives way; "
        f"fingertips touch within {1000 * TOUCHING:g} mm; a point jumps that goes {1000 * JUMP:g} mm farther from "
        "frame to frame than in truth.",
        digits=2,
    )


def _flat(numbers: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """One object, with what stands behind or in front of keys."""
    flat = {}
    for place, values in numbers.items():
        prefix = f"{SYNTHESISED}_" if place == SYNTHESISED else ""
        suffix = "" if place in ("main", SYNTHESISED) else f"_{place}"
        flat |= {f"{prefix}{key}{suffix}": value for key, value in values.items()}
    return flat


def _remarks(numbers: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    for place, values in numbers.items():
        jump = values.get("largest_jump_mm_output")
        if jump is not None:
            verdict = "none" if jump <= 1000 * JUMP else f"the largest is {jump:.1f} mm"
            yield f"Jumps above {1000 * JUMP:g} mm that are not in the truth, {place} motion: {verdict}."
        share, true = values.get("any_penetrating_share_output"), values.get("any_penetrating_share_truth")
        if share is not None and true is not None:
            yield f"Penetrating frames, {place} motion: {100 * share:.1f} %, in truth {100 * true:.1f} %."
