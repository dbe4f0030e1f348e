"""A person in a video as a body in the room: trunk and legs from landmarks, arms and hands from a network.

The room's axes are the camera's, but for its tilt, which is learned from how the person stands; z is 0 where they
begin. Their lowest point is on the floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.arms import arm_rotations, with_arms
from bodysense.body.ik import IkState
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rotation import matrix_to_quaternion, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.body.spring import spring_step
from bodysense.capture.landmarks import BODY_LANDMARKS
from bodysense.capture.person import VISIBLE, PersonLandmarks, arm_keypoints, joined_landmarks
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.landmark_body import LandmarkBody
from bodysense.occlusion.camera_view import Camera

if TYPE_CHECKING:
    from bodysense.estimators.arms import Arms

SEEN_ERROR, GUESSED_ERROR = 0.05, 0.15  # m: what is expected of a point that was seen, and of one that was not
_PLACED_BY = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # landmarks that say where a body is
_REACH = 3.0  # standard deviations of the smoothing
_FAR, _NEAR = 3.0, 0.3  # m from the camera: where nobody has been seen yet, and the nearest that anybody comes
_STRAIGHT, _STEEPEST = np.radians(25.0), np.radians(35.0)  # of a body that stands; the most that a camera is tilted
_LONGEST_MEAN = 10.0  # s over which the tilt is averaged


@dataclass(frozen=True)
class VideoSettings:
    """How a video becomes motion."""

    look_ahead: float = 0.25  # s that an answer waits for frames to come; 0 answers at once
    calm: float = 0.05  # s: standard deviation of the smoothing of landmarks, over frames before and those ahead
    field_of_view: float = 60.0  # degrees over the longer side of the picture
    tilt: float | None = None  # degrees by which the camera looks down; by how the person stands, where it is not given
    place_half_life: float = 0.1  # s in which half of a jump across the picture is closed
    depth_half_life: float = 0.3  # s, of a jump toward the camera or away from it

    def __post_init__(self) -> None:
        if not 0 <= self.look_ahead <= 0.5:
            raise BodysenseError(f"--look-ahead {self.look_ahead:g}: give 0 to 0.5 s")
        if not 5 <= self.field_of_view <= 170:
            raise BodysenseError(f"--field-of-view {self.field_of_view:g}: give 5 to 170 degrees")
        for name in ("calm", "place_half_life", "depth_half_life"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"video settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class VideoFrames:
    """T completed frames, with what they were completed from."""

    time: np.ndarray  # (T,) s
    estimate: PointEstimate  # with its pose, in the room
    person: PersonLandmarks  # as they were found
    camera: Camera  # (T,) in the room

    @property
    def pose(self) -> Pose:
        """(T, …) in the room."""
        assert self.estimate.pose is not None
        return self.estimate.pose

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, eq=False)
class VideoState:
    """Everything that the next frames depend on."""

    arms: Any  # the state of the network
    ik: IkState | None
    pose: Pose  # of the last frame, its pelvis at the origin, in the camera's axes
    place: np.ndarray  # (3,) m: where the pelvis was, in the camera's axes
    velocity: np.ndarray  # (3,) m/s
    tilt: float  # rad: how far the camera looks down
    begun: tuple[float, float] | None = None  # s and m: when the person was first seen, and at which z of the room
    time: float = -np.inf  # s
    waiting: PersonLandmarks | None = None  # the frames to complete, after those before that they are smoothed with
    done: int = 0  # how many are of before


@dataclass(frozen=True)
class VideoBody:
    """Completes the body of a person in a video. Without `arms` arms and hands come from landmarks, like the rest.

    A frame is complete when one has come in that is `look_ahead` later; `finish` completes the last ones.
    """

    body: LandmarkBody
    arms: Arms | None
    aspect: float  # width / height of the pictures
    settings: VideoSettings = VideoSettings()

    @property
    def skeleton(self) -> Skeleton:
        """The body that is completed."""
        return self.body.skeleton

    @property
    def focal(self) -> float:
        """Focal length in heights of the picture."""
        return max(self.aspect, 1.0) / 2 / float(np.tan(np.radians(self.settings.field_of_view) / 2))

    def start(self) -> VideoState:
        """The state before the first frame: nobody yet, so a body that stands."""
        arms = None if self.arms is None else self.arms.start()
        pose = replace(standing_pose(self.skeleton), root_position=np.zeros(3))
        tilt = float(np.radians(self.settings.tilt or 0.0))
        return VideoState(arms, None, pose, np.array([0.0, 0.0, -_FAR]), np.zeros(3), tilt)

    def step(self, person: PersonLandmarks, state: VideoState) -> tuple[VideoFrames, VideoState]:
        """Take in the next T ≥ 1 frames: the frames that are complete by now, and the state after them."""
        waiting = person if state.waiting is None else joined_landmarks([state.waiting, person])
        state = replace(state, waiting=waiting)
        if self.arms is None:
            due = waiting.time + self.settings.look_ahead <= waiting.time[-1] + 1e-6
            count = int(due.sum()) - state.done
            return self._complete(count, None, state)
        found, arms = self.arms.step(arm_keypoints(person), state.arms)
        return self._complete(len(found.time), found.estimate.pose, replace(state, arms=arms))

    def finish(self, state: VideoState) -> VideoFrames:
        """The frames that were still waited for."""
        count = 0 if state.waiting is None else len(state.waiting) - state.done
        arms = None if self.arms is None or not count else self.arms.finish(state.arms).estimate.pose
        return self._complete(count, arms, state)[0]

    def _complete(self, count: int, arms: Pose | None, state: VideoState) -> tuple[VideoFrames, VideoState]:
        """The next `count` frames that wait, with the network's arms."""
        assert state.waiting is not None
        turned = None if arms is None else arm_rotations(arms)
        waiting, first = state.waiting, state.done
        roots, rotations = np.empty((count, 3)), np.empty((count, len(self.skeleton.joints), 4))
        positions, axes = np.empty((count, 3)), np.empty((count, 3, 3))
        for k in range(count):
            state = self._next(smoothed(waiting, first + k, self.settings.calm, self.settings.look_ahead), state)
            if turned is not None:
                state = replace(state, pose=with_arms(state.pose, turned[k]))
            axes[k] = _tilted(state.tilt)
            pose = self._in_room(state)
            roots[k], rotations[k] = pose.root_position, pose.rotation
            positions[k] = roots[k] - axes[k] @ state.place
        person = waiting[first : first + count]
        aspect, focal = np.full(count, self.aspect), np.full(count, self.focal)
        frames = VideoFrames(
            person.time,
            self._estimate(Pose(self.skeleton, roots, rotations), person),
            person,
            Camera(positions, axes, focal, aspect),
        )
        # What is left of the frames before is what the next ones are smoothed with.
        past = waiting.time[: first + count]
        old = 0 if not len(past) else int((past < past[-1] - _REACH * self.settings.calm).sum())
        return frames, replace(state, waiting=waiting[old:], done=first + count - old)

    def _next(self, person: PersonLandmarks, state: VideoState) -> VideoState:
        """The state after one frame, of smoothed landmarks; where there is no body, everything stays as it was."""
        if not person.has_body[0]:
            return state
        pose, ik = self.body.solve(person, state.ik)
        pose = replace(pose, root_position=np.zeros(3))
        time = float(person.time[0])
        place, tilt = self._located(pose, person), self._tilt(person, state)
        if state.begun is None:
            begun = (time, float((_tilted(tilt) @ place)[2]))
            return replace(state, ik=ik, pose=pose, place=place, tilt=tilt, begun=begun, time=time)
        lives = np.array([self.settings.place_half_life] * 2 + [self.settings.depth_half_life])
        offset, velocity = spring_step(state.place - place, state.velocity, lives, time - state.time)
        return replace(state, ik=ik, pose=pose, place=place + offset, velocity=velocity, tilt=tilt, time=time)

    def _tilt(self, person: PersonLandmarks, state: VideoState) -> float:
        """rad: the mean of how far standing bodies lean toward the camera, over the time that the person was seen."""
        if self.settings.tilt is not None:
            return state.tilt
        lean = _lean(person)
        if lean is None:
            return state.tilt
        time = float(person.time[0])
        elapsed = 0.0 if state.begun is None else time - state.begun[0]
        share = 1.0 if not elapsed else (time - state.time) / min(elapsed, _LONGEST_MEAN)
        return state.tilt + share * (lean - state.tilt)

    def _located(self, pose: Pose, person: PersonLandmarks) -> np.ndarray:
        """(3,) m: where the pelvis is in the camera's axes, so that joints are seen where the landmarks are.

        A joint at q from a pelvis at (x, y, −depth) is seen at focal · (q + (x, y)) / (depth − q_z): linear in all
        three, solved in the least squares.
        """
        names = [f"{side}_{part}" for part in _PLACED_BY for side in ("left", "right")]
        marks = [BODY_LANDMARKS.index(name) for name in names]
        q = np.asarray(forward_kinematics(pose)[0])[self.skeleton.indices(names)]
        seen, pull = person.picture[0, marks], np.clip(person.visible[0, marks], 0.05, 1.0)
        rows, values = np.zeros((2, len(names), 3)), np.empty((2, len(names)))
        for axis in range(2):
            rows[axis, :, axis] = self.focal
            rows[axis, :, 2] = -seen[:, axis]
            values[axis] = -self.focal * q[:, axis] - seen[:, axis] * q[:, 2]
        place = np.linalg.lstsq((rows * pull[:, None]).reshape(-1, 3), (values * pull).ravel(), rcond=None)[0]
        place[2] = -max(place[2], _NEAR)
        return place

    def _in_room(self, state: VideoState) -> Pose:
        """The last frame's pose in the room."""
        axes = _tilted(state.tilt)
        rotation = np.array(state.pose.rotation)
        rotation[0] = quaternion_multiply(matrix_to_quaternion(axes), rotation[0])
        pose = replace(state.pose, rotation=rotation)
        rest = self.skeleton.path @ self.skeleton.rest_offset + self.skeleton.rest_offset[0]
        lowest = float(np.asarray(forward_kinematics(pose)[0])[:, 1].min())
        x, _, z = axes @ state.place
        begun = z if state.begun is None else state.begun[1]
        return replace(pose, root_position=np.array([x, float(rest[:, 1].min()) - lowest, z - begun]))

    def _estimate(self, pose: Pose, person: PersonLandmarks) -> PointEstimate:
        occluded = np.ones((len(person), len(self.skeleton.points)))
        for point, name in enumerate(self.skeleton.points):
            if name in BODY_LANDMARKS:
                occluded[:, point] = 1 - person.visible[:, BODY_LANDMARKS.index(name)]
            elif self.skeleton.wrist_of[point] >= 0:
                occluded[:, point] = ~person.has_hand[:, int(name.startswith("right"))]
        position = np.asarray(forward_kinematics(pose)[0])
        confidence = np.where(occluded < 1 - VISIBLE, SEEN_ERROR, GUESSED_ERROR)
        return PointEstimate(self.skeleton, position, occluded, confidence, pose)


def _tilted(tilt: float) -> np.ndarray:
    """(3, 3) room ← camera of a camera that looks down by `tilt` rad."""
    cosine, sine = np.cos(tilt), np.sin(tilt)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def _lean(person: PersonLandmarks) -> float | None:
    """rad: how far a body that stands straight leans toward the camera; None where it does not, or is not seen."""
    parts = ("shoulder", "hip", "knee", "ankle")
    marks = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for side in ("left", "right")] for part in parts])
    if person.visible[0, marks].min() < VISIBLE:
        return None
    joints = person.world[0, marks]  # (part, side, 3)
    bones = [*(joints[1] - joints[2]), *(joints[2] - joints[3]), (joints[0] - joints[1]).mean(axis=0)]
    up = joints[0].mean(axis=0) - joints[3].mean(axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    straight = min(float(bone @ up) / max(float(np.linalg.norm(bone)), 1e-9) for bone in bones)
    lean = float(np.arctan2(up[2], up[1]))
    return lean if straight > np.cos(_STRAIGHT) and abs(lean) < _STEEPEST else None


def smoothed(person: PersonLandmarks, frame: int, calm: float, ahead: float) -> PersonLandmarks:
    """One frame, averaged with those around it, up to `ahead` s later, by a Gaussian of standard deviation `calm` s.

    It has no body where there is none in reach.
    """
    later = person.time - person.time[frame]
    near = np.exp(-0.5 * (later / calm) ** 2) * (np.abs(later) <= _REACH * calm) * (later <= ahead + 1e-6)

    def mean(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
        weight = np.where(mask, near.reshape(-1, *[1] * (mask.ndim - 1)), 0.0)
        total = weight.sum(axis=0)
        weight = weight / np.where(total > 0, total, 1.0)
        spread = weight.reshape(*weight.shape, *[1] * (values.ndim - weight.ndim))
        return (np.where(spread > 0, values, 0.0) * spread).sum(axis=0, keepdims=True)

    body, hand = person.has_body, person.has_hand
    return PersonLandmarks(
        time=person.time[frame : frame + 1],
        world=mean(person.world, body),
        picture=mean(person.picture, body),
        visible=mean(person.visible, body),
        has_body=(near[:, None] * body[:, None]).any(axis=0),
        hand=mean(person.hand, hand),
        hand_world=mean(person.hand_world, hand),
        has_hand=((near[:, None] * hand) > 0).any(axis=0)[None],
    )
