"""Pairs of hands, of clips and synthesised, and figures that are gathered over many of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

import numpy as np

from bodysense.body.hands.hand import hand_pose, hand_skeleton
from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.parallel import parallel_map
from bodysense_lab.core.scoring import group_of
from bodysense_lab.data.datasets import Census, gather_results
from bodysense_lab.synthesis.hands import varied_hand
from bodysense_lab.synthesis.motion import RATE
from bodysense_lab.synthesis.pairs import synthesize_pair

SYNTHESISED = "synthesised"  # the group of synthesised hands
SYNTHESISED_SECONDS, SPREAD = 20.0, 0.05  # s of a piece; the spread of the hands' sizes


class Figures(Protocol):
    """Figures that add up."""

    def merge(self, other: Any) -> None:
        """Count what another has counted."""


F = TypeVar("F", bound=Figures)
Work = Callable[["HandPair", np.random.Generator], F]  # it must pickle
Piece = tuple[int, int]  # of a series of synthesised pieces, and the number of one


@dataclass(frozen=True, eq=False)
class HandPair:
    """Two hands of a person over time at 60 Hz, each a left hand in its own world, and the body if it is known."""

    left: Pose
    right: Pose
    body: Pose | None = None

    @property
    def time(self) -> np.ndarray:
        """(T,) s."""
        return np.arange(1, len(self.left.root_position) + 1) / RATE

    @property
    def hands(self) -> dict[str, Pose]:
        """By the names that observations have."""
        return {"left": self.left, "right": self.right}


def synthesised_pair(seed: Piece, seconds: float = SYNTHESISED_SECONDS) -> HandPair:
    """A pair of hands of some size that meet again and again."""
    rng = np.random.default_rng(seed)
    hand = varied_hand(hand_skeleton(default_skeleton(), "left"), SPREAD, rng)
    left, right = synthesize_pair(hand, seconds, rng)
    return HandPair(left.pose, right.pose)


def over_clips(
    work: Work[F], clips: Iterable[Clip], jobs: int, advance: Callable[[Clip], None]
) -> tuple[dict[str, F], Census]:
    """Return the figures of all clips with fingers by group of categories; `advance` is called after every clip."""

    def with_fingers() -> Iterator[Clip]:
        for clip in clips:
            if clip.has_fingers:
                yield clip
            else:
                advance(clip)

    return gather_results(partial(_of_clip, work=work), with_fingers(), jobs, advance)


def over_seeds(work: Work[F], seeds: Iterable[Piece], jobs: int, advance: Callable[[], None]) -> F:
    """Return the figures of synthesised pairs, every one of other hands; `advance` is called after each."""
    found: F | None = None
    for _, figures in parallel_map(partial(_of_seed, work=work), seeds, jobs):
        if found is None:
            found = figures
        else:
            found.merge(figures)
        advance()
    assert found is not None, "a table has at least one piece"
    return found


def _of_clip(clip: Clip, work: Work[F]) -> dict[str, F]:
    body = resample(clip, RATE).pose
    pair = HandPair(hand_pose(body, "left"), hand_pose(body, "right"), body)
    return {group_of(clip): work(pair, np.random.default_rng(0))}


def _of_seed(seed: Piece, work: Work[F]) -> F:
    return work(synthesised_pair(seed), np.random.default_rng(seed))
