"""Quality of the page: checks named as in Lighthouse, and one sentence for every error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def checked(scenario: Scenario, site: Path) -> dict[str, Any]:
    return scenario("alone/checks", site)


def test_head_says_what_the_page_is(checked: dict[str, Any]) -> None:
    head = checked["head"]
    assert head["language"] == "en" and head["title"]
    assert {"viewport", "description", "color-scheme"} <= set(head)


def test_scripts_are_small_and_nothing_comes_from_elsewhere(checked: dict[str, Any]) -> None:
    scripts = {name: size for name, size in checked["sizes"].items() if name.endswith(".js")}
    assert scripts and max(scripts.values()) < 750_000  # bytes, unpacked
    assert checked["sizes"]["index.css"] < 20_000
    assert checked["elsewhere"] == []


def test_labels_roles_and_contrast_in_light_and_dark(
    checked: dict[str, Any], record_property: Callable[[str, object], None]
) -> None:
    record_property("axe_faults", sum(map(len, checked["axe"].values())))
    assert checked["axe"] == {"light": [], "dark": []}


def test_nothing_jumps_while_the_page_loads(checked: dict[str, Any]) -> None:
    assert checked["shift"] < 0.1  # cumulative layout shift


def test_a_small_phone_holds_the_page(checked: dict[str, Any]) -> None:
    assert checked["tooWide"] == 0
    assert checked["tooSmall"] == []


def test_a_message_on_a_phone_does_not_cover_the_body(checked: dict[str, Any]) -> None:
    assert len(checked["covered"]) == 2 and max(checked["covered"]) <= 0  # pixels


def test_nothing_covers_a_webcams_picture(checked: dict[str, Any]) -> None:
    assert len(checked["overPicture"]) == 30
    assert {size: over for size, over in checked["overPicture"].items() if over} == {}


def test_a_lying_phone_shows_the_figure_large(checked: dict[str, Any]) -> None:
    assert checked["lying"] >= 0.8


def test_the_introduction_is_between_header_and_timeline(checked: dict[str, Any]) -> None:
    assert len(checked["introduced"]) == 5
    for size, (below_header, above_timeline, height) in checked["introduced"].items():
        assert min(below_header, above_timeline) >= 0 and height > 250, (size, below_header, above_timeline, height)


def test_sources_are_reached_by_keyboard_and_focus_is_visible(checked: dict[str, Any]) -> None:
    reached = [name for name, _ in checked["keyboard"]]
    assert reached[0] == "skip" and {"open-headset", "open-file"} <= set(reached)
    assert all(is_seen for _, is_seen in checked["keyboard"])


def test_a_second_visit_fetches_nothing(checked: dict[str, Any]) -> None:
    assert checked["fetchedAgain"] == []


def test_whatever_goes_wrong_is_one_sentence(scenario: Scenario, site: Path) -> None:
    notices = scenario("alone/faults", site)["notices"]
    assert len(notices) == 16
    for text in notices.values():
        assert "\n" not in text and 20 < len(text) < 200 and text.endswith(".")


def test_words_are_plain_in_every_state(scenario: Scenario, site: Path, tmp_path: Path) -> None:
    words = "\n".join(scenario("alone/words", site, tmp_path)["read"])  # the fixture refuses jargon
    for state in (
        "Getting ready…",
        "Only a headset and two controllers are tracked",
        "The page's own performance",
        "completed here, ",
        "from the truth",
        "Error against the truth",
        "Take 0: ",
        "Recorded before",
        "Put the headset on",
        "Point and pinch, or pull the trigger.",
        "Hold still: 0 …",
        "You are marked as sitting",
        "0 point tracked · 0 cm expected error",
        "The headset is off.",
        "is no address of a bridge",
        "song.ogg",
    ):
        assert state in words, state
