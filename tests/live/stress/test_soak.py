"""Wearers over a bad network: sessions answer, resume and stay small; a server that keeps anything is found."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("prometheus_client", reason="needs packages/live")
from ..conftest import free_port, storing
from .soak import SoakCounts, SoakPlan, descriptors, faults, rss_mb, soak


def test_what_a_server_keeps_is_a_fault() -> None:
    plan = SoakPlan()
    flat = SoakCounts(answered=1, rss_mb_warm=100.0, rss_mb_last=104.0, descriptors_warm=20, descriptors_last=21)
    assert faults(flat, plan) == []
    assert faults(replace(flat, descriptors_last=26), plan) == ["6 more descriptors are open"]
    assert faults(replace(flat, rss_mb_last=120.0), plan) == ["memory grew by 20 MB"]


def test_open_files_are_counted_and_connections_are_not(tmp_path: Path) -> None:
    before = descriptors(os.getpid())
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()),
        (tmp_path / "kept").open("w"),
    ):
        assert descriptors(os.getpid()) == before + 2


def test_files_and_memory_of_processes_that_a_server_started_are_counted() -> None:
    files, size = descriptors(os.getpid()), rss_mb(os.getpid())
    text = "held = [bytearray(b'1') * 2**25, *map(open, ['/dev/null'] * 9)]; print(flush=True); open(0).read()"
    command = [sys.executable, "-c", text]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout and child.stdin
        child.stdout.readline()
        assert descriptors(os.getpid()) >= files + 9
        assert rss_mb(os.getpid()) > size + 32
        child.stdin.close()


@pytest.mark.slow
@pytest.mark.alone
def test_wearers_over_a_bad_network_are_answered_and_resume() -> None:
    plan = SoakPlan(seconds_connected=2.5)
    counts = soak(plan, np.random.default_rng(1))
    assert faults(counts, plan) == []
    assert counts.breaks > 2 and counts.resumed > 2
    assert counts.answered > 0.7 * counts.sent


@pytest.mark.slow
@pytest.mark.alone
def test_wearers_of_killed_processes_resume_in_another() -> None:
    with storing(free_port()) as address:
        plan = SoakPlan(sessions=6, seconds=15.0, workers=2, shared=address, seconds_between_kills=5.0)
        counts = soak(plan, np.random.default_rng(2))
    assert faults(counts, plan) == []
    assert counts.killed >= 2 and counts.resumed > 2
