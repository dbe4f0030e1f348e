"""One session: a signal in, poses out; settings, clock and placement of one person. No sockets, no threads.

`receive` takes the newest frame, `job` gives what is to be estimated, `answer` makes the pose of it; `step` is all of
that for one session alone. Times of frames are the client's own. Inside they become moments that always increase, and
by little: where the client's clock was set, and where the world was moved, a moment comes `AFRESH` s later than the one
before, after which every estimator starts afresh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.body.stature import height_from_headset
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.ik_tracker import IkTrackerState, smooth
from bodysense.observation import Observation
from bodysense.serve.estimation import PROFILES, Adaptive, AdaptiveState, adaptive, step_many
from bodysense.serve.messages import (
    Calibrate,
    Change,
    Placed,
    ProfileChanged,
    Recentre,
    Region,
    Said,
    ServerMessage,
    Settings,
    changed,
)
from bodysense.serve.protocol import PoseFrame, SignalFrame
from bodysense.serve.webxr import STILL, Placement, door, rotated, through

CLOCK_SET = 1.0  # s: a clock that jumps as far back, or forward, was set
AFRESH = 2.0  # s
SHORTEST_STEP = 1e-4  # s between frames
_STANDING = 1.0  # s, to take somebody's height in
_FADE, _FADE_HALF_LIFE = 0.6, 0.08  # s: how settings are changed without a jump
_PARTS: dict[str, Region] = {
    **dict.fromkeys(("spine1", "spine2", "spine3"), "torso"),
    **dict.fromkeys(("neck", "head"), "head"),
    **dict.fromkeys(("collar", "shoulder", "elbow", "wrist"), "arms"),
    **dict.fromkeys(("hip", "knee", "ankle", "foot"), "legs"),
}


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be estimated."""

    adaptive: Adaptive
    observation: Observation  # T = 1
    state: AdaptiveState
    frame: SignalFrame
    received: float  # s, of the server's clock


@dataclass(frozen=True, eq=False)
class Answer:
    """What came of a job."""

    signal: SignalFrame
    frame: PoseFrame
    pose: Pose
    moment: float  # s, always increasing
    received: float  # s, of the server's clock


class Session:
    """One person who is tracked.

    `points` are the names of the signal. Raises ProtocolError for points that nobody knows.
    """

    def __init__(self, points: Sequence[str], base: Skeleton, settings: Settings = Settings()) -> None:
        self.points = tuple(points)
        self.settings = settings
        self.profile = PROFILES[0]
        self.revision = 0  # rises with every change that a welcome tells of
        self._notes: list[ServerMessage] = []
        self._base = base
        self._time: float | None = None  # s, the client's, of the last frame
        self._shift = 0.0  # s, from the client's time to moments
        self._starts_afresh = False  # with the next frame
        self._waiting: tuple[SignalFrame, float, float] | None = None  # frame, moment, received
        self._busy = False
        self._placement = Placement()
        self._recentres = self._reseats = False  # with the next headset
        self._heights: list[tuple[float, float]] | None = None  # moment, m: of a headset while its wearer stands
        self._shown: IkTrackerState | None = None
        self._fade = -math.inf  # the moment until which changed settings fade in
        self._build()
        if settings.posture == "seated":
            self._reseats = True

    def _build(self) -> None:
        """Everything that depends on the skeleton."""
        height = self.settings.height
        self.skeleton = self._base if height is None else self._base.scaled(height)
        self._adaptive = adaptive(self.skeleton)
        self._state = self._adaptive.start()
        self._standing = standing_pose(self.skeleton)
        self._no_spin = np.zeros((len(self.skeleton.joints), 3))
        self.open_door(self.points)
        self._shown = None

    def open_door(self, points: Sequence[str]) -> None:
        """Take a signal of these points from now on."""
        self._door = door(points, self.skeleton)
        self.points, self._waiting = tuple(points), None
        self._choose()

    def _choose(self) -> None:
        """What settings choose among points and joints."""
        hidden = set(self.settings.hidden)
        self._seen = np.array([name not in hidden for name in self.points], dtype=bool)
        regions = set(self.settings.regions)
        self._still = np.array([_region(name) not in {None, *regions} for name in self.skeleton.joints])
        self._keeps_still = bool(self._still.any())

    @property
    def is_ready(self) -> bool:
        """Whether there is a frame to be estimated."""
        return self._waiting is not None and not self._busy

    def receive(self, frame: SignalFrame, now: float) -> str | None:
        """Take a frame that came at `now` s of the server's clock; says why a frame was dropped, this or another."""
        if self._time is not None:
            step = frame.time - self._time
            if -CLOCK_SET < step < SHORTEST_STEP and not self._starts_afresh:
                return "late"
            if abs(step) > CLOCK_SET or self._starts_afresh:
                self._shift += AFRESH - step
        self._time, self._starts_afresh = frame.time, False
        replaced = self._waiting is not None
        self._waiting = (frame, frame.time + self._shift, now)
        return "replaced" if replaced else None

    def job(self) -> Job | None:
        """The next job, if there is a frame and no other job is under way."""
        if self._waiting is None or self._busy:
            return None
        frame, moment, received = self._waiting
        self._waiting, self._busy = None, True
        if self._heights:
            self._measure()
        observation = through(self._door, frame, self._seen, self._placement, moment)
        if self._recentres or self._reseats or self._heights is not None:
            observation = self._set_up(frame, moment, observation)
        return Job(self._adaptive, observation, self._state, frame, received)

    def answer(self, job: Job, estimate: PointEstimate, state: AdaptiveState) -> Answer | None:
        """The pose of a job; None where the person was given another skeleton meanwhile."""
        self._busy = False
        if job.adaptive is not self._adaptive:
            return None
        assert estimate.pose is not None
        root, rotation = np.asarray(estimate.pose.root_position[0]), np.asarray(estimate.pose.rotation[0])
        error, hidden = estimate.confidence[0], estimate.occluded[0]
        if not math.isfinite(np.vdot(root, root) + np.vdot(rotation, rotation)):
            self._state = self._adaptive.start()  # so that no session is stuck
            return None
        self._state = state
        if self._keeps_still:
            rotation = np.where(self._still[:, None], self._standing.rotation, rotation)
        if self.settings.mirror:
            root, rotation = self.mirrored(root, rotation)
            error, hidden = error[self.skeleton.mirror], hidden[self.skeleton.mirror]
        moment = float(job.observation.time[0])
        root, rotation = self._smoothed(root, rotation, moment)
        if state.profile != self.profile:
            self.profile = state.profile
            self._notes.append(ProfileChanged(state.profile))
        profile = PROFILES.index(state.profile)
        pose_frame = PoseFrame(profile, job.frame.sequence, job.frame.time, root, rotation, error, hidden)
        return Answer(job.frame, pose_frame, Pose(self.skeleton, root, rotation), moment, job.received)

    def step(self) -> Answer | None:
        """The pose that answers the newest frame, None where there is none."""
        job = self.job()
        if job is None:
            return None
        (estimate, state), *_ = step_many([(job.adaptive, job.observation, job.state)])
        return self.answer(job, estimate, state)

    def abandon(self) -> None:
        """Give the job up that is under way, because it failed; start afresh."""
        self._busy, self._state = False, self._adaptive.start()

    def start_afresh(self) -> None:
        """Whatever time the next frame has, it begins a new motion."""
        self._starts_afresh = True

    def notes(self) -> list[ServerMessage]:
        """What is to be told since the last call."""
        notes, self._notes = self._notes, []
        return notes

    def change(self, message: Change | Recentre | Calibrate) -> None:
        """Do what a client asks for. Raises ProtocolError for settings that are none."""
        if isinstance(message, Recentre):
            self._recentres = True
            return
        if isinstance(message, Calibrate):
            if self.settings.posture == "seated":
                self._notes.append(Said("to take your height, stand up and choose the posture 'standing' first"))
                return
            self._heights = []
            self._notes.append(Said("stand upright and look ahead for one second"))
            return
        before, self.settings = self.settings, changed(self.settings, message.settings)
        if self.settings.height != before.height:
            self._build()
        self._choose()
        if self.settings.mirror != before.mirror:
            self._shown = None
        if self.settings.regions != before.regions or self.settings.smoothing != before.smoothing:
            self._fade = math.inf  # until the next frame says what time it is
        # A person of another height is raised by another height.
        if self.settings.posture != before.posture or (
            self.settings.posture == "seated" and self.settings.height != before.height
        ):
            self._reseats = True
        self.revision += 1

    def placed(self) -> Placed:
        """How the signal's world is moved now."""
        return Placed(self._placement.offset, self._placement.heading)

    def truth(self, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What really was, (3,) and (J, 4) in the signal's world, as it is shown beside the answer."""
        turned = rotation.copy()
        turned[:1] = self._placement.turn(rotation[:1])
        root = self._placement.place(root[None])[0]
        return self.mirrored(root, turned) if self.settings.mirror else (root, turned)

    def mirrored(self, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A pose with left and right swapped, across the plane x = 0."""
        partner = self.skeleton.mirror[: len(rotation)]
        return root * [-1, 1, 1], rotation[partner] * [1, 1, -1, -1]

    def _smoothed(self, root: np.ndarray, rotation: np.ndarray, moment: float) -> tuple[np.ndarray, np.ndarray]:
        """The pose that is shown: as it is, or behind it by the smoother."""
        if self._fade == math.inf:
            self._fade = moment + _FADE
        half_life = max(self.settings.smoothing, _FADE_HALF_LIFE if moment < self._fade else 0.0)
        before = self._shown
        if before is None or before.time is None or half_life == 0 or moment - before.time > CLOCK_SET:
            self._shown = IkTrackerState(None, None, None, moment, root, rotation, STILL, self._no_spin)
            return root, rotation
        target = Pose(self.skeleton, root, rotation)
        root, velocity, rotation, spin = smooth(target, before, moment - before.time, half_life)
        self._shown = IkTrackerState(None, None, None, moment, root, rotation, velocity, spin)
        return root, rotation

    def _set_up(self, frame: SignalFrame, moment: float, observation: Observation) -> Observation:
        """The observation of a frame, after what waits for a headset was done with it."""
        if "head" not in observation.points:
            return observation
        raw = through(self._door, frame, self._seen, Placement(), moment)
        head = raw.points.index("head")
        if not raw.has_position[0, head]:
            return observation
        place = raw.position[0, head]
        if self._heights is not None:
            self._heights.append((moment, float(place[1])))
        placement = self._placement
        if self._recentres:
            ahead = rotated(raw.rotation[0, [head]], np.array([[0.0, 0, 1]]))[0]
            turned = raw.has_rotation[0, head] and math.hypot(ahead[0], ahead[2]) > 0.1
            heading = -math.atan2(ahead[0], ahead[2]) if turned else 0.0
            moved = Placement(heading).place(place[None])[0]
            placement = Placement(heading, (-float(moved[0]), placement.offset[1], -float(moved[2])))
        if self._reseats or (self._recentres and self.settings.posture == "seated"):
            x, _, z = placement.offset
            up = self._head_height() - float(place[1]) if self.settings.posture == "seated" else 0.0
            placement = replace(placement, offset=(x, up, z))
        self._recentres = self._reseats = False
        if placement == self._placement:
            return observation
        self._placement = placement
        self._notes.append(self.placed())
        self._shift += AFRESH
        return through(self._door, frame, self._seen, placement, moment + AFRESH)

    def _head_height(self) -> float:
        """m, of the head of this person who stands."""
        rest = (self.skeleton.path @ self.skeleton.rest_offset)[:, 1]
        return float(rest[self.skeleton.index("head")] - rest.min())

    def _measure(self) -> None:
        """Take the height of somebody who has stood for a second."""
        assert self._heights
        if self._heights[-1][0] - self._heights[0][0] < _STANDING:
            return
        heights, self._heights = self._heights, None
        try:
            height = round(height_from_headset(np.array([value for _, value in heights]), self._base), 3)
        except BodysenseError as error:
            self._notes.append(Said(str(error)))
            return
        self.settings = replace(self.settings, height=height)
        self._build()
        self.revision += 1
        self._notes.append(Said(f"you are {height:.2f} m tall"))


def _region(joint: str) -> Region | None:
    """The region of a joint; None for the pelvis, which always moves."""
    part = joint.removeprefix("left_").removeprefix("right_")
    if part == "pelvis":
        return None
    return _PARTS.get(part, "fingers")
