"""Postures that are rare in recordings, made from standing people: seated, kneeling, crouching, lying.

People with a headset sit most of the time, but recorded people rarely do. This module moves the pelvis of a standing
person to another height, puts feet or knees on the floor, and solves the legs between them by inverse kinematics. Hands
rest on the thighs or are held in front. A posture lasts for a whole sequence or for parts of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_exp, quaternion_to_matrix, slerp, smooth_step
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.postures.leg_postures import LegPosture, draw_posture
from bodysense_lab.completion.data.postures.limbs import bend_limb, hips_of, limb_of
from bodysense_lab.completion.data.smooth_noise import smooth_noise
from bodysense_lab.synthesis.scenes.moves import ease

# Shares of the postures. `standing` changes the arms only.
KINDS = {
    "chair": 0.36,
    "floor": 0.08,
    "kneeling": 0.10,
    "half kneeling": 0.08,
    "lunge": 0.04,
    "crouch": 0.07,
    "lying": 0.03,
    "standing": 0.10,
    "stride": 0.08,  # upright, one foot in front of the other
    "bow": 0.06,  # with straight legs
}
_HANDS_ANYWHERE = ("standing", "stride", "bow")  # postures whose hands may be held in any place of `_HANDS`
_WHOLE_SEQUENCE = 0.55  # share of sequences that are in the posture throughout
_RESTING, _HOLDING = 0.4, 0.25  # shares of sequences whose hands rest on the thighs, and are held still in front
_HELD = 0.6  # share of strides and bows whose hands are held in a place of `_HANDS`
_SIDES = ("left", "right")
_UPPER = [k for k, name in enumerate(BODY) if name.rpartition("_")[2] not in ("hip", "knee", "ankle", "foot")]
# Shares of the trunk's lean, and of the pelvis's tilt, by which each joint of the upper body turns.
_LEANS = {"pelvis": 0.0, "spine1": 0.5, "spine2": 0.85, "neck": 0.6, "head": 0.25}
_TILTS = {"pelvis": 1.0, "spine1": 0.5, "spine2": 0.1}
_SWAY, _TURNING = 0.15, 0.3  # shares of the standing person's horizontal motion and turning that remain
_LYING = [f"{side}_{part}" for side in _SIDES for part in ("shoulder", "hip", "knee", "ankle")]
_BACK = np.radians(120)  # radians; feet that point down by more lie on their backs, toes too
_STILL, _UPRIGHT = 0.3, 0.85  # m/s, and share of the rest height; a slower and higher pelvis is that of a standing body


def standing_share(corpus: Corpus) -> np.ndarray:
    """Return the share of frames of each clip (C,) in which its person stands still."""
    shares = np.zeros(len(corpus))
    for clip in range(len(corpus)):
        first, count = int(corpus.start[clip]), int(corpus.length[clip])
        rest = float(corpus.rest_offset[clip, 0, 1])
        shares[clip] = is_standing(corpus.root[first : first + count], rest, float(corpus.rate[clip])).mean()
    return shares


def is_standing(root: np.ndarray, rest: float, rate: float) -> np.ndarray:
    """Return (T,) bool: whether a body stands, given its pelvis path (T, 3) m and the pelvis's rest height, m."""
    speed = np.linalg.norm(np.gradient(root[:, [0, 2]], axis=0), axis=-1) * rate
    return (root[:, 1] > _UPRIGHT * rest) & (speed < _STILL)


def low_share(corpus: Corpus) -> np.ndarray:
    """Return the share of frames of each clip (C,) in which the pelvis is below 80 % of its rest height."""
    return np.array(
        [
            (corpus.root[first : first + count, 1] < 0.8 * rest[0, 1]).mean()
            for first, count, rest in zip(corpus.start, corpus.length, corpus.rest_offset, strict=True)
        ]
    )


def draw_kind(rng: np.random.Generator) -> str:
    """Draw one of `KINDS`."""
    return str(rng.choice(list(KINDS), p=list(KINDS.values())))


def apply_posture(
    rotation: np.ndarray, root: np.ndarray, offset: np.ndarray, kind: str, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Change a standing person's world rotations (T, 22, 4) wxyz and pelvis path (T, 3) m to a posture of `KINDS`.

    `offset` (65, 3) m are the person's rest offsets.
    """
    if kind == "lying":
        return _lie_down(rotation, root, offset, rate, rng)
    before = quaternion_to_matrix(rotation.astype(float))
    frames = len(root)
    share = np.zeros(frames) if kind == "standing" else _posture_share(frames, rate, rng)
    matrix, path = before.copy(), root.astype(float).copy()
    if kind != "standing":
        matrix, path = _blend_posture(before, path, offset, draw_posture(kind, offset, rng), share, rate, rng)
    drawn = rng.uniform()
    if kind in _HANDS_ANYWHERE:
        if kind == "standing" or drawn < _HELD:
            names = list(_HANDS)
            matrix = _hold_hands(matrix, path, offset, _HANDS[names[int(rng.integers(len(names)))]], rate, rng)
    elif drawn < _HOLDING:
        matrix = _hold_hands(matrix, path, offset, _HANDS["in front"], rate, rng)
    elif drawn < _HOLDING + _RESTING and kind in ("chair", "kneeling", "half kneeling", "floor"):
        matrix = _rest_hands_on_thighs(matrix, path, offset, share, rate, rng)
    return matrix_to_quaternion(matrix), path


def _posture_share(frames: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the weight (T,) of the posture over time: 0, as recorded, to 1, in the posture."""
    if rng.uniform() < _WHOLE_SEQUENCE:
        return np.ones(frames)
    times, values, now = [0.0], [float(rng.uniform() < 0.5)], 0.0
    while now < frames / rate:
        now += rng.uniform(2.0, 9.0)
        takes = rng.uniform(0.6, 2.2)
        times += [now, now + takes]
        values += [values[-1], 1 - values[-1]]
        now += takes
    return ease(np.interp(np.arange(frames) / rate, times, values))


def _blend_posture(
    before: np.ndarray,
    root: np.ndarray,
    offset: np.ndarray,
    posture: LegPosture,
    share: np.ndarray,
    rate: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return matrices (T, 22, 3, 3) and the pelvis's path (T, 3) m, blended with a posture by `share` (T,)."""
    facing = before[:, 0, :, 2]
    yaw = np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))
    kept = yaw.mean() + _TURNING * (yaw - yaw.mean())
    turn, square = _about_up(kept - yaw), _about_up(kept)
    slow = smooth_noise(len(root), 2, rate, 2.5, rng) * np.radians([2.0, 5.0])
    tilt = posture.tilt + slow[:, 0]
    # People lean forward while they sit down or get up.
    lean = posture.lean + slow[:, 1] + 4 * share * (1 - share) * np.radians(rng.uniform(15, 45))
    side = square[:, :, 0]
    after = before.copy()
    for joint in _UPPER:
        name = BODY[joint]
        angle = _LEANS.get(name, 1.0) * lean + _TILTS.get(name, 0.0) * tilt
        after[:, joint] = quaternion_to_matrix(quaternion_exp(side * angle[:, None])) @ turn @ before[:, joint]

    middle = np.median(root[:, [0, 2]], axis=0)
    place = np.zeros_like(root)
    place[:, [0, 2]] = middle + _SWAY * (root[:, [0, 2]] - middle) - posture.back * square[:, [0, 2], 2]
    hips = hips_of(after[:, 0], offset)
    place[:, 1] = posture.height - hips[..., 1].mean(axis=1) + _SWAY * (root[:, 1] - np.median(root[:, 1]))
    # Feet stay still while the pelvis moves: they are relative to its median position.
    still = np.median(place, axis=0)
    level = _about_up(np.full(1, np.median(kept)))[0]
    path = root + share[:, None] * (place - root)
    mixed = _blend(before, after, share)
    old = hips_of(before[:, 0], offset)
    now = hips_of(mixed[:, 0], offset)
    for k, (side_name, leg) in enumerate(zip(_SIDES, posture.legs, strict=True)):
        limb = limb_of("leg", side_name, offset)
        mirror = np.array([1.0 if side_name == "left" else -1.0, 1.0, 1.0])
        start = still + np.median(hips[:, k], axis=0)
        target = start + level @ (leg.ankle * mirror)
        target[1] = leg.ankle[1]
        knee_before = before[:, limb.first] @ limb.upper
        ankle_before = root + old[:, k] + knee_before + before[:, limb.second] @ limb.lower
        lift = 4 * share * (1 - share) * np.minimum(0.12, 0.4 * np.linalg.norm(ankle_before - target, axis=-1))
        ankle = ankle_before + share[:, None] * (target - ankle_before)
        ankle[:, 1] += lift
        pole = share[:, None] * (level @ (leg.pole * mirror))
        pole += (1 - share)[:, None] * (before[:, limb.first] @ limb.front)
        bent = bend_limb(limb, path + now[:, k], ankle, pole)
        mixed[:, limb.first], mixed[:, limb.second] = bent[0], bent[1]
        out = leg.toes_out * mirror[0]
        foot = level @ quaternion_to_matrix(quaternion_exp(np.array([0.0, out, 0.0])))
        ends = (limb.end, BODY.index(f"{side_name}_foot"))
        toes = leg.toes_down if leg.toes_down > _BACK else min(leg.toes_down, 0.3)
        for joint, down in zip(ends, (leg.toes_down, toes), strict=True):
            pitched = foot @ quaternion_to_matrix(quaternion_exp(np.array([down, 0.0, 0.0])))
            mixed[:, joint] = _blend(before[:, joint], np.broadcast_to(pitched, before[:, joint].shape), share)
    recorded = share == 0
    mixed[recorded], path[recorded] = before[recorded], root[recorded]
    return mixed, path


def _lie_down(
    rotation: np.ndarray, root: np.ndarray, offset: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Lay a standing person on their back, belly or side, with the pose unchanged."""
    before = quaternion_to_matrix(rotation.astype(float))
    facing = before[:, 0, :, 2]
    yaw = np.arctan2(facing[:, 0], facing[:, 2])
    level = _about_up(np.full(1, np.median(np.unwrap(yaw))))[0]
    drawn = rng.uniform()
    axis = level @ (np.array([-1.0, 0, 0]) if drawn < 0.6 else np.array([1.0, 0, 0]) if drawn < 0.75 else [0, 0, 1.0])
    if drawn >= 0.87:
        axis = -axis
    angle = np.radians(rng.uniform(65, 92)) + smooth_noise(len(root), 1, rate, 3.0, rng)[:, 0] * np.radians(3)
    turn = quaternion_to_matrix(quaternion_exp(axis * angle[:, None]))
    middle = np.median(root, axis=0)
    path = middle + np.einsum("tij,tj->ti", turn, (root - middle) * [_SWAY, 0.3, _SWAY])
    after = turn[:, None] @ before
    low = [_joint_position(after, path, offset, name)[:, 1] for name in _LYING]
    path[:, 1] += rng.uniform(0.06, 0.14) + rng.uniform(0, 0.5) * (rng.uniform() < 0.4) - np.quantile(low, 0.03)
    return matrix_to_quaternion(after), path


@dataclass(frozen=True)
class _HandPlace:
    """Place of a left hand relative to the neck: outward, up and forward, as shares of the pelvis's rest height."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    pole: tuple[float, float, float]  # direction of the elbow


_HANDS = {
    "in front": _HandPlace((0.04, -0.5, 0.15), (0.3, -0.05, 0.5), (0.35, -1.0, -0.35)),
    "behind the back": _HandPlace((-0.03, -0.56, -0.24), (0.10, -0.40, -0.12), (0.8, -0.4, -0.6)),
    "behind the head": _HandPlace((0.02, 0.08, -0.14), (0.10, 0.20, -0.05), (1.0, 0.2, 0.0)),
    "over the head": _HandPlace((0.02, 0.35, -0.10), (0.40, 0.62, 0.30), (1.0, 0.1, -0.2)),
    "on the hips": _HandPlace((0.13, -0.52, -0.05), (0.20, -0.42, 0.08), (1.0, -0.2, -0.5)),
    "crossed": _HandPlace((-0.16, -0.32, 0.12), (-0.04, -0.18, 0.24), (0.7, -1.0, 0.1)),
}


def _hold_hands(
    matrix: np.ndarray, root: np.ndarray, offset: np.ndarray, hands: _HandPlace, rate: float, rng: np.random.Generator
) -> np.ndarray:
    """Hold the hands in a place at times; both hands, or at times one."""
    facing = matrix[:, 0, :, 2]
    square = _about_up(np.arctan2(facing[:, 0], facing[:, 2]))
    both = _random_activation(len(root), rate, rng)
    place = rng.uniform(hands.low, hands.high) * offset[0, 1]
    one_hand = rng.uniform() < 0.15
    after = matrix.copy()
    for side in _SIDES[: 1 if one_hand else 2]:
        mirror = np.array([1.0 if side == "left" else -1.0, 1.0, 1.0])
        shoulder = _joint_position(after, root, offset, f"{side}_shoulder")
        chest = _joint_position(after, root, offset, "neck")
        moving = smooth_noise(len(root), 3, rate, 1.5, rng) * 0.03 + rng.normal(0, 0.03, 3)
        target = chest + np.einsum("tij,tj->ti", square, (place + moving) * mirror)
        pole = np.einsum("tij,j->ti", square, np.array(hands.pole) * mirror)
        after = _move_arm(after, root, offset, side, shoulder, target, pole, both, None)
    return after


def _rest_hands_on_thighs(
    matrix: np.ndarray, root: np.ndarray, offset: np.ndarray, share: np.ndarray, rate: float, rng: np.random.Generator
) -> np.ndarray:
    """Rest the hands on the thighs at times, while the thighs are level."""
    after = matrix.copy()
    along = float(rng.uniform(0.4, 1.0))
    for side in _SIDES:
        if rng.uniform() < 0.15:
            continue
        sign = 1.0 if side == "left" else -1.0
        hip, knee = (_joint_position(matrix, root, offset, f"{side}_{name}") for name in ("hip", "knee"))
        thigh = knee - hip
        level = np.linalg.norm(thigh[:, [0, 2]], axis=-1) / np.linalg.norm(thigh, axis=-1)
        often = _random_activation(len(root), rate, rng) * share * np.clip((level - 0.5) * 4, 0, 1)
        direction = thigh / np.linalg.norm(thigh, axis=-1, keepdims=True)
        up = np.array([0.0, 1.0, 0.0]) - direction[:, 1:2] * direction
        up /= np.maximum(np.linalg.norm(up, axis=-1, keepdims=True), 0.1)
        across = np.cross(up, direction)
        jitter = smooth_noise(len(root), 2, rate, 2.0, rng) * 0.015 + rng.normal(0, 0.03, 2)
        target = hip + (along + float(rng.normal(0, 0.07)) + jitter[:, :1]) * thigh - 0.08 * direction
        target += 0.09 * up + (jitter[:, 1:] + sign * 0.02) * across
        shoulder = _joint_position(after, root, offset, f"{side}_shoulder")
        pole = sign * across * 0.6 + np.array([0.0, -0.5, 0.0]) - 0.4 * direction
        inward = quaternion_to_matrix(quaternion_exp(up * -sign * np.radians(rng.uniform(-10, 35))))
        pointing = np.einsum("tij,tj->ti", inward, direction) * sign
        hand = np.stack([pointing, up, np.cross(pointing, up)], axis=-1)
        after = _move_arm(after, root, offset, side, shoulder, target, pole, often, hand)
    return after


def _move_arm(
    matrix: np.ndarray,
    root: np.ndarray,
    offset: np.ndarray,
    side: str,
    shoulder: np.ndarray,
    target: np.ndarray,
    pole: np.ndarray,
    share: np.ndarray,
    hand: np.ndarray | None,
) -> np.ndarray:
    """Move an arm toward a target by `share` (T,); the hand follows the forearm if `hand` is None."""
    limb = limb_of("arm", side, offset)
    elbow = matrix[:, limb.first] @ limb.upper
    wrist = shoulder + elbow + matrix[:, limb.second] @ limb.lower
    end = wrist + share[:, None] * (target - wrist)
    way = (1 - share)[:, None] * (matrix[:, limb.first] @ limb.front) + share[:, None] * pole
    first, second = bend_limb(limb, shoulder, end, way)
    after = matrix.copy()
    if hand is None:
        hand = second
    active = share > 0
    after[active, limb.first], after[active, limb.second] = first[active], second[active]
    after[:, limb.end] = _blend(matrix[:, limb.end], hand, share)
    return after


def _random_activation(frames: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Draw a weight (T,) from 0 to 1: either always 1, or smoothly on and off."""
    if rng.uniform() < 0.5:
        return np.ones(frames)
    wave = smooth_noise(frames, 1, rate, 3.0, rng)[:, 0]
    return smooth_step(np.clip(wave * 1.5 + 0.7, 0, 1))


def _blend(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate matrices (T, ..., 3, 3) from a to b by `share` (T,)."""
    begin, end = matrix_to_quaternion(a), matrix_to_quaternion(b)
    weight = np.broadcast_to(share.reshape(-1, *(1,) * (begin.ndim - 2)), begin.shape[:-1])
    return quaternion_to_matrix(slerp(begin, end, weight))


def _about_up(angle: np.ndarray) -> np.ndarray:
    """Return rotation matrices (T, 3, 3) about +Y by angles (T,), radians."""
    return quaternion_to_matrix(quaternion_exp(np.array([0.0, 1.0, 0.0]) * angle[:, None]))


def _joint_position(matrix: np.ndarray, root: np.ndarray, offset: np.ndarray, name: str) -> np.ndarray:
    """Return positions (T, 3) m of a joint, for world rotations (T, 22, 3, 3) of all joints."""
    skeleton = default_skeleton()
    place, point = root.copy(), skeleton.index(name)
    while skeleton.parents[point] >= 0:
        place = place + matrix[:, skeleton.parents[point]] @ offset[point]
        point = skeleton.parents[point]
    return place
