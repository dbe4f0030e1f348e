"""Every `train` command: a trial of few clips and steps by two processes.

`tests/lab/commands/test_resuming.py` trains with one process. The completion network's trial publishes too.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from people.split import write_people

from bodysense.cli import main
from bodysense.demo import packaged_performance
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import Source
from bodysense.tracking.model import load_completion
from bodysense.tracking.tracker import Tracker
from bodysense_lab.commands import train
from bodysense_lab.core import fit, sweep
from bodysense_lab.data import clips

FIRST_LINE = 20.0  # s of a processor from the command to its first line
# Files that each training writes next to --out, its log, and options for a small network.
COMMANDS = {
    "completion": ("net.safetensors", "net/completion.jsonl", "--finger-steps 2 --warm-up 1"),
    "completion-fingers": ("net.ckpt", "net.jsonl", "--warm-up 1"),
    "completion-joining": ("net.safetensors", "net/joining.jsonl", "--frames 300 --warm-up 1"),
    "body-gru": ("net.onnx", "net.jsonl", "--lanes 4 --hidden 16"),
    "unoc-tables": ("nets/window_9.pt", "nets/window_9.jsonl", "--networks window_9 --batch-scale 0.02"),
    "fingers": ("net.onnx", "net.jsonl", ""),
    "upper-body": ("net.onnx", "net.jsonl", ""),
    "hmd-vae": ("net.onnx", "net.jsonl", "--batch 4"),
    "arms": ("net.onnx", "net.jsonl", "--width 32 --layers 1 --spatial-layers 1 --batch 8"),
    "arms-table": ("nets/cnn.pt", "nets/cnn.jsonl", "--networks cnn --width 32 --batch 8"),
    "gloves": ("nets/glove_joints.onnx", "nets/glove_joints.jsonl", ""),
}
TRAINED = sorted(set(COMMANDS) - {"completion"})  # which is published afterwards
# Trained by two processes. Two nodes train `completion-fingers`; `fingers` and `arms-table` train like two others.
OF_TWO = sorted(set(TRAINED) - {"fingers", "arms-table", "completion-fingers"})

# A process that runs commands one after the other, with a word in place of each .onnx file, as `short_training` does.
ONE_BY_ONE = """
import importlib, shlex, sys
from pathlib import Path
from bodysense.cli import main

def export(*given, **options):
    next(one for one in given if isinstance(one, Path)).write_bytes(b"trained")

if __name__ == "__main__":
    for module in ("unoc.network", "hmd_vae", "pahmt"):
        importlib.import_module(f"bodysense_lab.papers.{module}.export").export = export
    importlib.import_module("bodysense_lab.papers.two_hands.train").export = export
    for command in sys.argv[1:]:
        if main(shlex.split(command)):
            sys.exit(command)
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three clips of the packaged performance for training, three for validation."""
    clip = packaged_performance()
    cut = [replace(clip, pose=clip.pose[first : first + 90]) for first in range(0, 600, 100)]
    return write_people(tmp_path_factory.mktemp("data"), {"train": cut[:3], "val": cut[3:]})


def arguments(command: str, data: Path, out: Path, steps: int) -> list[str]:
    written, _, small = COMMANDS[command]
    place = out / written.split("/")[0]
    trial = f"--limit 2 --steps {steps} --threads 1 {small}"
    return ["train", command, "--data", str(data), "-o", str(place), *trial.split()]


def test_no_train_command_is_left_out() -> None:
    names = {name.replace("_", "-") for name in train.commands()._subcommands} - {"card"}
    assert names == set(COMMANDS)


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The splits of the clips that are read, in order: two of the three of each split are a trial's."""
    read_clip, read = clips._read, list[str]()

    def counted(source: Source, *rest: Any) -> Clip:
        read.append(source.split)
        return read_clip(source, *rest)

    monkeypatch.setattr(clips, "_read", counted)
    return read


@pytest.mark.slow
@pytest.mark.usefixtures("quick_completion")
def test_the_completion_network_is_trained_and_published(
    recorded: Path, tmp_path: Path, read: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert main(arguments("completion", recorded, tmp_path, 2)) == 0
    assert sorted(read) == 4 * ["train"] + 4 * ["val"]  # to train, and to calibrate
    network = load_completion(tmp_path / COMMANDS["completion"][0])
    assert Tracker(network=network).start().model is network
    check_log(tmp_path / COMMANDS["completion"][1], "1 process")


@pytest.mark.slow
@pytest.mark.parametrize("command", TRAINED)
@pytest.mark.usefixtures("short_training")
def test_a_trial_names_its_machine_first_and_reads_as_many_clips_as_it_is_limited_to(
    command: str,
    recorded: Path,
    tmp_path: Path,
    read: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    line, marks = fit.progress_line, []

    def marked(progress: fit.Progress) -> str:
        marks.append(time.process_time())
        return line(progress)

    for module in (fit, sweep):
        monkeypatch.setattr(module, "progress_line", marked)
    begun = time.process_time()
    assert main([*arguments(command, recorded, tmp_path, 2), "--devices", "1", "--nodes", "1"]) == 0
    assert sorted(read) == ["train", "train", "val", "val"]
    assert marks[0] - begun < FIRST_LINE
    written, log, _ = COMMANDS[command]
    assert (tmp_path / written).is_file()
    check_log(tmp_path / log, "1 process")
    output = capsys.readouterr().out
    assert re.match(r"training on cpu, \w+ layers, 1 process\nreading the train split: 0/2\n", output)
    assert output.index("reading the train split: 2/2, ") < output.index("reading the val split: 2/2, ")
    first = next(line for line in output.splitlines() if "step " in line)
    assert re.search(r"step 0/2, \d+ s · cpu, (float32|bfloat16) layers, 1 process", first), output


@pytest.mark.slow
@pytest.mark.parametrize("commands", [OF_TWO[:3], OF_TWO[3:]], ids=" ".join)
def test_two_processes_share_trainings(commands: list[str], recorded: Path, tmp_path: Path) -> None:
    """They train one network after the other, and end at the first that fails."""
    (tmp_path / "commands.py").write_text(ONE_BY_ONE)
    for command in commands:
        (tmp_path / command).mkdir()
    lines = [
        shlex.join([*arguments(command, recorded, tmp_path / command, 2), "--devices", "2"]) for command in commands
    ]
    with distributed(tmp_path, "--standalone", "--nproc-per-node", "2", str(tmp_path / "commands.py"), *lines) as both:
        output = both.communicate(timeout=600)[0]
    assert both.returncode == 0, output
    for command in commands:
        written, log, _ = COMMANDS[command]
        assert (tmp_path / command / written).is_file(), output
        check_log(tmp_path / command / log, "2 processes")


@pytest.mark.slow
def test_two_nodes_share_a_training(recorded: Path, tmp_path: Path) -> None:
    """The loop's work, which all tasks have in common."""
    words = ["-m", "bodysense", *arguments("completion-fingers", recorded, tmp_path, 2), "--nodes", "2"]
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    meeting = ("--nnodes", "2", "--nproc-per-node", "1", "--master-addr", "127.0.0.1", "--master-port", port)
    started = [distributed(tmp_path, *meeting, "--node-rank", str(rank), *words) for rank in range(2)]
    output = [process.communicate(timeout=600)[0] for process in started]
    assert [process.returncode for process in started] == [0, 0], output
    written, log, _ = COMMANDS["completion-fingers"]
    assert (tmp_path / written).is_file()
    check_log(tmp_path / log, "2 processes")


def distributed(folder: Path, *words: str) -> subprocess.Popen[str]:
    """Start PyTorch's launcher with some words; caches are in a folder."""
    return subprocess.Popen(
        [sys.executable, "-m", "torch.distributed.run", *words],
        env={**os.environ, "OMP_NUM_THREADS": "1", "XDG_CACHE_HOME": str(folder / "cache")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def check_log(path: Path, processes: str) -> None:
    """Check that one process kept the log of a trial of two steps."""
    (line,) = [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()]
    assert (line["step"], line["steps"]) == (2, 2) and line["steps_per_second"] > 0
    assert line["machine"].endswith(f"layers, {processes}")
