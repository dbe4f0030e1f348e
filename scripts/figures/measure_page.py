"""Measure the page in headless Chromium: loaded bytes, time to a moving body, a webcam's body, headset sessions.

    python scripts/figures/measure_page.py FIGURES/page.json
    python scripts/figures/measure_page.py FIGURES/page-endurance.json    (ten minutes of a headset, on a quiet machine)

Needs node, Chromium, `npm ci` in web/, `scripts/build_landmarkers.py` and `packages/lab[render]`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from bodysense.cli.show import write_numbers
from bodysense_live.server.page_files import write_page

ROOT = Path(__file__).parents[2]
VISITS, MINUTES = 10, 10
TIMES, MEMORY = ("p50", "p99", "worst"), ("heap", "process")
TESTS = (  # each records its measurements
    "test_page.py::test_a_visit_fetches_little",
    "test_page_quality.py::test_labels_roles_and_contrast_in_light_and_dark",
    "test_webcam.py::test_a_webcams_body_is_the_person_of_the_film",
)


def recorded(folder: Path) -> dict[str, float]:
    """Run the tests that measure, and return their records. Raises CalledProcessError if one fails."""
    report = folder / "report.xml"
    tests = [f"tests/web/{name}" for name in TESTS]
    report_to = (f"--junitxml={report}", "-o", "junit_family=xunit1")  # the older form has properties
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-m", "slow", *report_to, *tests]
    subprocess.run(command, cwd=ROOT, check=True)
    properties = ElementTree.parse(report).iter("property")
    return {one.attrib["name"]: float(one.attrib["value"]) for one in properties}


def run_scenario(folder: Path, scenario: str, *arguments: object) -> dict[str, Any]:
    """Write the page, run a scenario of web/tests/browser in Chromium, and return what it printed."""
    write_page(folder / "site")
    command = ["node", f"tests/browser/{scenario}.mjs", str(folder / "site"), *map(str, arguments)]
    environment = os.environ | {"CHROMIUM": os.environ.get("CHROMIUM") or shutil.which("chromium") or ""}
    done = subprocess.run(
        command, cwd=ROOT / "web", env=environment, capture_output=True, text=True, encoding="utf-8", check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def visited(folder: Path) -> dict[str, float]:
    """Visit the page `VISITS` times; return the times of the first text, body, and completed body."""
    visits = [run_scenario(folder, "alone/first", folder / "first.png") for _ in range(VISITS)]
    times = {name: [visit[name] for visit in visits] for name in ("words", "moving", "completed")}
    return {
        f"{name}_{which}_s": float(statistic(values))
        for name, values in times.items()
        for which, statistic in (("min", np.min), ("median", np.median), ("max", np.max))
    }


def page(folder: Path) -> dict[str, float]:
    """Return a visit's bytes, the time to a moving body, axe-core's faults, and the errors of a webcam's body."""
    return visited(folder) | recorded(folder)


def endurance(folder: Path) -> dict[str, float]:
    """Return the times of steps and of the page's frames over ten minutes of a headset, and the memory."""
    found = run_scenario(folder, "headset/endurance", MINUTES * 60)
    held = {f"{key}_{when}_mb": found["held"][k][key] for k, when in ((0, "early"), (-1, "late")) for key in MEMORY}
    times = {f"step_{key}_ms": found[key] for key in TIMES} | {f"frame_{key}_ms": found["page"][key] for key in TIMES}
    thread = found["thread"] or {}
    return {
        "minutes": float(MINUTES),
        "rate_hz": found["rate"],
        **times,
        **{f"thread_{key}_ms": value for key, value in thread.items()},
        **held,
    }


MEASURES: dict[str, Callable[[Path], dict[str, float]]] = {"page": page, "page-endurance": endurance}


def main() -> None:
    """Measure the page, and print and write the numbers."""
    path = Path(*sys.argv[1:])
    if path.stem not in MEASURES:
        raise SystemExit(f"{path}: name it {' or '.join(f'{name}.json' for name in MEASURES)}")
    with tempfile.TemporaryDirectory() as folder:
        numbers = MEASURES[path.stem](Path(folder))
    for name, value in numbers.items():
        print(f"{name:24} {value:.3f}")
    write_numbers(path, numbers, timed=False)  # Chromium's time is not known


if __name__ == "__main__":
    main()
