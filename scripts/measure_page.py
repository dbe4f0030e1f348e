"""Measure the page in headless Chromium: what a visit loads, when a body moves, how a webcam's body fits its film.

    python scripts/measure_page.py FIGURES/page.json

Needs node, Chromium, `npm ci` in web/, `scripts/build_landmarkers.py` and `packages/lab[render]`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from bodysense.cli.show import write_numbers
from bodysense_live.page_files import write_page

ROOT = Path(__file__).parents[1]
VISITS = 10
TESTS = (  # each records what it measures
    "test_page.py::test_a_visit_fetches_little",
    "test_page_quality.py::test_labels_roles_and_contrast_in_light_and_dark",
    "test_webcam.py::test_a_webcams_body_is_the_person_of_the_film",
)


def recorded(folder: Path) -> dict[str, float]:
    """Run the tests that measure, and return what they recorded. Raises CalledProcessError if one fails."""
    report = folder / "report.xml"
    tests = [f"tests/web/{name}" for name in TESTS]
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-m", "slow", f"--junitxml={report}", *tests]
    subprocess.run(command, cwd=ROOT, check=True)
    properties = ElementTree.parse(report).iter("property")
    return {one.attrib["name"]: float(one.attrib["value"]) for one in properties}


def visited(folder: Path) -> dict[str, float]:
    """Visit the page anew `VISITS` times, and return when words stand, a body moves, and the network completed it."""
    write_page(folder / "site")
    command = ["node", "tests/browser/first.mjs", str(folder / "site"), str(folder / "first.png")]
    environment = os.environ | {"CHROMIUM": os.environ.get("CHROMIUM") or shutil.which("chromium") or ""}
    visits = []
    for _ in range(VISITS):
        done = subprocess.run(
            command, cwd=ROOT / "web", env=environment, capture_output=True, text=True, encoding="utf-8", check=True
        )
        visits.append(json.loads(done.stdout.splitlines()[-1]))
    times = {name: [visit[name] for visit in visits] for name in ("words", "moving", "completed")}
    return {
        f"{name}_{statistic.__name__}_s": float(statistic(values))
        for name, values in times.items()
        for statistic in (np.min, np.median, np.max)
    }


def main() -> None:
    """Measure, print and write."""
    (path,) = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        numbers = visited(Path(folder)) | recorded(Path(folder))
    for name, value in numbers.items():
        print(f"{name:24} {value:.3f}")
    write_numbers(Path(path), numbers)


if __name__ == "__main__":
    main()
