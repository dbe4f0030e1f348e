"""Tracked values of one person in one frame, and rotations that they imply."""

from dataclasses import dataclass

import numpy as np

from bodysense.geometry.rotation import normalize, quaternion_to_matrix
from bodysense.observing.observation import Observation

from .points import BODY, HEAD, HEAD_TOP, JOINTS, PELVIS, POINTS, SPINE3, WRISTS, at
from .vectors import UP, cross, frame_of, length, mix, turned_onto, unit

UNTRACKED = 1e4  # m: the accuracy of a point that is not tracked
FINEST, COARSEST = 1e-4, 1000.0  # m: no point counts as more accurate, or as less
FARTHEST = 1000.0  # m/s²: an acceleration beyond is no measurement
GOES, COURSE = 0.4, 0.5  # m/s from which a head has a course; s in which half of a change of it is followed
SHORTEST_LINE = 0.1  # m: a shorter line from right to left gives no heading

KNUCKLES = [[at(f"{side}_{name}1") for name in ("index", "middle", "ring", "pinky")] for side in ("left", "right")]

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
    knuckle: np.ndarray  # (2, 4, 3) m, from base: of `KNUCKLES`, measured or implied by the others
    has_knuckles: np.ndarray  # (2,) bool: all of a hand's are known
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
    """Return the tracked values of frame t."""
    seen = Tracked(
        base=base,
        interval=interval,
        floor=floor - base[1],
        has_position=np.zeros(POINTS, bool),
        has_rotation=np.zeros(JOINTS, bool),
        implied=np.zeros(JOINTS, bool),
        position=np.zeros((POINTS, 3), np.float32),
        knuckle=np.zeros((2, 4, 3), np.float32),
        has_knuckles=np.zeros(2, bool),
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
            seen.accuracy[point] = min(max(observation.accuracy[t, k], FINEST), COARSEST)
        if observation.has_rotation[t, k] and point < JOINTS:
            seen.has_rotation[point] = True
            seen.rotation[point] = quaternion_to_matrix(normalize(observation.rotation[t, k]))
        if observation.acceleration is not None and point < BODY:
            felt = observation.acceleration[t, k]
            if (np.abs(felt) <= FARTHEST).all():
                seen.has_acceleration[point], seen.acceleration[point] = True, felt
    return seen


def find_knuckles(seen: Tracked) -> None:
    """Find all knuckles of each hand: the palm is stiff, so that three of them and the wrist place a hidden one."""
    for hand, (wrist, knuckles) in enumerate(zip(WRISTS, KNUCKLES, strict=True)):
        has = seen.has_position[knuckles]
        seen.knuckle[hand], seen.has_knuckles[hand] = seen.position[knuckles], has.all()
        if has.sum() != 3 or not seen.has_position[wrist]:
            continue
        known, rest = np.flatnonzero(has), seen.rest_offset[knuckles]
        places = [rest[known], seen.position[knuckles][known] - seen.position[wrist]]
        before, now = (frame_of(of.mean(axis=0), of[-1] - of[0]) for of in places)
        if before[:, 2].any() and now[:, 2].any():
            off = now @ before.T @ (rest[~has][0] - rest[known].mean(axis=0))
            seen.knuckle[hand, ~has] = seen.position[wrist] + places[1].mean(axis=0) + off
            seen.has_knuckles[hand] = True


def imply_rotations(seen: Tracked) -> None:
    """Turn joints that branch as the points on them: R = [now's frame] [rest's frame]ᵀ."""
    position, has = seen.position.copy(), seen.has_position.copy()
    for hand in np.flatnonzero(seen.has_knuckles):
        position[KNUCKLES[hand]], has[KNUCKLES[hand]] = seen.knuckle[hand], True
    for joint, ((a, b), (c, d)) in BRANCHES.items():
        if seen.has_rotation[joint] or not has[[joint, a, b, c, d]].all():
            continue
        rest = seen.rest_offset.copy()
        rest[joint] = 0
        before, now = (frame_of(of[b] - of[a], of[d] - of[c]) for of in (rest, position))
        if before[:, 2].any() and now[:, 2].any():  # points in one line imply no rotation
            seen.implied[joint], seen.rotation[joint] = True, now @ before.T


def place_head(seen: Tracked, before: np.ndarray | None) -> None:
    """Move a head that is not tracked with the points that are, from the points (65, 3) of the frame before."""
    if seen.has_position[HEAD]:
        return
    start = np.zeros((POINTS, 3)) if before is None else before
    displacement = (seen.position - start)[seen.has_position]
    seen.position[HEAD] = start[HEAD] + (displacement.mean(axis=0) if len(displacement) else 0)


def read_head(seen: Tracked, course: np.ndarray) -> None:
    """Give a head that is placed but not turned the likeliest rotation, which the network reads."""
    if seen.has_rotation[HEAD] or not seen.has_position[HEAD]:
        return
    left, right = ([at(f"{side}_{name}") for name in ("hip", "shoulder", "ankle")] for side in ("left", "right"))
    lines = [
        seen.position[a] - seen.position[b] for a, b in zip(left, right, strict=True) if seen.has_position[[a, b]].all()
    ]
    line = sum(lines, np.zeros(3)) * [1, 0, 1]
    ahead = unit(cross(line, UP)) if length(line) > SHORTEST_LINE else course if course.any() else np.array([0, 0, 1.0])
    turned = next((seen.rotation[joint] for joint in (SPINE3, PELVIS) if seen.turned(joint)), None)
    likely = np.stack([cross(UP, ahead), UP, ahead], axis=1) if turned is None else turned
    if seen.has_position[HEAD_TOP]:
        likely = turned_onto(likely, likely @ seen.rest_offset[HEAD_TOP], seen.position[HEAD_TOP] - seen.position[HEAD])
    seen.rotation[HEAD], seen.has_rotation[HEAD] = likely, True


def course_of(seen: Tracked, velocity: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return where a head faces, else goes at a velocity (3,) m/s: (3,), horizontal, of length one; zero if unknown."""
    if seen.has_rotation[HEAD]:
        turn = seen.rotation[HEAD]
        return unit(np.array([turn[0, 2] - turn[2, 0], 0, turn[0, 0] + turn[2, 2]]))
    goes = velocity * [1, 0, 1]
    return before if length(goes) < GOES else unit(mix(before, unit(goes), 1 - 2 ** (-seen.interval / COURSE)))
