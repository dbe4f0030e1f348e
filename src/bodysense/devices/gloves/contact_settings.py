"""How hands are kept out of each other (`contact`)."""

from __future__ import annotations

from dataclasses import dataclass, fields

from bodysense.errors import BodysenseError


@dataclass(frozen=True)
class ContactSettings:
    """How hands are kept out of each other. Lengths in metres."""

    tolerance: float = 5e-4  # penetration that is left alone
    max_iterations: int = 3  # linear steps a frame, at most
    touching: float = 0.020  # fingertip markers nearer than this: the fingertips are brought as near
    apart: float = 0.030  # farther than this: they are left as they are; in between, partly
    missed: float = 0.0015  # by less than this fingertips are not brought together
    half_life: float = 0.05  # s in which half of a correction goes that is no longer needed
    speed: float = 0.2  # m/s at which a point is corrected, at most: 3.3 mm a frame at 60 Hz
    seen_weight: float = 4.0  # how much harder a finger moves whose marker is seen, and a hand whose back is
    hand_weight: float = 10.0  # how much harder a whole hand moves than a finger
    keeping: float = 0.005  # fingertips whose flesh is nearer than this are not taken apart
    nearby: float = 0.005  # gaps narrower than this are kept while others are widened

    def __post_init__(self) -> None:
        for field in fields(self):
            if not getattr(self, field.name) > 0:
                raise BodysenseError(
                    f"contact settings: {field.name} is {getattr(self, field.name):g}; it must be positive"
                )
        if not self.touching < self.apart:
            raise BodysenseError(
                f"contact settings: touching is {self.touching:g} m and apart {self.apart:g} m; apart must be more"
            )
