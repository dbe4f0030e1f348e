"""Two machines train one network: two `torchrun` of one process each, on loopback, with one shared folder."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bodysense.io.bvh import write_bvh
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import split_of


def machines(folder: Path, clip: Clip, asked: str) -> list[str]:
    """What two machines said that train on a folder `data` of a waving person to learn from and one to watch."""
    for split in ("train", "val"):
        person = next(name for name in map(str, range(99)) if split_of(name) == split)
        (folder / "data" / person).mkdir(parents=True)
        write_bvh(folder / "data" / person / "waving.bvh", clip)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    started = [
        subprocess.Popen(
            [
                *(sys.executable, "-m", "torch.distributed.run", "--nnodes", "2", "--node-rank", str(rank)),
                *("--nproc-per-node", "1", "--master-addr", "127.0.0.1", "--master-port", str(port)),
                *("-m", "bodysense", "train", *asked.split()),
            ],
            cwd=folder,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for rank in (0, 1)
    ]
    said = [machine.communicate(timeout=300)[0] for machine in started]
    assert [machine.returncode for machine in started] == [0, 0], said
    return said


@pytest.mark.slow
def test_two_machines_train_a_network_of_the_tables(tmp_path: Path, waving_clip: Clip) -> None:
    asked = (
        "--data data -o out --networks window_9 --epochs 1 --window-stride 4 --batch-scale 0.02 --threads 1 --nodes 2"
    )
    said = machines(tmp_path, waving_clip, f"unoc-tables {asked}")
    assert "trained 9 frames" in said[0] and "trained" not in said[1]
    assert len((tmp_path / "out" / "window_9.jsonl").read_text().splitlines()) == 1  # one of them keeps the log
    assert not list(tmp_path.glob("out/episodes/*/.*.part"))


@pytest.mark.slow
def test_two_machines_train_a_body_vae(tmp_path: Path, waving_clip: Clip) -> None:
    asked = "--data data -o one.pt --model 1 --steps 3 --batch 4 --threads 1 --nodes 2"
    machines(tmp_path, waving_clip, f"hmd-vae {asked}")
    assert (tmp_path / "one.pt").is_file()
    assert len((tmp_path / "one.jsonl").read_text().splitlines()) == 1
