"""Arms of a scripted body: postures that follow each other, by inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bodysense_lab.completion.data.postures.limbs import bend_limb, limb_of
from bodysense_lab.synthesis.scenes.joints import INDEX, Motion, euler, joint_position
from bodysense_lab.synthesis.scenes.moves import ease
from bodysense_lab.synthesis.scenes.script import SIDES, SIGN, ArmPosture, Script

CHEST_FOLLOWS = 0.22  # share of the head's turn by which the chest turns along
_REACH = 0.985  # of an arm's length; longest distance from the shoulder to the wrist
_FOLDED = 0.34  # of an arm's length; shortest distance, an elbow bent by 140°
_SOFT = 0.02  # of an arm's length; the two limits are approached smoothly
_AROUND, _WIDEST = 1.6, 0.3  # 1/m of a way's spread, and m: a hand leaves the straight line by so much, and no more
_OUTWARD = np.array([0.6, 0.0, 0.8])  # direction in which it does, of a left hand: outward and ahead
_COLLAR = 24.0  # degrees; a collar bone rises by as much with the highest hand
_TURN = 1.75  # rad; a forearm turns its hand by less
_BEND, _BEND_SCALE = 1.5, 1.1  # rad, 1; a wrist bends by less than the product of the first and tanh(1 / second)
_AMBIGUOUS = 0.12  # a palm that faces away from where the hand can turn it turns in neither direction


@dataclass(frozen=True, eq=False)
class _Aim:
    """Where an arm goes, world: the wrist from the shoulder, and directions of elbow and palm, (T, 3) each."""

    wrist: np.ndarray  # m
    elbow: np.ndarray
    palm: np.ndarray


def bend_arms(
    motion: Motion,
    script: Script,
    values: dict[str, np.ndarray],
    middle: np.ndarray,
    offset: np.ndarray,
    time: np.ndarray,
    noise: np.ndarray,
) -> None:
    """Turn collars, upper arms, forearms and hands of a motion to the postures of the arms.

    Args:
        motion: trunk and legs; the arms are written into it.
        script: the arms' postures and their times.
        values: channels (T,) by name.
        middle: (T, 3) m, between the hips.
        offset: (65, 3) m, rest offsets of the body.
        time: (T,) s.
        noise: (T, 2, 3) random motion of both wrists, of standard deviation 1.
    """
    zero, arm = np.zeros(len(time)), script.frame.arm
    chest = motion.rotation[:, INDEX["spine3"]]
    upright = euler(values["yaw"] + values["twist"] + CHEST_FOLLOWS * values["gaze_yaw"], zero, zero)
    for k, side in enumerate(SIDES):
        motion.rotation[:, INDEX[f"{side}_collar"]] = chest
        shoulder = joint_position(motion, offset, f"{side}_shoulder")
        hanging = upright @ euler(zero, -values[f"{side}_arm_swing"], zero)
        outward = sum(offset[INDEX[f"{side}_{name}"]] for name in ("collar", "shoulder")) * [1.0, 0.0, 0.0]
        frames = {
            "gravity": (shoulder, hanging),
            "chest": (shoulder - chest @ outward, chest),
            "pelvis": (middle, motion.rotation[:, 0]),
            "head": (joint_position(motion, offset, "head"), motion.rotation[:, INDEX["head"]]),
            "thigh": (joint_position(motion, offset, f"{side}_hip"), motion.rotation[:, INDEX[f"{side}_hip"]]),
            "world": (np.zeros((len(time), 3)), euler(values["yaw"], zero, zero)),
        }
        aim = _mix(script.arms[k], time, frames, shoulder, arm, SIGN[k], noise[:, k], upright)
        high = (aim.wrist[:, 1] / arm + 0.3) / 1.3
        target = shoulder + aim.wrist
        motion.rotation[:, INDEX[f"{side}_collar"]] = chest @ euler(zero, zero, SIGN[k] * _COLLAR * ease(high))
        shoulder = joint_position(motion, offset, f"{side}_shoulder")
        limb = limb_of("arm", side, offset)
        upper, lower = bend_limb(limb, shoulder, _within_reach(shoulder, target, arm), aim.elbow)
        motion.rotation[:, limb.first], motion.rotation[:, limb.second] = upper, lower
        motion.rotation[:, limb.end] = lower @ _hand(lower, aim.palm, SIGN[k])


def _mix(
    schedule: Sequence[tuple[float, float, ArmPosture]],
    time: np.ndarray,
    frames: dict[str, tuple[np.ndarray, np.ndarray]],
    shoulder: np.ndarray,
    arm: float,
    sign: float,
    noise: np.ndarray,
    upright: np.ndarray,
) -> _Aim:
    """Return the weighted mean of postures; `frames` have places (T, 3) m and rotations (T, 3, 3)."""
    mirror = np.array([sign, 1.0, 1.0])
    wrist, elbow, palm = (np.zeros((len(time), 3)) for _ in range(3))
    spread = np.zeros(len(time))
    for (_, _, posture), weight in zip(schedule, _weights(schedule, time), strict=True):
        if not weight.any():
            continue
        origin, turned = frames[posture.frame]
        if posture.frame == "world":
            place = np.broadcast_to(posture.wrist, wrist.shape)
        else:
            place = origin + turned @ (np.array(posture.wrist) * arm * mirror)
        place = place + posture.motion * noise - shoulder
        wrist += weight[:, None] * place
        spread += weight * (place * place).sum(axis=-1)
        elbow += weight[:, None] * (turned @ (np.array(posture.elbow) * mirror))
        palm += weight[:, None] * (turned @ (np.array(posture.palm) * mirror))
    # Between two postures a hand goes around the body, not through it.
    far = np.maximum(spread - (wrist * wrist).sum(axis=-1), 0.0) / arm
    around = _WIDEST * np.tanh(_AROUND * far / _WIDEST)
    return _Aim(wrist + around[:, None] * (upright @ (_OUTWARD * mirror)), elbow, palm)


def _weights(schedule: Sequence[tuple[float, float, ArmPosture]], time: np.ndarray) -> list[np.ndarray]:
    """Return the weight (T,) of each posture of an arm over time; they sum to 1."""
    risen = [np.ones(len(time))] + [ease((time - begin) / (end - begin)) for begin, end, _ in schedule[1:]]
    weights = []
    for k, share in enumerate(risen):
        weight = share.copy()
        for later in risen[k + 1 :]:
            weight *= 1 - later
        weights.append(weight)
    return weights


def _within_reach(shoulder: np.ndarray, target: np.ndarray, arm: float) -> np.ndarray:
    """Move targets (T, 3) m smoothly to distances that an arm reaches."""
    way = target - shoulder
    length = np.linalg.norm(way, axis=-1, keepdims=True) / arm
    most = _REACH - _SOFT * np.logaddexp(0.0, (_REACH - length) / _SOFT)
    least = _FOLDED + _SOFT * np.logaddexp(0.0, (most - _FOLDED) / _SOFT)
    return shoulder + way / np.maximum(length, 1e-6) * least


def _hand(forearm: np.ndarray, palm: np.ndarray, sign: float) -> np.ndarray:
    """Return rotations (T, 3, 3) of a hand relative to its forearm whose palm faces a direction (T, 3) if it can.

    The forearm turns the hand by at most about 95°, and the wrist bends by at most about 65°.
    """
    facing = np.einsum("tji,tj->ti", forearm, palm)
    facing = facing / np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-6)
    across = np.hypot(facing[:, 1], facing[:, 2])
    turn = 2 * np.arctan2(-facing[:, 2], across - facing[:, 1] + _AMBIGUOUS)
    turn = np.degrees(_TURN * np.tanh(turn / _TURN))
    bend = np.degrees(_BEND * np.tanh(facing[:, 0] * sign / _BEND_SCALE)) * sign
    zero = np.zeros(len(turn))
    return euler(zero, turn, zero) @ euler(zero, zero, bend)
