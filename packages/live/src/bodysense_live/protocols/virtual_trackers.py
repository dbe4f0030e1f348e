"""Virtual trackers that are sent to other programs: the point of each, and the joint whose rotation it has."""

from __future__ import annotations

# Knee trackers are worn on the thighs, elbow trackers on the upper arms. VMT's indices are in this order.
TURNED_BY: dict[str, str] = {
    **{point: point for point in ("pelvis", "spine3", "left_ankle", "right_ankle")},
    **{f"{side}_knee": f"{side}_hip" for side in ("left", "right")},
    **{f"{side}_elbow": f"{side}_shoulder" for side in ("left", "right")},
}
