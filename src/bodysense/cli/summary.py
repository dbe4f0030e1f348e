"""`--json`: the result of a command as a file for other programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.files import written_beside

if TYPE_CHECKING:
    from bodysense.takes.take import Take


def write_summary(path: Path | None, outputs: list[Path], values: Mapping[str, Any]) -> None:
    """Write a JSON object with the output files of a command and values about them; nothing if `path` is None."""
    if path is None:
        return
    with written_beside(path) as beside:
        whole = {"outputs": [str(out) for out in outputs], **values}
        beside.write_text(json.dumps(whole, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def take_values(take: Take, speed: float, warnings: Sequence[str], of_markers: bool) -> dict[str, Any]:
    """Return values about a completed take: frames, Hz, speed, height in metres, filled frames and warnings.

    If `of_markers`, the filled frames are those of its markers.
    """
    from bodysense.body.shape import stature

    values: dict[str, Any] = {
        "frames": len(take.time),
        "frame_rate": round(take.clip.frame_rate, 6),
        "frames_per_second": round(speed, 1),
        "height": round(float(stature(take.person.skeleton.rest_offset)), 4),
        "height_is_inferred": bool(take.person.bone_deviation.any() and take.person.height is None),
        "warnings": list(warnings),
    }
    filled: dict[str, np.ndarray] = {}
    if take.partial is not None:
        filled = dict(zip(take.partial.rig.joints, take.partial.holes.T, strict=True))
    elif of_markers and take.markers is not None and take.markers.found is not None:
        filled = dict(zip(take.markers.found.raw.names, take.filled_markers.filled.T, strict=True))
    values["filled_frames"] = {name: int(frames.sum()) for name, frames in filled.items() if frames.any()}
    return values
