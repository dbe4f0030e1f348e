"""Feet that stand: where contact with the floor is likely a foot is held in its place, and none is under the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.errors import BodysenseError


@dataclass(frozen=True)
class FootLockSettings:
    """When a foot is held and how it comes free."""

    hold: float = 0.6  # probability of contact from which a foot is held
    release: float = 0.4  # and below which it is let go
    half_life: float = 0.1  # s in which half of what a released foot was held back by fades
    longest: float = 0.12  # m: a foot that its leg drags farther slides along
    highest: float = 0.5  # m: no foot is lifted farther to be on the floor

    def __post_init__(self) -> None:
        if not 0 < self.release <= self.hold < 1:
            raise BodysenseError(
                f"foot lock: release {self.release:g} and hold {self.hold:g} must be probabilities, release the smaller"
            )
        for name in ("half_life", "longest", "highest"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"foot lock: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class FootLockState:
    """What holds each foot, left and right; of one body, or of many (…)."""

    held: np.ndarray  # (…, 2) -1 free, 0 by its ankle, 1 by its ball
    anchor: np.ndarray  # (…, 2, 2) m: where that stands, x and z
    shift: np.ndarray  # (…, 2, 2) m: how far the foot is moved, x and z


def released() -> FootLockState:
    """No foot is held."""
    return FootLockState(np.full(2, -1), np.zeros((2, 2)), np.zeros((2, 2)))


def lock_feet(
    foot: np.ndarray,
    contact: np.ndarray,
    interval: np.ndarray | float,
    settings: FootLockSettings,
    state: FootLockState,
) -> tuple[np.ndarray, FootLockState]:
    """By how much (…, 2, 3) m to move each foot, and the state after it.

    Args:
        foot: (…, 2, 3, 3) m, world: ankle, ball and toe tip of left and right foot.
        contact: (…, 2, 2) probability that ankle and ball stand on the floor.
        interval: (…) s since the frame before.
        settings: When a foot is held.
        state: Of the frame before.
    """
    held = state.held
    shift = state.shift * (0.5 ** (np.asarray(interval) / settings.half_life))[..., None, None]
    # Of each foot the part that holds it, or that would: whether it is the ball.
    by_ball = np.where(held >= 0, held == 1, contact[..., 1] >= contact[..., 0])
    likely = np.where(by_ball, contact[..., 1], contact[..., 0])
    let_go = (held >= 0) & (likely < settings.release)
    if let_go.any():  # it may be held by its other part at once
        by_ball = np.where(let_go, contact[..., 1] >= contact[..., 0], by_ball)
        likely = np.where(by_ball, contact[..., 1], contact[..., 0])
    stays = (held >= 0) & ~let_go
    holds = stays | (likely >= settings.hold)
    standing = np.where(by_ball[..., None], foot[..., 1, ::2], foot[..., 0, ::2])
    anchor = np.where((holds & ~stays)[..., None], standing + shift, state.anchor)
    pull = anchor - standing
    length = np.sqrt(np.einsum("...i,...i->...", pull, pull))
    pull *= np.minimum(1.0, settings.longest / np.maximum(length, 1e-9))[..., None]
    shift = np.where(holds[..., None], pull, shift)
    anchor = np.where(holds[..., None], standing + pull, anchor)
    move = np.zeros((*held.shape, 3))
    move[..., ::2] = shift
    # A floor that is deeper than this is somewhere else: legs do not fold to stand on it.
    move[..., 1] = np.minimum(np.maximum(-foot[..., 1].min(axis=-1), 0), settings.highest)
    return move, FootLockState(np.where(holds, by_ball, -1), anchor, shift)
