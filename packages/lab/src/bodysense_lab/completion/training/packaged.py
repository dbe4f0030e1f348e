"""Training sequences of the packaged performance, for benchmarks and trials without data."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bodysense.demo import packaged_performance
from bodysense_lab.completion.data.corpus import Corpus, corpus_of
from bodysense_lab.completion.data.sequences import Sequence
from bodysense_lab.completion.training.task import sequence_sampler


def packaged_corpus() -> Corpus:
    """Return a corpus of the packaged performance."""
    return corpus_of([packaged_performance()])


def packaged_sampler(rng: np.random.Generator) -> Callable[[], Sequence]:
    """Return a function that draws a sequence of the packaged performance."""
    return sequence_sampler(packaged_corpus(), False, rng)
