"""Paths through key poses: movements of minimum jerk (Flash and Hogan, 1985), with or without rests between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_log, quaternion_multiply

# s, duration of a movement; it is longer if the movement would be too fast
_TYPICAL_DURATION, _SHORTEST_DURATION, _LONGEST_DURATION = 0.40, 0.12, 1.6
_FLOWING_SHARE = 0.45  # share of the keys that the motion passes without a rest
_OVERLAP = 0.3  # greatest overlap of two movements, in shares of the shorter one
_TYPICAL_REST, _LONGEST_REST = 0.22, 2.0  # s of rest at a key
_SHORTEST_HOLD = 0.12  # s of rest at a held key, at least


@dataclass(frozen=True, eq=False)
class Timing:
    """Times of the K − 1 movements between K keys. At most two movements overlap."""

    start: np.ndarray  # (K − 1, G) s, of each of G parts
    end: np.ndarray  # (K − 1,) s, of all parts together


def draw_timing(least: np.ndarray, held: np.ndarray, lag: np.ndarray, rng: np.random.Generator) -> Timing:
    """Draw random times of movements, from 0 s on.

    Args:
        least: (K − 1,) s, shortest duration of each movement.
        held: (K,) bool, keys at which the motion rests.
        lag: (K − 1, G) delay of each part's start, in shares of the movement, 0 to 1.
        rng: generator of durations and rests.
    """
    count = len(least)
    lasting = np.clip(
        _TYPICAL_DURATION * np.exp(0.55 * rng.standard_normal(count)), _SHORTEST_DURATION, _LONGEST_DURATION
    )
    lasting = np.maximum(lasting, least)
    rest = np.minimum(_TYPICAL_REST * np.exp(0.9 * rng.standard_normal(count)), _LONGEST_REST)
    shorter = np.minimum(lasting, np.roll(lasting, 1))
    flows = (rng.random(count) < _FLOWING_SHARE) & ~held[:-1]
    rest = np.where(flows, -_OVERLAP * rng.random(count) * shorter, np.maximum(rest, held[:-1] * _SHORTEST_HOLD))
    rest[:1] = np.abs(rest[:1])
    end = np.cumsum(rest + lasting)
    return Timing((end - lasting)[:, None] + lag * lasting[:, None], end)


def interpolate_keys(time: np.ndarray, timing: Timing, keys: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return values (T, N) of keys (K, N) at `time` (T,) s; column n moves with part `part[n]` of the timing."""
    key, shares = _progress(time, timing)
    step = np.diff(keys, axis=0, append=keys[-1:])
    values = keys[key]
    for later, share in enumerate(shares):
        values = values + step[np.minimum(key + later, len(step) - 1)] * share[:, part]
    return values


def interpolate_rotations(time: np.ndarray, timing: Timing, keys: np.ndarray) -> np.ndarray:
    """Return quaternions (T, 4) of keys (K, 4) at `time` (T,) s; they move with the timing's first part."""
    key, shares = _progress(time, timing)
    step = quaternion_log(quaternion_multiply(quaternion_conjugate(keys[:-1]), keys[1:]))
    step = np.concatenate([step, np.zeros((1, 3))])
    values = keys[key]
    for later, share in enumerate(shares):
        turn = quaternion_exp(step[np.minimum(key + later, len(step) - 1)] * share[:, :1])
        values = quaternion_multiply(values, turn)
    return values


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Return the progress of a movement, 0 to 1, after a share of its time; it rests before 0 and after 1."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)


def _progress(time: np.ndarray, timing: Timing) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the last key reached (T,), and the progress (T, G) of the next two movements."""
    key = np.searchsorted(timing.end, time, side="right")
    shares = []
    for later in range(2):
        movement = np.minimum(key + later, len(timing.end) - 1)
        start, end = timing.start[movement], timing.end[movement][:, None]
        share = minimum_jerk((time[:, None] - start) / (end - start))
        shares.append(np.where((key + later < len(timing.end))[:, None], share, 0.0))
    return key, shares
