"""The shipped three-point predictor: its table, beside an analytic upper body, the head alone, published figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from bodysense.body.skeleton import Skeleton
from bodysense.data.clip import Clip
from bodysense.estimators.three_point import ThreePoint
from bodysense.estimators.three_point_answers import load_three_point
from bodysense.estimators.three_point_state import ThreePointSettings
from bodysense.estimators.upper_body_ik import UpperBodyIk
from bodysense.evaluation.datasets import Census, DataSet, census_of, describe
from bodysense.evaluation.full_body import FullBodyScores, Stage, evaluate_full_body
from bodysense.evaluation.headset import GROUPS
from bodysense.evaluation.report import Cell, Report, cell, finite
from bodysense.export.chart import BarPanel, plain_bars
from bodysense.occlusion.three_point import HEAD_ONLY

HEIGHTS = (1.5, 1.7, 2.0)  # m
# AMASS, 60 Hz, as quoted by the later papers: component rotation error °, MPJPE cm, velocity cm/s, jitter.
PUBLISHED = {
    "HMD-VAE (as quoted)": (4.11, 6.83, 37.99, None),
    "AvatarPoser": (3.08, 4.18, 27.70, 14.49),
    "AGRoL (offline)": (2.66, 3.71, 18.59, 7.26),
    "EgoPoser": (2.90, 3.80, 24.26, 14.89),
    "AvatarJLM": (2.90, 3.35, 20.79, 8.39),
    "SAGE": (2.53, 3.28, 20.62, 6.55),
    "HMD-Poser": (2.29, 3.15, 17.52, 6.21),
    "KineST": (2.25, 2.86, 15.26, 5.97),
    "FisherPoser": (2.04, 2.97, 20.52, 5.33),
}
MEASURES = (
    *("mpjpe_cm", "lower_mpjpe_cm", "upper_mpjpe_cm", "hands_mpjpe_cm", "rotation_deg", "mpjre_component_deg"),
    *("velocity_cm_s", "jitter", "skate_cm_s", "penetration_cm"),
)


@dataclass(frozen=True)
class ThreePointTable:
    """Scores of the predictor and of what stands beside it."""

    shipped: FullBodyScores
    unlocked: FullBodyScores  # the network's answer as it is: feet not held, not kept above the floor
    head_only: FullBodyScores
    baseline: FullBodyScores  # the analytic upper body, its legs standing
    heights: dict[float, FullBodyScores]  # the same clips on bodies of other heights
    untold: FullBodyScores  # the wearer's height is taken from the headset

    def numbers(self) -> dict[str, float]:
        """One flat object; keys without a group at their end are over the main categories. `best_` is tracked."""
        result: dict[str, float] = {}
        for group in GROUPS:
            suffix = "" if group == "main" else f"_{group}"
            for measure in MEASURES:
                result[f"best_{measure}{suffix}"] = self.shipped.get(measure, "tracked", group)
                result[f"estimate_{measure}{suffix}"] = self.shipped.get(measure, "estimate", group)
                result[f"head_only_{measure}{suffix}"] = self.head_only.get(measure, "tracked", group)
                result[f"baseline_{measure}{suffix}"] = self.baseline.get(measure, "estimate", group)
            for measure in ("jitter", "skate_cm_s", "penetration_cm"):
                result[f"truth_{measure}{suffix}"] = self.shipped.get(measure, "truth", group)
            for measure in ("skate_cm_s", "penetration_cm", "mpjpe_cm"):
                result[f"unlocked_{measure}{suffix}"] = self.unlocked.get(measure, "estimate", group)
        for measure in ("head_world_cm", "head_world_deg", "hands_world_cm", "head_far_share", "hands_far_share"):
            result[f"best_{measure}"] = self.shipped.get(measure)
        for height, scores in self.heights.items():
            result[f"height_{height:.1f}_mpjpe_cm"] = scores.get("mpjpe_cm", "estimate")
        for measure in ("mpjpe_cm", "height_error_cm", "refused"):
            result[f"untold_{measure}"] = self.untold.get(measure, "estimate")
        return finite(result)


def shipped_on(skeleton: Skeleton, model: Path | None, held: bool = True) -> ThreePoint:
    """The predictor on a wearer's skeleton; without `held`, the network's answer as it is."""
    settings = ThreePointSettings() if held else ThreePointSettings(feet=None)
    return ThreePoint(skeleton, load_three_point(model), settings)


def evaluate_three_point(
    data: DataSet, model: Path | None, jobs: int, advance: Callable[[Clip], None]
) -> tuple[ThreePointTable, Census]:
    """Score the predictor and what stands beside it on a data set; `advance` is told of every clip of every pass."""
    census = Census()

    def count(clip: Clip) -> None:
        nonlocal census
        census += census_of(clip)
        advance(clip)

    make = partial(shipped_on, model=model)
    one = partial(evaluate_full_body, jobs=jobs, advance=advance)
    table = ThreePointTable(
        shipped=evaluate_full_body(data.clips(), make, jobs=jobs, advance=count),
        unlocked=one(data.clips(), partial(make, held=False), tracked=False),
        head_only=one(data.clips(), make, HEAD_ONLY),
        baseline=one(data.clips(), UpperBodyIk, tracked=False),
        heights={height: one(data.clips(), make, tracked=False, height=height) for height in HEIGHTS},
        untold=one(data.clips(), make, tracked=False, measured=True),
    )
    return table, census


PASSES = 5 + len(HEIGHTS)


def three_point_report(table: ThreePointTable, census: Census, data: DataSet) -> Report:
    """The table as it is handed out."""
    return Report(
        name="three-point",
        title="A whole body from a headset and two hands",
        columns=(
            *("motion", "method", "MPJPE", "lower", "upper", "hands", "rotation", "component", "velocity", "jitter"),
            *("skate", "under floor"),
        ),
        rows=tuple(_rows(table)),
        numbers=table.numbers() | census.numbers(),
        data=(describe(data, census),),
        remarks=tuple(_remarks(table)),
        remarks_title="What it comes to",
        caption="22 joints. cm from the head; geodesic local rotation and mean difference of axis-angle components, °; "
        "cm/s; jitter 10² m/s³; skate cm/s of feet that truly stand; depth of foot points, cm. Averages over frames at "
        "30 Hz. Published: AMASS at 60 Hz, by other people's splits; to be read beside ours, not against them.",
        digits=2,
        panels=(_panel(table),),
    )


def _panel(table: ThreePointTable) -> BarPanel:
    """Position errors of every group of motions that was scored."""
    groups = tuple(group for group in GROUPS if cell(table.shipped.get("mpjpe_cm", "tracked", group)) is not None)
    methods: tuple[tuple[str, FullBodyScores, Stage], ...] = (
        ("bodysense", table.shipped, "tracked"),
        ("head only", table.head_only, "tracked"),
        ("analytic upper body", table.baseline, "estimate"),
    )
    series = [
        plain_bars(name, [cell(scores.get("mpjpe_cm", stage, group)) for group in groups])
        for name, scores, stage in methods
    ]
    return BarPanel("whole body, from the head", groups, tuple(series), "MPJPE, cm")


def _rows(table: ThreePointTable) -> Iterator[tuple[Cell, ...]]:
    for group in GROUPS:
        rows: tuple[tuple[str, FullBodyScores, Stage], ...] = (
            ("bodysense", table.shipped, "tracked"),
            ("its network, feet held", table.shipped, "estimate"),
            ("its network alone", table.unlocked, "estimate"),
            ("bodysense, head only", table.head_only, "tracked"),
            ("analytic upper body, legs standing", table.baseline, "estimate"),
            ("the motion itself", table.shipped, "truth"),
        )
        for name, scores, stage in rows:
            values = [cell(scores.get(measure, stage, group)) for measure in MEASURES]
            if any(value is not None for value in values):
                yield (group, name, *values)
    for name, (component, position, velocity, jerk) in PUBLISHED.items():
        yield ("published", name, position, None, None, None, None, component, velocity, jerk, None, None)


def _remarks(table: ThreePointTable) -> Iterator[str]:
    numbers = table.numbers()
    ours, base = (numbers.get(f"{name}_mpjpe_cm") for name in ("best", "baseline"))
    if ours is not None and base:
        yield f"{ours / base:.2f} of the error of the analytic upper body with standing legs ({base:.1f} cm)."
    jerk, true = numbers.get("best_jitter"), numbers.get("truth_jitter")
    if jerk is not None and true:
        yield f"Jitter {jerk / true:.2f} of the motion's own."
    errors = {height: numbers.get(f"height_{height:.1f}_mpjpe_cm") for height in HEIGHTS}
    middle = errors[1.7]
    if middle:
        shares = ", ".join(
            f"{height:.1f} m {error:.2f} cm ({error / height / (middle / 1.7) - 1:+.1%} of its height's share)"
            for height, error in errors.items()
            if error is not None
        )
        yield f"On bodies of other heights: {shares}."
    untold, away, refused = (numbers.get(f"untold_{name}") for name in ("mpjpe_cm", "height_error_cm", "refused"))
    if untold is not None and away is not None and refused is not None:
        yield (
            f"With the height taken from the headset, {away:.1f} cm off on average: {untold:.2f} cm, over all but "
            f"{refused:.0%} of the frames, in whose clips nobody stands."
        )
