"""Video as a device: a person's landmarks in, points of their body in the room out.

Head, shoulders and legs are laid along the landmarks with the wearer's own bones (`landmark_points`). Arms and hands
are rotations by a network; where they are follows from these. What is not seen is not observed, so that the tracker
completes it. The room's axes are the camera's, but for its tilt, which is learned from how the person stands; z is 0
where they begin, and the lowest point of their legs is on the floor.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.arms import ARM_JOINTS, ARM_PARTS, ARM_POINTS, CHEST, SIDES, arm_rotations, arm_skeleton
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import matrix_to_quaternion, quaternion_canonical, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.body.spring import spring_step
from bodysense.capture.landmarks import BODY_LANDMARKS, Landmarker
from bodysense.capture.person import (
    VISIBLE,
    PersonLandmarks,
    PersonSettings,
    PersonState,
    arm_keypoints,
    follow,
    joined_landmarks,
)
from bodysense.capture.video import Picture, VideoBrokenError
from bodysense.devices.landmark_points import LaidPoints, LandmarkPoints
from bodysense.errors import BodysenseError
from bodysense.observation import LANDMARK_ACCURACY, Observation
from bodysense.occlusion.camera_view import Camera

if TYPE_CHECKING:
    from bodysense.estimators.arms import Arms

_LEGS = tuple(f"{side}_{part}" for side in SIDES for part in ("knee", "ankle", "foot", "toe"))
# What may be observed. Landmarks of hips are too rough: on rendered videos bodies are 1-2 cm nearer without them.
POINTS = ("head", CHEST, *_LEGS, *ARM_JOINTS)
_WITH_POSITION = ("head", "left_shoulder", "right_shoulder", *_LEGS)
_UNSEEN_LEGS = 3.0  # times as far off a body is whose legs are not seen: it stands as high as if they were straight
_PLACED_BY = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # landmarks that say where a body is
_ARM_MARKS = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for part in ARM_POINTS] for side in SIDES])
_SOLE = ("ankle", "foot", "toe")
_REACH = 3.0  # standard deviations of the smoothing
_FAR, _NEAR = 3.0, 0.3  # m from the camera: where nobody has been seen yet, and the nearest that anybody comes
_STRAIGHT, _STEEPEST = np.radians(25.0), np.radians(35.0)  # of a body that stands; the most that a camera is tilted
_LONGEST_MEAN = 10.0  # s over which the tilt is averaged


@dataclass(frozen=True)
class VideoSettings:
    """How a video becomes observed points."""

    look_ahead: float = 0.25  # s that a frame waits for frames to come; 0 gives each at once
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
    """T frames, with what they were made of."""

    observation: Observation  # of `POINTS`, in the room
    person: PersonLandmarks  # as they were found
    camera: Camera  # (T,) in the room

    @property
    def time(self) -> np.ndarray:
        """(T,) s."""
        return self.observation.time

    def __len__(self) -> int:
        return len(self.observation)


@dataclass(frozen=True, eq=False)
class VideoState:
    """Everything that the next frames depend on."""

    arms: Any  # the state of the network
    place: np.ndarray  # (3,) m: where the pelvis was, in the camera's axes
    velocity: np.ndarray  # (3,) m/s
    tilt: float  # rad: how far the camera looks down
    root: np.ndarray  # (3,) m: where the pelvis was, in the room
    begun: tuple[float, float] | None = None  # s and m: when the person was first seen, and at which z of the room
    time: float = -np.inf  # s
    waiting: PersonLandmarks | None = None  # the frames to come, after those before that they are smoothed with
    done: int = 0  # how many are of before


@dataclass(frozen=True)
class VideoDevice:
    """A camera that watches a person of a `skeleton`, with a network of `arms`. Immutable; state is an argument.

    A frame is given when one has come in that is `look_ahead` later; `finish` gives the last ones.
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
        """The state before the first frame: nobody yet."""
        tilt = float(np.radians(self.settings.tilt or 0.0))
        return VideoState(
            self.arms.start(), np.array([0.0, 0.0, -_FAR]), np.zeros(3), tilt, self.skeleton.rest_offset[0]
        )

    def step(self, person: PersonLandmarks, state: VideoState) -> tuple[VideoFrames, VideoState]:
        """Take in the next T ≥ 1 frames: the frames that are ready by now, and the state after them."""
        waiting = person if state.waiting is None else joined_landmarks([state.waiting, person])
        state = replace(state, waiting=waiting)
        found, arms = self.arms.step(arm_keypoints(person), state.arms)
        return self._given(len(found), found.estimate.pose, replace(state, arms=arms))

    def finish(self, state: VideoState) -> VideoFrames:
        """The frames that were still waited for."""
        count = 0 if state.waiting is None else len(state.waiting) - state.done
        return self._given(count, self.arms.finish(state.arms).estimate.pose if count else None, state)[0]

    def _given(self, count: int, arms: Pose | None, state: VideoState) -> tuple[VideoFrames, VideoState]:
        """The next `count` frames that wait, with the network's arms."""
        assert state.waiting is not None
        waiting, first = state.waiting, state.done
        person = waiting[first : first + count]
        turned = None if arms is None else arm_rotations(arms)
        seen = _nothing(person.time)
        positions, axes = np.empty((count, 3)), np.empty((count, 3, 3))
        for k in range(count):
            calm = smoothed(waiting, first + k, self.settings.calm, self.settings.look_ahead)
            laid = self._points.lay(calm) if calm.has_body[0] else None
            if laid is not None:
                assert turned is not None
                state = self._followed(laid, calm, state)
                self._observe(seen, k, laid, calm, turned[k], state)
            axes[k] = _tilted(state.tilt)
            positions[k] = state.root - axes[k] @ state.place
        camera = Camera(positions, axes, np.full(count, self.focal), np.full(count, self.aspect))
        # What is left of the frames before is what the next ones are smoothed with.
        past = waiting.time[: first + count]
        old = 0 if not len(past) else int((past < past[-1] - _REACH * self.settings.calm).sum())
        frames = VideoFrames(seen, person, camera)
        return frames, replace(state, waiting=waiting[old:], done=first + count - old)

    def _followed(self, laid: LaidPoints, person: PersonLandmarks, state: VideoState) -> VideoState:
        """The state after one frame with a body: where it is."""
        time, place, tilt = float(person.time[0]), self._located(laid, person), self._tilt(person, state)
        if state.begun is None:
            begun = (time, float((_tilted(tilt) @ place)[2]))
            state = replace(state, place=place, tilt=tilt, begun=begun, time=time)
        else:
            lives = np.array([self.settings.place_half_life] * 2 + [self.settings.depth_half_life])
            offset, velocity = spring_step(state.place - place, state.velocity, lives, time - state.time)
            state = replace(state, place=place + offset, velocity=velocity, tilt=tilt, time=time)
        assert state.begun is not None
        room = _tilted(tilt)
        x, _, z = room @ state.place
        rest = self.skeleton.path @ self.skeleton.rest_offset + self.skeleton.rest_offset[0]
        soles = self.skeleton.indices([f"{side}_{part}" for side in SIDES for part in _SOLE])
        lowest = float(((laid.position[soles] @ room.T)[:, 1] - rest[soles, 1]).min())
        return replace(state, root=np.array([x, -lowest, z - state.begun[1]]))

    def _observe(
        self,
        seen: Observation,
        frame: int,
        laid: LaidPoints,
        person: PersonLandmarks,
        arms: np.ndarray,
        state: VideoState,
    ) -> None:
        """Fill in one frame of an observation: what is seen of a body."""
        room, (where, joints) = _tilted(state.tilt), self._places
        visible, turned, rotation = laid.visible[where].copy(), np.zeros(len(POINTS)), np.full((len(POINTS), 4), np.nan)
        turned[joints], rotation[joints] = laid.turned[where[joints]], laid.rotation[where[joints]]
        chest = laid.rotation[self.skeleton.index(CHEST)]
        of_arms = np.asarray(forward_kinematics(self._arm_pose(chest, arms))[1])[1:]
        is_seen = person.visible[0, _ARM_MARKS].min(axis=1)
        for name, turn in zip(ARM_JOINTS, of_arms, strict=True):
            side, _, part = name.partition("_")
            number, place = SIDES.index(side), POINTS.index(name)
            rotation[place] = turn
            turned[place] = is_seen[number] if part in ARM_PARTS or person.has_hand[0, number] else 0.0
        visible[self._is_rotation] = 0.0
        error = LANDMARK_ACCURACY * (1.0 if visible[self._legs].max() >= VISIBLE else _UNSEEN_LEGS)
        at = visible >= VISIBLE
        seen.position[frame, at] = laid.position[where[at]] @ room.T + state.root
        seen.has_position[frame, at] = True
        seen.accuracy[frame, at] = error / visible[at]
        known = np.flatnonzero(turned >= VISIBLE)
        tilt = np.broadcast_to(matrix_to_quaternion(room), (len(known), 4))
        seen.rotation[frame, known] = quaternion_canonical(quaternion_multiply(tilt, rotation[known]))
        seen.has_rotation[frame, known] = True

    def _arm_pose(self, chest: np.ndarray, arms: np.ndarray) -> Pose:
        """Both arms on a chest that is turned so (4,), local rotations (38, 4)."""
        rotation = np.zeros((len(self._arm_skeleton.joints), 4))
        rotation[0], rotation[1:] = chest, arms
        return Pose(self._arm_skeleton, np.zeros(3), rotation)

    @cached_property
    def _arm_skeleton(self) -> Skeleton:
        return arm_skeleton(self.skeleton)

    @cached_property
    def _points(self) -> LandmarkPoints:
        return LandmarkPoints(self.skeleton)

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        """Where `POINTS` are in the skeleton, and which of them are joints."""
        where = self.skeleton.indices(POINTS)
        return where, np.flatnonzero(where < len(self.skeleton.joints))

    @cached_property
    def _is_rotation(self) -> np.ndarray:
        """Which of `POINTS` are observed without a position."""
        return np.array([name not in _WITH_POSITION for name in POINTS])

    @cached_property
    def _legs(self) -> np.ndarray:
        """Where the legs are in `POINTS`."""
        return np.array([POINTS.index(name) for name in _LEGS])

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

    def _located(self, laid: LaidPoints, person: PersonLandmarks) -> np.ndarray:
        """(3,) m: where the pelvis is in the camera's axes, so that joints are seen where the landmarks are.

        A joint at q from a pelvis at (x, y, −depth) is seen at focal · (q + (x, y)) / (depth − q_z): linear in all
        three, solved in the least squares.
        """
        names = [f"{side}_{part}" for part in _PLACED_BY for side in SIDES]
        marks = [BODY_LANDMARKS.index(name) for name in names]
        q = laid.position[self.skeleton.indices(names)]
        seen, pull = person.picture[0, marks], np.clip(person.visible[0, marks], 0.05, 1.0)
        rows, values = np.zeros((2, len(names), 3)), np.empty((2, len(names)))
        for axis in range(2):
            rows[axis, :, axis] = self.focal
            rows[axis, :, 2] = -seen[:, axis]
            values[axis] = -self.focal * q[:, axis] - seen[:, axis] * q[:, 2]
        place = np.linalg.lstsq((rows * pull[:, None]).reshape(-1, 3), (values * pull).ravel(), rcond=None)[0]
        place[2] = -max(place[2], _NEAR)
        return place


@dataclass(frozen=True, eq=False)
class Watched:
    """Frames that became ready together; a picture came in between, or the end."""

    frames: VideoFrames
    pictures: tuple[Picture, ...] = field(repr=False)  # one a frame
    landmark_seconds: float  # that the landmarkers took for the newest picture
    device_seconds: float  # that the rest took


def watch(
    pictures: Iterable[Picture],
    landmarker: Landmarker,
    device_for: Callable[[float], VideoDevice],
    settings: PersonSettings = PersonSettings(),
) -> Iterator[Watched]:
    """Observe one person in pictures, in memory that does not grow with them.

    `device_for` gives the device for pictures of a width / height. Where the video breaks, the frames that were still
    waited for come first, then its `VideoBrokenError`.
    """
    source, broken = iter(pictures), None
    device, state, person_state = None, None, PersonState()
    waiting: list[Picture] = []
    while True:
        try:
            picture = next(source, None)
        except VideoBrokenError as error:
            picture, broken = None, error
        if picture is None:
            break
        begun = clock.perf_counter()
        bodies, hands = landmarker.find(picture)
        found = clock.perf_counter()
        if device is None or state is None:
            device = device_for(picture.pixels.shape[1] / picture.pixels.shape[0])
            state = device.start()
        person, person_state = follow(picture, bodies, hands, person_state, settings)
        frames, state = device.step(person, state)
        waiting.append(picture)
        done = tuple(waiting[: len(frames)])
        del waiting[: len(frames)]
        yield Watched(frames, done, found - begun, clock.perf_counter() - found)
    if device is not None and state is not None and waiting:
        begun = clock.perf_counter()
        frames = device.finish(state)
        yield Watched(frames, tuple(waiting), 0.0, clock.perf_counter() - begun)
    if broken is not None:
        raise broken


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


def _nothing(time: np.ndarray) -> Observation:
    """Frames in which nothing is observed."""
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


def _tilted(tilt: float) -> np.ndarray:
    """(3, 3) room ← camera of a camera that looks down by `tilt` rad."""
    cosine, sine = np.cos(tilt), np.sin(tilt)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def _lean(person: PersonLandmarks) -> float | None:
    """rad: how far a body that stands straight leans toward the camera; None where it does not, or is not seen."""
    parts = ("shoulder", "hip", "knee", "ankle")
    marks = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES] for part in parts])
    if person.visible[0, marks].min() < VISIBLE:
        return None
    joints = person.world[0, marks]  # (part, side, 3)
    bones = [*(joints[1] - joints[2]), *(joints[2] - joints[3]), (joints[0] - joints[1]).mean(axis=0)]
    up = joints[0].mean(axis=0) - joints[3].mean(axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    straight = min(float(bone @ up) / max(float(np.linalg.norm(bone)), 1e-9) for bone in bones)
    lean = float(np.arctan2(up[2], up[1]))
    return lean if straight > np.cos(_STRAIGHT) and abs(lean) < _STEEPEST else None
