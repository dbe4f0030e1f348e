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


def test_figures_of_reproduced_rows(tmp_path: Path) -> None:
    """A row's figure is replaced, and nothing else of the page; every row of the script is on the page."""
    script = runpy.run_path(str(ROOT / "scripts" / "reproduce_figures.py"))
    page = (ROOT / "docs" / "reproduce.md").read_text(encoding="utf-8")
    for row, (_, figure) in script["FIGURES"].items():
        changed = script["with_figure"](page, row, figure(Figures()))
        lines = [pair for pair in zip(page.splitlines(), changed.splitlines(), strict=True) if pair[0] != pair[1]]
        assert len(lines) == 1 and lines[0][1].startswith(f"| {row} |")
        before, after = (line.split(" | ") for line in lines[0])
        assert before[:3] == after[:3] and before[4:] == after[4:] and after[3] == figure(Figures())
    with pytest.raises(ValueError, match=r"no row 9\.9"):
        script["with_figure"](page, "9.9", "1")


def test_tables_of_all_clips_name_no_limit(script: dict[str, Any]) -> None:
    figures = Figures()
    figures |= {"clips": 36.0, "clips_in_split": 285.0}
    assert "--data DIR --limit 36`: 36 clips" in script["completion"](figures)
    assert "--data DIR --limit 36 --takes`: 36 clips" in script["takes"](figures)
    figures["clips"] = 285.0
    assert "--data DIR`: 285 clips" in script["completion"](figures)


def test_the_card_of_the_network(script: dict[str, Any]) -> None:
    text = script["network"](Figures())
    assert "seed" in text and "- validation people, known bodies, cm: head 1.25" in text
    assert "validation people" not in script["network"](None)
