"""The page's list of trackers, and lengths that a user knows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def facts(scenario: Scenario, site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return scenario("alone/trackers", site, tmp_path_factory.mktemp("trackers"))


def test_trackers_are_swapped_renamed_and_forgotten(facts: dict[str, Any]) -> None:
    usual = [["Hips", "pelvis"], ["Left ankle", "left_ankle"], ["Right ankle", "right_ankle"]]
    swapped = [["Hips", "pelvis"], ["Left ankle", "right_ankle"], ["Right ankle", "left_ankle"]]
    forgotten = [["Belt", "pelvis"], *usual[1:]]
    assert facts["rows"] == [usual, swapped, forgotten, forgotten]  # the name is kept over a reload


def test_the_body_follows_trackers_where_they_are_worn(facts: dict[str, Any]) -> None:
    before, swapped, after = facts["off"]  # cm from the truth
    assert swapped > before + 3 and after < before + 2


def test_axe_finds_no_fault_in_the_list(facts: dict[str, Any]) -> None:
    assert facts["axe"] == []


def test_lengths_are_displayed_refused_kept_and_forgotten(facts: dict[str, Any]) -> None:
    shown = dict(facts["shown"])
    assert 1.5 < shown["height"] < 1.9 and 0.3 < shown["thigh"] < 0.5 and 1.2 < shown["reach"] < 1.6
    assert facts["refused"] == "Hip to knee: 3 m is not a person's; give 0.25 to 0.65 m."
    assert facts["kept"] == "0.50" and facts["forgotten"] == ""
    assert facts["canForget"] == [True, False]
