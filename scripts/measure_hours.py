"""Estimate the processor hours of the trainings of docs/reproduce.md, from two short runs of each.

    python scripts/measure_hours.py DATA FIGURES/hours.json [NAME …]

DATA is a folder of motion with fingers or a prepared store. The processor time between a run of few and one of more
steps gives that of a step. A file that is there keeps the numbers of trainings that are not named.
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

FEW = ("--limit", "16", "--check-every", "1000000")  # clips, for full batches; no checks in between
STEPS = {  # command and options: the steps of the two runs
    "train hmd-vae": (20, 80),
    "train gloves --form paper --network markers": (20, 320),
    "train gloves --form paper --network joints": (20, 320),
    "train body-gru --form paper": (2, 8),
    "train arms --model ahmt": (2, 5),
    "train arms --model pahmt": (2, 5),
}
OUT = {"hmd-vae": "net.pt", "arms": "net.pt", "body-gru": "net.onnx", "gloves": "nets"}  # --out, by the training


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", type=Path, help="folder of motion or a prepared store")
    parser.add_argument("out", type=Path, help="file for the numbers")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="trainings, as docs/reproduce.md names them; all if omitted"
    )
    chosen = parser.parse_args()
    numbers = json.loads(chosen.out.read_text(encoding="utf-8")) if chosen.out.is_file() else {}
    numbers.pop("cpu_seconds", None)  # of the runs, not of the trainings
    if numbers.pop("processor", processor()) != processor():
        raise SystemExit(f"{chosen.out}: measured on another processor; give another file")
    for name in chosen.names or STEPS:
        short, long = (seconds(name, steps, chosen.data) for steps in STEPS[name])
        numbers[f"{name}_seconds_a_step"] = (long - short) / (STEPS[name][1] - STEPS[name][0])
        print(f"{name}: {short:.1f} s, {long:.1f} s: {numbers[f'{name}_seconds_a_step']:.3f} s a step", flush=True)
        write_numbers(chosen.out, numbers)


def seconds(name: str, steps: int, data: Path) -> float:
    """Return the processor time of a training of `steps` steps, s."""
    program = shutil.which("bodysense")
    assert program is not None
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / OUT[name.split()[1]]
        options = ["--data", str(data), *FEW, "--steps", str(steps), "--threads", "1", "-o", str(out)]
        subprocess.run([program, *name.split(), *options], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
