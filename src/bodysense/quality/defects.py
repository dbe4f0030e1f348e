"""Defects of finished takes: spikes, pops, frozen limbs, swapped sides, backward knees, sliding and sunken feet."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal, get_args

from bodysense.body.pose import Pose
from bodysense.errors import BodysenseError
from bodysense.quality.foot_defects import slides, sunken_feet
from bodysense.quality.joint_defects import Found, backward_knees, freezes, pops, spikes, swaps

Kind = Literal["spike", "pop", "freeze", "swap", "knee", "slide", "floor"]
KINDS: tuple[Kind, ...] = get_args(Kind)
FINDERS: dict[Kind, Callable[[Pose, float], list[Found]]] = {
    "spike": spikes,
    "pop": pops,
    "freeze": freezes,
    "swap": swaps,
    "knee": backward_knees,
    "slide": slides,
    "floor": sunken_feet,
}
UNITS: dict[Kind, str] = {
    **{"spike": "°", "pop": "°", "freeze": "s", "swap": "°"},
    **{"knee": "°", "slide": "cm/s", "floor": "cm"},
}


@dataclass(frozen=True)
class Defect:
    """A defect of one joint, or of one limb."""

    kind: Kind
    joint: str  # of the default skeleton
    first: int  # frames, counted from 0, both included
    last: int
    size: float  # in `UNITS`: how far, how fast or for how long

    def __str__(self) -> str:
        return f"{self.kind} of {self.joint} in frames {self.first}-{self.last}: {self.size:.3g} {UNITS[self.kind]}"


def find_defects(pose: Pose, frame_rate: float, only: Collection[str] = ()) -> list[Defect]:
    """Return the defects of a motion (T, …) at a frame rate in Hz, by first frame; of the kinds `only`, or of all.

    Raises BodysenseError for an unknown kind.
    """
    for kind in only:
        if kind not in KINDS:
            raise BodysenseError(f"unknown kind of defect {kind!r}; valid are {', '.join(KINDS)}")
    found = [
        Defect(kind, joint, first, last, size)
        for kind, finder in FINDERS.items()
        if not only or kind in only
        for joint, first, last, size in finder(pose, frame_rate)
    ]
    return sorted(found, key=lambda defect: (defect.first, defect.kind, defect.joint))
