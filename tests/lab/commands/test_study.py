"""`bodysense study`: build, simulated answers, analysis, and refusals in one line."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.study.analysis import draw_key, write_key


@pytest.fixture
def key(tmp_path: Path) -> Path:
    write_key(tmp_path / "key.json", draw_key([f"a scene {k}" for k in range(8)], np.random.default_rng(0)))
    return tmp_path / "key.json"


@pytest.mark.slow
def test_build_writes_the_pages_and_the_key(tmp_path: Path, short_clip: Clip, small_network: Path, run) -> None:
    for name in ("one", "two"):
        write_bvh(tmp_path / f"{name}.bvh", replace(short_clip, pose=short_clip.pose[:15]))
    given = ("--clips", tmp_path / "one.bvh", tmp_path / "two.bvh", "--model", small_network, "--jobs", 1)
    output = run("study", "build", tmp_path / "study", *given, "--scenes", 1, "--seed", 3)
    assert f"wrote {tmp_path / 'study' / 'site'}: 3 pairs a rater; serve this folder" in output
    ((name, clips),) = json.loads((tmp_path / "study" / "key.json").read_text())["scenes"].items()
    assert name in ("one-1", "two-1") and re.search(rf"^{name}: \d+% of joints hidden, [\d.]+ cm off", output, re.M)
    assert sorted(clips.values()) == ["baseline", "ours", "truth"]
    assert len(list((tmp_path / "study" / "site" / "clips").glob("*.webp"))) == 3


def test_analyze_finds_the_preference_of_simulated_raters(tmp_path: Path, key: Path, run) -> None:
    out, numbers = tmp_path / "answers", tmp_path / "numbers.json"
    given = ("--raters", 39, "--truth", 0.9, "--ours", 0.5, "--seed", 1)
    assert run("study", "simulate", key, "-o", out, *given) == f"wrote 39 files to {out}\n"
    files = sorted(out.iterdir())
    assert [files[0].name, files[-1].name] == ["answers-simulated-001.json", "answers-simulated-039.json"]
    output = run("study", "analyze", key, *files, "--json", numbers)
    assert output.startswith("39 raters; ") and "a scene 7: truth over ours" in output
    found = json.loads(numbers.read_text())
    for name, mean in (("truth_over_ours", 0.4), ("ours_over_baseline", 0.5), ("truth_over_baseline", 0.9)):
        assert abs(found[f"{name}_mean"] - mean) < 3.5 * found[f"{name}_standard_error"]
        assert found[f"{name}_p"] < 0.01
        printed = re.findall(rf"^\(all\): {name.replace('_', ' ')} (\S+) ± \S+  t \S+  p (\S+)$", output, re.M)
        assert printed == [(f"{found[f'{name}_mean']:+.2f}", f"{found[f'{name}_p']:.3f}")]


def test_one_rater_gives_means_only(tmp_path: Path, key: Path, run) -> None:
    run("study", "simulate", key, "-o", tmp_path / "a", "--raters", 1)
    (file,) = (tmp_path / "a").iterdir()
    output = run("study", "analyze", key, file, "--json", tmp_path / "n.json")
    assert "1 raters;" in output and "nan" not in output
    assert not any(name.endswith("_p") for name in json.loads((tmp_path / "n.json").read_text()))


BAD = {
    "analyze {key}": "no answers are given; name at least one file that the study's page saved",
    "analyze {key} {cut}": "cut.json is not JSON",
    "analyze {key} {one} {one}": "rater 'simulated-001' has answered in",
    "analyze {key} {one} --json {folder}/no/n.json": "the folder {folder}/no does not exist",
    "simulate {key} -o {folder}/s --ours much": "--ours",
    "simulate {key} -o {folder}/s --raters 0": "--raters 0: give a whole number",
    "simulate {key} -o {folder}/s --seed -1": "--seed -1: give a whole number",
    "build {folder}": "exists; name a new folder",
    "build {folder}/s --seed -1": "--seed -1: give a whole number",
    "build {folder}/s --jobs 0": "--jobs 0: give a whole number",
    "build {folder}/s --clips {folder}/missing.bvh": "missing.bvh",
    "build {folder}/s --seconds 0": "--seconds 0",
    "build {folder}/no/s": "the folder {folder}/no does not exist",
}


def test_wrong_options_and_files_are_refused(tmp_path: Path, key: Path, run, refused) -> None:
    run("study", "simulate", key, "-o", tmp_path / "answers", "--raters", 1)
    one = tmp_path / "answers" / "answers-simulated-001.json"
    cut = tmp_path / "cut.json"
    cut.write_text(one.read_text()[:200])
    before = sorted(tmp_path.rglob("*"))
    names = {"key": key, "one": one, "cut": cut, "folder": tmp_path}
    for command, message in BAD.items():
        output = refused("study", *(part.format(**names) for part in command.split()))
        assert message.format(**names) in output, command
        assert sorted(tmp_path.rglob("*")) == before, command
