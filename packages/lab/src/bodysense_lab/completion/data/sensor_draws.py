"""Random sensors of training sequences: the distribution of tracked points that the network learns from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SensorSet
from bodysense_lab.completion.data.points import (
    ACCELERATION_INDICES,
    BODY_POINTS,
    FINGER_JOINTS,
    FINGER_OF,
    FINGER_POINTS,
    FINGERS,
    INPUT_POINTS,
    KNUCKLES,
    SIDES,
)
from bodysense_lab.completion.data.signal_kinds import TRAINING_SIGNALS, draw_signal, signal_masks

HEAD, WRISTS = "head", ("left_wrist", "right_wrist")
# Shares of the kinds of sequences.
KINDS = {
    "three_point": 0.21,
    "head": 0.065,
    "trackers": 0.11,  # head, hands and worn trackers
    "imus": 0.12,  # head, hands and sensors with rotation only
    "camera": 0.165,  # points that a headset's cameras see
    "mixed": 0.06,  # head, mostly hands, and a few parts on one or both sides, with sensors of different kinds
    "random": 0.03,  # any subset of points, each with a position, a rotation or both
    "headless": 0.02,  # recordings with holes, positions only, worn trackers without a headset
    "any": 0.22,  # any kind of signal (`signal_kinds`), with or without a head
}
FINGER_KINDS = {
    "nothing": 0.40,  # controllers or no hands: fingers are synthesised
    "tracked": 0.25,  # gloves or hand tracking: all positions, all rotations, or both
    "camera": 0.25,  # points that a headset's cameras see
    "random": 0.10,  # some joints and tips, each with a position, a rotation or both
}
_GAPS = 0.4  # share of sequences with hands in which `lost_hand` hides hands at times
_ONE_HAND, _NO_ROTATION = 0.12, 0.04  # shares of three-point sequences: with one hand, with hands without rotation
_CHANGES = 0.2  # share of sequences with other sensors in which sensors are lost at times
_PART_OF_HEAD, _NO_PLACE = 0.08, 0.7  # shares: headsets without position or rotation; those without position
_HEADSET_LOST = 0.06  # share of headsets that are lost at times
_LOST_PARTS = ((True, False), (True, True), (False, True))  # position and rotation that such headsets lose
_LOST_SHARES = (0.5, 0.35, 0.15)  # of `_LOST_PARTS`
_ACCELERATION_SHARE = 0.8  # share of sequences whose sensors with rotation only have accelerations
_PAIRS = ("ankle", "knee", "elbow", "hip", "shoulder", "foot")
_IMU_JOINTS = ("knee", "ankle", "hip", "elbow", "shoulder")
_SENSOR_KINDS = ("both", "position", "rotation")


@dataclass(frozen=True, eq=False)
class SensorMasks:
    """Masks of tracked points of one sequence."""

    has_position: np.ndarray  # (T, 27) bool
    has_rotation: np.ndarray  # (T, 22) bool
    has_acceleration: np.ndarray  # (T, 12) bool, of `ACCELERATION_POINTS`


def fixed_sensors(sensors: SensorSet, visible: np.ndarray, interval: float, rng: np.random.Generator) -> SensorMasks:
    """Return the masks of a sensor set, given the points that cameras see, `visible` (T, 27). Nothing is random."""
    del interval, rng
    position, rotation = np.isin(INPUT_POINTS, sensors.position), np.isin(BODY, sensors.rotation)
    has_position = (visible | position) if sensors.camera else np.tile(position, (len(visible), 1))
    has_rotation = np.tile(rotation, (len(visible), 1))
    has_acceleration = rotation_only(has_position, has_rotation) & sensors.acceleration
    return SensorMasks(has_position, has_rotation, has_acceleration)


def draw_sensors(visible: np.ndarray, interval: float, rng: np.random.Generator) -> SensorMasks:
    """Draw masks for frames every `interval` s, given the points that cameras see, `visible` (T, 27)."""
    frames = len(visible)
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    position, rotation = np.zeros(len(INPUT_POINTS), dtype=bool), np.zeros(len(BODY), dtype=bool)

    def add(name: str, what: str = "both") -> None:
        if what != "rotation":
            position[INPUT_POINTS.index(name)] = True
        if what != "position" and name in BODY:
            rotation[BODY.index(name)] = True

    add(HEAD)
    if kind not in ("head", "headless", "random", "any") and not (kind == "mixed" and rng.uniform() < 0.2):
        for wrist in WRISTS:
            add(wrist)
    if kind == "three_point" and rng.uniform() < _ONE_HAND:
        _remove(position, rotation, WRISTS[int(rng.integers(2))])
    if kind == "three_point" and rng.uniform() < _NO_ROTATION:
        rotation[[BODY.index(wrist) for wrist in WRISTS]] = False
    if kind == "trackers":
        _add_trackers(add, rng)
    if kind == "imus":
        _add_imus(add, rng)
    if kind == "mixed":
        _add_mixed(add, rng)
    if kind == "random":
        share = rng.uniform(0.05, 0.8)
        for name in INPUT_POINTS:
            if rng.uniform() < share:
                add(name, str(rng.choice(_SENSOR_KINDS)))
    if kind == "headless":
        _headless(position, rotation, add, rng)
    acceleration = rng.uniform() < _ACCELERATION_SHARE
    if kind == "any":
        sensors = draw_signal(rng, TRAINING_SIGNALS)
        (position, rotation), acceleration = signal_masks(sensors), sensors.acceleration
    has_position, has_rotation = np.tile(position, (frames, 1)), np.tile(rotation, (frames, 1))
    if kind == "camera":
        has_position, has_rotation = _camera_masks(visible)
    if rng.uniform() < _GAPS:
        for wrist, knuckles in zip(WRISTS, KNUCKLES, strict=True):
            lost = lost_hand(frames, interval, rng)
            for name in (wrist, knuckles):
                has_position[lost, INPUT_POINTS.index(name)] = False
            has_rotation[lost, BODY.index(wrist)] = False
    if kind not in ("three_point", "head", "camera") and rng.uniform() < _CHANGES:
        for name in INPUT_POINTS:
            lost = spans(frames, interval, rng, 3.0, longest=8.0)
            if name == HEAD and (kind not in ("headless", "any") or rng.uniform() < 0.7):
                continue
            has_position[lost, INPUT_POINTS.index(name)] = False
            if name in BODY:
                has_rotation[lost, BODY.index(name)] = False
    if kind not in ("any", "headless"):
        _lose_head(has_position, has_rotation, interval, rng)
    has_acceleration = rotation_only(has_position, has_rotation) & acceleration
    return SensorMasks(has_position, has_rotation, has_acceleration)


def draw_without_head(visible: np.ndarray, interval: float, rng: np.random.Generator) -> SensorMasks:
    """Run `draw_sensors` until the head's position or rotation is missing in a frame."""
    while True:
        drawn = draw_sensors(visible, interval, rng)
        if not (drawn.has_position[:, INPUT_POINTS.index(HEAD)] & drawn.has_rotation[:, BODY.index(HEAD)]).all():
            return drawn


def _lose_head(has_position: np.ndarray, has_rotation: np.ndarray, interval: float, rng: np.random.Generator) -> None:
    """Remove the head's position, its rotation or both, always or at times."""
    place, turn, drawn = INPUT_POINTS.index(HEAD), BODY.index(HEAD), rng.uniform()
    if drawn < _PART_OF_HEAD:
        if rng.uniform() < _NO_PLACE:
            has_position[:, place] = False
        else:
            has_rotation[:, turn] = False
    elif drawn < _PART_OF_HEAD + _HEADSET_LOST:
        lost = spans(len(has_position), interval, rng, 4.0, longest=3.0)
        loses_position, loses_rotation = _LOST_PARTS[int(rng.choice(len(_LOST_PARTS), p=_LOST_SHARES))]
        has_position[lost & loses_position, place] = False
        has_rotation[lost & loses_rotation, turn] = False


def rotation_only(has_position: np.ndarray, has_rotation: np.ndarray) -> np.ndarray:
    """Return (T, 12) bool: `ACCELERATION_POINTS` with a tracked rotation and no tracked position."""
    return has_rotation[:, ACCELERATION_INDICES] & ~has_position[:, ACCELERATION_INDICES]


def _add_trackers(add, rng: np.random.Generator) -> None:
    """Add worn trackers: usual sets, or random ones."""
    drawn = rng.uniform()
    if drawn < 0.75:
        add("pelvis")
    if drawn < 0.5:
        for side in ("left", "right"):
            add(f"{side}_ankle")
    if drawn < 0.22:
        add("spine3")
        for side in ("left", "right"):
            add(f"{side}_elbow")
            add(f"{side}_knee")
    if drawn >= 0.7:
        what = str(rng.choice(["both", "position"], p=[0.7, 0.3]))
        for part in _PAIRS:
            if rng.uniform() < 0.35:
                for side in ("left", "right"):
                    if rng.uniform() < 0.85:
                        add(f"{side}_{part}", what)
        if rng.uniform() < 0.4:
            add("spine3", what)


def _add_imus(add, rng: np.random.Generator) -> None:
    """Add sensors with rotation only."""
    drawn = rng.uniform()
    parts = ["knee"] if drawn < 0.45 else ["ankle"] if drawn < 0.6 else ["knee", "ankle"] if drawn < 0.7 else []
    parts = parts or [part for part in _IMU_JOINTS if rng.uniform() < 0.5]
    for part in parts:
        for side in ("left", "right"):
            add(f"{side}_{part}", "rotation")
    for name in ("pelvis", "spine3"):
        if rng.uniform() < 0.4:
            add(name, "rotation")
    if rng.uniform() < 0.1:
        add("pelvis")


def _add_mixed(add, rng: np.random.Generator) -> None:
    """Add sensors of random kinds to a few parts of the body, as often on one side as on both."""
    share = rng.uniform(0.05, 0.5)
    for part in ("pelvis", "spine3", *_PAIRS):
        if rng.uniform() < share:
            what = str(rng.choice(_SENSOR_KINDS))
            sides = ("left", "right") if rng.uniform() < 0.5 else (str(rng.choice(["left", "right"])),)
            for name in (part,) if part in BODY else tuple(f"{side}_{part}" for side in sides):
                add(name, what)


def _headless(position: np.ndarray, rotation: np.ndarray, add, rng: np.random.Generator) -> None:
    """Draw sensors without a headset: recordings with holes, positions only, gloves only, or worn trackers."""
    drawn = rng.uniform()
    if drawn < 0.35:  # a recording with holes
        for name in BODY_POINTS:
            if rng.uniform() < 0.85:
                add(name)
        if rng.uniform() < 0.5:
            _remove(position, rotation, HEAD)
    elif drawn < 0.7:  # positions alone
        rotation[:] = False
        share = rng.uniform(0.3, 1.0)
        for name in (*BODY_POINTS, *KNUCKLES):
            if rng.uniform() < share:
                add(name, "position")
    elif drawn < 0.8:  # gloves alone
        _remove(position, rotation, HEAD)
        for name in (*WRISTS, *KNUCKLES) if rng.uniform() < 0.7 else WRISTS:
            add(name)
    else:
        _remove(position, rotation, HEAD)
        for name in ("pelvis", *WRISTS, "left_ankle", "right_ankle", "spine3"):
            if rng.uniform() < 0.75:
                add(name)


def _camera_masks(visible: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of seen positions, the head's pose, and rotations of seen hands, which knuckles imply."""
    has_position = visible.copy()
    has_rotation = np.zeros((len(visible), len(BODY)), dtype=bool)
    has_position[:, INPUT_POINTS.index(HEAD)] = True
    has_rotation[:, BODY.index(HEAD)] = True
    for wrist in WRISTS:
        has_rotation[:, BODY.index(wrist)] = has_position[:, INPUT_POINTS.index(wrist)]
    return has_position, has_rotation


def _remove(position: np.ndarray, rotation: np.ndarray, name: str) -> None:
    position[INPUT_POINTS.index(name)] = False
    rotation[BODY.index(name)] = False


# Durations of losses of a hand: shares, medians (s) and log deviations of two log-normal laws, and the longest.
# Measured on Quest recordings: 10 % under 0.03 s, 50 % under 0.1 s, 61 % under 0.2 s, 89 % under 1 s, 99 % under 6.7 s.
_LOSSES, _LONGEST_LOSS = ((0.52, 0.06, 0.7), (0.48, 0.45, 1.25)), 17.0
_LOSS_RATES = (3.0, 30.0)  # losses per minute, from and to, log-uniform


def loss_durations(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw durations (N,) s of losses of a hand."""
    brief = rng.uniform(size=count) < _LOSSES[0][0]
    median = np.where(brief, _LOSSES[0][1], _LOSSES[1][1])
    spread = np.where(brief, _LOSSES[0][2], _LOSSES[1][2])
    return np.minimum(median * np.exp(spread * rng.standard_normal(count)), _LONGEST_LOSS)


def lost_hand(frames: int, interval: float, rng: np.random.Generator) -> np.ndarray:
    """Draw frames (T,), bool, in which one hand is lost."""
    lost = np.zeros(frames, dtype=bool)
    low, high = np.log(_LOSS_RATES)
    count = rng.poisson(np.exp(rng.uniform(low, high)) * frames * interval / 60)
    for begin, seconds in zip(rng.uniform(0, frames, count), loss_durations(count, rng), strict=True):
        lost[int(begin) : int(begin) + max(1, round(seconds / interval))] = True
    return lost


def spans(
    frames: int, interval: float, rng: np.random.Generator, per_minute: float, longest: float = 3.0
) -> np.ndarray:
    """Draw frames (T,), bool, in spans of 0.2 s to `longest` s, log-uniform, `per_minute` a minute on average."""
    lost = np.zeros(frames, dtype=bool)
    for _ in range(rng.poisson(per_minute * frames * interval / 60)):
        begin = rng.uniform(0, frames)
        lost[int(begin) : int(begin + np.exp(rng.uniform(np.log(0.2), np.log(longest))) / interval) + 1] = True
    return lost


@dataclass(frozen=True, eq=False)
class FingerMasks:
    """Masks of tracked fingers of both hands of one sequence."""

    has_position: np.ndarray  # (T, 2, 20) bool
    has_rotation: np.ndarray  # (T, 2, 15) bool
    has_wrist: np.ndarray  # (T, 2) bool: the wrist is measured, not estimated

    @classmethod
    def wrists_only(cls, frames: int) -> FingerMasks:
        """Return masks of hands whose fingers are not tracked."""
        joints, wrists = np.zeros((frames, 2, FINGER_JOINTS), dtype=bool), np.ones((frames, 2), dtype=bool)
        return cls(np.zeros((frames, 2, FINGER_POINTS), dtype=bool), joints, wrists)


def fixed_fingers(name: str, visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingerMasks:
    """Return the masks of `nothing`, `tips` or a `camera` for hands that cameras see (T, 2). Nothing is random."""
    del interval, rng
    fingers = FingerMasks.wrists_only(len(visible))
    if name == "tips":
        fingers.has_position[..., FINGER_JOINTS:] = True
    if name == "camera":
        fingers.has_position[:], fingers.has_wrist[:] = visible[..., None], visible
    return fingers


def draw_fingers(kind: str, visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingerMasks:
    """Draw masks of a kind of `FINGER_KINDS`, for frames every `interval` s in which cameras see hands (T, 2)."""
    fingers = FingerMasks.wrists_only(len(visible))
    has_position, has_rotation, has_wrist = fingers.has_position, fingers.has_rotation, fingers.has_wrist

    def hidden(per_minute: float, longest: float = 3.0) -> np.ndarray:
        return np.stack([spans(len(visible), interval, rng, per_minute, longest) for _ in SIDES], axis=1)

    if kind == "nothing":
        drawn = rng.uniform()
        if drawn < 0.15:  # a headset alone
            has_wrist[:] = False
        elif drawn < 0.35:
            has_wrist[:] = ~hidden(8.0)
    elif kind == "tracked":
        drawn = rng.uniform()
        has_position[:], has_rotation[:] = drawn < 0.7, drawn > 0.4
        if rng.uniform() < 0.5:
            lost = hidden(8.0) if rng.uniform() < 0.7 else hidden(3.0, 8.0)
            has_position[lost], has_rotation[lost] = False, False
            has_wrist[:] = ~lost | (rng.uniform() < 0.5)
    elif kind == "camera":
        seen = visible.copy() if rng.uniform() < 0.7 else np.ones_like(visible)
        seen &= ~hidden(8.0)
        has_position[:] = seen[..., None]
        has_rotation[:] = (seen & (rng.uniform() < 0.3))[..., None]
        has_wrist[:] = seen | (rng.uniform() < 0.25)
    else:
        _some_fingers(has_position, has_rotation, rng)
        if rng.uniform() < 0.3:
            lost = hidden(8.0)
            has_position[lost], has_rotation[lost] = False, False
    return fingers


def _some_fingers(has_position: np.ndarray, has_rotation: np.ndarray, rng: np.random.Generator) -> None:
    """Draw tips only, whole fingers, or any joints and tips; equal on both hands."""
    drawn, what = rng.uniform(), rng.uniform()
    if drawn < 0.3:
        points, what = np.arange(FINGER_POINTS) >= FINGER_JOINTS, 0.0  # tips have no rotation
    elif drawn < 0.55:
        points = rng.uniform(size=len(FINGERS))[FINGER_OF] < 0.5
    else:
        points = rng.uniform(size=FINGER_POINTS) < rng.uniform(0.1, 0.9)
    has_position[:] = points & (what < 0.75)
    has_rotation[:] = points[:FINGER_JOINTS] & (what > 0.5)
