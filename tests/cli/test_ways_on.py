"""Ways on: each command that a message prints is run as printed, and ends in the body that the message promises.

Messages are collected from the source. A message with a command, or with an option to give, is either the subject of a
scenario here, or named in `ELSEWHERE` with the reason.
"""

from __future__ import annotations

import ast
import gzip
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from import_graph import MODULES, package, parsed

from bodysense.body.pose import Pose
from bodysense.cli import main
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.io.formats.gltf.writer import write_glb
from bodysense.sources.conversion import convert

COMMAND = re.compile(
    r"\b(?:bodysense [a-z]+(?= )|python -c|gunzip|iconv|blender -b|pip install|dask scheduler|python scripts)"
)
# Fragments of messages whose way on runs in another test, or cannot run in a test.
ELSEWHERE = {
    "a video; complete it": "video: tests/cli/test_video.py tracks one",
    "the video itself (bodysense track": "video: tests/cli/test_video.py tracks one",
    "a webcam never ends": "a webcam",
    "in a clone of the repository: pip install": "installs a package",
    "this Pillow writes no WebP": "installs a package",
    "the compiled core": "builds the core: every run of the tests did",
    "the compiled library": "builds the core: every run of the tests did",
    "is not read; convert it with Blender": "Debian's Blender reads no USD and no Collada",
    "convert it once: python -c": "objects in an archive: tests/io reads one by its command",
    "give one of its files, such as": "a folder: tests/cli/test_many.py tracks one by the command",
    "no Dask scheduler answers": "tests/test_parallel.py runs one",
    "is not calibrated with the markers": "tests/cli/test_markers.py calibrates by the command",
}


@cache
def messages() -> tuple[str, ...]:
    """Return the texts of the library, with {} for values; docstrings are left out."""
    found = list[str]()
    for module in (module for module in MODULES if package(module) == "bodysense"):
        nodes, dropped = list(ast.walk(parsed(module))), set[int]()
        for node in nodes:
            if isinstance(node, ast.Expr):
                dropped.add(id(node.value))
            if isinstance(node, ast.JoinedStr):
                dropped |= {id(part) for part in node.values}
                found.append(
                    "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
                )
        constants = (node for node in nodes if isinstance(node, ast.Constant) and id(node) not in dropped)
        found += [node.value for node in constants if isinstance(node.value, str)]
    return tuple(found)


@cache
def printed() -> tuple[str, ...]:
    """Return the messages that name a command to run."""
    return tuple(text for text in messages() if COMMAND.search(text) and " " in text)


def with_values(text: str) -> re.Pattern[str]:
    """Return the pattern of a message with any values."""
    return re.compile(".*?".join(re.escape(part) for part in text.split("{}")), re.DOTALL)


def finds(text: str, said: str) -> bool:
    return with_values(text).search(said) is not None


# --- scenarios: each makes files in the current folder and returns the words of a command that is refused or warns ---

Words = list[str]


def held_arm(clip: Clip) -> Words:
    """An arm that holds its angle while the body moves."""
    rotation = np.array(clip.pose.rotation)
    arm = clip.pose.skeleton.indices(["left_shoulder", "left_elbow", "left_wrist"])
    rotation[:, arm] = rotation[:1, arm]
    write_bvh("take.bvh", replace(clip, pose=replace(clip.pose, rotation=rotation)))
    return ["convert", "take.bvh", "-o", "out.bvh"]


def recording(clip: Clip) -> Words:
    write_bvh("motion.bvh", clip)
    assert main(["simulate", "motion.bvh", "-o", "take.npz", "--device", "three_point"]) == 0
    return ["convert", "take.npz", "-o", "out.bvh"]


def checked_recording(clip: Clip) -> Words:
    recording(clip)
    return ["check", "take.npz"]


def without_legs(clip: Clip) -> Words:
    skeleton = clip.pose.skeleton
    legs = [name for name in skeleton.points if name.partition("_")[2] in ("hip", "knee", "ankle", "foot", "toe")]
    write_bvh("take.bvh", bare(clip, legs))
    return ["convert", "take.bvh", "-o", "out.bvh"]


def checked_half(clip: Clip) -> Words:
    without_legs(clip)
    return ["check", "take.bvh"]


def not_finite(clip: Clip) -> Words:
    write_bvh("take.bvh", clip)
    lines = Path("take.bvh").read_text().splitlines()
    words = lines[-2].split()
    words[12] = "nan"
    Path("take.bvh").write_text("\n".join([*lines[:-2], " ".join(words), lines[-1]]) + "\n")
    return ["convert", "take.bvh", "-o", "out.bvh"]


def gzipped_text(clip: Clip) -> Words:
    write_bvh("plain.bvh", clip)
    Path("take.bvh").write_bytes(gzip.compress(Path("plain.bvh").read_bytes()))
    return ["convert", "take.bvh", "-o", "out.bvh"]


def gzipped(clip: Clip) -> Words:
    write_bvh("plain.bvh", clip)
    Path("take.bvh.gz").write_bytes(gzip.compress(Path("plain.bvh").read_bytes()))
    return ["convert", "take.bvh.gz", "-o", "out.bvh"]


def in_utf_16(clip: Clip) -> Words:
    write_bvh("plain.bvh", clip)
    Path("take.bvh").write_text(Path("plain.bvh").read_text(), encoding="utf-16")
    return ["convert", "take.bvh", "-o", "out.bvh"]


def pickled_model() -> Words:
    poses = np.zeros((20, 72))
    np.savez("take.npz", poses=poses, trans=np.zeros((20, 3)), mocap_framerate=30.0, betas=np.zeros(10))
    count = 24
    parents = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
    places = np.random.default_rng(0).normal(size=(count, 3))
    model = {
        **{"v_template": places, "shapedirs": np.zeros((count, 3, 10)), "J_regressor": np.eye(count)},
        "kintree_table": np.array([[max(parent, 0) for parent in parents], list(range(count))]),
    }
    Path("model.pkl").write_bytes(pickle.dumps(model))
    return ["convert", "take.npz", "-o", "out.bvh", "--smpl-model", "model.pkl"]


def nameless(clip: Clip) -> Words:
    """A rig without names whose arms differ in length, so that nothing tells its limbs."""
    skeleton = clip.pose.skeleton
    names = tuple(f"j{k}" for k in range(len(skeleton.points)))
    count, offset = len(skeleton.joints), np.array(skeleton.rest_offset)
    offset[skeleton.indices(["left_elbow", "left_wrist"])] *= 2.5
    other = type(skeleton)(names[:count], names[count:], skeleton.parents, offset)
    write_bvh("take.bvh", replace(clip, pose=replace(clip.pose, skeleton=other)))
    return ["convert", "take.bvh", "-o", "out.bvh"]


def map_that_is_no_json(clip: Clip) -> Words:
    write_bvh("take.bvh", clip)
    Path("joints.json").write_text("hips: pelvis")
    return ["convert", "take.bvh", "-o", "out.bvh", "--joints", "joints.json"]


def mirrored(clip: Clip) -> Words:
    write_bvh("take.bvh", clip)
    return ["track", "take.bvh", "-o", "out.bvh", "--missing", "left_hand", "--left-handed"]


def rate_of_glb(clip: Clip) -> Words:
    write_glb(Path("take.glb"), clip)
    return ["track", "take.glb", "-o", "out.bvh", "--device", "three_point", "--rate", "60"]


def bare(clip: Clip, gone: list[str]) -> Clip:
    """Return a clip without some points."""
    skeleton, pose = clip.pose.skeleton, clip.pose
    keep = [k for k, name in enumerate(skeleton.points) if name not in gone]
    joints = [k for k in keep if k < len(skeleton.joints)]
    names = [skeleton.points[k] for k in keep]
    parents = tuple(-1 if skeleton.parents[k] < 0 else keep.index(skeleton.parents[k]) for k in keep)
    part = type(skeleton)(tuple(names[: len(joints)]), tuple(names[len(joints) :]), parents, skeleton.rest_offset[keep])
    return replace(clip, pose=Pose(part, pose.root_position, pose.rotation[:, joints]))


def test_commands_are_collected() -> None:
    assert len(printed()) > 25


SCENARIOS: dict[Callable[[Clip], Words], str] = {  # and a fragment of the message
    held_arm: "complete them: bodysense track {} -o {}",
    recording: "complete it first: bodysense track {} -o motion.bvh, or give",
    checked_recording: "not a motion; complete it first: bodysense track {} -o motion.bvh",
    without_legs: "complete it: bodysense track {} -o {}",
    checked_half: "complete it first: bodysense track {} -o motion.bvh",
    not_finite: "or fill it: bodysense track {} -o filled.bvh",
    gzipped_text: "unpack it: gunzip -c {} > unpacked_{}",
    gzipped: "unpack it: gunzip -k {}",
    in_utf_16: "iconv -f {} -t UTF-8 {} > utf8_{}",
    nameless: "bodysense data joints {} -o joints.json, and --joints",
    map_that_is_no_json: "draft it with bodysense data joints",
    mirrored: "bodysense convert {} -o whole.bvh --left-handed",
    rate_of_glb: "out (bodysense convert resamples)",
}


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.__name__)
def test_a_printed_command_ends_in_a_body(
    scenario: Callable[[Clip], Words],
    tmp_path: Path,
    short_clip: Clip,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    words = scenario(short_clip)
    capsys.readouterr()
    main(words)
    said = capsys.readouterr().err
    assert any(finds(text, said) for text in printed() if with_values(SCENARIOS[scenario]).search(text)), said
    before = {path: path.stat().st_mtime_ns for path in Path().iterdir()}
    follow(said, words, short_clip)
    motions = [path for path in Path().glob("*.bvh") if before.get(path) != path.stat().st_mtime_ns]
    motions.sort(key=lambda path: path.name in (words[1], "unpacked_take.bvh", "utf8_take.bvh"))
    assert motions, said
    body = read_bvh(motions[0]).pose
    assert len(body.root_position) >= 0.9 * len(short_clip) and {"left_wrist", "head"} <= set(body.skeleton.joints)


def follow(said: str, words: Words, clip: Clip) -> None:
    """Run the command that a message prints, and the first command on its result if it wrote a file."""
    if shell := re.search(r"(python -c \"[^\"]+\"|gunzip [^;\n]+|iconv [^;\n]+)", said):
        before = set(Path().iterdir())
        line = re.sub(r"^python\b", f'"{sys.executable}"', shell[0])
        subprocess.run(line, shell=True, check=True, capture_output=True)
        made = sorted(set(Path().iterdir()) - before) or [Path(words[1])]
        assert main([words[0], made[0].name, *words[2:]]) == 0
        return
    command = re.search(r"bodysense ((?:data )?[a-z]+)((?: [^ ,;()]+)*)", said)
    assert command is not None
    arguments = [*command[1].split(), *command[2].split()]
    if arguments[:2] == ["data", "joints"]:
        draft = ["data", "joints", words[1], "-o", "joints.json", "--overwrite"]
        assert main(draft) == 0
        fill_in(Path("joints.json"), clip)
        arguments = [*words[:4], "--joints", "joints.json"]
    if "resamples" in said:  # a rate to leave out: the motion is converted to it
        assert main([*words[: words.index("--rate")]]) == 0
        arguments = ["convert", words[1], "-o", "whole.bvh", *words[-2:]]
    assert main(arguments) == 0


def fill_in(draft: Path, clip: Clip) -> None:
    """Name the joints of a draft as a user does who knows the file."""
    table = json.loads(draft.read_text())
    if not any(table.values()):
        table = {f"j{k}": name for k, name in enumerate(clip.pose.skeleton.joints)}
    draft.write_text(json.dumps(table))


def test_the_command_for_a_pickled_model_ends_in_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = pickled_model()
    assert main(words) == 2
    command = re.search(r"python -c \"[^\"]+\"", capsys.readouterr().err)
    assert command is not None
    subprocess.run(command[0].replace("python", sys.executable, 1), shell=True, check=True)
    with np.load("model.npz") as model:
        assert {"v_template", "shapedirs", "kintree_table", "J_regressor"} == set(model.files)


def test_a_motion_in_memory_that_lacks_legs_is_completed_as_its_message_says(
    tmp_path: Path, short_clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    without_legs(short_clip)
    with pytest.raises(BodysenseError, match=r"complete it: bodysense track take\.bvh -o out\.bvh"):
        convert("take.bvh", "out.bvh")
    recording(short_clip)
    with pytest.raises(BodysenseError, match=r"complete it: bodysense track take\.npz -o out\.bvh"):
        convert("take.npz", "out.bvh")
    assert main(["track", "take.npz", "-o", "out.bvh"]) == 0


FURTHER = (  # fragments of messages whose commands the other tests of this file run
    "--smpl-model {}: a model is read from .npz",
    "not a motion, and conversion tracks nothing; complete it",
    "leave the file out, or complete it first: bodysense track",  # the command of `checked_half`
    "not a motion; complete it first: bodysense track",
)


def test_every_message_with_a_command_is_run() -> None:
    known = [*SCENARIOS.values(), *FURTHER, *ELSEWHERE]
    alone = [
        text for text in printed() if not re.fullmatch(r"bodysense (?:[a-z]+ )+\d|bodysense train [a-z{}-]+", text)
    ]
    assert [text for text in alone if not any(fragment in text for fragment in known)] == []
    assert [fragment for fragment in known if not any(fragment in text for text in alone)] == []


def test_commands_that_train_a_network_exist(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("bodysense_lab")
    trained = {text for text in printed() if re.fullmatch(r"bodysense train [a-z-]+", text)}
    assert len(trained) >= 4
    for text in sorted(trained):
        with pytest.raises(SystemExit) as ended:
            main([*text.split()[1:], "--help"])
        assert ended.value.code == 0
    capsys.readouterr()


def test_options_in_messages_exist(capsys: pytest.CaptureFixture[str]) -> None:
    """Each option that a message names is one of a command."""
    options = {"--overwrite", "--quiet", "--version", "--help", "--python-expr", "--force-reinstall", "--csv", "--html"}
    for command in ("track", "convert", "simulate", "check", "repair", "demo", "data info", "data joints"):
        with pytest.raises(SystemExit):
            main([*command.split(), "--help"])
        options |= set(re.findall(r"--[a-z][a-z-]*[a-z]", capsys.readouterr().out))
    named = {option for text in messages() for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]", text)}
    named -= {option for option in named if option.startswith("--tyro")}
    assert named - options == set()
