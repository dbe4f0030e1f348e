"""User study (UNOC, section 5.1, Fig. 6; reproduce.md 1.18): key, answers of raters, and their mean preferences.

Each scene is rendered under three conditions. A rater sees every pair of every scene once, side by side, and chooses
the more natural one or neither. Animations have opaque names. The key maps them to conditions and is never served.
A vote is +1 for the first of a comparison and −1 for the second. As in the paper, a value is a rater's mean vote over
the scenes, tested against zero; votes of one rater are not independent, so they are never pooled. p is not corrected
for the number of tests.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from scipy import stats

from bodysense.errors import BodysenseError
from bodysense.files import read_json, write_json

Condition = Literal["truth", "ours", "baseline"]
CONDITIONS: tuple[Condition, ...] = get_args(Condition)
COMPARISONS: tuple[tuple[Condition, Condition], ...] = (("truth", "ours"), ("ours", "baseline"), ("truth", "baseline"))
SIGNS = {"left": 1, "right": -1, "none": 0}  # of choices
KEY_FORMAT, ANSWERS_FORMAT = "bodysense study key 1", "bodysense study answers 1"


@dataclass(frozen=True)
class StudyKey:
    """Key to the animations of a study."""

    study: str  # opaque name
    scenes: dict[str, dict[str, Condition]]  # condition of each animation, by the scene's name

    def comparison(self, left: str, right: str) -> tuple[int, int, int]:
        """Return scene and comparison of a pair, and 1, or −1 in reverse order. Raises KeyError for other names."""
        for scene, clips in enumerate(self.scenes.values()):
            if left in clips and right in clips and left != right:
                pair = (clips[left], clips[right])
                reverse = pair not in COMPARISONS
                return scene, COMPARISONS.index(pair[::-1] if reverse else pair), -1 if reverse else 1
        raise KeyError(f"{left}, {right}")


@dataclass(frozen=True)
class Preference:
    """A mean vote in [−1, 1], positive for the first of a comparison, tested against zero."""

    mean: float
    standard_error: float  # NaN for fewer than two votes
    t: float  # Student's, n − 1 degrees of freedom; infinite if all agree, NaN without a test
    p: float  # two-sided
    n: int


def draw_key(scenes: Sequence[str], generator: np.random.Generator) -> StudyKey:
    """Draw a key with new opaque names for the animations of named scenes.

    Every ring is truth → ours → baseline from a random start, so that the page can balance sides without the key.
    """

    def opaque() -> str:
        return generator.bytes(6).hex()

    starts = generator.integers(len(CONDITIONS), size=len(scenes))
    rings = [CONDITIONS[start:] + CONDITIONS[:start] for start in starts]
    clips: dict[str, dict[str, Condition]] = {
        name: {opaque(): one for one in ring} for name, ring in zip(scenes, rings, strict=True)
    }
    return StudyKey(opaque(), clips)


def write_key(path: Path, key: StudyKey) -> None:
    """Write a key as JSON."""
    write_json(path, {"format": KEY_FORMAT, "study": key.study, "scenes": key.scenes})


def read_key(path: Path) -> StudyKey:
    """Read a key. Raises BodysenseError for another kind of file."""
    content = _read(path, KEY_FORMAT, "give the key.json that `bodysense study build` wrote")
    scenes: Any = content.get("scenes")
    sound = isinstance(scenes, dict) and scenes and all(isinstance(clips, dict) for clips in scenes.values())
    if not sound or any(sorted(map(str, clips.values())) != sorted(CONDITIONS) for clips in scenes.values()):
        raise BodysenseError(
            f"{path}: not every scene has an animation each of {', '.join(CONDITIONS)}; build the study again"
        )
    return StudyKey(str(content.get("study")), scenes)


def read_votes(path: Path, key: StudyKey) -> tuple[str, np.ndarray]:
    """Read a rater's name and votes (scenes, comparisons). Raises BodysenseError unless every pair is answered once."""
    content = _read(path, ANSWERS_FORMAT, "give a file that the study's page saved")
    if content.get("study") != key.study:
        raise BodysenseError(f"{path}: answers of study {content.get('study')!r}, but the key is of {key.study!r}")
    cast = np.full((len(key.scenes), len(COMPARISONS)), np.nan)
    try:
        for row in content["answers"]:
            scene, which, sign = key.comparison(row["left"], row["right"])
            if not np.isnan(cast[scene, which]):
                raise BodysenseError(f"{path}: {row['left']}, {row['right']} is answered twice; save the answers again")
            cast[scene, which] = sign * SIGNS[row["choice"]]
        rater = str(content["rater"])
    except (KeyError, TypeError) as error:
        raise BodysenseError(f"{path}: not answers of this study ({error!r}); save them again") from None
    if missing := int(np.isnan(cast).sum()):
        raise BodysenseError(f"{path}: {missing} of {cast.size} pairs are not answered; let the rater finish")
    return rater, cast


def read_all_votes(paths: Sequence[Path], key: StudyKey) -> np.ndarray:
    """Read the votes (raters, scenes, comparisons) of all raters. Raises BodysenseError for a repeated rater."""
    if not paths:
        raise BodysenseError("no answers are given; name at least one file that the study's page saved")
    found: dict[str, np.ndarray] = {}
    for path in paths:
        rater, cast = read_votes(path, key)
        if rater in found:
            raise BodysenseError(f"{path}: rater {rater!r} has answered in another file, too; give one of them")
        found[rater] = cast
    return np.stack(list(found.values()))


def preference(values: np.ndarray) -> Preference:
    """Return the mean of values (n,) and Student's one-sample t-test of it against zero.

    Equal values have no variance: p is 0 if they differ from zero, and 1 if not.
    """
    n, mean = len(values), float(values.mean())
    if n < 2:
        return Preference(mean, math.nan, math.nan, math.nan, n)
    if values.min() == values.max():
        return Preference(mean, 0.0, math.copysign(math.inf, mean) if mean else math.nan, 0.0 if mean else 1.0, n)
    t, p = map(float, stats.ttest_1samp(values, 0.0))
    return Preference(mean, float(stats.sem(values)), t, p, n)


def preferences(key: StudyKey, cast: np.ndarray) -> dict[str, list[Preference]]:
    """Return the preferences for each of `COMPARISONS` by scene, and over all scenes as '(all)'."""
    values = {name: cast[:, scene] for scene, name in enumerate(key.scenes)} | {"(all)": cast.mean(axis=1)}
    return {name: [preference(votes) for votes in of.T] for name, of in values.items()}


def study_numbers(found: Mapping[str, list[Preference]]) -> dict[str, float]:
    """Return one flat object: `truth_over_ours_mean`, `<scene>_truth_over_ours_p` …; finite values only."""
    numbers: dict[str, float] = {"raters": found["(all)"][0].n, "scenes": len(found) - 1}
    for scene, rows in found.items():
        for (first, second), one in zip(COMPARISONS, rows, strict=True):
            key = f"{first}_over_{second}" if scene == "(all)" else f"{scene}_{first}_over_{second}"
            numbers |= {f"{key}_{name}": getattr(one, name) for name in ("mean", "standard_error", "t", "p")}
    return {key: value for key, value in numbers.items() if math.isfinite(value)}


def write_simulated_answers(
    folder: Path,
    key: StudyKey,
    raters: int,
    quality: Mapping[Condition, float],
    rng: np.random.Generator,
    ties: float = 0.2,
) -> None:
    """Write answers of simulated raters; the mean vote on a pair is the difference of its conditions' quality.

    Votes are independent. The share of 'no difference' is `ties` for equal
    quality and falls to 0 for a difference of ±1. Raises BodysenseError for a difference beyond that.
    """
    for first, second in COMPARISONS:
        if not abs(quality[first] - quality[second]) <= 1:
            raise BodysenseError(f"quality of {first} and {second}: mean votes, their differences, are from -1 to 1")
    for number in range(1, raters + 1):
        rows = []
        for clips in key.scenes.values():
            clip_of = {condition: clip for clip, condition in clips.items()}
            for pair in COMPARISONS:
                left, right = pair if rng.random() < 0.5 else pair[::-1]  # sides
                mean = quality[left] - quality[right]
                equal = ties * (1 - abs(mean))
                odds = [(1 - equal + mean) / 2, (1 - equal - mean) / 2, equal]
                rows.append({"left": clip_of[left], "right": clip_of[right], "choice": rng.choice(list(SIGNS), p=odds)})
        rater = f"simulated-{number:03d}"
        answers = {"format": ANSWERS_FORMAT, "study": key.study, "rater": rater, "answers": rows}
        write_json(folder / f"answers-{rater}.json", answers)


def _read(path: Path, form: str, fix: str) -> dict[str, Any]:
    """Return the object in a JSON file of format `form`."""
    content = read_json(path, fix)
    if not isinstance(content, dict) or content.get("format") != form:
        raise BodysenseError(f"{path}: its format is not {form!r}; {fix}")
    return content
