"""User study (UNOC, section 5.1, Fig. 6; reproduce.md 1.18): pairs of animations for each rater, key, and answers.

Each scene is rendered under three conditions. A rater sees every pair of every scene once, side by side, and chooses
the more natural one or neither. Animations have opaque names. The key maps them to conditions and is never served.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import written_beside

Condition = Literal["truth", "ours", "baseline"]
Choice = Literal["left", "right", "none"]
CONDITIONS: tuple[Condition, ...] = get_args(Condition)
CHOICES: tuple[Choice, ...] = get_args(Choice)
# A vote is +1 for the first of a comparison, −1 for the second, 0 for no difference (Fig. 6 has the same order).
COMPARISONS: tuple[tuple[Condition, Condition], ...] = (("truth", "ours"), ("ours", "baseline"), ("truth", "baseline"))
KEY_FORMAT, ANSWERS_FORMAT = "bodysense study key 1", "bodysense study answers 1"

_WORD = 2**32


@dataclass(frozen=True)
class StudyScene:
    """One motion under every condition, as a ring of animations (`pairs_for` defines their order)."""

    name: str
    condition: dict[str, Condition]  # of every animation, by its opaque name, in the ring's order

    @property
    def ring(self) -> tuple[str, ...]:
        """Names of the animations in order, which is all that raters' pages contain of the scene."""
        return tuple(self.condition)


@dataclass(frozen=True)
class StudyKey:
    """Key to the animations of a study. `study` is its opaque name, which also determines each rater's order."""

    study: str
    scenes: tuple[StudyScene, ...]

    @cached_property
    def scene_of(self) -> dict[str, int]:
        """Index of the scene of every animation."""
        return {clip: index for index, scene in enumerate(self.scenes) for clip in scene.ring}

    def condition_of(self, clip: str) -> Condition:
        """Return the condition of an animation."""
        return self.scenes[self.scene_of[clip]].condition[clip]


@dataclass(frozen=True)
class Answers:
    """Choices of one rater in the order of the pairs: (left animation, right animation, choice)."""

    study: str
    rater: str
    given: tuple[tuple[str, str, Choice], ...]


def draw_key(scenes: Sequence[str], generator: np.random.Generator) -> StudyKey:
    """Draw a key with new opaque names for the animations of named scenes.

    Every ring is truth → ours → baseline from a random start. So the order of names reveals nothing, but equal
    directions of two rings give equal sides in their comparisons.
    """

    def opaque() -> str:
        return generator.bytes(6).hex()

    study, study_scenes = opaque(), []
    for name in scenes:
        start = int(generator.integers(len(CONDITIONS)))
        study_scenes.append(StudyScene(name, {opaque(): c for c in CONDITIONS[start:] + CONDITIONS[:start]}))
    return StudyKey(study, tuple(study_scenes))


def pairs_for(key: StudyKey, rater: str) -> list[tuple[str, str]]:
    """Return every pair of every scene, (left, right), in the order determined by the study and the rater's name.

    A ring is displayed forward in one half of the scenes and backward in the other. So, for each rater, each condition
    is equally often on the left and on the right (as in the paper). With an even number of scenes each comparison has
    both side orders equally often. The page does the same (study/assets/study.js, `pairsFor`).
    """
    generator = numbers(f"{key.study}:{rater}")
    count = len(key.scenes)
    half = count // 2 + (_below(generator, 2) if count % 2 else 0)
    turned = _shuffled(list(range(count)), generator)[:half]
    pairs = []
    for index, scene in enumerate(key.scenes):
        ring = scene.ring
        for place, clip in enumerate(ring):
            after = ring[(place + 1) % len(ring)]
            pairs.append((after, clip) if index in turned else (clip, after))
    return _shuffled(pairs, generator)


def numbers(text: str) -> Iterator[int]:
    """Yield pseudo-random integers below 2³² from a text: FNV-1a of its UTF-8 bytes, Mulberry32; as in study.js."""
    state = 0x811C9DC5
    for byte in text.encode():
        state = (state ^ byte) * 0x01000193 % _WORD
    while True:
        state = (state + 0x6D2B79F5) % _WORD
        mixed = (state ^ state >> 15) * (state | 1) % _WORD
        mixed ^= (mixed + (mixed ^ mixed >> 7) * (mixed | 61)) % _WORD
        yield mixed ^ mixed >> 14


def _below(generator: Iterator[int], limit: int) -> int:
    return next(generator) * limit // _WORD


def _shuffled(items: list[Any], generator: Iterator[int]) -> list[Any]:
    for last in range(len(items) - 1, 0, -1):
        other = _below(generator, last + 1)
        items[last], items[other] = items[other], items[last]
    return items


def write_key(path: str | Path, key: StudyKey) -> None:
    """Write a key as JSON."""
    scenes = [{"name": scene.name, "clips": scene.condition} for scene in key.scenes]
    _write(path, {"format": KEY_FORMAT, "study": key.study, "scenes": scenes})


def read_key(path: str | Path) -> StudyKey:
    """Read a key. Raises BodysenseError for another kind of file."""
    content = _read(path, KEY_FORMAT, "give the key.json that `bodysense study build` wrote")
    try:
        scenes = tuple(StudyScene(str(row["name"]), dict(row["clips"])) for row in content["scenes"])
        key = StudyKey(str(content["study"]), scenes)
    except (KeyError, TypeError, ValueError) as error:
        raise BodysenseError(f"{path}: the key lacks or misshapes a part ({error!r}); build the study again") from None
    wrong = [scene.name for scene in scenes if sorted(map(str, scene.condition.values())) != sorted(CONDITIONS)]
    if wrong or not scenes or len(key.scene_of) != len(CONDITIONS) * len(scenes):
        where = f"scene {wrong[0]!r} has not" if wrong else "its scenes have not"
        raise BodysenseError(f"{path}: {where} one animation each of {', '.join(CONDITIONS)}; build the study again")
    return key


def write_answers(path: str | Path, answers: Answers) -> None:
    """Write a rater's answers as the page does."""
    rows = [{"left": left, "right": right, "choice": choice} for left, right, choice in answers.given]
    _write(path, {"format": ANSWERS_FORMAT, "study": answers.study, "rater": answers.rater, "answers": rows})


def read_answers(path: str | Path, key: StudyKey) -> Answers:
    """Read a rater's answers. Raises BodysenseError unless they answer every pair of the key's study once."""
    content = _read(path, ANSWERS_FORMAT, "give a file that the study's page saved")
    try:
        rows = [(row["left"], row["right"], row["choice"]) for row in content["answers"]]
        answers = Answers(content["study"], content["rater"], tuple(rows))
        known = all(isinstance(text, str) for row in [(answers.study, answers.rater), *rows] for text in row)
    except (KeyError, TypeError) as error:
        raise BodysenseError(f"{path}: the answers lack or misshape a part ({error!r}); save them again") from None
    if not known:
        raise BodysenseError(f"{path}: the answers contain other values than texts; save them again")
    if answers.study != key.study:
        raise BodysenseError(
            f"{path}: these are answers of study {answers.study!r}, the key is of {key.study!r}; give the key that "
            "was written with their page"
        )
    seen: set[frozenset[str]] = set()
    for left, right, choice in rows:
        for clip in (left, right):
            if clip not in key.scene_of:
                raise BodysenseError(f"{path}: no animation {clip!r} is in the study {key.study!r}; save them again")
        if left == right or key.scene_of[left] != key.scene_of[right]:
            raise BodysenseError(f"{path}: {left!r} and {right!r} are not a pair of one scene; save them again")
        if choice not in CHOICES:
            raise BodysenseError(f"{path}: unknown choice {choice!r}; valid are {', '.join(CHOICES)}")
        if {left, right} in seen:
            raise BodysenseError(f"{path}: the pair {left!r}, {right!r} is answered twice; save them again")
        seen.add(frozenset((left, right)))
    wanted = len(COMPARISONS) * len(key.scenes)
    if len(seen) != wanted:
        raise BodysenseError(
            f"{path}: {len(seen)} of {wanted} pairs are answered; let the rater finish, or leave the file out"
        )
    return answers


def read_all_answers(paths: Sequence[str | Path], key: StudyKey) -> list[Answers]:
    """Read the answers of several raters. Raises BodysenseError for no file, a bad file, or a repeated rater."""
    if not paths:
        raise BodysenseError("no answers are given; name at least one file that the study's page saved")
    found: dict[str, str | Path] = {}
    result = []
    for path in paths:
        answers = read_answers(path, key)
        if answers.rater in found:
            raise BodysenseError(
                f"{path}: rater {answers.rater!r} has answered in {found[answers.rater]} too; give one of the files"
            )
        found[answers.rater] = path
        result.append(answers)
    return result


def _write(path: str | Path, content: dict[str, Any]) -> None:
    with written_beside(path) as beside:
        beside.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _read(path: str | Path, form: str, fix: str) -> dict[str, Any]:
    """Return the object in a JSON file of format `form`."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BodysenseError(f"{path} cannot be read ({error.strerror}); {fix}") from None
    except ValueError as error:
        raise BodysenseError(f"{path}: not complete JSON ({error}); {fix}") from None
    if not isinstance(content, dict) or content.get("format") != form:
        other = content.get("format") if isinstance(content, dict) else None
        raise BodysenseError(f"{path}: its format is {other!r}, not {form!r}; {fix}")
    return content
