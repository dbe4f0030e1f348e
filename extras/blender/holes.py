"""Missing frames of bones, and their text for the argument `missing` of `bodysense.track`. Pure Python."""

from __future__ import annotations

from collections.abc import Iterable, Mapping


def unkeyed(keys: Mapping[str, set[int]], first: int, last: int) -> dict[str, set[int]]:
    """Return the frames from `first` to `last` without a key, of each bone that has keys at all."""
    gaps = {bone: set(range(first, last + 1)) - frames for bone, frames in keys.items() if frames}
    return {bone: frames for bone, frames in gaps.items() if frames}


def runs(frames: Iterable[int]) -> tuple[tuple[int, int], ...]:
    """Return the first and last frame of each run of consecutive frames."""
    found: list[tuple[int, int]] = []
    for frame in sorted(frames):
        if found and frame == found[-1][1] + 1:
            found[-1] = (found[-1][0], frame)
        else:
            found.append((frame, frame))
    return tuple(found)


def missing_text(holes: Mapping[str, set[int]], first: int) -> str:
    """Return the holes as 'arm,hand:3-9,leg:0-4'; `first` is the frame that the take counts as 0."""
    bones: dict[tuple[int, int], list[str]] = {}
    for bone, frames in holes.items():
        for run in runs(frames):
            bones.setdefault(run, []).append(bone)
    return ",".join(f"{','.join(names)}:{start - first}-{end - first}" for (start, end), names in bones.items())
