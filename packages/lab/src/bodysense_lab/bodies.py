"""Bodies of people of AMASS: height and floor from all motions of a person, and lines that describe them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from bodysense.io.placement import BodyPlacement, Footing

_LISTED = 12  # people who are described one by one


def pool_footings(parts: Iterable[Footing]) -> Footing:
    """Return what several motions of one person tell together."""
    parts = list(parts)
    return Footing(
        sizes=np.sum([one.sizes for one in parts], axis=0),
        pelvis=np.concatenate([one.pelvis for one in parts]),
        sole=np.concatenate([one.sole for one in parts]),
        stands=np.concatenate([one.stands for one in parts]),
        rate=parts[0].rate,
        stature=parts[0].stature,
    )


def body_lines(bodies: Mapping[str, BodyPlacement]) -> list[str]:
    """Return a line for each person; of many, what they have together."""
    if len(bodies) <= _LISTED:
        return [f"{person or 'the body'}: {placement.remark}" for person, placement in bodies.items()]
    lines = []
    for source, text in (
        ("model", "bones by the body model"),
        ("steps", "as tall as their steps show (--smpl-model gives bodies their own bones)"),
        ("default", "with too few steps for a height (--smpl-model)"),
    ):
        heights = [placement.height for placement in bodies.values() if placement.source == source]
        if heights:
            lines.append(f"{len(heights)} people {text}: {min(heights):.2f} to {max(heights):.2f} m")
    moved = [placement.floor for placement in bodies.values() if placement.floor]
    if moved:
        lines.append(f"soles of {len(moved)} people at {min(moved):.2f} to {max(moved):.2f} m: moved to 0")
    return lines
