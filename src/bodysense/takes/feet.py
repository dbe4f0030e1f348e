"""Standing feet of a joined body: they are held in place and on the floor."""

from __future__ import annotations

import numpy as np

from bodysense.body.footing import side_clearance, stop_sliding
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reach
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.series import smoothed
from bodysense.takes.fitting import fade_offsets
from bodysense.tracking.estimate import CONTACT_POINTS

Array = np.ndarray
FARTHEST = 0.06  # m; largest shift that holds a foot. 0.12 holds more firmly, and causes a third more jumps
# Probabilities of contact from which a foot is held, and below which it is released; s in which it then returns to its
# own path. Lower ones hold more firmly, and cause up to twice the jumps. Chosen on validation clips.
HOLD, RELEASE, FADE = 0.8, 0.6, 0.3
HOVER, LOWERING = 0.01, 0.2  # m above the floor from which a standing foot is lowered; s over which that is smoothed
LOW, LOWEST = 0.3, 0.7  # probabilities of contact from which a foot is lowered a little, and completely
STILL, LASTING = 0.6, 0.3  # reduction of `HOVER` for a body that stands still (a share); s for which it must do so
FARTHEST_DOWN = 0.15  # m; largest lowering of both feet of a standing body
# The rule of the core (core/src/limbs/legs.c) for bodies whose feet carry them.
LOW_HEAD, SEATED = 0.71, 0.76  # of a standing head's height: it sits low, kneels or lies; it stands or sits on a chair
STRETCHED = 0.92  # of it; a body lands from a jump with a head that is higher
STEADY = 0.7  # m/s; a head that moves up or down faster belongs to a body that jumps
FALLING = 2.0  # m/s, of a head that goes down below `STRETCHED`; a slower one sits down or crouches
_SIDES = ("left", "right")


def plant_feet(pose: Pose, contact: Array, measured: Array, turned: Array, floor: float, seconds: float) -> Pose:
    """Hold standing feet of a pose (T,) in place and on the floor, and lift soles that are under it.

    At least one foot of a standing body is on the floor.

    Args:
        pose: (T,).
        contact: (T, 4) probability that each of `CONTACT_POINTS` rests on something.
        measured: (T, P) bool: points that are tracked. Legs with tracked feet are not moved.
        turned: (T, J) bool: joints whose rotation is tracked. Legs with tracked shins or feet are not moved.
        floor: height of the floor, m.
        seconds: time between frames.
    """
    skeleton, position = pose.skeleton, np.asarray(forward_kinematics(pose)[0])
    free = {}
    for side in _SIDES:
        soles = skeleton.indices([f"{side}_{part}" for part in ("ankle", "foot", "toe")])
        lower = skeleton.indices([f"{side}_{part}" for part in ("knee", "ankle")])
        free[side] = np.asarray(~measured[:, soles].any(axis=1) & ~turned[:, lower].any(axis=1))
    clearance = {side: side_clearance(position, skeleton, side) - floor for side in _SIDES}
    chances = {
        side: contact[:, [place for place, name in enumerate(CONTACT_POINTS) if name.startswith(side)]]
        for side in _SIDES
    }
    stands = {side: np.clip((one.max(axis=1) - LOW) / (LOWEST - LOW), 0.0, 1.0) for side, one in chances.items()}
    sole = HOVER * (1 - STILL * sustained(np.minimum(*stands.values()), seconds))
    hovers = upright_share(position, skeleton, floor, seconds) * (np.minimum(*clearance.values()) - sole)
    hovers = np.where(np.logical_and(*free.values()), np.clip(hovers, 0.0, FARTHEST_DOWN), 0.0)
    for side in _SIDES:
        if not free[side].any():
            continue
        place = position[:, skeleton.indices([name for name in CONTACT_POINTS if name.startswith(side)])]
        shift = stop_sliding(place, chances[side], free[side], seconds, FARTHEST, FADE, (HOLD, RELEASE))
        known = smoothed(free[side].astype(float), LOWERING / seconds)
        away = np.clip(2 * known - 1, 0.0, 1.0)  # 0 near frames with a tracked leg
        over = np.maximum(stands[side] * np.clip(clearance[side] - sole, 0.0, FARTHEST), hovers)
        lower = away * smoothed(over, LOWERING / seconds)
        deep = np.maximum(0.0, -clearance[side])
        allowed = fade_offsets(deep[:, None], ~free[side], seconds)[:, 0]  # tracked feet may be under the floor
        shift[:, 1] = np.where(free[side], np.maximum(0.0, deep - allowed) - lower, 0.0)
        pose = reach(pose, f"{side}_ankle", position[:, skeleton.index(f"{side}_ankle")] + shift)
    return pose


def sustained(share: Array, seconds: float) -> Array:
    """Return the least share (T,) over `LASTING` s before or after each frame, whichever is larger, smoothed."""
    frames = max(1, round(LASTING / seconds))
    padded = np.pad(share, frames, mode="edge")
    least = np.lib.stride_tricks.sliding_window_view(padded, frames + 1).min(axis=-1)  # of frames and those after
    return smoothed(np.maximum(least[:-frames], least[frames:]), LASTING / 2 / seconds)


def upright_share(position: Array, skeleton: Skeleton, floor: float, seconds: float) -> Array:
    """Return the certainty (T,) in [0, 1] that feet carry the body, which stands, walks or sits; 0 if it lies or jumps.

    Args:
        position: (T, P, 3) m, world.
        skeleton: the body.
        floor: height of the floor, m.
        seconds: time between frames.
    """
    head = skeleton.index("head")
    high = position[:, head, 1] - floor
    tall = float(skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[head, 1])
    speed = np.gradient(high, seconds) if len(high) > 1 else np.zeros_like(high)
    risen = np.clip((high / tall - LOW_HEAD) / (SEATED - LOW_HEAD), 0.0, 1.0)
    fastest = np.where((speed < 0) & (high < STRETCHED * tall), FALLING, STEADY)
    calm = np.clip((fastest - np.abs(speed)) / (0.5 * fastest), 0.0, 1.0)
    return np.where(high > tall + 0.03, 0.0, risen * calm)
