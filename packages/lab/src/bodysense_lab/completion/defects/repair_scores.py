"""Scores of repair: made-up defects that are found, clean frames that are called defective, and what repair leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.quality.defects import KINDS, Defect, find_defects
from bodysense.takes.repair import repair
from bodysense_lab.completion.defects.made_defects import MAKERS, MadeDefect
from bodysense_lab.core.table import Cell, Report, finite

RATE, SECONDS = 30.0, 12.0  # Hz; s of a clip that is used
SHORTEST = 4.0  # s; shorter clips are left out


@dataclass
class RepairScores:
    """Sums over clips."""

    frames: int = 0
    flagged: dict[str, int] = field(default_factory=lambda: dict.fromkeys((*KINDS, "any"), 0))
    made: dict[str, int] = field(default_factory=lambda: dict.fromkeys(MAKERS, 0))
    found: dict[str, int] = field(default_factory=lambda: dict.fromkeys(MAKERS, 0))
    before: dict[str, list[float]] = field(default_factory=lambda: {kind: [] for kind in MAKERS})  # m
    after: dict[str, list[float]] = field(default_factory=lambda: {kind: [] for kind in MAKERS})  # m
    slid: list[float] = field(default_factory=list)  # m/s of feet whose slides were repaired


def score_repair(clips: Iterable[Clip], advance: Callable[[Clip], None] = lambda clip: None) -> RepairScores:
    """Make a defect of each kind in every clip, and count what is found, wrongly found and repaired."""
    rng, scores = np.random.default_rng(1), RepairScores()
    for clip in clips:
        if clip.seconds >= SHORTEST:
            at_rate = resample(clip, RATE)
            begin = int(rng.integers(0, max(1, len(at_rate) - round(SECONDS * RATE))))
            piece = at_rate.pose[begin : begin + round(SECONDS * RATE)]
            _score_clip(Clip(at_rate.name, piece, at_rate.frame_rate, at_rate.person), rng, scores)
        advance(clip)
    return scores


def _score_clip(clip: Clip, rng: np.random.Generator, scores: RepairScores) -> None:
    clean = find_defects(clip.pose, clip.frame_rate)
    scores.frames += len(clip)
    for kind in (*KINDS, "any"):
        scores.flagged[kind] += int(_flagged(len(clip), [one for one in clean if kind in ("any", one.kind)]).sum())
    for kind, make in MAKERS.items():
        made = make(clip, rng)
        if made is None:
            continue
        scores.made[kind] += 1
        defects = find_defects(made.clip.pose, clip.frame_rate, [kind])
        if not is_found(made, defects):
            continue
        scores.found[kind] += 1
        mended = repair(made.clip, only=[kind]).take.clip
        span, joints = slice(made.first, made.last + 1), clip.pose.skeleton.indices(_carried(clip, made))
        truth, wrong, right = (np.asarray(forward_kinematics(one.pose)[0]) for one in (clip, made.clip, mended))
        for errors, place in ((scores.before, wrong), (scores.after, right)):
            errors[kind].append(float(np.linalg.norm((place - truth)[span][:, joints], axis=-1).mean()))
        if kind == "slide":
            ankle = right[span][:, clip.pose.skeleton.index(made.joints[-1])]
            speed = np.linalg.norm(np.diff(ankle[:, [0, 2]], axis=0), axis=-1) * clip.frame_rate
            scores.slid.append(float(speed.mean()))


def _carried(clip: Clip, made: MadeDefect) -> list[str]:
    """Return the points that the wrong joints carry, fingers not counted."""
    skeleton = clip.pose.skeleton
    wrong = set(skeleton.indices(made.joints))
    found = set(wrong)
    for point, parent in enumerate(skeleton.parents):
        if parent in found:
            found.add(point)
    tops = {joint for joint in wrong if skeleton.parents[joint] not in wrong}  # they turn, but do not move
    return [skeleton.points[k] for k in sorted(found - tops) if k < 22]


def _flagged(frames: int, defects: Iterable[Defect]) -> np.ndarray:
    """Return (frames,) bool: a defect covers the frame."""
    flagged = np.zeros(frames, dtype=bool)
    for defect in defects:
        flagged[defect.first : defect.last + 1] = True
    return flagged


def is_found(made: MadeDefect, defects: Iterable[Defect]) -> bool:
    """Whether defects cover at least half of a made one, in one of its joints."""
    right = [defect for defect in defects if defect.kind == made.kind and defect.joint in made.joints]
    return bool(_flagged(made.last + 1, right)[made.first :].mean() >= 0.5)


def repair_report(scores: RepairScores, name: str) -> Report:
    """Return the table: a row for each kind of defect."""
    rows: list[tuple[Cell, ...]] = []
    numbers: dict[str, float] = {}
    for kind in MAKERS:
        made, found = scores.made[kind], scores.found[kind]
        share = 100 * found / made if made else np.nan
        false = 100 * scores.flagged[kind] / max(scores.frames, 1)
        before, after = (
            100 * float(np.mean(part[kind])) if part[kind] else np.nan for part in (scores.before, scores.after)
        )
        rows.append((kind, made, share, false, before, after, after / before))
        numbers |= {f"{kind}_made": float(made), f"{kind}_found_percent": share, f"{kind}_false_percent": false}
        numbers |= {f"{kind}_before_cm": before, f"{kind}_after_cm": after}
    others = {f"{kind}_false_percent": 100 * scores.flagged[kind] / max(scores.frames, 1) for kind in (*KINDS, "any")}
    slid = 100 * float(np.mean(scores.slid)) if scores.slid else np.nan
    return Report(
        name="repair",
        title=f"Defects found and repaired in {name}",
        columns=("defect", "made", "found %", "false %", "before cm", "after cm", "ratio"),
        rows=tuple(rows),
        numbers=finite(numbers | others | {"repaired_foot_cm_s": slid, "frames": float(scores.frames)}),
        caption=f"One defect of each kind in every clip of {SHORTEST:g} s or more ({SECONDS:g} s of it, {RATE:g} Hz). "
        "False: share of the frames of true motion in which a defect of the kind is found; of any kind: "
        f"{others['any_false_percent']:.2f} %. Before and after: mean error of the points that the wrong joints carry. "
        f"A repaired foot slides at {slid:.2f} cm/s.",
        digits=2,
    )
