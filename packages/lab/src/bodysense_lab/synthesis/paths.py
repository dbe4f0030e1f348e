"""Paths through key poses: movements of minimum jerk (Flash and Hogan, 1985), with rests between or without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_log, quaternion_multiply

_TYPICAL, _SHORTEST, _LONGEST = 0.40, 0.12, 1.6  # s that a movement lasts, unless it is too fast then
_FLOWING = 0.45  # share of the keys at which nothing rests
_OVERLAP = 0.3  # of the shorter movement: so much earlier the next may begin
_REST, _LONGEST_REST, _HELD = 0.22, 2.0, 0.12  # s of rest at a key; at least so long where it is held


@dataclass(frozen=True, eq=False)
class Timing:
    """When the K − 1 movements between K keys take place. At most two take place at once."""

    start: np.ndarray  # (K − 1, G) s: each of G parts sets out by itself
    end: np.ndarray  # (K − 1,) s: all arrive together


def draw_timing(least: np.ndarray, held: np.ndarray, lag: np.ndarray, rng: np.random.Generator) -> Timing:
    """Random times of movements from 0 s on.

    Args:
        least: (K − 1,) s that each movement lasts at least.
        held: (K,) bool: keys at which the motion rests.
        lag: (K − 1, G) share of a movement, 0 to 1, by which each part sets out later.
        rng: for the choice of durations and rests.
    """
    count = len(least)
    lasting = np.clip(_TYPICAL * np.exp(0.55 * rng.standard_normal(count)), _SHORTEST, _LONGEST)
    lasting = np.maximum(lasting, least)
    rest = np.minimum(_REST * np.exp(0.9 * rng.standard_normal(count)), _LONGEST_REST)
    shorter = np.minimum(lasting, np.roll(lasting, 1))
    flows = (rng.random(count) < _FLOWING) & ~held[:-1]
    rest = np.where(flows, -_OVERLAP * rng.random(count) * shorter, np.maximum(rest, held[:-1] * _HELD))
    rest[:1] = np.abs(rest[:1])
    end = np.cumsum(rest + lasting)
    return Timing((end - lasting)[:, None] + lag * lasting[:, None], end)


def along(time: np.ndarray, timing: Timing, keys: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Values (T, N) at `time` (T,) s of keys (K, N), of which column n moves with part `part[n]` of the timing."""
    key, shares = _progress(time, timing)
    step = np.diff(keys, axis=0, append=keys[-1:])
    values = keys[key]
    for later, share in enumerate(shares):
        values = values + step[np.minimum(key + later, len(step) - 1)] * share[:, part]
    return values


def along_rotations(time: np.ndarray, timing: Timing, keys: np.ndarray) -> np.ndarray:
    """Quaternions (T, 4) at `time` (T,) s of keys (K, 4); they move with the timing's first part."""
    key, shares = _progress(time, timing)
    step = quaternion_log(quaternion_multiply(quaternion_conjugate(keys[:-1]), keys[1:]))
    step = np.concatenate([step, np.zeros((1, 3))])
    values = keys[key]
    for later, share in enumerate(shares):
        turn = quaternion_exp(step[np.minimum(key + later, len(step) - 1)] * share[:, :1])
        values = quaternion_multiply(values, turn)
    return values


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """How far a movement has come, 0 to 1, after a share of its time; at rest before and after."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)


def _progress(time: np.ndarray, timing: Timing) -> tuple[np.ndarray, list[np.ndarray]]:
    """The key reached last (T,), and how far (T, G) the next two movements have come."""
    key = np.searchsorted(timing.end, time, side="right")
    shares = []
    for later in range(2):
        movement = np.minimum(key + later, len(timing.end) - 1)
        start, end = timing.start[movement], timing.end[movement][:, None]
        share = minimum_jerk((time[:, None] - start) / (end - start))
        shares.append(np.where((key + later < len(timing.end))[:, None], share, 0.0))
    return key, shares
