"""Estimate the processor hours of the trainings of docs/reproduce.md from two short runs of each, and time commands.

    python scripts/figures/measure_hours.py DATA FIGURES/hours.json [NAME …]

DATA is a folder of motion with fingers or a prepared store. The processor time between a run of few and one of more
steps gives that of a step. Commands that need no data of yours run whole, on the packaged performance. A file that is
there keeps the numbers of those that are not named.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

from bodysense.cli.show import processor, write_numbers
from bodysense.demo import packaged_performance
from bodysense.io.formats.bvh import write_bvh

FEW = ("--limit", "16", "--check-every", "1000000")  # clips, for full batches; no checks in between
STEPS = {  # command and options: the steps of the two runs
    "train hmd-vae": (20, 80),
    "train gloves --form paper --network markers": (20, 320),
    "train gloves --form paper --network joints": (20, 320),
    "train body-gru --form paper": (2, 32),
    "train arms --model ahmt": (2, 5),
    "train arms --model pahmt": (2, 5),
}
WHOLE = {  # command and options, in a folder with the packaged performance
    "papers generate": ("-o", "bodies.bvh"),
    "papers track --method two_hands": ("performance.bvh", "-o", "hands.bvh"),
}
OUT = {"hmd-vae": "net.pt", "arms": "net.pt", "body-gru": "net.onnx", "gloves": "nets"}  # --out, by the training


def main() -> None:
    """Measure trainings and commands, and write the numbers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of motion or a prepared store")
    parser.add_argument("out", type=Path, help="file for the numbers")
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="trainings and commands, as docs/reproduce.md names them; all if omitted",
    )
    chosen = parser.parse_args()
    if unknown := [name for name in chosen.names if name not in (*STEPS, *WHOLE)]:
        parser.error(f"{unknown[0]!r} is unknown; valid are {', '.join(map(repr, (*WHOLE, *STEPS)))}")
    numbers = json.loads(chosen.out.read_text(encoding="utf-8")) if chosen.out.is_file() else {}
    numbers.pop("cpu_seconds", None)  # of the runs, not of the trainings
    if numbers.pop("processor", processor()) != processor():
        raise SystemExit(f"{chosen.out}: measured on another processor; give another file")
    for name in [name for name in WHOLE if not chosen.names or name in chosen.names]:
        numbers[f"{name}_seconds"] = seconds_whole(name)
        print(f"{name}: {numbers[f'{name}_seconds']:.1f} s", flush=True)
        write_numbers(chosen.out, numbers)
    for name in [name for name in STEPS if not chosen.names or name in chosen.names]:
        short, long = (seconds(name, steps, chosen.data) for steps in STEPS[name])
        numbers[f"{name}_seconds_a_step"] = (long - short) / (STEPS[name][1] - STEPS[name][0])
        print(f"{name}: {short:.1f} s, {long:.1f} s: {numbers[f'{name}_seconds_a_step']:.3f} s a step", flush=True)
        write_numbers(chosen.out, numbers)


def seconds(name: str, steps: int, data: Path) -> float:
    """Return the processor time of a training of `steps` steps, s."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / OUT[name.split()[1]]
        options = ["--data", str(data.resolve()), *FEW, "--steps", str(steps), "--threads", "1", "-o", str(out)]
        return processor_time([*name.split(), *options], Path(folder))


def seconds_whole(name: str) -> float:
    """Return the processor time of a command of `WHOLE`, s."""
    with tempfile.TemporaryDirectory() as folder:
        write_bvh(Path(folder) / "performance.bvh", packaged_performance())
        return processor_time([*name.split(), *WHOLE[name]], Path(folder))


def processor_time(command: list[str], folder: Path) -> float:
    """Return the processor time of a command of bodysense in a folder, s."""
    program = shutil.which("bodysense")
    assert program is not None
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([program, *command], check=True, stdout=subprocess.DEVNULL, cwd=folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
