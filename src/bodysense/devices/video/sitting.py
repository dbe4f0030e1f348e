"""Sitting and standing before a camera: which of both, and the legs of either.

Landmarks of a person who faces the camera are hardly deeper for raised thighs than for hanging ones, and webcams rarely
see feet. So the posture is decided over time from several cues. Legs beyond the picture do not count: landmarkers guess
that they hang. Legs of sitting people lie on a seat of a likely height, which the knees in the picture or a known
floor correct. Knees of standing people lose the bend that landmarks give straight legs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.arms import SIDES
from bodysense.body.skeleton import Skeleton
from bodysense.devices.video.landmark_points import FittedPoints
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.devices.video.posture_constants import (
    ANKLE_VISIBLE,
    APART,
    ASSUMED,
    CUE_HALF_LIFE,
    CUE_RANGE,
    DROP_BIAS,
    DROP_DEVIATION,
    DROPS,
    HIP_OVER_SEAT,
    KNEE_VISIBLE,
    LONGEST_CUE,
    LOWEST,
    MARGIN,
    ON_TABLE,
    PITCH,
    SEAT,
    SEAT_DEVIATION,
    SEATED,
    SHORT,
    STANDING,
    STRAIGHT_BEND,
    TRUE_BEND,
    USUAL,
    WIDEST,
)

_PAIRS = {part: [BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES] for part in ("hip", "knee", "ankle")}
_LEGS = [BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES for part in ("knee", "ankle", "heel", "toe")]


@dataclass(frozen=True)
class Sitting:
    """Evidence for the posture from the frames so far."""

    cues: float | None = None  # mean sum of cues; None before knees were seen
    is_seated: bool = True  # people whose legs were never seen sit at a desk
    time: float = -np.inf  # s, of the last frame with knees

    def step(self, person: PersonLandmarks) -> Sitting:
        """Return the state after one more frame of unprocessed landmarks; it is unchanged if no knees are seen."""
        if not person.has_body[0] or _seen(person, "knee") < KNEE_VISIBLE:
            return self
        time, cues = float(person.time[0]), _cues(person)
        share = 1.0 if self.cues is None else 1 - 2 ** (-min(time - self.time, LONGEST_CUE) / CUE_HALF_LIFE)
        mean = cues if self.cues is None else self.cues + share * (cues - self.cues)
        margin = 0.0 if self.cues is None else (-MARGIN if self.is_seated else MARGIN)
        return Sitting(mean, mean > SEATED + margin, time)


def without_guessed_legs(person: PersonLandmarks) -> PersonLandmarks:
    """Return unprocessed landmarks whose legs are not seen beyond the lower edge of the picture."""
    visible = person.visible.copy()
    visible[:, _LEGS] *= ~(person.picture[:, _LEGS, 1] < LOWEST)
    return replace(person, visible=visible)


def _seen(person: PersonLandmarks, part: str) -> float:
    """Return the probability that both landmarks of a part are seen in one frame."""
    return float(person.visible[0, _PAIRS[part]].min())


def _cues(person: PersonLandmarks) -> float:
    """Return the sum of cues of one frame with knees."""
    world, picture = person.world[0], person.picture[0]
    hips, knees, ankles = (picture[_PAIRS[part]] for part in ("hip", "knee", "ankle"))
    across = world[_PAIRS["hip"][0]] - world[_PAIRS["hip"][1]]
    across = across / max(float(np.linalg.norm(across)), 1e-9)
    ahead = np.array([-across[2], 0.0, across[0]])  # level, in the camera's axes
    thigh = (world[_PAIRS["knee"]] - world[_PAIRS["hip"]]).mean(axis=0)
    pitch = np.degrees(np.arctan2(thigh @ ahead, -thigh[1]))
    frontal = float(np.clip(2 * abs(across[0]) - 1, 0, 1))  # widths tell nothing of a person from the side
    width = float(np.linalg.norm(knees[0] - knees[1]) / max(float(np.linalg.norm(hips[0] - hips[1])), 1e-3))
    cues = [_cue(pitch, PITCH), frontal * _cue(width, APART)]
    if _seen(person, "ankle") >= ANKLE_VISIBLE:
        lengths = [np.linalg.norm(a - b, axis=-1).mean() for a, b in ((hips, knees), (knees, ankles))]
        cues.append(_cue(float(lengths[0] / max(lengths[1], 1e-3)), SHORT))
    return sum(cues)


def _cue(value: float, scale: tuple[float, float]) -> float:
    return float(np.clip((value - scale[0]) / scale[1], *CUE_RANGE))


def lay_legs(
    fitted: FittedPoints,
    person: PersonLandmarks,
    place: np.ndarray,
    focal: float,
    room: np.ndarray,
    skeleton: Skeleton,
    is_seated: bool,
    floor: float | None,
) -> FittedPoints:
    """Return a body with the legs of its posture.

    `place` (3,) m is the pelvis in the axes of an upright camera, `room` (3, 3) turns these to the room's, `floor` is
    the floor's height over the camera's, m, if known.
    """
    seen = _seen(person, "knee") >= KNEE_VISIBLE
    if not seen and floor is not None:
        is_seated = (room @ place)[1] - floor < STANDING * skeleton.rest_offset[0, 1]
    if not is_seated:
        return _stand(fitted, person, room, skeleton)
    position = fitted.position.copy()
    left, right = position[skeleton.indices([f"{side}_hip" for side in SIDES])]
    level = room @ [right[2] - left[2], 0.0, left[0] - right[0]]  # where the pelvis faces
    ahead = np.array([level[0], 0.0, level[2]]) / max(float(np.hypot(level[0], level[2])), 1e-9)
    thighs = [_thigh(side, fitted, person, place, focal, room, skeleton, ahead, seen) for side in SIDES]
    rest = _rest(skeleton)
    hip, knee, ankle, foot, toe = (
        skeleton.indices([f"{side}_{part}" for side in SIDES]) for part in ("hip", "knee", "ankle", "foot", "toe")
    )
    length = float(np.linalg.norm(rest[knee[0]] - rest[hip[0]]))
    over = float(skeleton.rest_offset[0, 1] + rest[knee, 1].mean())  # m, of the knees over the floor
    usual = SEAT + HIP_OVER_SEAT - over
    if seen:
        drop = float(np.mean([-length * thigh[1] for thigh in thighs])) - DROP_BIAS
        sure, trust = 1 / DROP_DEVIATION**2, 1 / SEAT_DEVIATION**2
        has_feet = _seen(person, "ankle") >= ANKLE_VISIBLE
        if drop < usual - USUAL and not has_feet:
            sure *= ON_TABLE
        if has_feet:  # who crouches has the feet in the picture
            trust *= np.exp(-0.5 * ((drop - usual) / USUAL) ** 2)
        drop = (drop * sure + usual * trust) / (sure + trust)
    elif floor is not None:
        drop = float((room @ (place + fitted.position[hip].mean(axis=0)))[1]) - floor - over
    else:
        drop = usual
    drop = float(np.clip(drop, *DROPS))
    for k, thigh in enumerate(thighs):
        flat = np.array([thigh[0], 0.0, thigh[2]])
        flat = flat / max(float(np.linalg.norm(flat)), 1e-9)
        bone = length * np.sqrt(1 - (drop / length) ** 2) * flat - [0.0, drop, 0.0]
        turned = np.stack([np.cross([0.0, 1.0, 0.0], flat), [0.0, 1.0, 0.0], flat], axis=1)  # feet ahead of the knees
        position[knee[k]] = position[hip[k]] + room.T @ bone
        for point in (ankle[k], foot[k], toe[k]):
            position[point] = position[knee[k]] + room.T @ turned @ (rest[point] - rest[knee[k]])
    return _with_legs(fitted, position, skeleton)


def _with_legs(fitted: FittedPoints, position: np.ndarray, skeleton: Skeleton) -> FittedPoints:
    """Return a body at other places, whose knees, and ankles, are assumed if both are hidden."""
    visible = fitted.visible.copy()
    for part in ("knee", "ankle"):
        pair = skeleton.indices([f"{side}_{part}" for side in SIDES])
        if visible[pair].max() < ASSUMED:
            visible[pair] = ASSUMED
    return replace(fitted, position=position, visible=visible)


def _thigh(
    side: str,
    fitted: FittedPoints,
    person: PersonLandmarks,
    place: np.ndarray,
    focal: float,
    room: np.ndarray,
    skeleton: Skeleton,
    ahead: np.ndarray,
    is_seen: bool,
) -> np.ndarray:
    """Return the direction (3,) of a thigh in the room, at its knee's place in the picture; `ahead` if it is hidden."""
    if not is_seen:
        return ahead
    rest, hip = _rest(skeleton), skeleton.index(f"{side}_hip")
    length = float(np.linalg.norm(rest[skeleton.index(f"{side}_knee")] - rest[hip]))
    ray = np.array([*person.picture[0, BODY_LANDMARKS.index(f"{side}_knee")], -focal])
    ray = ray / np.linalg.norm(ray)
    start = place + fitted.position[hip]
    middle = float(ray @ start)
    depth = np.sqrt(max(middle**2 - float(start @ start) + length**2, 0.0))
    ends = [room @ ((middle + sign * depth) * ray - start) for sign in (-1.0, 1.0)]
    thigh = max(ends, key=lambda end: float(end @ ahead))
    thigh = thigh / max(float(np.linalg.norm(thigh)), 1e-9)
    aside = np.cross([0.0, 1.0, 0.0], ahead)
    wide = float(np.clip(thigh @ aside, -WIDEST, WIDEST))
    flat = wide * aside + np.sqrt(1 - wide**2) * ahead
    return np.array([flat[0], thigh[1], flat[2]])


def _stand(fitted: FittedPoints, person: PersonLandmarks, room: np.ndarray, skeleton: Skeleton) -> FittedPoints:
    """Return a body whose knees lose the bend that landmarks of straight legs have; hidden shins hang."""
    position, rest = fitted.position.copy(), _rest(skeleton)
    for number, side in enumerate(SIDES):
        hip, knee, ankle, foot, toe = skeleton.indices(
            [f"{side}_{part}" for part in ("hip", "knee", "ankle", "foot", "toe")]
        )
        thigh, shin = position[knee] - position[hip], position[ankle] - position[knee]
        sizes = np.linalg.norm(thigh), np.linalg.norm(shin)
        is_hidden = person.visible[0, _PAIRS["ankle"][number]] < ANKLE_VISIBLE
        if is_hidden:
            shin = room.T @ (rest[ankle] - rest[knee])
        bend = np.degrees(np.arccos(np.clip(thigh @ shin / (sizes[0] * sizes[1]), -1, 1)))
        share = (
            1.0
            if bend >= TRUE_BEND
            else max(bend - STRAIGHT_BEND, 0) * TRUE_BEND / (TRUE_BEND - STRAIGHT_BEND) / max(bend, 1e-6)
        )
        chord = shin if is_hidden else thigh + shin
        chord = chord / np.linalg.norm(chord)
        ends = [(1 - share) * size * chord + share * bone for bone, size in zip((thigh, shin), sizes, strict=True)]
        position[knee] = position[hip] + ends[0] * sizes[0] / np.linalg.norm(ends[0])
        moved = position[knee] + ends[1] * sizes[1] / np.linalg.norm(ends[1]) - position[ankle]
        position[[ankle, foot, toe]] += moved
    return _with_legs(fitted, position, skeleton)


def _rest(skeleton: Skeleton) -> np.ndarray:
    return skeleton.path @ skeleton.rest_offset
