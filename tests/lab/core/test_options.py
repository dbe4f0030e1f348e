"""Options of trial trainings on few clips."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bodysense.cli import main
from bodysense_lab.commands import arms, completion, gloves, hmd_vae, train

# The module of each training, and its steps without --limit.
TRAININGS = {
    "completion": (completion, 6200),
    "completion-fingers": (completion, 2000),
    "completion-joining": (completion, 4000),
    "body-gru": (train, None),
    "unoc-tables": (train, None),
    "fingers": (train, 500),
    "upper-body": (train, 8000),
    "hmd-vae": (hmd_vae, 6000),
    "arms": (arms, None),
    "arms-table": (arms, None),
    "gloves": (gloves, None),
}
OUT = {
    **dict.fromkeys(("completion", "completion-joining"), "a.safetensors"),
    **dict.fromkeys(("unoc-tables", "arms-table", "gloves"), "nets"),
    "completion-fingers": "a.ckpt",
}


@pytest.fixture
def run_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return a function that runs a training command without training and returns its options."""

    def run(command: str, *options: str) -> Any:
        runs: list[Any] = []
        name, module = command.replace("-", "_"), TRAININGS[command][0]

        def training(run: Any) -> None:
            runs.append(run)

        training.__annotations__ = inspect.get_annotations(getattr(module, name), eval_str=True)
        training.__name__ = name
        monkeypatch.setattr(module, name, training)
        out = tmp_path / OUT.get(command, "a.onnx")
        assert main(["train", command, "--data", str(tmp_path), "-o", str(out), *options]) == 0
        return runs[0]

    return run


def steps_of(run: Any) -> int | None:
    return run.schedule.steps if hasattr(run, "schedule") else run.steps


@pytest.mark.parametrize("command", TRAININGS)
def test_trials_have_few_steps_unless_steps_are_given(
    run_of: Callable[..., Any], command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = TRAININGS[command][1]
    assert steps_of(run_of(command)) == usual
    assert steps_of(run_of(command, "--limit", "1", "--steps", str(usual or 70))) == (usual or 70)
    assert "--steps" not in capsys.readouterr().out
    assert steps_of(run_of(command, "--limit", "1")) == 4
    assert "--limit 1: a trial with --steps 4" in capsys.readouterr().out


def test_a_trial_of_completion_trains_fingers_and_joining_briefly(run_of: Callable[..., Any]) -> None:
    assert run_of("completion", "--limit", "1").finger_steps == 4
    assert run_of("completion", "--limit", "1", "--finger-steps", "0").finger_steps == 0
    assert run_of("completion-joining", "--limit", "1").frames == 300
