"""Kinematics of a script: trunk and head from angles, legs and arms by inverse kinematics, balance over the feet."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense_lab.completion.data.postures.limbs import bend_limb, limb_of
from bodysense_lab.synthesis.scenes.arms import CHEST_FOLLOWS, bend_arms
from bodysense_lab.synthesis.scenes.joints import INDEX, Motion, euler, joint_position
from bodysense_lab.synthesis.scenes.moves import waves
from bodysense_lab.synthesis.scenes.script import KNEE, SIDES, SIGN, Frame, Script

_CALM = 0.16  # s, time in which the hips go down ahead of the end of a leg's reach
_HEEL = np.array([0.0, 0.0, -0.045])  # m, from below the ankle to the back of the heel
_SWAY = {"x": 0.004, "z": 0.006, "tilt": 0.5, "roll": 0.3, "yaw": 0.8, "bend": 0.9, "side": 0.7, "twist": 0.9}
_HEAD_SWAY = {"gaze_yaw": 2.0, "gaze_pitch": 1.6, "gaze_roll": 1.3}  # degrees
# Masses of the parts that balance over the feet, relative to the body: joint, joint, share between them, mass.
_MASSES = (
    *(("pelvis", "spine2", 0.3, 0.20), ("spine3", "neck", 0.3, 0.24), ("head", "head", 0.0, 0.08)),
    *((f"{side}_{a}", f"{side}_{b}", 0.45, mass) for side in SIDES
      for a, b, mass in (("hip", "knee", 0.12), ("shoulder", "elbow", 0.028), ("elbow", "wrist", 0.024))),
)  # fmt: skip


def frame_of(offset: np.ndarray) -> Frame:
    """Return the sizes of a body with rest offsets (65, 3) m."""
    skeleton = default_skeleton()
    length = {name: float(np.linalg.norm(offset[skeleton.index(name)])) for name in
              ("left_knee", "left_ankle", "left_elbow", "left_wrist")}  # fmt: skip
    path = skeleton.path[skeleton.index("left_ankle")] @ offset
    return Frame(
        scale=float(offset[0, 1]) / 0.991,
        thigh=length["left_knee"],
        shin=length["left_ankle"],
        hip_width=float(offset[skeleton.index("left_hip"), 0]),
        ankle=float(offset[0, 1] + path[1]),
        ball=offset[skeleton.indices(["left_foot", "right_foot"])],
        arm=length["left_elbow"] + length["left_wrist"],
    )


def solve(script: Script, offset: np.ndarray, time: np.ndarray, rng: np.random.Generator) -> Motion:
    """Return the motion of a script on a body with rest offsets (65, 3) m, at times (T,), s."""
    values = script.moves.at(time)
    sway = waves(time, len(_SWAY), 0.08, 0.6, rng)
    for k, (name, size) in enumerate(_SWAY.items()):
        values[name] = values[name] + size * values["sway"] * sway[:, k]
    glance = waves(time, len(_HEAD_SWAY), 0.1, 0.9, rng)
    for k, (name, size) in enumerate(_HEAD_SWAY.items()):
        values[name] = values[name] + size * glance[:, k]
    noise = waves(time, 6, 0.15, 1.0, rng).reshape(len(time), 2, 3)
    frame = script.frame
    rotation = np.zeros((len(time), len(BODY), 3, 3))
    _turn_trunk(rotation, values)
    feet = [_feet(values, side, frame) for side in (0, 1)]
    for k, side in enumerate(SIDES):
        rotation[:, INDEX[f"{side}_ankle"]], rotation[:, INDEX[f"{side}_foot"]] = feet[k][1], feet[k][2]
    hips = offset[1:3]
    from_middle = np.einsum("tij,kj->tki", rotation[:, 0], hips - hips.mean(axis=0))
    way = np.radians(values["yaw"])
    ahead = np.stack([np.sin(way), np.zeros_like(way), np.cos(way)], axis=-1)
    ground = np.stack([values["x"], np.zeros_like(way), values["z"]], axis=-1)
    ground += (values["lead"] * values["balance"])[:, None] * ahead
    sat = np.radians(values["kneel_angle"])  # sitting on the heels turns the thighs about the knees
    ground -= (frame.thigh * np.sin(sat))[:, None] * ahead
    values["height"] = values["height"] - frame.thigh * (1 - np.cos(sat))
    shift, rate = np.zeros((len(time), 3)), 1 / float(time[1] - time[0]) if len(time) > 1 else 1.0
    motion = Motion(rotation, ground)
    for iteration in range(2):
        middle = ground + shift
        middle[:, 1] = _hip_height(values, middle, from_middle, [foot[0] for foot in feet], frame, rate)
        motion = Motion(rotation, middle - rotation[:, 0] @ hips.mean(axis=0))
        _bend_legs(motion, values, middle[:, None] + from_middle, [foot[0] for foot in feet], offset, frame)
        bend_arms(motion, script, values, middle, offset, time, noise)
        if iteration == 0:
            apart = _mass_centre(motion, offset) - middle
            shift = -apart * [1.0, 0.0, 1.0] * values["balance"][:, None]
    return motion


def _turn_trunk(rotation: np.ndarray, values: dict[str, np.ndarray]) -> None:
    """Turn pelvis, spine, neck and head. The neck follows the trunk, and the head looks where the gaze says."""
    yaw, tilt, roll = values["yaw"], values["tilt"], values["roll"]
    bend, side = values["bend"], values["side"]
    twist = values["twist"] + CHEST_FOLLOWS * values["gaze_yaw"]
    for name, share in (("pelvis", 0.0), ("spine1", 0.35), ("spine2", 0.7), ("spine3", 1.0)):
        turned = euler(yaw + share * twist, tilt + share * bend, (1 - 0.6 * share) * roll + share * side)
        rotation[:, INDEX[name]] = turned
    chest_yaw, chest_pitch, chest_roll = yaw + twist, tilt + bend, 0.4 * roll + side
    head_yaw = yaw + values["gaze_yaw"]
    away = values["gaze_pitch"] + 0.35 * chest_pitch - chest_pitch
    head_pitch = chest_pitch + 55.0 * np.tanh(away / 55.0)
    head_roll = 0.3 * chest_roll + values["gaze_roll"]
    for name, share in (("neck", 0.45), ("head", 1.0)):
        forward = 4.0 if name == "neck" else 0.0
        rotation[:, INDEX[name]] = euler(
            chest_yaw + share * (head_yaw - chest_yaw),
            chest_pitch + share * (head_pitch - chest_pitch) + forward,
            chest_roll + share * (head_roll - chest_roll),
        )


def _feet(values: dict[str, np.ndarray], side: int, frame: Frame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the path (T, 3) m of an ankle, and rotations (T, 3, 3) of the foot and of its toes.

    A heel rises about the ball of the foot, and toes rise about the heel.
    """
    of = {name: values[f"{SIDES[side]}_{name}"] for name in
          ("ankle_x", "ankle_z", "lift", "foot_yaw", "heel", "toes_up", "swing")}  # fmt: skip
    zero = np.zeros_like(of["heel"])
    level = euler(of["foot_yaw"], zero, zero)
    ball, heel = frame.ball[side], _HEEL * frame.scale - [0.0, frame.ankle, 0.0]
    risen, lowered = euler(zero, of["heel"], zero), euler(zero, -of["toes_up"], zero)
    moved = (ball - risen @ ball) + (heel - lowered @ heel)
    ankle = np.stack([of["ankle_x"], frame.ankle + of["lift"], of["ankle_z"]], axis=-1)
    ankle += np.einsum("tij,tj->ti", level, moved)
    pitch = of["heel"] - of["toes_up"]
    toes = pitch - of["heel"] * (1 - 0.65 * of["swing"])
    return ankle, euler(of["foot_yaw"], pitch, zero), euler(of["foot_yaw"], toes, zero)


def _hip_height(
    values: dict[str, np.ndarray],
    middle: np.ndarray,
    from_middle: np.ndarray,
    ankles: list[np.ndarray],
    frame: Frame,
    rate: float,
) -> np.ndarray:
    """Return the height (T,) m of the middle of the hips: as written, but no higher than both legs reach."""
    bones = frame.thigh**2 + frame.shin**2 + 2 * frame.thigh * frame.shin * np.cos(np.radians(values["straight"]))
    limits = []
    for k in (0, 1):
        hip = middle + from_middle[:, k]
        flat = ((ankles[k] - hip)[:, [0, 2]] ** 2).sum(axis=-1)
        down = np.sqrt(np.maximum(bones - flat, 0.05 * bones))
        limits.append(ankles[k][:, 1] + down - from_middle[:, k, 1])
    # People do not bounce at the end of each leg's reach: the hips go down ahead of it, and no higher than it.
    window = 2 * round(_CALM * rate / 4) + 1
    reach = minimum_filter1d(_softly_lowest(limits, values["softness"]), 2 * window - 1, mode="nearest")
    reach = uniform_filter1d(uniform_filter1d(reach, window, mode="nearest"), window, mode="nearest")
    return _softly_lowest([values["height"], reach], values["softness"])


def _softly_lowest(values: list[np.ndarray], softness: np.ndarray) -> np.ndarray:
    """Return the smooth minimum (T,) of values (T,); it is lower by `softness` (T,) where two of them are equal."""
    soft, lowest = softness / np.log(2), np.min(values, axis=0)
    return lowest - soft * np.log(sum(np.exp((lowest - one) / soft) for one in values))


def _bend_legs(
    motion: Motion,
    values: dict[str, np.ndarray],
    hips: np.ndarray,
    ankles: list[np.ndarray],
    offset: np.ndarray,
    frame: Frame,
) -> None:
    """Turn thighs and shins so that the ankles are in place; knees point along the feet, or are on the floor."""
    zero = np.zeros(len(hips))
    for k, side in enumerate(SIDES):
        of = {name: values[f"{side}_{name}"] for name in ("foot_yaw", "knee_out", "kneel", "knee_x", "knee_z")}
        apart = (of["foot_yaw"] - values["yaw"] + 180) % 360 - 180
        forward = euler(values["yaw"] + 0.5 * apart + SIGN[k] * of["knee_out"], zero, zero) @ [0.0, 0.45, 1.0]
        if of["kneel"].any():
            knee = np.stack([of["knee_x"], np.full(len(hips), KNEE * frame.scale), of["knee_z"]], axis=-1)
            there = knee - (hips[:, k] + ankles[k]) / 2
            forward += of["kneel"][:, None] * (there / np.linalg.norm(there, axis=-1, keepdims=True) - forward)
        limb = limb_of("leg", side, offset)
        motion.rotation[:, limb.first], motion.rotation[:, limb.second] = bend_limb(
            limb, hips[:, k], ankles[k], forward
        )
    for k, side in enumerate(SIDES):
        if values[f"{side}_cross"].any():
            _cross_leg(motion, values, k, hips, ankles[k], offset)


def _cross_leg(
    motion: Motion, values: dict[str, np.ndarray], k: int, hips: np.ndarray, ankle: np.ndarray, offset: np.ndarray
) -> None:
    """Raise a leg to a place at the other knee; its foot follows the shin."""
    side, share = SIDES[k], values[f"{SIDES[k]}_cross"][:, None]
    zero = np.zeros(len(hips))
    square = euler(values["yaw"], zero, zero)
    mirror = np.array([SIGN[k], 1.0, 1.0])
    there = np.stack([values[f"{side}_cross_{axis}"] for axis in "xyz"], axis=-1) * mirror
    knee = joint_position(motion, offset, f"{SIDES[1 - k]}_knee")
    target = knee + np.einsum("tij,tj->ti", square, there)
    pole = np.stack([values[f"{side}_pole_{axis}"] for axis in "xyz"], axis=-1) * mirror
    pole = np.einsum("tij,tj->ti", square, pole)
    limb = limb_of("leg", side, offset)
    before = motion.rotation[:, limb.first] @ limb.front
    end = ankle + share * (target - ankle)
    bent = bend_limb(limb, hips[:, k], end, before + share * (pole - before))
    motion.rotation[:, limb.first], motion.rotation[:, limb.second] = bent
    follows = bent[1] @ euler(zero, values[f"{side}_plantar"], zero)
    for name in ("ankle", "foot"):
        joint = INDEX[f"{side}_{name}"]
        mixed = motion.rotation[:, joint] + share[..., None] * (follows - motion.rotation[:, joint])
        motion.rotation[:, joint] = _orthonormal(mixed)


def _orthonormal(matrix: np.ndarray) -> np.ndarray:
    """Return rotations (T, 3, 3) near matrices by Gram-Schmidt, from the forward axis."""
    z = matrix[..., 2] / np.linalg.norm(matrix[..., 2], axis=-1, keepdims=True)
    y = matrix[..., 1] - (matrix[..., 1] * z).sum(axis=-1, keepdims=True) * z
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _mass_centre(motion: Motion, offset: np.ndarray) -> np.ndarray:
    """Return the centre of mass (T, 3) m of the parts that balance over the feet."""
    total, centre = 0.0, np.zeros_like(motion.root)
    for first, second, share, mass in _MASSES:
        a = joint_position(motion, offset, first)
        b = a if second == first else joint_position(motion, offset, second)
        centre += mass * (a + share * (b - a))
        total += mass
    return centre / total
