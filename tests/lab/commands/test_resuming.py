"""Trainings that are killed after the first checkpoint resume, and end like uninterrupted ones."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from people.split import write_people

from bodysense.cli import main
from bodysense.demo import packaged_performance
from bodysense_lab.completion.networks import publish
from bodysense_lab.core import fit

# Options of each command, its log, and the file it writes. `fingers` trains like `upper-body`, tables like networks.
TRAININGS = {
    "completion": ("--steps 4 --warm-up 1 --finger-steps 0", "net/completion.jsonl", "net.safetensors"),
    "body-gru": ("--steps 6 --lanes 2 --chunk 2 --hidden 8 --passes 1 --finger-passes 1", "net.jsonl", "net.onnx"),
    "upper-body": ("--form paper --steps 6", "net.jsonl", "net.onnx"),
    "hmd-vae": (
        "--model 1 --latent 4 --width 16 --sequence-width 8 --steps 6 --batch 4",
        "net.jsonl",
        "net.pt",
    ),
    "arms": ("--model cnn --width 16 --layers 1 --epochs 6 --batch 32", "net.jsonl", "net.pt"),
    "gloves": (
        "--network markers --steps 6 --hand-minutes 0.5 --pair-minutes 0",
        "nets/glove_markers.jsonl",
        "nets/glove_markers.onnx",
    ),
    "completion-fingers": ("--steps 6 --warm-up 1", "net.jsonl", "net.ckpt"),
    "completion-joining": ("--steps 6 --warm-up 1 --frames 300", "net/joining.jsonl", "net.safetensors"),
}
# These trainings draw the batch of a step by its number. The others draw new batches after they resume.
BY_STEP = ("arms", "gloves")
# One training is killed as a process. The others are stopped in `fit`, which writes all checkpoints: this is faster.
AS_PROCESS = "gloves"
KILLED = """
import os, signal, sys
from bodysense.cli import main
from bodysense_lab.core import fit

save, saved = fit.save_checkpoint, []

def once(*arguments):
    if saved:
        os.kill(os.getpid(), signal.SIGKILL)
    saved.append(save(*arguments))

fit.save_checkpoint = once
main(sys.argv[1:])
"""


class Stopped(BaseException):
    """Exception that ends a run after its first checkpoint; no command catches it."""


def stop_after_first_checkpoint(arguments: list[str]) -> None:
    """Run a training until the step after its first checkpoint begins."""
    save, step, saved = fit.save_checkpoint, fit.take_step, []

    def marked(*given: Any) -> None:
        saved.append(save(*given))

    def stopping(*given: Any) -> Any:
        if saved:
            raise Stopped
        return step(*given)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(Stopped):
        patch.setattr(fit, "save_checkpoint", marked)
        patch.setattr(fit, "take_step", stopping)
        main(arguments)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three seconds of the packaged performance for a person in training and one in validation."""
    clip = packaged_performance()
    learned, watched = (replace(clip, pose=clip.pose[first : first + 100]) for first in (100, 300))
    return write_people(tmp_path_factory.mktemp("data"), {"train": [learned], "val": [watched]})


@pytest.mark.slow
@pytest.mark.parametrize("command", TRAININGS)
@pytest.mark.usefixtures("short_training")
def test_a_killed_training_resumes(
    command: str, recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # Writing the final file takes long; tests/cli/test_trials.py tests it.
    monkeypatch.setattr(publish, "publish", lambda body, fingers, data, out, *card: out.write_bytes(b"trained"))
    options, log, written = TRAININGS[command]
    out = {name: tmp_path / name for name in ("whole", "killed")}
    arguments = {
        name: [
            *("train", command, "--data", str(recorded), *options.split(), "--check-every", "2", "--threads", "1"),
            *("-o", str(folder / Path(written if "/" not in written else "nets"))),
        ]
        for name, folder in out.items()
    }
    for folder in out.values():
        folder.mkdir()
    assert main(arguments["whole"]) == 0
    whole = logged(out["whole"] / log)
    assert [line["step"] for line in whole][:2] == [2, 4], "the run has more than one checkpoint"

    if command == AS_PROCESS:
        killed = subprocess.run(
            [sys.executable, "-c", KILLED, *arguments["killed"]], capture_output=True, text=True, check=False
        )
        assert killed.returncode == -signal.SIGKILL, killed.stderr
    else:
        stop_after_first_checkpoint(arguments["killed"])
    assert logged(out["killed"] / log) == whole[:1]
    assert written.endswith(".ckpt") or not (out["killed"] / written).exists()

    assert main(arguments["killed"]) == 0
    resumed = logged(out["killed"] / log)
    assert [line["step"] for line in resumed] == [line["step"] for line in whole], "no step is lost or repeated"
    if command in BY_STEP:
        assert resumed == whole
    else:
        for ours, theirs in zip(resumed, whole, strict=True):
            assert ours["terms"]["loss"] == pytest.approx(theirs["terms"]["loss"], rel=1.0)
    assert (out["killed"] / written).is_file()


def logged(log: Path) -> list[dict[str, Any]]:
    """Return the lines of a run's log, without times."""
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return [
        {name: value for name, value in line.items() if name not in ("seconds", "steps_per_second")} for line in lines
    ]
