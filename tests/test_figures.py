"""The script that writes the tables of README and docs: what it makes of figures, and the places it puts them."""

from __future__ import annotations

import runpy
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "scripts" / "readme_figures.py"))


class Figures(defaultdict):
    """Every figure there is, all the same."""

    def __init__(self) -> None:
        super().__init__(lambda: 1.25)

    def __contains__(self, key: object) -> bool:
        return True


@pytest.mark.parametrize("table", ["completion", "completion_measures", "published", "sight"])
def test_tables_of_completion(script: dict[str, Any], table: str) -> None:
    text = script[table](Figures())
    widths = [{line.count("|") for line in part.splitlines()} for part in text.split("\n\n") if part.startswith("|")]
    assert widths and all(len(width) == 1 for width in widths), "every row is as wide as its table"
    assert "1.25" in text


def test_the_table_of_speed(script: dict[str, Any]) -> None:
    assert "1.25 ms each" in script["speed"](defaultdict(Figures))


def test_places(script: dict[str, Any]) -> None:
    """What stands around the markers stays."""
    text = script["put"]("a\n<!-- begin x -->\nold\n<!-- end x -->\nb\n", "x", "new")
    assert text == "a\n<!-- begin x -->\nnew\n<!-- end x -->\nb\n"
    places = {
        "README.md": ("completion",),
        "docs/gloves.md": ("gloves", "gloves-layouts", "gloves-speed", "gloves-fusion", "gloves-settings"),
        "docs/papers/two-hands.md": ("gloves-table3", "gloves-table4", "gloves-occlusion", "gloves-limits"),
        "docs/rendered.md": ("video",),
        "docs/completion.md": ("completion", "published"),
        "docs/evaluation.md": ("sight", "speed"),
        "docs/papers/unoc.md": ("headset", "networks", "table3", "table4", "table5", "smoothness", "applications"),
        "docs/papers/hmd-vae.md": ("hmd-vae",),
        "docs/papers/pahmt.md": ("table1", "arms-speed"),
    }
    for file, names in places.items():
        whole = (ROOT / file).read_text(encoding="utf-8")
        assert all(whole.count(f"<!-- {word} {name} -->") == 1 for name in names for word in ("begin", "end")), file
