"""Video device: a person's landmarks in, points of their body in the room out.

Head, shoulders and legs follow the landmarks' directions with the wearer's own bone lengths (`landmark_points`). A
network gives rotations of arms and hands; arms are aligned with their lines in the picture (`arm_geometry.lines`).
Unseen parts are not observed, and the tracker completes them.

The room's axes are the camera's without its tilt and roll, which are learned from the standing person (`camera_level`).
z is 0 at the start, and the lowest point of the legs is on the floor.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.arms import ARM_JOINTS, ARM_POINTS, CHEST, SIDES, arm_rotations, arm_skeleton
from bodysense.body.keypoints import Camera, arm_directions
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import ARM, Skeleton
from bodysense.devices.video.arm_geometry.lines import align_with_lines, with_depths
from bodysense.devices.video.arm_geometry.turns import align_arms, palm_rotations, with_palms
from bodysense.devices.video.camera_level import CameraLevel, remove_roll, roll_matrix, tilt_matrix
from bodysense.devices.video.landmark_points import TRUNK, FittedPoints, LandmarkPoints, locate_pelvis
from bodysense.devices.video.landmark_smoothing import REACH, neighbours, smooth_frame
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks, arm_keypoints, joined_landmarks
from bodysense.devices.video.posture_constants import FEET_VISIBLE, FLOOR_HALF_LIFE, UNSEEN_LEGS, VISIBLE
from bodysense.devices.video.sitting import Sitting, lay_legs, without_guessed_legs
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    normalize,
    quaternion_canonical,
    quaternion_multiply,
)
from bodysense.geometry.spring import spring_step
from bodysense.observing.observation import LANDMARK_ACCURACY, Observation

if TYPE_CHECKING:
    from bodysense.devices.video.arms import Arms

_LEGS = tuple(f"{side}_{part}" for side in SIDES for part in ("knee", "ankle", "foot", "toe"))
# Points that may be observed. Hips are left out because their landmarks are inaccurate: errors are 1-2 cm smaller.
POINTS = ("head", CHEST, *_LEGS, *ARM_JOINTS)
_WITH_POSITION = ("head", "left_shoulder", "right_shoulder", *_LEGS)
_ARM_MARKS = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for part in ARM_POINTS] for side in SIDES])
_LEG_MARKS = [BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES for part in ("knee", "ankle")]
_KNEE_MARKS = [BODY_LANDMARKS.index(f"{side}_knee") for side in SIDES]
_FAR = 3.0  # m, initial distance from the camera, before a person has been seen
LANDMARK_SMOOTHING = 0.05  # s, standard deviation of the smoothing of landmarks over earlier and later frames
_ARM_SMOOTHING = 0.03  # s, the same for arms, which move faster
_PLACE_HALF_LIFE = 0.1  # s, half-life of a jump across the picture
_DEPTH_HALF_LIFE = 0.3  # s, half-life of a jump toward the camera or away from it


@dataclass(frozen=True)
class VideoSettings:
    """Settings of video tracking."""

    look_ahead: float = 0.25  # s to wait for later frames; 0 outputs each at once
    field_of_view: float = 60.0  # degrees over the longer side of the picture
    tilt: float | None = None  # degrees by which the camera looks down; None: learned from the standing person
    roll: float | None = None  # degrees by which upright things lean to the right in the picture; None: learned, too

    def __post_init__(self) -> None:
        if not 0 <= self.look_ahead <= 0.5:
            raise BodysenseError(f"--look-ahead {self.look_ahead:g}: give 0 to 0.5 s")
        if not 5 <= self.field_of_view <= 170:
            raise BodysenseError(f"--field-of-view {self.field_of_view:g}: give 5 to 170 degrees")
        for name, most in (("tilt", 90), ("roll", 180)):
            if (angle := getattr(self, name)) is not None and not abs(angle) <= most:
                raise BodysenseError(f"--{name} {angle:g}: give -{most} to {most} degrees")


@dataclass(frozen=True, eq=False)
class VideoFrames:
    """T observed frames, with their landmarks and camera."""

    observation: Observation  # of `POINTS`, in the room
    person: PersonLandmarks  # not smoothed, but corrected for the camera's roll
    camera: Camera  # (T,) in the room

    @property
    def time(self) -> np.ndarray:
        """(T,) s."""
        return self.observation.time

    def __len__(self) -> int:
        return len(self.observation)


@dataclass(frozen=True, eq=False)
class VideoState:
    """State for the next frames."""

    arms: Any  # state of the network
    place: np.ndarray  # (3,) m, last position of the pelvis in the upright camera's axes
    velocity: np.ndarray  # (3,) m/s, of the smoothing of this position
    root: np.ndarray  # (3,) m, last position of the pelvis in the room
    level: CameraLevel = CameraLevel()
    sitting: Sitting = Sitting()
    floor: float | None = None  # m, height of the floor over the camera; None before feet were seen
    begun: tuple[float, float] | None = None  # time (s) of the first sighting, and z (m) in the room then
    time: float = -np.inf  # s, time of the last sighting
    waiting: PersonLandmarks | None = None  # `done` frames that were output but are needed for smoothing, then the next
    # (N, 4), of waiting frames: tilt, roll (rad), whether seated, and visibility of the legs, guessed ones included.
    levels: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    done: int = 0


@dataclass(frozen=True)
class VideoDevice:
    """Device for videos of one person with a `skeleton`; a network estimates `arms`. Immutable; state is an argument.

    A frame is output when one has arrived that is `look_ahead` later; `finish` returns the last ones.
    """

    skeleton: Skeleton
    arms: Arms
    aspect: float  # width / height of the pictures
    settings: VideoSettings = VideoSettings()

    @property
    def focal(self) -> float:
        """Focal length in heights of the picture."""
        return max(self.aspect, 1.0) / 2 / float(np.tan(np.radians(self.settings.field_of_view) / 2))

    def start(self) -> VideoState:
        """Return the state before the first frame."""
        return VideoState(self.arms.start(), np.array([0.0, 0.0, -_FAR]), np.zeros(3), self.skeleton.rest_offset[0])

    def step(self, person: PersonLandmarks, state: VideoState) -> tuple[VideoFrames, VideoState]:
        """Add the next T ≥ 1 frames; return the frames that are ready, and the state."""
        level, sitting, levels, frames = state.level, state.sitting, [], []
        legs = person.visible[:, _LEG_MARKS].mean(axis=1)
        person = without_guessed_legs(person)
        for k in range(len(person)):
            sitting = sitting.step(person[k : k + 1])
            level = level.step(person[k : k + 1], sitting.is_seated)
            levels.append((*self._angles(level), sitting.is_seated, legs[k]))
            frames.append(remove_roll(person[k : k + 1], levels[-1][1]))
        person = joined_landmarks(frames)
        waiting = person if state.waiting is None else joined_landmarks([state.waiting, person])
        state = replace(state, waiting=waiting, levels=np.concatenate([state.levels, levels]), level=level)
        state = replace(state, sitting=sitting)
        found, arms = self.arms.step(arm_keypoints(person), state.arms)
        return self._output(len(found), found.estimate.pose, replace(state, arms=arms))

    def _angles(self, level: CameraLevel) -> tuple[float, float]:
        """Return the given or learned tilt and roll (rad)."""
        tilt, roll = self.settings.tilt, self.settings.roll
        return (
            level.likely_tilt if tilt is None else float(np.radians(tilt)),
            level.likely_roll if roll is None else float(np.radians(roll)),
        )

    def finish(self, state: VideoState) -> VideoFrames:
        """Return the remaining frames."""
        count = 0 if state.waiting is None else len(state.waiting) - state.done
        return self._output(count, self.arms.finish(state.arms).estimate.pose if count else None, state)[0]

    def _output(self, count: int, arms: Pose | None, state: VideoState) -> tuple[VideoFrames, VideoState]:
        """Return the next `count` waiting frames with the network's `arms`, and the state."""
        assert state.waiting is not None
        waiting, first = state.waiting, state.done
        person = waiting[first : first + count]
        turned = None if arms is None else arm_rotations(arms)
        seen = _empty_observation(person.time)
        positions, axes = np.empty((count, 3)), np.empty((count, 3, 3))
        for k in range(count):
            settings, (tilt, roll, seated, _) = self.settings, state.levels[first + k]
            room = tilt_matrix(tilt)
            smooth = smooth_frame(waiting, first + k, LANDMARK_SMOOTHING, settings.look_ahead)
            fitted = self._points.fit(smooth) if smooth.has_body[0] else None
            if fitted is not None:
                assert turned is not None
                fitted, state = self._follow(fitted, smooth, room, bool(seated), state)
                places = smooth_frame(waiting, first + k, _ARM_SMOOTHING, settings.look_ahead).picture[0, _ARM_MARKS]
                near = neighbours(waiting.time, first + k, LANDMARK_SMOOTHING, settings.look_ahead) * waiting.has_body
                whole = float(near @ state.levels[:, 3] / near.sum())
                bones = self._arms(fitted, turned[k], smooth, places, whole, state)
                self._observe(seen, k, fitted, smooth, bones, room, state)
            axes[k] = room @ roll_matrix(roll)
            positions[k] = state.root - room @ state.place
        camera = Camera(positions, axes, np.full(count, self.focal), np.full(count, self.aspect))
        # Keep earlier frames that are needed to smooth the next ones.
        past = waiting.time[: first + count]
        old = 0 if not len(past) else int((past < past[-1] - REACH * LANDMARK_SMOOTHING).sum())
        frames = VideoFrames(seen, person, camera)
        return frames, replace(state, waiting=waiting[old:], levels=state.levels[old:], done=first + count - old)

    def _follow(
        self, fitted: FittedPoints, person: PersonLandmarks, room: np.ndarray, is_seated: bool, state: VideoState
    ) -> tuple[FittedPoints, VideoState]:
        """Return the body with legs of its posture, and the state with its position in one more frame."""
        time, floor = float(person.time[0]), state.floor
        trunk = locate_pelvis(fitted, person, self.skeleton, self.focal, TRUNK)
        fitted = lay_legs(fitted, person, trunk, self.focal, room, self.skeleton, is_seated, floor)
        place = locate_pelvis(fitted, person, self.skeleton, self.focal)
        if state.begun is None:
            state = replace(state, place=place, begun=(time, float((room @ place)[2])))
        else:
            lives = np.array([_PLACE_HALF_LIFE] * 2 + [_DEPTH_HALF_LIFE])
            offset, velocity = spring_step(state.place - place, state.velocity, lives, time - state.time)
            state = replace(state, place=place + offset, velocity=velocity)
        assert state.begun is not None
        x, y, z = room @ state.place
        rest = self.skeleton.path @ self.skeleton.rest_offset + self.skeleton.rest_offset[0]
        # By the ankles alone: how far toes point down is the least sure of all.
        ankles = self.skeleton.indices([f"{side}_ankle" for side in SIDES])
        lowest = float(((fitted.position[ankles] @ room.T)[:, 1] - rest[ankles, 1]).min())
        marks = _LEG_MARKS if is_seated else _KNEE_MARKS  # shins of standing people hang
        if person.visible[0, marks].min() >= FEET_VISIBLE:
            share = 1.0 if floor is None else 1 - 2 ** (-(time - state.time) / FLOOR_HALF_LIFE)
            floor = y + lowest if floor is None else floor + share * (y + lowest - floor)
        return fitted, replace(state, root=np.array([x, -lowest, z - state.begun[1]]), floor=floor, time=time)

    def _arms(
        self,
        fitted: FittedPoints,
        arms: np.ndarray,
        person: PersonLandmarks,
        places: np.ndarray,
        whole: float,
        state: VideoState,
    ) -> np.ndarray:
        """Return rotations (38, 4) of arms and hands in the camera's axes.

        Arms have local rotations `arms` (38, 4), and are aligned with their lines in the picture, at `places`
        (2, 3, 2). Hands are turned toward their landmarks. `whole` is the visibility of the legs as the landmarker
        gives it, by which the trust in depths was fitted.
        """
        chest = fitted.rotation[self.skeleton.index(CHEST)]
        pose = Pose(self._arm_skeleton, np.zeros(3), np.vstack([chest, arms]))
        position, turned = map(np.asarray, forward_kinematics(pose))
        joints = self._arm_skeleton.indices([f"{side}_{part}" for side in SIDES for part in ARM_POINTS]).reshape(2, 3)
        bones = np.asarray(normalize(np.diff(position[joints], axis=1)))
        shoulders = fitted.position[self.skeleton.indices([f"{side}_shoulder" for side in SIDES]), 2]
        length = np.linalg.norm(np.diff(position[joints], axis=1), axis=-1)
        predicted = arm_directions(person.world[0, _ARM_MARKS])
        away = -float(state.place[2]) - shoulders
        deep = with_depths(bones, predicted, person.picture[0, _ARM_MARKS], self.focal, away, length, whole)
        lines = align_with_lines(deep, places, self.focal, -float(state.place[2]))
        palms = palm_rotations(person.hand_world[0], self.skeleton)
        return with_palms(align_arms(turned[1:], bones, lines), palms, person.has_hand[0])

    def _observe(
        self,
        seen: Observation,
        frame: int,
        fitted: FittedPoints,
        person: PersonLandmarks,
        arms: np.ndarray,
        room: np.ndarray,
        state: VideoState,
    ) -> None:
        """Fill in one frame of an observation, in place: the seen points of a body, and rotations (38, 4) of arms."""
        where, joints = self._places
        visible, turned, rotation = (
            fitted.visible[where].copy(),
            np.zeros(len(POINTS)),
            np.full((len(POINTS), 4), np.nan),
        )
        turned[joints], rotation[joints] = fitted.turned[where[joints]], fitted.rotation[where[joints]]
        is_seen = person.visible[0, _ARM_MARKS].min(axis=1)
        for name, turn in zip(ARM_JOINTS, arms, strict=True):
            side, _, part = name.partition("_")
            number, place = SIDES.index(side), POINTS.index(name)
            rotation[place] = turn
            turned[place] = is_seen[number] if part in ARM or person.has_hand[0, number] else 0.0
        visible[self._is_rotation] = 0.0
        hidden = person.visible[0, _LEG_MARKS].reshape(2, 2).max(axis=0) < VISIBLE  # knees, ankles
        error = np.full(len(POINTS), LANDMARK_ACCURACY * (UNSEEN_LEGS if hidden.all() else 1.0))
        error[self._assumed[hidden]] = LANDMARK_ACCURACY * UNSEEN_LEGS
        at = visible >= VISIBLE
        seen.position[frame, at] = fitted.position[where[at]] @ room.T + state.root
        seen.has_position[frame, at] = True
        seen.accuracy[frame, at] = error[at] / visible[at]
        known = np.flatnonzero(turned >= VISIBLE)
        tilt = np.broadcast_to(matrix_to_quaternion(room), (len(known), 4))
        seen.rotation[frame, known] = quaternion_canonical(quaternion_multiply(tilt, rotation[known]))
        seen.has_rotation[frame, known] = True

    @cached_property
    def _arm_skeleton(self) -> Skeleton:
        return arm_skeleton(self.skeleton)

    @cached_property
    def _points(self) -> LandmarkPoints:
        return LandmarkPoints(self.skeleton)

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of `POINTS` in the skeleton, and indices in `POINTS` of joints."""
        where = self.skeleton.indices(POINTS)
        return where, np.flatnonzero(where < len(self.skeleton.joints))

    @cached_property
    def _is_rotation(self) -> np.ndarray:
        """Mask of the `POINTS` that are observed without a position."""
        return np.array([name not in _WITH_POSITION for name in POINTS])

    @cached_property
    def _assumed(self) -> np.ndarray:
        """Indices (2, 2) of both knees and both ankles in `POINTS`."""
        return np.array([[POINTS.index(f"{side}_{part}") for side in SIDES] for part in ("knee", "ankle")])


def _empty_observation(time: np.ndarray) -> Observation:
    """Return an observation without any observed point at `time` (T,) s."""
    shape = (len(time), len(POINTS))
    return Observation(
        points=POINTS,
        position=np.full((*shape, 3), np.nan),
        rotation=np.full((*shape, 4), np.nan),
        has_position=np.zeros(shape, dtype=bool),
        has_rotation=np.zeros(shape, dtype=bool),
        accuracy=np.full(shape, LANDMARK_ACCURACY),
        time=np.asarray(time, dtype=float),
    )
