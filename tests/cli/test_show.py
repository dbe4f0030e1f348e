"""Numbers for machines: strict JSON, and nothing that is not a number."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path

import pytest

from bodysense.cli.show import processor, write_numbers


def test_nan_figures_are_left_out(tmp_path: Path) -> None:
    write_numbers(tmp_path / "a.json", {"error_cm": 1.5, "ratio": float("nan"), "peak": float("inf"), "clips": 3})

    def refuse(word: str) -> float:
        pytest.fail(f"{word} is no JSON")

    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    numbers = json.loads(text, parse_constant=refuse)
    assert 0 < numbers.pop("cpu_seconds") <= sum(os.times()[:4]) + 0.01  # rounded
    assert numbers == {"processor": processor(), "error_cm": 1.5, "clips": 3}


def test_the_time_of_a_part_is_not_written(tmp_path: Path) -> None:
    write_numbers(tmp_path / "a.json", {"clips": 3}, timed=False)
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"processor": processor(), "clips": 3}


@pytest.mark.parametrize(
    ("lines", "name"),
    [
        (["model name\t: AMD EPYC", "flags\t\t: fpu avx2 avx512f avx512_vnni"], "AMD EPYC (AVX2, AVX-512, VNNI)"),
        (["model name\t: AMD EPYC", "flags\t\t: fpu sse2"], "AMD EPYC"),
        (["Features\t: fp asimd asimddp bf16"], f"{platform.processor() or platform.machine()} (bf16, dot products)"),
    ],
)
def test_a_processor_is_named_with_its_units(tmp_path: Path, lines: list[str], name: str) -> None:
    (tmp_path / "cpuinfo").write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert processor(tmp_path / "cpuinfo") == name
    assert processor(tmp_path / "nothing") == (platform.processor() or platform.machine())
