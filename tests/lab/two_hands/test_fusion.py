"""Fusion of inertial sensors with markers: hidden markers, scores of the methods, and how settings are chosen."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.glove import MARKERS
from bodysense.body.hands.hand import FINGERS
from bodysense.body.hands.hand_family import draw_hand
from bodysense.devices.gloves import gap_fillers
from bodysense.devices.gloves.hands import load_glove_models
from bodysense.devices.gloves.inertial import InertialSettings
from bodysense_lab.commands.gloves import gloves_settings
from bodysense_lab.data.datasets import Census
from bodysense_lab.papers.two_hands.score import choice, fusion
from bodysense_lab.papers.two_hands.score.scores import GloveTable, HandTask, _of_people
from bodysense_lab.papers.two_hands.trials import HandErrors, Trials, cut, hide_some
from bodysense_lab.synthesis.hands import synthesize_hand


@pytest.fixture(scope="module")
def trials() -> Trials:
    rng = np.random.default_rng(12)
    hand = draw_hand(rng)
    made = cut([synthesize_hand(hand.skeleton, 9.0, rng)], 30, rng, hand, fusion.SCORED)
    assert made is not None
    return made


def test_all_markers_of_a_lost_finger_are_hidden_and_no_others() -> None:
    for k, finger in enumerate(FINGERS):
        lost = np.arange(len(FINGERS))[None] == k
        hidden = {name for name, gone in zip(MARKERS, fusion._hidden(lost)[0], strict=True) if gone}
        assert hidden == {name for name in MARKERS if name.startswith(finger) and not name.endswith("_base")}
    assert (hide_some(50, 3, np.random.default_rng(1), of=5).sum(axis=1) == 3).all()


def test_fused_fingers_are_nearer_than_by_markers_and_than_by_sensors(trials: Trials) -> None:
    lost = np.ones((len(trials), 5), dtype=bool)
    errors = fusion.fusion_errors(trials, lost, load_glove_models(), np.random.default_rng(3))
    mean = {method: np.nanmean(error, axis=1) for method, error in errors.items()}
    assert set(mean) == set(fusion.METHODS) and all(len(values) == len(fusion.SECONDS) for values in mean.values())
    assert (mean["fused"][1:] < 0.6 * mean["markers"][1:]).all()
    assert (mean["fused"][:3] < mean["imu"][:3]).all()


def test_the_motions_of_a_person_are_scored_together() -> None:
    tasks = [HandTask([], group, person) for group, person in (("main", "a"), ("main", "b"), ("main", "a"))]
    assert [(task.group, task.person) for task in _of_people(iter(tasks))] == [("main", "a"), ("main", "b")]


def test_the_longest_half_life_near_the_best_is_chosen() -> None:
    assert choice.choose({1.0: 1.0, 2.0: 0.9, 8.0: 0.917, 16.0: 0.919, None: 0.95}, 0.02) == 8.0
    assert choice.choose({1.0: 1.0, None: 1.01}, 0.02) is None
    assert choice.choose({1.0: 1.0, None: 1.01}, 0.0) == 1.0


def test_a_report_names_the_chosen_values() -> None:
    means = HandErrors()
    for name, candidates in choice.CANDIDATES.items():
        for value in candidates.values:
            for seconds in candidates.seconds:
                error = 1.0 if value == candidates.values[1] else 2.0
                means.add((name, value, seconds), np.array([error]))
    report = choice.settings_report(GloveTable(means, Census(), None, 1))
    assert report.numbers["fading_chosen_s"] == 2.0 and report.numbers["aside_chosen_s"] == 1.0
    assert "2 is chosen and is not the default, 8." in report.remarks[0]
    defaults = {name: candidates.default for name, candidates in choice.CANDIDATES.items()}
    assert defaults == {"fading": gap_fillers.FADING, "aside": InertialSettings().aside}


def test_the_defaults_are_chosen_by_the_table_in_the_docs() -> None:
    """`FADING` is the longest half-life within 2 % of the best, on hands of the validation split."""
    page = (Path(__file__).parents[3] / "docs" / "gloves.md").read_text(encoding="utf-8")
    table = page.partition("<!-- begin gloves-settings -->")[2].partition("<!-- end")[0]
    for candidates in choice.CANDIDATES.values():
        cells = re.findall(rf"^\| {re.escape(candidates.title)} \| (\S+?)(?:, the default)? \| (\S+) \|$", table, re.M)
        means = {None if value == "kept" else float(value): float(error) for value, error in cells}
        assert tuple(means) == candidates.values
        assert choice.choose(means, candidates.within) == candidates.default
    assert choice.CANDIDATES["fading"].within == 0.02 and "within 2 % of the best" in " ".join(page.split())
    assert inspect.signature(gloves_settings).parameters["table"].default.split == "val"
