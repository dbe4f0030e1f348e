"""Streams that play whole sequences side by side, a chunk at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sized
from typing import TypeVar

import numpy as np

S = TypeVar("S", bound=Sized)


def played(draw: Callable[[], S], count: int, chunk: int) -> Iterator[tuple[list[tuple[S, int]], np.ndarray]]:
    """Of `count` streams, for each chunk: the sequence that each plays and its first frame there, and who begins (B,).

    A stream whose sequence has ended draws the next one.
    """
    playing = [(draw(), 0) for _ in range(count)]
    while True:
        yield playing, np.array([first == 0 for _, first in playing])
        after = [(one, first + chunk) for one, first in playing]
        playing = [(one, first) if first < len(one) else (draw(), 0) for one, first in after]
