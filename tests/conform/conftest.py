"""Performance of every pose and gesture by a body of the shape space, as a faultless tracker reports it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY, Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_exp
from bodysense_conform.sources.files import pose_subject
from bodysense_conform.subject import SIDES, Step, Subject, Transport, is_finger

RATE = 20
LOST = slice(130, 150)  # frames in which the left wrist is completed
FEET = ("left_ankle", "left_foot", "left_toe", "right_ankle", "right_foot", "right_toe")
FINGERS = ("index", "middle", "ring", "pinky")
Angles = dict[str, np.ndarray]  # rotation vectors (3,) by joint, rad


def about(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Return a rotation vector in radians from degrees."""
    return np.radians([x, y, z])


def both(**left: np.ndarray) -> Angles:
    """Angles of the left side and their mirror images."""
    return {f"{side}_{part}": v * (1 if side == "left" else [1, -1, -1]) for part, v in left.items() for side in SIDES}


def leg(side: str, hip: float, knee: float) -> Angles:
    """A leg bent in its plane, its foot level."""
    return {f"{side}_hip": about(-hip), f"{side}_knee": about(knee), f"{side}_ankle": about(hip - knee)}


HANG = both(shoulder=about(z=-72.0), elbow=about(y=-6.0))
RELAXED = both(**{f"{finger}{k}": about(z=-17.0) for finger in FINGERS for k in (1, 2, 3)})
FIST = both(**{f"{f}{k}": about(z=-z) for f in FINGERS for k, z in ((1, 75.0), (2, 95.0), (3, 60.0))})
ARMS_UP = both(shoulder=about(z=50.0), collar=about(z=30.0))
ARMS_AHEAD = both(shoulder=about(y=-80.0))


# Degrees by joint of a left hand whose thumb touches a finger's tip, to 1 cm on the body below.
PINCHES = {
    "index": {"thumb1": (56, -12, 20), "thumb2": (-5, -8, -7), "1": (0, 0, -45), "2": (0, 0, -42), "3": (0, 0, -41)},
    "middle": {"thumb1": (56, 3, 4), "thumb3": (-5, -1, 0), "1": (-6, -2, -49), "2": (2, 0, -46), "3": (-1, 0, -50)},
    "ring": {"thumb1": (56, 22, -4), "thumb2": (-7, -1, 1), "1": (-7, -4, -47), "2": (3, 0, -44), "3": (0, 0, -46)},
    "pinky": {
        "thumb1": (57, 57, 0),
        "thumb2": (-35, -5, -13),
        "1": (-7, -3, -44),
        "2": (3, -1, -42),
        "3": (-2, 0, -42),
    },
}


def pinch(finger: str) -> Angles:
    """Both hands with the thumb at a finger's tip."""
    angles = PINCHES[finger].items()
    return both(**{name if name.startswith("thumb") else f"{finger}{name}": about(*v) for name, v in angles})


def script() -> list[tuple[str, float, list[tuple[float, Angles]]]]:
    """Labels, seconds, and keys (share of the step, angles) between which the body blends."""
    stand = HANG | RELAXED
    squat = stand | leg("left", 80, 110) | leg("right", 80, 110)
    steps = [
        ("stand", 10.0, [(0.0, stand), (1.0, stand)]),
        ("t_pose", 2.5, [(0.25, {}), (1.0, {})]),
        ("arms_up", 2.5, [(0.25, ARMS_UP), (1.0, ARMS_UP)]),
        ("squat", 6.0, [(0.1, stand), (0.3, squat), (0.5, stand), (0.7, squat), (0.9, stand)]),
    ]
    for side in SIDES:
        up = stand | {f"{side}_shoulder": about(z=75.0 if side == "left" else -75.0)}
        steps.append((f"{side}_arm_raise", 2.5, [(0.3, stand), (0.6, up), (1.0, stand)]))
    for side in SIDES:
        steps.append((f"{side}_leg_raise", 2.0, [(0.0, stand), (0.5, stand | leg(side, 60, 60)), (1.0, stand)]))
    lifts = [(k / 16, stand | leg(SIDES[k % 4 // 2], 55, 65) if k % 2 else stand) for k in range(17)]
    steps.append(("march", 9.6, lifts))
    sitting = stand | ARMS_AHEAD | leg("left", 88, 88) | leg("right", 88, 88)
    steps += [
        ("sit", 3.0, [(0.35, sitting), (0.9, sitting), (1.0, sitting)]),
        ("flat", 1.5, [(0.3, HANG), (1.0, HANG)]),
    ]
    steps.append(("fist", 1.5, [(0.3, HANG | FIST), (1.0, HANG | FIST)]))
    for finger in FINGERS:
        steps.append((f"pinch_{finger}", 1.5, [(0.3, HANG | pinch(finger)), (1.0, HANG | pinch(finger))]))
    turned = stand | both(elbow=about(x=80.0), wrist=about(x=40.0))
    steps.append(("wrist_rotate", 2.0, [(0.0, stand), (0.5, turned), (1.0, stand)]))
    steps += [("remount", 2.0, [(0.0, stand), (1.0, stand)]), ("other", 2.5, [(0.0, stand), (1.0, stand)])]
    steps += [("other", 4.8, [(0.0, stand), (1.0, stand)]), ("t_pose", 2.5, [(0.25, {}), (1.0, {})])]
    return steps


def swung(
    skeleton: Skeleton, steps: list[tuple[str, float, list[tuple[float, Angles]]]]
) -> tuple[np.ndarray, list[Step]]:
    """Local rotations (T, J, 4) and the steps."""
    times, keys, labels, start = [-0.001], [HANG | RELAXED], [], 0.0
    for label, seconds, ways in steps:
        for share, angles in ways:
            times.append(start + share * seconds)
            keys.append(angles)
        labels.append(Step(label, start, start + seconds))
        start += seconds
    time = np.arange(round(start * RATE)) / RATE
    vectors = np.zeros((len(keys), len(skeleton.joints), 3))
    for k, angles in enumerate(keys):
        for name, vector in angles.items():
            vectors[k, skeleton.index(name)] = vector
    at = np.maximum.accumulate(times)
    place = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 2)
    share = np.clip((time - at[place]) / np.maximum(at[place + 1] - at[place], 1e-9), 0, 1)
    share = (0.5 - 0.5 * np.cos(np.pi * share))[:, None, None]
    blended = (1 - share) * vectors[place] + share * vectors[place + 1]
    walk = [step for step in labels if step.label == "other"][-1]
    inside = (time >= walk.start) & (time < walk.end)
    ramp = np.clip(np.minimum(time[inside] - walk.start, walk.end - time[inside]) / 0.5, 0, 1)
    phase = 2 * np.pi * (time[inside] - walk.start) / 1.2
    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = 24 * ramp * sign * np.cos(phase)
        lift = 35 * ramp * np.maximum(-sign * np.sin(phase), 0)
        for part, degrees in (("hip", -(swing + lift / 2)), ("knee", lift), ("ankle", swing - lift / 2)):
            blended[inside, skeleton.index(f"{side}_{part}")] = np.radians(
                np.stack([degrees, 0 * swing, 0 * swing], -1)
            )
    blended[:, skeleton.index("spine1"), 0] += np.radians(1.5) * np.sin(2 * np.pi * 0.3 * time)  # it breathes
    return quaternion_exp(blended), labels


def planted(skeleton: Skeleton, rotation: np.ndarray) -> Pose:
    """The body on the floor: its lowest sole at rest height, the lower foot where it was."""
    root = np.tile(skeleton.rest_offset[0], (len(rotation), 1))
    feet, ankles = skeleton.indices(FEET), skeleton.indices(["left_ankle", "right_ankle"])
    resting = (skeleton.path @ skeleton.rest_offset)[feet, 1]
    position = forward_kinematics(Pose(skeleton, root, rotation))[0]
    low = resting - resting.min()
    root[:, 1] -= (position[:, feet, 1] - low).min(axis=1) - 0.01
    stands = np.argmin(position[:, ankles, 1], axis=1)
    flat = position[:, ankles][:, :, [0, 2]]
    move = flat[np.arange(len(flat) - 1), stands[1:]] - flat[np.arange(1, len(flat)), stands[1:]]
    root[1:, [0, 2]] += np.cumsum(move, axis=0)
    return Pose(skeleton, root, rotation)


@pytest.fixture(scope="session")
def performed() -> tuple[Pose, list[Step]]:
    skeleton = default_skeleton().with_offsets(sample_bodies("test", 3)[2])
    rotation, steps = swung(skeleton, script())
    return planted(skeleton, rotation), steps


def given_out(pose: Pose, steps: Sequence[Step]) -> Subject:
    """Performance from a tracker that loses a wrist for a second and is taken off once."""
    time = np.arange(len(pose.rotation)) / RATE
    subject = pose_subject("clean", "MCAP", pose, time)
    off = next(step for step in steps if step.label == "remount")
    valid = np.broadcast_to((time < off.start) | (time > off.end - 0.2), subject.valid.T.shape).T.copy()
    measured = np.ones_like(valid)
    hand = [
        k for k, name in enumerate(subject.points) if name.startswith("left") and (is_finger(name) or "wrist" in name)
    ]
    measured[LOST, hand] = False
    palms = [name in BODY or name.endswith(("_index1", "_pinky1")) for name in subject.points]
    transport = Transport(
        messages=len(time),
        log_time=time + 0.02,
        available=time + 0.02,
        device_time=time + 7.0,
        all_tracked=np.asarray(valid[:, palms].all(axis=1)),
        all_valid=np.asarray(valid[:, palms].all(axis=1)),
    )
    return replace(
        subject, steps=tuple(steps), valid=valid, measured=measured, floor=0.0, transport=transport, sha256="0" * 64
    )


@pytest.fixture(scope="session")
def clean(performed: tuple[Pose, list[Step]]) -> Subject:
    """The performance as a subject that passes every check."""
    return given_out(*performed)
