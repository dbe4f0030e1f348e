"""What is tracked of one person in one frame, and what that implies before a network is asked."""

from dataclasses import dataclass

import numpy as np

from bodysense.body.rotation import normalize, quaternion_to_matrix
from bodysense.observation import Observation

from .points import BODY, HEAD, JOINTS, POINTS, at
from .vectors import frame_of

UNTRACKED = 1e4  # m: the accuracy of a point that is not tracked
FINEST = 1e-4  # m: no point is more accurate
FARTHEST = 1000.0  # m/s²: an acceleration beyond is no measurement

# Joints with several children: turned by points on them that are seen, along two vectors, each from a point to another.
BRANCHES = {
    at(joint): tuple((at(begin), at(end)) for begin, end in vectors)
    for joint, vectors in {
        "pelvis": (("right_hip", "left_hip"), ("pelvis", "spine1")),
        "spine3": (("right_collar", "left_collar"), ("spine3", "neck")),
        "left_wrist": (("left_wrist", "left_middle1"), ("left_pinky1", "left_index1")),
        "right_wrist": (("right_wrist", "right_middle1"), ("right_pinky1", "right_index1")),
    }.items()
}


@dataclass
class Tracked:
    """Joints in place of the trackers that they carry. Places count from `base`. Arrays are of single precision."""

    base: np.ndarray  # (3,) m, world
    interval: float  # s since the frame before
    floor: float  # m, height of the floor from base
    has_position: np.ndarray  # (65,) bool
    has_rotation: np.ndarray  # (52,) bool, measured
    implied: np.ndarray  # (52,) bool: measured points imply the rotation
    position: np.ndarray  # (65, 3) m, from base
    rotation: np.ndarray  # (52, 3, 3) world ← joint
    accuracy: np.ndarray  # (65,) m
    acceleration: np.ndarray  # (22, 3) m/s², world
    has_acceleration: np.ndarray  # (22,) bool
    rest_offset: np.ndarray  # (65, 3) m
    deviation: np.ndarray  # (65,) m

    def turned(self, joint: int) -> bool:
        """Whether a joint's rotation is measured or implied."""
        return bool(self.has_rotation[joint] or self.implied[joint])


def choose_base(observation: Observation, t: int, floor: float) -> np.ndarray:
    """Whole metres near the head, or else near the first point that is tracked, at the height of the floor."""
    places = dict(zip(observation.points, observation.position[t], strict=True))
    seen = [name for name, has in zip(observation.points, observation.has_position[t], strict=True) if has]
    near = places["head"] if "head" in seen else places[seen[0]] if seen else np.zeros(3)
    return np.rint([near[0], floor, near[2]])


def gather(observation: Observation, t: int, base: np.ndarray, interval: float, floor: float) -> Tracked:
    """What is tracked in frame t."""
    seen = Tracked(
        base=base,
        interval=interval,
        floor=floor - base[1],
        has_position=np.zeros(POINTS, bool),
        has_rotation=np.zeros(JOINTS, bool),
        implied=np.zeros(JOINTS, bool),
        position=np.zeros((POINTS, 3), np.float32),
        rotation=np.tile(np.eye(3, dtype=np.float32), (JOINTS, 1, 1)),
        accuracy=np.full(POINTS, UNTRACKED, np.float32),
        acceleration=np.zeros((BODY, 3), np.float32),
        has_acceleration=np.zeros(BODY, bool),
        rest_offset=np.zeros((POINTS, 3)),
        deviation=np.zeros(POINTS),
    )
    for k, name in enumerate(observation.points):
        point = at(name)
        if observation.has_position[t, k]:
            seen.has_position[point] = True
            seen.position[point] = observation.position[t, k] - base
            seen.accuracy[point] = max(observation.accuracy[t, k], FINEST)
        if observation.has_rotation[t, k] and point < JOINTS:
            seen.has_rotation[point] = True
            seen.rotation[point] = quaternion_to_matrix(normalize(observation.rotation[t, k]))
        if observation.acceleration is not None and point < BODY:
            felt = observation.acceleration[t, k]
            if (np.abs(felt) <= FARTHEST).all():
                seen.has_acceleration[point], seen.acceleration[point] = True, felt
    return seen


def imply_rotations(seen: Tracked) -> None:
    """Turn joints that branch as the points on them: R = [now's frame] [rest's frame]ᵀ."""
    for joint, ((a, b), (c, d)) in BRANCHES.items():
        if seen.has_rotation[joint] or not seen.has_position[[joint, a, b, c, d]].all():
            continue
        rest = seen.rest_offset.copy()
        rest[joint] = 0
        before, now = (frame_of(of[b] - of[a], of[d] - of[c]) for of in (rest, seen.position))
        if before[:, 2].any() and now[:, 2].any():  # points in one line imply no rotation
            seen.implied[joint], seen.rotation[joint] = True, now @ before.T


def place_head(seen: Tracked, before: np.ndarray | None) -> None:
    """Move a head that is not tracked with the points that are, from the points (65, 3) of the frame before."""
    if seen.has_position[HEAD]:
        return
    start = np.zeros((POINTS, 3)) if before is None else before
    moved = (seen.position - start)[seen.has_position]
    seen.position[HEAD] = start[HEAD] + (moved.mean(axis=0) if len(moved) else 0)
