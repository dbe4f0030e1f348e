"""Plausibility of a body that was read or tracked: is it of a person's size, in space, and the right way round?

One gate behind every reader. Each doubt says which option of the command line settles it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

SIZES = (0.4, 2.3)  # m: height of a person
FASTEST = 12.0  # m/s: of the pelvis; a sprinter's is 12.4
_FAR = 20.0  # m from the origin
FLOOR = 3.0  # m: feet farther from y = 0 are in another unit or world
RATES = (5.0, 500.0)  # Hz: frames a second of a motion
_FLAT = 0.01  # of the body's size: thinner bodies are flat
_BENT = 0.04  # of a limb's length: distance of a knee from the line through hip and ankle that shows its direction
_SHARE = 0.1  # of the frames in which knees must be bent
_TURNED = 0.25  # mean cosine by which feet or knees must point backward

Places = Mapping[str, np.ndarray]  # (N, 3) m of our joints, by name, in some frames; NaN where missing
Kind = Literal["size", "speed", "floor", "flat", "mirror", "rate"]


@dataclass(frozen=True)
class Doubt:
    """Property of a motion that is unlike a person, and the option that settles it."""

    kind: Kind
    text: str


def doubts_about(
    place: Places, later: Places, moment: float, rate: float, *, unit: str | None = None, left_handed: bool = False
) -> list[Doubt]:
    """Return the doubts about a body, worst first.

    Args:
        place: positions (N, 3) m of joints in some frames, +Y up.
        later: the same a moment later.
        moment: that moment, s.
        rate: frames a second.
        unit: the unit that was given for the file, if one was.
        left_handed: whether its axes were given as left-handed.
    """
    mirrored, size = _mirrored(place, left_handed), _size(place, unit)
    unusual = None
    if not RATES[0] <= rate <= RATES[1]:
        unusual = Doubt("rate", f"its rate of {rate:.3g} frames a second is unlike a motion's; see that it is right")
    found = [flat_doubt(place), _speed(place, later, moment), mirrored, unusual, size]
    return [doubt for doubt in found if doubt is not None]


def floor_doubt(floor: float, unit: str | None = None) -> Doubt | None:
    """Return a doubt about feet that stand at a height (m) far from 0; `unit` is the one that was given, if any."""
    if abs(floor) <= FLOOR:
        return None
    return Doubt("floor", f"its feet stand at y = {floor:.3g} m, far from 0: if the unit is wrong, {unit_fix(unit)}")


def unit_fix(unit: str | None) -> str:
    """Return the fix for a file in a wrong unit: another than the one that was given, if one was."""
    return "give --unit cm or mm" if unit is None else f"leave --unit {unit} out, or give another"


def mirror_fix(left_handed: bool, names: str = "names") -> str:
    """Return the fix for a body or a hand in a mirror, by whether its axes were given as left-handed."""
    if left_handed:
        return f"leave --left-handed out; otherwise the {names} take left for right"
    return f"if the axes are left-handed (Unity, Unreal), give --left-handed; otherwise the {names} take left for right"


def facing(place: Places) -> tuple[float, float]:
    """Return the mean cosines, -1 to 1, by which feet and bent knees point forward as the sides are named.

    Forward follows from left and right, so that both are negative if the sides are exchanged or the world is mirrored.
    NaN if feet or knees are missing, or knees are never bent.
    """
    feet, knees = [], []
    for side in ("left", "right"):
        hip, knee, ankle = (place.get(f"{side}_{part}") for part in ("hip", "knee", "ankle"))
        other = [place.get(f"{name}_hip") for name in ("left", "right")]
        if hip is None or knee is None or ankle is None or other[0] is None or other[1] is None:
            continue
        across = other[0] - other[1]
        toes = place.get(f"{side}_toe", place.get(f"{side}_foot"))
        if toes is not None:
            feet.append(_cosine(np.cross(across, knee - ankle), toes - ankle))
        bend = knee - (hip + ankle) / 2
        with np.errstate(invalid="ignore"):
            bent = np.linalg.norm(bend, axis=-1) > _BENT * np.linalg.norm(hip - ankle, axis=-1)
        knees.append(np.where(bent, _cosine(np.cross(across, hip - ankle), bend), np.nan))
    return _mean(feet, 0.0), _mean(knees, _SHARE)


def _mean(values: list[np.ndarray], share: float) -> float:
    """Return the mean of values (N,) that are known, NaN if fewer than a share of them are."""
    known = np.concatenate(values) if values else np.zeros(0)
    finite = known[np.isfinite(known)]
    return float(finite.mean()) if finite.size > share * known.size else float("nan")


def _mirrored(place: Places, left_handed: bool) -> Doubt | None:
    feet, knees = facing(place)
    # Feet and knees agree, or one is unknown.
    if not (feet < -_TURNED or knees < -_TURNED) or feet > 0 or knees > 0:
        return None
    parts = " and ".join(name for name, value in (("feet point", feet), ("knees bend", knees)) if value < 0)
    return Doubt("mirror", f"its {parts} backward, as of a body in a mirror: {mirror_fix(left_handed)}")


def flat_doubt(place: Places) -> Doubt | None:
    """Return a doubt about points that all lie in one plane."""
    points = np.stack(list(place.values()), axis=1)
    points = points[np.isfinite(points).all(axis=(1, 2))]
    if len(points) == 0 or points.shape[1] < 4:
        return None
    # All frames in one plane are a camera's picture: people do not move in a plane for a whole motion.
    spread = np.linalg.svd((points - points.mean(axis=(0, 1))).reshape(-1, 3), compute_uv=False)
    if not spread[0] > 0 or spread[2] > _FLAT * spread[0]:
        return None
    return Doubt(
        "flat",
        "all of its points lie in one plane: it has no depth, as key points of one camera; give the video itself "
        "(bodysense track video.mp4 -o motion.bvh), or points in space",
    )


def _speed(place: Places, later: Places, moment: float) -> Doubt | None:
    root = next((name for name in ("pelvis", "spine1", "left_hip", "head") if name in place), None)
    if root is None or moment <= 0:
        return None
    speed = np.linalg.norm(later[root] - place[root], axis=-1) / moment
    speed = speed[np.isfinite(speed)]
    fast = float(np.percentile(speed, 90)) if speed.size else 0.0
    if fast <= FASTEST:
        return None
    return Doubt("speed", f"the body moves at {fast:.3g} m/s: if its path is in another unit, give --unit cm or mm")


def _size(place: Places, unit: str | None) -> Doubt | None:
    chains = [("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")]
    usual = {"hip": 0.85, "shoulder": 0.52}  # m: of an adult of 1.7 m
    sizes = []
    for chain in chains:
        for side in ("left", "right"):
            ends = [place.get(f"{side}_{part}") for part in chain]
            if all(end is not None for end in ends):
                one, two, three = ends
                length = np.linalg.norm(two - one, axis=-1) + np.linalg.norm(three - two, axis=-1)  # type: ignore[operator]
                if np.isfinite(length).any():
                    sizes.append(1.7 * float(np.nanmedian(length)) / usual[chain[0]])
    height = float(np.median(sizes)) if sizes else 1.7
    if SIZES[0] <= height <= SIZES[1]:
        return None
    return Doubt("size", f"the body is about {height:.3g} m tall; {unit_fix(unit)}, or give its --height")


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return cosines (N,) of the angles between vectors (N, 3); NaN for vectors without a length."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return (a * b).sum(axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))


def path_in_metres(path: np.ndarray, rate: float, given: float | None, name: str) -> tuple[np.ndarray, list[str]]:
    """Return the path (T, 3) m of a pelvis in the `given` unit, or in the one in which people can move, and warnings.

    `name` is the array's, for messages.
    """
    if given is not None:
        return path * given, []
    if len(path) < 2 or not _is_too_fast(path, rate, 1.0):
        return path, []
    for unit, metres in (("cm", 0.01), ("mm", 0.001)):
        if not _is_too_fast(path, rate, metres):
            return path * metres, [
                f"{name!r} is taken as {unit}: in metres the body moves too fast (--unit m keeps it)"
            ]
    return path, []  # `doubts_about` tells how fast it is


def _is_too_fast(path: np.ndarray, rate: float, metres: float) -> bool:
    """Whether a pelvis moves as no person does, far from the origin."""
    step = min(max(1, round(rate / 15)), len(path) - 1)  # over 1/15 s, so that noise does not count
    speed = metres * np.linalg.norm(path[step:] - path[:-step], axis=-1) * rate / step
    return bool(np.percentile(speed, 90) > FASTEST and metres * np.abs(path).max() > _FAR)
