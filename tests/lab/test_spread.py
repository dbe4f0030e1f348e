"""Work in several processes, and on a Dask scheduler's machines: the same results, in order."""

from __future__ import annotations

from math import sqrt

import pytest

from bodysense.errors import BodysenseError
from bodysense_lab.spread import spread

NUMBERS = [float(number) for number in range(7)]
ROOTS = [(number, number**0.5) for number in NUMBERS]  # `sqrt`: processes must be able to import the work


def test_here() -> None:
    assert list(spread(sqrt, NUMBERS, 1)) == ROOTS


@pytest.mark.slow
def test_in_processes() -> None:
    assert list(spread(sqrt, NUMBERS, 2)) == ROOTS


@pytest.mark.slow
def test_on_a_scheduler() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        assert list(spread(sqrt, NUMBERS, 1, cluster.scheduler_address)) == ROOTS


@pytest.mark.slow
def test_no_scheduler_there() -> None:
    with pytest.raises(BodysenseError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        list(spread(sqrt, NUMBERS, 1, "tcp://127.0.0.1:9"))
