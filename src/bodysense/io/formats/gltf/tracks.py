"""glTF animation: `Track` is the change of one property of a node, `sampled` its values at any time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    normalize,
    slerp,
)
from bodysense.io.formats.gltf.file import GltfFile


@dataclass(frozen=True, eq=False)
class Track:
    """The change of one property of a node."""

    times: np.ndarray  # (K,) s
    values: np.ndarray  # (K, …)
    kind: str  # LINEAR, STEP, CUBICSPLINE


def tracks_of(file: GltfFile, name: str | None = None) -> dict[tuple[int, str], Track]:
    """Return the tracks of an animation by node and property: of the named one, else of that with the most tracks."""
    best: dict[tuple[int, str], Track] = {}
    for animation in _animations(file, name):
        tracks: dict[tuple[int, str], Track] = {}
        try:
            for channel in animation["channels"]:
                target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
                if "node" not in target or target["path"] not in ("translation", "rotation", "scale"):
                    continue
                kind = sampler.get("interpolation", "LINEAR")
                times, values = file.array(sampler["input"])[:, 0], file.array(sampler["output"])
                if not (np.isfinite(times).all() and np.isfinite(values).all()):
                    raise BodysenseError(f"{file.path}: its animation is not all finite; export it again")
                many = len(times) * (3 if kind == "CUBICSPLINE" else 1)
                if len(values) != many or (np.diff(times) <= 0).any():
                    raise BodysenseError(f"{file.path}: an animation's times and values do not match; export it again")
                tracks[int(target["node"]), target["path"]] = Track(times, values, kind)
        except (KeyError, IndexError, TypeError, ValueError):
            raise BodysenseError(f"{file.path}: an animation in it is damaged; export it again") from None
        best = max(best, tracks, key=len)
    return best


def _animations(file: GltfFile, name: str | None) -> list[Any]:
    """Return the animations with a name, or all. Raises BodysenseError for an unknown name."""
    every = file.document.get("animations", [])
    every = every if isinstance(every, list) else []
    if name is None:
        return every
    names = [str(animation.get("name", "")) if isinstance(animation, dict) else "" for animation in every]
    if name not in names:
        listed = ", ".join(names) or "none"
        raise BodysenseError(f"{file.path}: --animation {name}: no animation has this name; there are: {listed}")
    return [every[names.index(name)]]


def sampled(track: Track, time: np.ndarray, turns: bool) -> np.ndarray:
    """Return values (T, …) of a track at some times; constant before its first and after its last."""
    after = np.clip(np.searchsorted(track.times, time, side="right"), 1, max(len(track.times) - 1, 1))
    before = after - 1
    if len(track.times) == 1:
        return np.repeat(track.values[1:2] if track.kind == "CUBICSPLINE" else track.values, len(time), axis=0)
    step = track.times[after] - track.times[before]
    share = np.clip((time - track.times[before]) / step, 0, 1)[:, None]
    if track.kind == "CUBICSPLINE":
        into, value, out = track.values[0::3], track.values[1::3], track.values[2::3]
        s, step = share, step[:, None]
        return (
            (2 * s**3 - 3 * s**2 + 1) * value[before]
            + (s**3 - 2 * s**2 + s) * step * out[before]
            + (3 * s**2 - 2 * s**3) * value[after]
            + (s**3 - s**2) * step * into[after]
        )
    first, second = track.values[before], track.values[after]
    if track.kind == "STEP":
        return np.where(share >= 1, second, first)
    if not turns:
        return first + share * (second - first)
    first, second = (normalize(np.roll(turn, 1, axis=-1)) for turn in (first, second))  # wxyz
    return np.roll(slerp(first, second, share[:, 0]), -1, axis=-1)
