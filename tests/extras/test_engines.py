"""The example in C, the installed library, and the listings for engines."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bodysense as bs
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording, read_recording
from bodysense.tracking.model import PACKAGED

ROOT = Path(__file__).parents[2]
CORE, EXTRAS, ENGINES = ROOT / "core", ROOT / "extras", ROOT / "extras" / "engines"
WEIGHTS = ROOT / "src" / "bodysense" / "weights" / PACKAGED
HEIGHT, FRAMES = 1.7, 90
CLOSE = 2e-6  # of what is printed with six places

# A person in C++ and in C#, read from the lines of an array of frames: time, then 7 numbers of each of three points.
CPP = r"""
#include <cstdio>
#include "bodysense.hpp"
int main(int, char **a) {
    static unsigned char file[1 << 23];
    FILE *weights = fopen(a[1], "rb");
    size_t bytes = fread(file, 1, sizeof file, weights);
    bodysense::Model model;
    bodysense::Body body;
    if (model.open(file, 3) != BS_MODEL_DAMAGED || model.open(file, bytes) || body.start(model, 1.7)) return 1;
    const char *names[] = {"head", "left_wrist", "right_wrist"};
    for (double time; scanf("%lf", &time) == 1;) {
        std::vector<bodysense::Tracked> points;
        for (const char *name : names) {
            bodysense::Tracked one;
            one.point = bodysense::point_of(name);
            one.has_position = one.has_rotation = true;
            for (double &v : one.position) if (scanf("%lf", &v) != 1) return 1;
            for (double &v : one.rotation) if (scanf("%lf", &v) != 1) return 1;
            points.push_back(one);
        }
        if (body.step(time, points)) return 1;
        printf("%.6f %.6f %.6f %.6f", time, body.root[0], body.root[1], body.root[2]);
        for (int k = 0; k < 4 * BS_JOINTS; ++k) printf(" %.6f", body.rotation[k / 4][k % 4]);
        printf("\n");
    }
}
"""
CSHARP = """
using System; using System.Globalization; using System.IO; using System.Linq; using BodySense;
static class Program {
    static void Main(string[] arguments) {
        CultureInfo.CurrentCulture = CultureInfo.InvariantCulture;
        using (var body = new Body(File.ReadAllBytes(arguments[0]), 1.7))
            for (string line; (line = Console.ReadLine()) != null;) {
                var v = line.Split(' ').Select(double.Parse).ToArray();
                body.Clear();
                for (int k = 0; k < 3; k++) {
                    int joint = Body.PointOf(new[] { "head", "left_wrist", "right_wrist" }[k]), at = 1 + 7 * k;
                    body.Track(joint, v[at], v[at + 1], v[at + 2]);
                    body.Turn(joint, v[at + 3], v[at + 4], v[at + 5], v[at + 6]);
                }
                body.Step(v[0]);
                var made = new[] { v[0] }.Concat(body.Root).Concat(body.Rotation);
                Console.WriteLine(string.Join(" ", made.Select(x => x.ToString("F6"))));
            }
    }
}
"""


def ran(*command: str | Path, text: str | None = None, **environment: str) -> str:
    """Run a program that must succeed, and return its output."""
    done = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        check=False,
        input=text,
        env={"PATH": "/usr/bin:/bin", **environment} if environment else None,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def rows(printed: str) -> np.ndarray:
    """(T, 4 + 208) numbers of lines: time, the root's place, local rotations."""
    return np.array([[float(word) for word in line.split()] for line in printed.splitlines()])


@pytest.fixture(scope="module")
def recording(waving_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of head and hands."""
    path = tmp_path_factory.mktemp("recording") / "seen.jsonl"
    seen = observe(waving_clip.pose, waving_clip.time, THREE_POINT)
    bs.write(path, Recording(seen, waving_clip.pose.skeleton, known=False))
    return path


@pytest.fixture(scope="module")
def lines(recording: Path) -> str:
    """The recording's frames as the programs above read them."""
    seen = read_recording(recording).observation
    values = np.concatenate([seen.position, seen.rotation], axis=-1).reshape(len(seen), -1)
    return "".join(
        " ".join(map(repr, [float(t), *map(float, row)])) + "\n" for t, row in zip(seen.time, values, strict=True)
    )


@pytest.fixture(scope="module")
def completed(recording: Path) -> np.ndarray:
    """The bodies that the Python library completes from the recording, as rows."""
    tracker, seen = bs.Tracker(bs.Person(height=HEIGHT)), read_recording(recording).observation
    pose = tracker.step(seen, tracker.start())[0].pose
    return np.concatenate([seen.time[:, None], pose.root_position, pose.rotation.reshape(len(seen), -1)], axis=1)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which `make install` put the library."""
    folder = tmp_path_factory.mktemp("installed")
    ran("make", "-s", "-C", CORE, "install", "examples", f"PREFIX={folder}", f"BUILD={folder / 'build'}", "CFLAGS=-O0")
    return folder


@pytest.mark.slow
def test_the_example_in_c(installed: Path, recording: Path, completed: np.ndarray) -> None:
    found = rows(ran(installed / "build" / "poses", WEIGHTS, recording, str(HEIGHT)))
    assert found.shape == (FRAMES, 212)
    np.testing.assert_allclose(found, completed, atol=CLOSE)
    assert np.ptp(found[:, 4:], axis=0).max() > 0.1  # a person moves


@pytest.mark.slow
def test_the_example_names_what_is_wrong(installed: Path, recording: Path) -> None:
    poses = installed / "build" / "poses"
    for arguments, message in (((recording, recording), "safetensors"), ((WEIGHTS,), "usage")):
        done = subprocess.run([poses, *arguments], capture_output=True, text=True, check=False)
        assert done.returncode and message in done.stderr


@pytest.mark.slow
def test_a_program_with_the_installed_library(installed: Path, recording: Path, completed: np.ndarray) -> None:
    """Compiled as pkg-config says, or as its file says where there is no pkg-config."""
    described = (installed / "lib" / "pkgconfig" / "bodysense.pc").read_text()
    flags = [
        word.replace("${prefix}", str(installed))
        for line in re.findall(r"^(?:Cflags|Libs): (.*)$", described, re.MULTILINE)
        for word in line.split()
    ]
    if shutil.which("pkg-config"):
        output = ran(
            "pkg-config", "--cflags", "--libs", "bodysense", PKG_CONFIG_PATH=str(installed / "lib" / "pkgconfig")
        )
        assert output.split() == flags
    program = installed / "linked"
    ran("cc", "-std=c11", CORE / "examples" / "poses.c", *flags, "-lm", "-o", program)
    found = ran(program, WEIGHTS, recording, str(HEIGHT), LD_LIBRARY_PATH=str(installed / "lib"))
    np.testing.assert_allclose(rows(found), completed, atol=CLOSE)


@pytest.mark.slow
def test_the_header_for_engines(installed: Path, lines: str, completed: np.ndarray, tmp_path: Path) -> None:
    compiler = cpp_compiler()
    (tmp_path / "program.cpp").write_text(CPP)
    flags = [f"-I{ENGINES}", f"-I{installed / 'include'}", f"-L{installed / 'lib'}", "-lbodysense"]
    warnings = ("-std=c++17", "-Wall", "-Wextra", "-Werror")
    ran(compiler, *warnings, tmp_path / "program.cpp", *flags, "-o", tmp_path / "program")
    found = ran(tmp_path / "program", WEIGHTS, text=lines, LD_LIBRARY_PATH=str(installed / "lib"))
    np.testing.assert_allclose(rows(found), completed, atol=CLOSE)


@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("mcs") and shutil.which("mono")), reason="needs Mono")
def test_the_listing_for_unity_runs(installed: Path, lines: str, completed: np.ndarray, tmp_path: Path) -> None:
    (tmp_path / "program.cs").write_text(CSHARP)
    sources = [EXTRAS / "unity" / "Runtime" / name for name in ("BodySenseNative.cs", "Body.cs")]
    options = ("-unsafe", "-langversion:7.2", "-warnaserror", f"-out:{tmp_path / 'a.exe'}")
    ran("mcs", *options, *sources, tmp_path / "program.cs")
    found = ran("mono", tmp_path / "a.exe", WEIGHTS, text=lines, LD_LIBRARY_PATH=str(installed / "lib"))
    np.testing.assert_allclose(rows(found), completed, atol=CLOSE)


def test_the_node_of_godot_compiles() -> None:
    """Without a warning."""
    warnings = ("-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")
    ran("cc", "-std=c11", "-fsyntax-only", *warnings, f"-I{CORE / 'include'}", EXTRAS / "godot" / "bodysense_godot.c")


def cpp_compiler() -> str:
    """Return the name of a C++ compiler. Skips the test if no compiler is installed."""
    found = next((name for name in ("c++", "g++", "clang++") if shutil.which(name)), None)
    if found is None:
        pytest.skip("no C++ compiler")
    return found


def test_the_page_names_files_that_exist() -> None:
    page = (ROOT / "docs" / "engines.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:extras|core|examples)/[\w/.-]+\.\w+)`", page)
    assert len(named) > 6
    assert not [name for name in named if not (ROOT / name).exists()]
