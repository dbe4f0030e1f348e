"""Key of a study, orders of raters, and answers: balanced, blind, read back, and refused if they do not match."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense_lab.study.study import (
    COMPARISONS,
    CONDITIONS,
    Answers,
    StudyKey,
    draw_key,
    numbers,
    pairs_for,
    read_all_answers,
    read_answers,
    read_key,
    write_answers,
    write_key,
)

CLIPS = {"a": "truth", "b": "ours", "c": "baseline"}  # of a scene


def key_of(scenes: int, seed: int = 0) -> StudyKey:
    return draw_key([f"scene {k}" for k in range(scenes)], np.random.default_rng(seed))


def answered(key: StudyKey, rater: str) -> Answers:
    return Answers(key.study, rater, tuple((left, right, "left") for left, right in pairs_for(key, rater)))


def test_the_generator_is_mulberry32() -> None:
    """Compare with a published FNV-1a hash (draft-eastlake-fnv, 32 bits) and a second implementation of Mulberry32."""
    state = 0xBF9CF968  # FNV-1a of "foobar"
    drawn = numbers("foobar")
    for _ in range(5):
        state = (state + 0x6D2B79F5) & 0xFFFFFFFF
        a = ((state ^ (state >> 15)) * (1 | state)) & 0xFFFFFFFF
        b = (a + (((a ^ (a >> 7)) * (61 | a)) & 0xFFFFFFFF)) & 0xFFFFFFFF
        a ^= b
        assert next(drawn) == a ^ (a >> 14)


@pytest.mark.parametrize("scenes", [1, 2, 3, 8])
def test_every_pair_appears_once_and_sides_are_balanced(scenes: int) -> None:
    """As in the paper, each rater sees every technique equally often on the left and on the right."""
    key = key_of(scenes)
    for rater in ("1", "2", "böse 🙂", ""):
        pairs = pairs_for(key, rater)
        assert len({frozenset(pair) for pair in pairs}) == len(pairs) == 3 * scenes
        assert all(key.scene_of[left] == key.scene_of[right] for left, right in pairs)
        for side in (0, 1):
            assert Counter(key.condition_of(pair[side]) for pair in pairs) == dict.fromkeys(CONDITIONS, scenes)
        first_left = Counter((key.condition_of(left), key.condition_of(right)) for left, right in pairs)
        for first, second in COMPARISONS:
            assert abs(first_left[first, second] - first_left[second, first]) == scenes % 2


def test_order_and_sides_differ_between_raters() -> None:
    key = key_of(4)
    orders = [pairs_for(key, f"r{k}") for k in range(400)]
    assert pairs_for(key, "r7") == orders[7] and len({tuple(order) for order in orders}) > 390
    start = Counter(frozenset(order[0]) for order in orders)
    # Each of the 12 pairs is first with probability 1/12, in each order with 1/2; bounds of four standard deviations.
    assert len(start) == 12 and max(abs(n - 400 / 12) for n in start.values()) < 4 * np.sqrt(400 * 11) / 12
    one = min(start, key=sorted)
    left = sum(min(one) == left for order in orders for left, right in order if {left, right} == one)
    assert abs(left - 200) < 4 * 10


def test_names_do_not_reveal_conditions() -> None:
    key = key_of(60)
    clips = [clip for scene in key.scenes for clip in scene.ring]
    assert len(set(clips)) == 180 and all(len(clip) == 12 and int(clip, 16) >= 0 for clip in clips)
    assert key_of(60) == key and key_of(60, seed=1).study != key.study
    places = Counter((scene.ring.index(clip), c) for scene in key.scenes for clip, c in scene.condition.items())
    assert len(places) == 9 and min(places.values()) > 8, "every condition has every position in the ring"


def test_key_and_answers_are_read_back(tmp_path: Path) -> None:
    key = key_of(3)
    write_key(tmp_path / "key.json", key)
    assert read_key(tmp_path / "key.json") == key
    given = [answered(key, rater) for rater in ("a", "b")]
    for one in given:
        write_answers(tmp_path / f"{one.rater}.json", one)
    assert read_all_answers([tmp_path / "a.json", tmp_path / "b.json"], key) == given


def other_scene(held: dict[str, Any]) -> None:
    first = held["answers"][0]
    for row in held["answers"]:
        if {row["left"], row["right"]}.isdisjoint((first["left"], first["right"])):
            first["left"] = row["left"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda held: held.update(study="elsewhere"),
            r"answers of study 'elsewhere', the key is of '\w{12}'; give the key that was written",
        ),
        (lambda held: held["answers"][0].update(left="0123456789ab"), "no animation '0123456789ab' is in the study"),
        (other_scene, "are not a pair of one scene"),
        (lambda held: held["answers"].append(held["answers"][0]), "is answered twice"),
        (lambda held: held["answers"].pop(), "5 of 6 pairs are answered; let the rater finish, or leave the file out"),
        (lambda held: held["answers"][0].update(choice="both"), "unknown choice 'both'; valid are left, right, none"),
        (lambda held: held.update(rater=7), "other values than texts"),
        (lambda held: held["answers"][2].pop("choice"), r"lack or misshape a part \(KeyError\('choice'\)\)"),
        (
            lambda held: held.update(format="bodysense recording 1"),
            "its format is 'bodysense recording 1', not 'bodysense study answers 1'",
        ),
    ],
)
def test_answers_that_do_not_match_the_key_are_refused(
    tmp_path: Path, spoil: Callable[[dict[str, Any]], None], message: str
) -> None:
    key, path = key_of(2), tmp_path / "a.json"
    write_answers(path, answered(key, "a"))
    held = json.loads(path.read_text())
    spoil(held)
    path.write_text(json.dumps(held))
    with pytest.raises(BodysenseError, match=message):
        read_answers(path, key)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scenes": []}, "its scenes have not one animation each"),
        ({"scenes": [{"name": name, "clips": CLIPS} for name in "12"]}, "its scenes have not one animation each"),
        ({"scenes": [{"name": "s", "clips": {**CLIPS, "b": "truth"}}]}, "scene 's' has not one"),
        ({"scenes": [{"name": "s", "clips": {**CLIPS, "b": 1}}]}, "scene 's' has not one"),
        ({"scenes": [{"clips": {}}]}, r"lacks or misshapes a part \(KeyError\('name'\)\)"),
        ({"scenes": 3}, "lacks or misshapes a part"),
        ({"format": "bodysense study answers 1"}, "not 'bodysense study key 1'; give the key.json"),
    ],
)
def test_other_files_are_refused_as_keys(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "key.json"
    write_key(path, key_of(2))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(BodysenseError, match=message):
        read_key(path)
