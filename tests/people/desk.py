"""Landmarks of people before a desk's camera, with truth: any seat, camera, table, stature and lean.

Landmarks err as MediaPipe's did on 60 rendered films of seats from 0.35 to 0.65 m: hips of raised thighs are seen
higher and knees lower; legs that are hidden are guessed as hanging, beyond the picture with probabilities up to 0.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.arms import SIDES
from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply

from .filmed import TABLE, seated_pose

HIPS_UP, KNEES_DOWN = 0.03, 0.035  # m by which landmarks of seated people are off, on average
BEHIND_TABLE, BEYOND_PICTURE = 0.34, 0.6  # largest probability of guessed knees
EDGE = 0.12  # of the picture's height from its edge, over which probabilities rise to 0.95
TABLE_SPAN = (0.32, 0.92)  # m from the pelvis to the near and the far edge of the table
NOISE = 0.004  # m
_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "heel", "toe")


@dataclass(frozen=True)
class Desk:
    """One person before one camera."""

    seat: float | None  # m; None: the person stands
    stature: float  # m, height of the person
    tilt: float  # degrees by which the camera looks down
    height: float  # m, of the camera over the floor
    distance: float  # m, of the camera from the pelvis
    at_table: bool
    lean: float  # degrees by which the trunk leans forward
    seed: int

    @property
    def pose(self) -> Pose:
        """The person's one pose."""
        skeleton = Person(height=self.stature).skeleton
        pose = standing_pose(skeleton) if self.seat is None else seated_pose(skeleton, self.seat)
        rotation = pose.rotation.copy()
        spine = skeleton.index("spine1")
        rotation[spine] = quaternion_multiply(quaternion_exp(np.radians([self.lean, 0.0, 0.0])), rotation[spine])
        return Pose(skeleton, pose.root_position, rotation)


def draw_desk(rng: np.random.Generator, seat: float | None, at_table: bool) -> Desk:
    """Return a person on a seat, or on foot, before a camera that shows the trunk; of standing people the knees too."""
    stature, tilt = float(rng.uniform(1.55, 1.9)), float(rng.uniform(-5.0, 22.0))
    distance = float(rng.uniform(0.9, 2.2) if seat is not None else rng.uniform(1.9, 3.2))
    middle = 0.52 * stature if seat is None else seat + 0.4  # m, of what is in the middle of the picture
    height = float(middle + distance * np.tan(np.radians(tilt)))
    return Desk(seat, stature, tilt, height, distance, at_table, float(rng.uniform(-5.0, 12.0)), int(rng.integers(99)))


def desk_landmarks(desk: Desk, focal: float, frames: int = 12, rate: float = 15.0) -> PersonLandmarks:
    """Return noisy landmarks (T, 33) of a still person."""
    rng, skeleton = np.random.default_rng(desk.seed), desk.pose.skeleton
    room = np.asarray(forward_kinematics(desk.pose)[0])
    cosine, sine = np.cos(np.radians(desk.tilt)), np.sin(np.radians(desk.tilt))
    axes = np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])  # room ← camera
    eye = np.array([0.0, desk.height, desk.distance])
    place = np.tile((room[skeleton.index("head")] - eye) @ axes, (len(BODY_LANDMARKS), 1))
    place[BODY_LANDMARKS.index("nose")] += np.array([0.0, 0.0, 0.1]) @ axes
    visible = np.ones(len(BODY_LANDMARKS))
    for sign, side in zip((1, -1), SIDES, strict=True):
        place[BODY_LANDMARKS.index(f"{side}_ear"), 0] += 0.07 * sign
        point = {part: room[skeleton.index(f"{side}_{'ankle' if part == 'heel' else part}")] for part in _PARTS}
        point = {part: at.copy() for part, at in point.items()}
        if desk.seat is not None:
            point["hip"][1] += HIPS_UP
            point["knee"][1] -= KNEES_DOWN
        is_hidden = _is_hidden(point["knee"], eye, axes, focal, desk.at_table)
        if is_hidden:
            point |= _hanging(point, skeleton, side)
        for part, at in point.items():
            mark = BODY_LANDMARKS.index(f"{side}_{part}")
            place[mark] = (at - eye) @ axes
            if part in ("knee", "ankle", "heel", "toe"):
                inside = 0.5 + focal * place[mark, 1] / -place[mark, 2]  # of the picture's height, over its edge
                visible[mark] = 0.25 + 0.7 * np.clip(inside / EDGE, 0.0, 1.0) if inside > 0 else 0.02
                if is_hidden:
                    most = BEHIND_TABLE if inside > 0 else BEYOND_PICTURE
                    visible[mark] = rng.uniform(0.02, most) if part == "knee" else 0.02
    world = place + rng.normal(0.0, NOISE, (frames, *place.shape))
    hips = world[:, [BODY_LANDMARKS.index(f"{side}_hip") for side in SIDES]].mean(axis=1)
    return PersonLandmarks(
        time=np.arange(frames) / rate,
        world=world - hips[:, None],
        picture=focal * world[..., :2] / -world[..., 2:],
        visible=np.tile(visible, (frames, 1)),
        has_body=np.ones(frames, dtype=bool),
        hand=np.full((frames, 2, 21, 2), np.nan),
        hand_world=np.full((frames, 2, 21, 3), np.nan),
        has_hand=np.zeros((frames, 2), dtype=bool),
    )


def _is_hidden(knee: np.ndarray, eye: np.ndarray, axes: np.ndarray, focal: float, at_table: bool) -> bool:
    """Whether a knee is beyond the picture or behind the table."""
    _, y, z = (knee - eye) @ axes
    if focal * y / -z < -0.5:
        return True
    share = (eye[1] - TABLE) / (eye[1] - knee[1])  # of the line of sight, from the camera to the top of the table
    crossed = eye[2] + share * (knee[2] - eye[2])
    return at_table and (eye[1] < TABLE or TABLE_SPAN[0] < crossed < TABLE_SPAN[1])


def _hanging(point: dict[str, np.ndarray], skeleton: Skeleton, side: str) -> dict[str, np.ndarray]:
    """Return places of legs that hang from the hip."""
    rest, hip = skeleton.path @ skeleton.rest_offset, skeleton.index(f"{side}_hip")
    names = {part: "ankle" if part == "heel" else part for part in ("knee", "ankle", "heel", "toe")}
    return {part: point["hip"] + rest[skeleton.index(f"{side}_{name}")] - rest[hip] for part, name in names.items()}
