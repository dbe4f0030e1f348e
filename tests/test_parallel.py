"""Work in several processes and on a Dask scheduler's machines gives equal results, in order."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from math import sqrt
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.parallel import parallel_map

NUMBERS = [float(number) for number in range(7)]
ROOTS = [(number, number**0.5) for number in NUMBERS]  # `sqrt`: processes must be able to import the work


def test_one_job_works_in_this_process() -> None:
    assert list(parallel_map(sqrt, NUMBERS, 1)) == ROOTS


@pytest.mark.slow
def test_several_jobs_work_in_processes() -> None:
    assert list(parallel_map(sqrt, NUMBERS, 2)) == ROOTS


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("signal_sent", ["SIGTERM", "SIGKILL"])
def test_workers_end_with_their_parent(tmp_path: Path, signal_sent: str) -> None:
    (tmp_path / "long_work.py").write_text(
        "import os, pathlib, time\n"
        "def work(k):\n"
        "    pathlib.Path(f'{k}.tmp').write_text(str(os.getpid()))\n"
        "    os.replace(f'{k}.tmp', f'{k}.pid')\n"
        "    time.sleep(60)\n"
    )
    script = (
        "from bodysense.parallel import parallel_map\n"
        "from long_work import work\n"
        "list(parallel_map(work, range(2), 2))\n"
    )
    path = os.pathsep.join([str(tmp_path), *sys.path])
    parent = subprocess.Popen([sys.executable, "-c", script], cwd=tmp_path, env={**os.environ, "PYTHONPATH": path})
    try:
        deadline = time.monotonic() + 60
        while len(list(tmp_path.glob("*.pid"))) < 2:
            assert time.monotonic() < deadline and parent.poll() is None
            time.sleep(0.05)
    finally:
        parent.send_signal(getattr(signal, signal_sent))
        parent.wait()
    workers = [int(file.read_text()) for file in tmp_path.glob("*.pid")]
    deadline = time.monotonic() + 10
    while (alive := [worker for worker in workers if _runs(worker)]) and time.monotonic() < deadline:
        time.sleep(0.05)
    for worker in alive:
        os.kill(worker, signal.SIGKILL)
    assert not alive


def _runs(process: int) -> bool:
    """Return whether a process runs; ended processes that were not waited for do not."""
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat")
        return not (state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z")
    except (ProcessLookupError, FileNotFoundError):
        return False


@pytest.mark.slow
def test_work_runs_on_a_scheduler() -> None:
    distributed = pytest.importorskip("distributed")
    anywhere = "127.0.0.1:0"  # by default each cluster's page takes port 8787
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=anywhere
    ) as cluster:
        assert list(parallel_map(sqrt, NUMBERS, 1, cluster.scheduler_address)) == ROOTS


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_refused() -> None:
    with pytest.raises(BodysenseError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        list(parallel_map(sqrt, NUMBERS, 1, "tcp://127.0.0.1:9"))
