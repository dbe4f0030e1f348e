"""Charts: complete PNG files of bars and lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense_lab.core.chart import BarPanel, Line, LinePanel, draw_panels, plain_bars


def is_whole(path: Path) -> bool:
    data = path.read_bytes()
    return data.startswith(b"\x89PNG") and data.endswith(b"IEND\xaeB`\x82")


def test_panels_of_bars_are_drawn(tmp_path: Path) -> None:
    ours, published = plain_bars("ours", [1.0, 2.0, None]), plain_bars("published", [None, 2.5, 3.0])
    np.testing.assert_array_equal(ours.height, [1.0, 2.0, np.nan])
    panel = BarPanel("body", ("GRU", "RNN", "without skip connections"), (ours, published), "cm")
    sizes = []
    for panels in ([panel], [panel, panel, panel]):
        draw_panels(tmp_path / "a.png", panels, "Table")
        assert is_whole(tmp_path / "a.png") and [path.name for path in tmp_path.iterdir()] == ["a.png"]
        sizes.append((tmp_path / "a.png").stat().st_size)
    assert sizes[1] > sizes[0]
    with pytest.raises(BodysenseError, match="does not exist"):
        draw_panels(tmp_path / "none" / "a.png", [panel], "Table")


def test_panels_of_lines_are_drawn_with_and_without_bars(tmp_path: Path) -> None:
    lines = tuple(Line(name, np.arange(5), np.arange(5) ** 0.5 + k) for k, name in enumerate("abcde"))
    panel = LinePanel("learning", lines, "steps", "cm")
    for panels in ([panel], [BarPanel("body", ("a",), (plain_bars("ours", [1.0]),), "cm"), panel]):
        draw_panels(tmp_path / "l.png", panels, "Table")
        assert is_whole(tmp_path / "l.png")
