"""Bodies of people in AMASS: height and floor from all motions of a person, and lines that describe them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from bodysense.io.placement import BodyPlacement, Footing

_LISTED = 12  # largest number of people that are listed one by one


def pool_footings(parts: Iterable[Footing]) -> Footing:
    """Join the footings of several motions of one person."""
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
    """Return a line for each person, or a summary if there are many."""
    if len(bodies) <= _LISTED:
        return [f"{person or 'the body'}: {placement.remark}" for person, placement in bodies.items()]
    lines = []
    for source, text in (
        ("model", "bones by the body model"),
        ("steps", "with heights from their steps (--smpl-model gives bodies their own bones)"),
        ("default", "with too few steps to infer a height (--smpl-model)"),
    ):
        heights = [placement.height for placement in bodies.values() if placement.source == source]
        if heights:
            lines.append(f"{len(heights)} people {text}: {min(heights):.2f} to {max(heights):.2f} m")
    floors = [placement.floor for placement in bodies.values() if placement.floor]
    if floors:
        lines.append(f"soles of {len(floors)} people at {min(floors):.2f} to {max(floors):.2f} m: moved to 0")
    return lines
