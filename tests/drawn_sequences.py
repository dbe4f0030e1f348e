"""Samplers of training sequences that processes started by tests import by name."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from bodysense_lab.completion.data.sequences import Sequence
from bodysense_lab.completion.training.packaged import packaged_sampler


def numbered(rng: np.random.Generator) -> Callable[[], Sequence]:
    """Draw sequences of a frame whose size is a random number and whose interval counts the draws."""
    first = packaged_sampler(np.random.default_rng(0))()
    cut = {one.name: getattr(first, one.name) for one in fields(Sequence)}
    for name, value in cut.items():
        if isinstance(value, np.ndarray) and len(value) == len(first):
            cut[name] = value[:1]
    short, counter = Sequence(**cut), itertools.count(1)
    return lambda: replace(short, size=float(rng.uniform()), interval=float(next(counter)))


def failing(rng: np.random.Generator) -> Callable[[], Sequence]:
    """End the process."""
    raise SystemExit(1)
