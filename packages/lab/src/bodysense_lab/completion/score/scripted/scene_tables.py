"""Tables of scripted scenes: errors by scene and set, visible faults by set, and heads of real headsets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from bodysense_lab.completion.score.scores import RunningScores
from bodysense_lab.completion.score.scripted.scene_scoring import SETS, SceneJob
from bodysense_lab.core.table import Cell, Report, finite

# Measures by set: key, title, and factor to the unit of the title.
FAULTS = (
    ("error_cm", "error, cm", 1.0),
    ("legs_cm", "legs, cm", 1.0),
    ("arms_cm", "arms, cm", 1.0),
    ("missed_steps_share", "missing steps, %", 100.0),
    ("false_steps_per_minute", "false steps a minute", 1.0),
    ("gliding_share", "gliding, %", 100.0),
    ("crossed_share", "crossed legs, %", 100.0),
    ("float_standing_share", "float standing, %", 100.0),
    ("float_bowing_share", "float bowing, %", 100.0),
    ("float_kneeling_share", "float kneeling, %", 100.0),
    ("kneeling_legs_cm", "legs kneeling, cm", 1.0),
    ("knee_off_deg", "knees off, °", 1.0),
    ("standing_knee_excess_deg", "standing knees bent too far, °", 1.0),
    ("turn_lag_deg", "pelvis behind in turns, °", 1.0),
    ("turn_off_deg", "pelvis off in turns, °", 1.0),
    ("lost_hand_cm", "lost hand, cm", 1.0),
    ("lost_low_hand_cm", "lost low hand, cm", 1.0),
    ("under_floor_share", "under the floor, %", 100.0),
    ("covered_share", "within the bound, %", 100.0),
)
_PALMS = {"none": "head alone", "hanging": "palms hanging", "inward": "palms inward", "down": "palms down"}
Scored = Mapping[tuple[str, str], RunningScores]  # by kind and set


def merge_scores(done: Iterable[tuple[SceneJob, Mapping[str, RunningScores]]]) -> dict[tuple[str, str], RunningScores]:
    """Return the scores of all scenes by kind and set."""
    merged: dict[tuple[str, str], RunningScores] = {}
    for job, by_set in done:
        for name, scores in by_set.items():
            merged.setdefault((job.kind, name), RunningScores()).merge(scores)
    return merged


def scene_reports(scored: Scored, headsets: Mapping[str, RunningScores], what: str) -> list[Report]:
    """Return the tables: errors by scene, faults by set, bounds by scene, and real headsets if they were scored."""
    kinds = list(dict.fromkeys(kind for kind, _ in scored))
    sets = list(dict.fromkeys(name for _, name in scored))
    whole = {name: _whole(scored, name) for name in sets}
    reports = [
        _by_scene(scored, kinds, sets, what),
        _by_set(whole, sets, what),
        _faults_by_scene(scored, kinds, sets),
    ]
    if headsets:
        reports.append(_of_headsets(headsets))
    return reports


def scene_numbers(scored: Scored, headsets: Mapping[str, RunningScores]) -> dict[str, float]:
    """Return all figures as one flat object: of each set, of each scene and set, and of real headsets."""
    numbers: dict[str, float] = {}
    for name in dict.fromkeys(name for _, name in scored):
        numbers |= {f"scenes_{name}_{key}": value for key, value in _whole(scored, name).numbers().items()}
    for (kind, name), scores in scored.items():
        numbers |= {f"scenes_{name}_{kind}_{key}": value for key, value in scores.numbers().items()}
    for palms, scores in headsets.items():
        numbers |= {f"headset_{palms}_{key}": value for key, value in scores.numbers().items()}
    return finite(numbers)


def _whole(scored: Scored, name: str) -> RunningScores:
    """Return the scores of all scenes of a set."""
    whole = RunningScores()
    for (_, which), scores in scored.items():
        if which == name:
            whole.merge(scores)
    return whole


def _by_scene(scored: Scored, kinds: list[str], sets: list[str], what: str) -> Report:
    rows: list[tuple[Cell, ...]] = []
    for kind in kinds:
        cells = [scored[kind, name] for name in sets]
        rows.append((kind.replace("_", " "), *(_triple(one) for one in cells)))
    rows.append(("mean", *(_triple(_whole(scored, name)) for name in sets)))
    return Report(
        name="scenes",
        title=f"Scripted scenes, {what}",
        columns=("scene", *(SETS[name].title for name in sets)),
        rows=tuple(rows),
        numbers={},
        caption="Mean error of 22 joints / of the legs / of the arms, cm. docs/evaluation.md defines the measures.",
    )


def _by_set(whole: Mapping[str, RunningScores], sets: list[str], what: str) -> Report:
    rows: list[tuple[Cell, ...]] = []
    for key, title, factor in FAULTS:
        values = [factor * whole[name].get(key) for name in sets]
        if any(math.isfinite(value) for value in values):
            rows.append((title, *(value if math.isfinite(value) else None for value in values)))
    return Report(
        name="scene-faults",
        title=f"Faults that a wearer sees, {what}",
        columns=("measure", *(SETS[name].title for name in sets)),
        rows=tuple(rows),
        numbers={},
        caption="Shares are of frames, of steps, or of hidden joints (bound).",
    )


def _faults_by_scene(scored: Scored, kinds: list[str], sets: list[str]) -> Report:
    """Return the faults of three points by scene, or of the first set."""
    name = "three_point" if "three_point" in sets else sets[0]
    shown = ("missed_steps_share", "gliding_share", "crossed_share", "float_standing_share", "covered_share")
    titles = {key: (title, factor) for key, title, factor in FAULTS}
    rows: list[tuple[Cell, ...]] = []
    for kind in kinds:
        values = [titles[key][1] * scored[kind, name].get(key) for key in shown]
        rows.append((kind.replace("_", " "), *(value if math.isfinite(value) else None for value in values)))
    return Report(
        name="scene-faults-by-scene",
        title=f"Faults by scene, {SETS[name].title}",
        columns=("scene", *(titles[key][0] for key in shown)),
        rows=tuple(rows),
        numbers={},
    )


def _of_headsets(headsets: Mapping[str, RunningScores]) -> Report:
    rows: list[tuple[Cell, ...]] = [
        (_PALMS[palms], 100 * scores.get("gliding_share"), 100 * scores.get("float_share"))
        for palms, scores in headsets.items()
    ]
    return Report(
        name="scene-headsets",
        title="Heads of real headsets, unknown bodies",
        columns=("hands", "gliding, %", "float, %"),
        rows=tuple(rows),
        numbers={},
    )


def _triple(scores: RunningScores) -> str:
    return "/".join(
        f"{scores.get(key):.{digits}f}" for key, digits in (("error_cm", 1), ("legs_cm", 0), ("arms_cm", 0))
    )
