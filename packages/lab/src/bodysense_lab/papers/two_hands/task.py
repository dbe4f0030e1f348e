"""Training of the networks of a glove (two-hands, section 3.3): how long, and how."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from bodysense_lab.core.fit import Task, process_seed, rate_at
from bodysense_lab.papers.two_hands.frames import GloveFrames

HIDDEN_SHARE = (0.70, 0.17, 0.08, 0.05)  # how often one to four markers are hidden (two-hands, Fig. 13)
EVEN_SHARE = (0.4, 0.25, 0.2, 0.15)  # ours: so that four are learned, too


@dataclass(frozen=True)
class GloveSchedule:
    """How long and on what. The learning rate warms up and falls as a cosine, or, with `patience`, is halved."""

    steps: int = 20_000
    batch: int = 256
    learning_rate: float = 1e-3
    warm_up: int = 200  # steps
    patience: int | None = None  # checks without progress after which the learning rate is halved: the paper's way
    average_decay: float = 0.999  # the kept weights are a moving average; 0 keeps the last ones
    check_every: int = 1000  # steps
    noise: float = 0.0003  # m, of every marker in every frame
    hidden_share: tuple[float, ...] = EVEN_SHARE
    # Weight of the change of a marker's error over 0.1 to 2 s. At run time the error at the moment of occlusion is
    # subtracted (two-hands, section 3.2.2, Discontinuities).
    change: float = 1.0
    squared: bool = False  # mean squared error, the paper's, of markers or of angles; else distances
    seed: int = 1


PAPER_MARKER_SCHEDULE = GloveSchedule(
    batch=32, patience=5, average_decay=0.0, noise=0.0, hidden_share=HIDDEN_SHARE, change=0.0, squared=True
)
PAPER_JOINT_SCHEDULE = GloveSchedule(batch=32, patience=5, average_decay=0.0, noise=0.0, squared=True)


@dataclass(frozen=True, eq=False)
class GloveTask(Task):
    """The training task of a network; every step draws from a generator of its own."""

    network: Any
    schedule: GloveSchedule
    frames: GloveFrames
    validation: GloveFrames
    source: Mapping[str, Any]
    rank: int = 0  # place among the processes that share the training: each draws hands of its own
    clip = 5.0

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam."""
        return torch.optim.Adam(self.network.parameters(), lr=self.schedule.learning_rate)

    def rate(self, step: int, steps: int | None = None) -> float:
        """Warm-up and cosine, or the same all along where it is halved instead."""
        schedule = self.schedule
        return rate_at(schedule, step) if schedule.patience is None else schedule.learning_rate

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[np.random.Generator]:
        """The generator of each step, so that a run that goes on is the run that it was."""
        seed = process_seed(self.schedule.seed, self.rank)
        return (np.random.default_rng([seed, step]) for step in itertools.count(done + 1))
