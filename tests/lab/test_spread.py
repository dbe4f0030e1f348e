"""Work in several processes, and on a Dask scheduler's machines: the same results, in order."""

from __future__ import annotations

import pytest

from bodysense.errors import BodysenseError
from bodysense.lab.spread import spread

NUMBERS = list(range(7))
SQUARES = [(number, float(number) ** 2) for number in NUMBERS]


def squared(number: int) -> float:
    return float(number) ** 2


def test_here() -> None:
    assert list(spread(squared, NUMBERS, 1)) == SQUARES


@pytest.mark.slow
def test_in_processes() -> None:
    assert list(spread(squared, NUMBERS, 2)) == SQUARES


@pytest.mark.slow
def test_on_a_scheduler() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        assert list(spread(squared, NUMBERS, 1, cluster.scheduler_address)) == SQUARES


@pytest.mark.slow
def test_no_scheduler_there() -> None:
    with pytest.raises(BodysenseError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        list(spread(squared, NUMBERS, 1, "tcp://127.0.0.1:9"))
