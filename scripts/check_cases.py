"""Run a folder of made-up files with known places (`cases.json`) through the command line, and count right rows.

    python scripts/check_cases.py FOLDER [--only NAME …]

A row of `cases.json` has `file`, `kind`, and for bodies `truth` (an .npz of `names`, `place` (T, N, 3) m, +Y up, and
`rate`) and `limit_cm`. Kinds: `body` must be read to these places; `refuse` must be one line that contains one of the
words `say`, where `or_body` also accepts a right body and `warn` a WARNING with such a word; `way_on` must be read, or
the command in its message is run and ends in the body. Exit status 0 if every row is right.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.cli import main
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense.io.formats.bvh import read_bvh

_COMMAND = re.compile(r"(?:python3? -c \".*?\"|bodysense [^;:]+?)(?=$|[;:,.]? |[;:,.]?$)")
_RELATED = re.compile(r"python3? -c \".*\"")


def run(arguments: list[str], folder: Path) -> tuple[int, str, str]:
    """Run the command line in a folder; return its status, output and errors."""
    out, err, before = io.StringIO(), io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            try:
                status = main(arguments)
            except SystemExit as end:
                status = end.code if isinstance(end.code, int) else 2
    finally:
        os.chdir(before)
    return status, out.getvalue(), err.getvalue()


def error_of(row: dict[str, Any], written: Path, truth: Path) -> str:
    """Return what differs from the truth; nothing if the body is right."""
    stored = np.load(truth)
    names, place = [str(name) for name in stored["names"]], stored["place"]
    pose = read_bvh(written).pose
    found = np.asarray(forward_kinematics(pose)[0])[:, pose.skeleton.indices(names)]
    frames = min(len(found), len(place))
    if len(found) < 0.9 * len(place):
        return f"{len(found)} of {len(place)} frames"
    found, place = found[:frames], place[:frames]
    if row.get("relative"):
        hips = [names.index("left_hip"), names.index("right_hip")]
        found, place = (p - p[:, hips].mean(axis=1, keepdims=True) for p in (found, place))
    found, place = (p - p.mean(axis=(0, 1)) for p in (found, place))  # the origin and the heading are free
    cross = (place[..., 0] * found[..., 2] - place[..., 2] * found[..., 0]).sum()
    same = (place[..., 0] * found[..., 0] + place[..., 2] * found[..., 2]).sum()
    found = quaternion_rotate(quaternion_exp(np.array([0.0, np.arctan2(cross, same), 0.0])), found)
    error = 100 * np.linalg.norm(found - place, axis=-1).mean(axis=0)
    limits = dict.fromkeys(names, np.inf) | row.get("joints", {})
    wrong = [f"{name} {error[names.index(name)]:.1f}" for name in limits if error[names.index(name)] > limits[name]]
    if error.mean() > row["limit_cm"]:
        wrong.append(f"mean {error.mean():.1f} cm")
    return ", ".join(wrong)


def outcome(row: dict[str, Any], folder: Path, work: Path) -> str:
    """Return what is wrong with a row; nothing if it is right."""
    name = row["file"]
    shutil.copy(folder / name, work / name)
    command = [row.get("command", "track"), name, "-o", "out.bvh", *row.get("options", [])]
    status, out, err = run(command, work)
    if row.get("verbose"):
        print(err)
    truth = folder / row["truth"] if "truth" in row else None
    said = err.lower().replace(name.lower(), "")
    says = any(word.lower() in said for word in row.get("say", [""]))
    unsaid = [word for word in row.get("say_not", []) if word.lower() in said]
    if status == 0 and row["kind"] != "refuse":
        return error_of(row, work / "out.bvh", truth) if truth else ""
    if status == 0:
        warned = row.get("warn") and "WARNING" in err and says
        if warned:
            return ""
        if not row.get("or_body") and any(word.lower() in out.lower() for word in row.get("say", [])):
            return ""  # read, and said how
        if row.get("or_body") and truth:
            return error_of(row, work / "out.bvh", truth)
        return f"read without a word: {err.strip()[:200]}"
    if len(err.strip().splitlines()) != 1:
        return f"{len(err.strip().splitlines())} lines: {err[:300]}"
    if row["kind"] == "refuse":
        return "" if says and not unsaid else f"does not say so: {err.strip()}"
    if row["kind"] == "way_on" and truth:
        found = _RELATED.search(err)
        if not found:
            return f"no command: {err.strip()}"
        subprocess.run(found[0], shell=True, cwd=work, check=False, capture_output=True)
        plain = next((path for path in work.iterdir() if path.stem.endswith("_plain")), None)
        if plain is None or run(["track", plain.name, "-o", "out.bvh"], work)[0]:
            return f"its command fails: {err.strip()}"
        return error_of(row, work / "out.bvh", truth)
    return err.strip()


def main_() -> int:
    """Run all rows; return the exit status."""
    parser = argparse.ArgumentParser(description="Run a folder of made-up files through the command line.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", help="files to run, without their folder")
    parser.add_argument("--verbose", action="store_true", help="print all messages")
    given = parser.parse_args()
    rows = json.loads((given.folder / "cases.json").read_text(encoding="utf-8"))
    rows = [row | {"verbose": given.verbose} for row in rows if not given.only or row["file"] in given.only]
    right = 0
    for row in rows:
        with tempfile.TemporaryDirectory() as work:
            wrong = outcome(row, given.folder.resolve(), Path(work))
        right += not wrong
        print(f"{'wrong' if wrong else 'right'}  {row['file']}{'  ' if wrong else ''}{wrong}", flush=True)
    print(f"{right} of {len(rows)}")
    return 0 if right == len(rows) else 1


if __name__ == "__main__":
    sys.exit(main_())
