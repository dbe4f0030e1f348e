"""How tall somebody is, from how high their head is carried."""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

SHORTEST, TALLEST = 1.4, 2.3  # m: whoever seems to be beyond does not stand on y = 0


def height_from_headset(head_height: np.ndarray, skeleton: Skeleton) -> float:
    """The wearer's height, m, from heights (T,) m of their headset over the floor; NaN where it was not tracked.

    The head is as high as in standing where it is nearly highest: at the 95th percentile, which a jump or a few bad
    frames do not move. `skeleton` says how much taller a body is than its head joint is high. Raises BodysenseError
    where nothing was tracked, and where nobody is as tall.
    """
    known = np.asarray(head_height, dtype=float)
    known = known[np.isfinite(known)]
    if not known.size:
        raise BodysenseError("the wearer's height: the headset was tracked in no frame; give the height in metres")
    rest = (skeleton.path @ skeleton.rest_offset)[:, 1]
    share = (rest[skeleton.index("head")] - rest.min()) / skeleton.height
    height = float(np.percentile(known, 95)) / share
    if not SHORTEST <= height <= TALLEST:
        raise BodysenseError(
            f"the wearer's height: a headset {np.percentile(known, 95):.2f} m over the floor is that of a body of "
            f"{height:.2f} m, not of one that stands on y = 0; give the height in metres"
        )
    return height
