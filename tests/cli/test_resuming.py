"""Every network is trained by its command, killed after a checkpoint, and goes on from there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bodysense.data.bvh import write_bvh
from bodysense.data.clip import Clip
from bodysense.data.splits import split_of

# The command, where its log lies, and what it writes.
TRAININGS = {
    "body-gru": ("--steps 1500 --lanes 2 --chunk 2 --hidden 8 --passes 1 -o net.onnx", "net.jsonl", "net.onnx"),
    "unoc-tables": (
        "--networks window_9 --epochs 60 --window-stride 2 --batch-scale 0.02 -o nets",
        "nets/window_9.jsonl",
        "nets/window_9.pt",
    ),
    "fingers": ("--steps 300 -o net.onnx", "net.jsonl", "net.onnx"),
    "upper-body": ("--form paper --steps 800 -o net.onnx", "net.jsonl", "net.onnx"),
    "hmd-vae": (
        "--model 1 --latent 4 --width 16 --sequence-width 8 --steps 900 --batch 4 --check-every 300 -o net.onnx",
        "net.jsonl",
        "net.onnx",
    ),
    "arms": (
        "--model cnn --width 16 --layers 1 --epochs 60 --batch 4 --check-every 60 -o net.onnx",
        "net.jsonl",
        "net.onnx",
    ),
    "arms-table": (
        "--networks cnn --width 16 --layers 1 --epochs 60 --batch 4 --check-every 60 -o nets",
        "nets/cnn.jsonl",
        "nets/cnn.pt",
    ),
    "gloves": (
        "--network recurrent --steps 1000 --hand-minutes 0.5 --pair-minutes 0.5 -o nets",
        "nets/glove_recurrent.jsonl",
        "nets/glove_recurrent.onnx",
    ),
    "completion": (
        "--steps 12 --warm-up 1 --check-every 4 --finger-steps 0 -o net.onnx",
        "net/completion.jsonl",
        "net.onnx",
    ),
    "completion-fingers": ("--steps 60 --warm-up 1 --check-every 20 -o net.ckpt", "net.jsonl", "net.ckpt"),
}
LONGEST = 600.0  # s that a run may take


@pytest.mark.slow
@pytest.mark.parametrize("command", TRAININGS)
def test_a_killed_training_goes_on(command: str, tmp_path: Path, waving_clip: Clip) -> None:
    for split in ("train", "val"):
        for person in [name for name in map(str, range(99)) if split_of(name) == split][:2]:
            (tmp_path / "data" / person).mkdir(parents=True)
            write_bvh(tmp_path / "data" / person / "waving.bvh", waving_clip)
    asked, log, written = TRAININGS[command]
    killed = train(tmp_path, command, asked)
    until = time.monotonic() + LONGEST
    while killed.poll() is None and not steps_of(tmp_path / log) and time.monotonic() < until:
        time.sleep(0.02)
    killed.kill()
    said = killed.communicate()[0]
    before = steps_of(tmp_path / log)
    assert before and (written.endswith(".ckpt") or not (tmp_path / written).is_file()), said
    resumed = train(tmp_path, command, asked)
    said = resumed.communicate(timeout=LONGEST)[0]
    assert resumed.returncode == 0, said
    after = steps_of(tmp_path / log)
    assert after[: len(before)] == before and after == sorted(set(after)), "no step is trained twice"
    assert (tmp_path / written).is_file() and len(after) > len(before)


def train(folder: Path, command: str, asked: str) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    data = ("--data", "data") if "--data" not in asked else ()
    return subprocess.Popen(
        [sys.executable, "-m", "bodysense", "train", command, *data, *asked.split(), "--threads", "1"],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def steps_of(log: Path) -> list[int]:
    """At which steps a run has left a checkpoint."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.is_file() else []
    return [json.loads(line)["step"] for line in lines if line.endswith("}")]
