"""One session: a signal in, poses out; settings, clock and placement of one person. No sockets, no threads.

`receive` takes the newest frame, `job` gives what is to be completed, `answer` makes the pose of it; `step` is all of
that for one session alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from bodysense.body.person import Person
from bodysense.body.shape import Measured, stature
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.estimate import Estimate
from bodysense.io.protocol import SignalFrame, read_signal, signal_time
from bodysense.observation import Observation, chosen_points
from bodysense.tracker import Tracker, TrackerSettings
from bodysense_live.answer import Answer, CompletionJob
from bodysense_live.calibrating import calibration, is_over, worn_text
from bodysense_live.estimation import Pipeline, PipelineState, device_of, step_many
from bodysense_live.inertial import Inertial
from bodysense_live.message_text import changed
from bodysense_live.messages import (
    Calibrate,
    Change,
    Notice,
    Placed,
    ProportionsChanged,
    Recentre,
    ServerMessage,
    Settings,
)
from bodysense_live.moments import Moments
from bodysense_live.showing import Showing
from bodysense_live.webxr import UNDECIDED, Placement, door, raised, recentred, through
from bodysense_live.worn_trackers import PlaceMatch

NOTICED = 0.001  # m; smaller changes of points of the T-pose are not sent
TOLD_EVERY = 0.1  # s between two skeletons that are sent
_INFERRED = 0.02  # m, standard deviation of a height that was inferred


class Session:
    """One person who is tracked.

    `points` are the names of the signal, `person` is what is known of the wearer when no height is set. `eased`: a body
    that leaps where a tracker is lost or found comes there within half a second instead. Raises ProtocolError for
    unknown points.
    """

    def __init__(
        self,
        points: Sequence[str],
        person: Person = Person(),
        settings: Settings = Settings(),
        placement: Placement = Placement(),
        worn: Mapping[str, str] = MappingProxyType({}),
        eased: bool = False,
    ) -> None:
        self.points = tuple(points)
        self.settings = settings
        self.revision = 0  # rises with every change that a welcome tells of
        self.calibrated: Person | None = None  # by the last calibration
        self._notes: list[ServerMessage] = []
        self._told = self._base = person  # as given at the start; as calibrated
        self._moments = Moments()
        self._waiting: tuple[SignalFrame | bytes, float, float] | None = None  # frame, moment, time received (s)
        self._busy = False
        self._placement = placement
        self._recentres = False  # with the next headset
        self._reseats = settings.posture == "seated"  # with the next headset
        self._stood: list[Observation] | None = None  # of a calibration second
        self._arms_out = False  # in which pose
        self._worn = dict(worn)  # nameless trackers → the joints that they are on
        self._match = PlaceMatch()  # of nameless trackers to joints
        self._inertial = Inertial.of(person)
        self._told_at = -math.inf  # the moment at which the skeleton was last sent
        wearer = self._wearer()
        self.skeleton = wearer.skeleton  # as the clients know it
        self._pipeline = Pipeline(
            Tracker(wearer, settings=self._tracking), device_of(points, wearer.skeleton, wearer.hands)
        )
        self._state = self._pipeline.start()
        self._showing = Showing(self.skeleton, settings, eased)
        self._path = self.skeleton.path  # that of all bodies
        self.open_door(self.points)

    def _wearer(self) -> Person:
        """Return the wearer by the settings."""
        height, base = self.settings.height, self._base
        if height is None:
            return base
        if base.bone_deviation.any():
            return Person(height=height, lengths=base.lengths, mounts=base.mounts, hands=base.hands)
        offset = base.skeleton.rest_offset
        scaled = base.skeleton.with_offsets(offset * (height / float(stature(offset))))
        return Person(scaled, mounts=base.mounts, hands=base.hands)

    @property
    def _tracking(self) -> TrackerSettings:
        return TrackerSettings(floor=self.settings.floor, hold_feet=self.settings.hold_feet)

    def _pass_on(self, pipeline: Pipeline) -> None:
        """Go on with another pipeline from where the one until now was."""
        if not self._moments.have_begun:  # no body was displayed yet, so it need not grow
            self._state = pipeline.start()
            self.skeleton = pipeline.tracker.people[0].skeleton
            self._door = door(self.points, self.skeleton, self._worn)
        else:
            self._state = pipeline.continued(self._pipeline, self._state)
        self._pipeline = pipeline

    def open_door(self, points: Sequence[str]) -> None:
        """Take a signal of these points from now on."""
        self._door = door(points, self.skeleton, self._worn)
        self.points, self._waiting, before = tuple(points), None, self.points
        if self.points != before:
            device = device_of(points, self.skeleton, self._base.hands)
            self._pass_on(Pipeline(self._pipeline.tracker, device))
        self._choose()

    def _choose(self) -> None:
        """Choose the points that settings do not hide."""
        hidden = set(self.settings.hidden)
        self._seen = np.array([name not in hidden for name in self.points], dtype=bool)

    @property
    def height(self) -> float:
        """m, of the body that the clients know."""
        return float(stature(self.skeleton.rest_offset))

    @property
    def is_ready(self) -> bool:
        """Whether there is a frame to be completed."""
        return self._waiting is not None and not self._busy

    @property
    def has_waiting(self) -> bool:
        """Whether a frame waits, to be completed or replaced by a newer one."""
        return self._waiting is not None

    def receive(self, frame: SignalFrame | bytes, now: float) -> str | None:
        """Take a frame that came at `now` s of the server's clock. Returns why this or another frame was dropped.

        A frame as bytes is decoded when it is its turn, so that frames that are replaced cost little. Raises
        ProtocolError for bytes of another length or kind.
        """
        moment = self._moments.of(signal_time(frame) if isinstance(frame, bytes) else frame.time)
        if moment is None:
            return "late"
        replaced = self._waiting is not None
        self._waiting = (frame, moment, now)
        return "replaced" if replaced else None

    def job(self) -> CompletionJob | None:
        """Return the next job, if a frame waits and no other job is under way.

        Raises ProtocolError for a frame with a value that no tracker gives; the frame is dropped.
        """
        if self._waiting is None or self._busy:
            return None
        data, moment, received = self._waiting
        self._waiting = None
        frame = read_signal(data, len(self.points)) if isinstance(data, bytes) else data
        self._busy = True
        if self._stood and is_over(self._stood):
            self._calibrate(self._stood)
        observation = through(self._door, frame, self._seen, self._placement, moment)
        if self._recentres or self._reseats:
            observation = self._set_up(frame, moment, observation)
        if self._stood is not None:
            # Trackers may be worn elsewhere than before, so nameless ones come in by their own names.
            bare = door(self.points, self.skeleton)
            self._stood.append(through(bare, frame, self._seen, self._placement, float(observation.time[0])))
        elif self._base.mounts and not set(UNDECIDED).isdisjoint(observation.points):
            observation = self._matched(frame, observation)
        self._inertial = self._inertial.headed(observation, self.skeleton)
        return CompletionJob(self._pipeline, self._as_worn(observation), self._state, frame, received, self._placement)

    def wear(self, trackers: Mapping[str, str]) -> None:
        """Take nameless trackers, by their names in the signal, to be worn on joints."""
        if trackers.items() - self._worn.items():
            self._worn |= trackers
            self._door = door(self.points, self.skeleton, self._worn)

    @property
    def worn(self) -> Mapping[str, str]:
        """The joints that nameless trackers are on, by their names in the signal."""
        return self._worn

    def _matched(self, frame: SignalFrame, observation: Observation) -> Observation:
        """Match nameless trackers by place; return the frame with those found."""
        wearer = self._pipeline.tracker.people[0]
        self._match, found = self._match.step(observation, wearer, self._head_height())
        if not found:
            return observation
        self.wear(found)
        self.calibrated = self._base  # so that the person's file gets their serials
        self._notes.append(Notice(worn_text(found)))
        return through(self._door, frame, self._seen, self._placement, float(observation.time[0]))

    def _as_worn(self, observation: Observation) -> Observation:
        """Drop rotations of trackers whose mounting is unknown."""
        unknown = self._door.strapped - self._pipeline.tracker.people[0].mounts.keys()
        if not unknown:
            return self._inertial.joints(observation)
        known = np.array([name not in unknown for name in observation.points])
        observation = replace(observation, has_rotation=observation.has_rotation & known)
        if unknown.isdisjoint(UNDECIDED):
            return self._inertial.joints(observation)
        decided = [k for k, name in enumerate(observation.points) if name not in UNDECIDED]
        return self._inertial.joints(chosen_points(observation, decided))

    def answer(self, job: CompletionJob, estimate: Estimate, state: PipelineState) -> Answer | None:
        """Return the job's pose, or None if it contains NaN."""
        self._busy = False
        root, rotation = np.asarray(estimate.pose.root_position[0]), np.asarray(estimate.pose.rotation[0])
        if not math.isfinite(np.vdot(root, root) + np.vdot(rotation, rotation)):
            self._state = self._pipeline.start()  # so that no session is stuck
            return None
        ours = job.pipeline is self._pipeline  # or the person was changed meanwhile
        self._state = state if ours else self._pipeline.continued(job.pipeline, state)
        moment = float(job.observation.time[0])
        self._follow(estimate.rest_offset[0], moment)
        if ours and state.tracker.contradicts_height():
            self._release_height()
        pose, sent, points = self._showing.shown(self.skeleton, job.observation, estimate, job.frame)
        return Answer(job.frame, sent, pose, moment, job.received, points, job.placement)

    def step(self) -> Answer | None:
        """Return the pose that answers the newest frame, or None without a frame."""
        job = self.job()
        if job is None:
            return None
        ((estimate, state),) = step_many([(job.pipeline, job.observation, job.state)])
        return self.answer(job, estimate, state)

    def abandon(self) -> None:
        """Drop the running job, because it failed, and reset."""
        self._busy, self._state = False, self._pipeline.start()

    def start_afresh(self) -> None:
        """Begin a new motion with the next frame, at any time."""
        self._moments.start_afresh()

    def notes(self) -> list[ServerMessage]:
        """Return messages for the clients since the last call."""
        notes, self._notes = self._notes, []
        return notes

    def change(self, message: Change | Recentre | Calibrate) -> None:
        """Apply a client's command. Raises ProtocolError for wrong settings."""
        if isinstance(message, Recentre):
            self._recentres = True
            return
        if isinstance(message, Calibrate):
            if self.settings.posture == "seated":
                self._notes.append(Notice("to take your height, stand up and choose the posture 'standing' first"))
                return
            self._stood, self._arms_out = [], message.arms_out
            arms = ", arms out to the sides," if self._arms_out else ""
            self._notes.append(Notice(f"stand upright{arms} and look ahead for one second"))
            return
        before, self.settings = self.settings, changed(self.settings, message.settings)
        if self.settings.height != before.height or self._tracking != self._pipeline.tracker.settings:
            is_other = self.settings.height != before.height  # the body grows to another height
            self._track(self._wearer() if is_other else self._pipeline.tracker.people[0])
        self._choose()
        self._showing.change(self.settings)
        # A person of another height is raised by another height.
        if self.settings.posture != before.posture or (
            self.settings.posture == "seated"
            and (self.settings.height, self.settings.floor) != (before.height, before.floor)
        ):
            self._reseats = True
        self.revision += 1

    def _track(self, wearer: Person) -> None:
        self._pass_on(Pipeline(Tracker(wearer, settings=self._tracking), self._pipeline.device))

    def _release_height(self) -> None:
        """Infer the height from now on, because the head was too high for the known one, and tell the wearer."""
        known, base = self._pipeline.tracker.people[0].height, self._base
        assert known is not None  # or it could not be contradicted
        self._notes.append(
            Notice(
                f"your head is higher than a height of {known.value:.2f} m allows; your height is inferred from now on"
            )
        )
        self.settings = replace(self.settings, height=None)
        if base.height is not None:
            self._base = Person(lengths=base.lengths, mounts=base.mounts, hands=base.hands)
        self._track(self._wearer())
        self.revision += 1

    def kept(self) -> tuple[Person, Placement, dict[str, str]]:
        """Return the wearer with the inferred height, the placement and worn trackers, for another process."""
        base = self._base
        if base.height is None and base.bone_deviation.any() and self.settings.height is None:
            height = Measured(self.height, _INFERRED)
            base = Person(height=height, lengths=base.lengths, mounts=base.mounts, hands=base.hands)
        return base, self._placement, self._worn

    def placed(self) -> Placed:
        """How the signal's world is moved now."""
        return Placed(self._placement.offset, self._placement.heading)

    def truth(self, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the true pose, (3,) and (J, 4) in the signal's world, in the form that is sent with the answer."""
        turned = rotation.copy()
        turned[:1] = self._placement.turn(rotation[:1])
        root = self._placement.place(root[None])[0]
        return self._showing.truth(self.skeleton, root, turned)

    def _follow(self, offset: np.ndarray, moment: float) -> None:
        """Take over and tell the proportions of the body, where they changed noticeably."""
        if moment - self._told_at < TOLD_EVERY:
            return
        self._told_at = moment
        if np.abs(self._path @ (offset - self.skeleton.rest_offset)).max() < NOTICED:
            return
        self.skeleton = self.skeleton.with_offsets(offset)
        if not self._door.is_plain:
            self._door = door(self.points, self.skeleton, self._worn)
        self._notes.append(ProportionsChanged(rounded(self.skeleton), round(self.height, 4)))

    def _set_up(self, frame: SignalFrame, moment: float, observation: Observation) -> Observation:
        """Return the observation of a frame, after the changes that wait for a headset were made."""
        if "head" not in observation.points:  # sensors alone
            if self._recentres:
                self._inertial, self._recentres = self._inertial.reheaded(observation, self.skeleton), False
            return observation
        raw = through(self._door, frame, self._seen, Placement(), moment)
        if not raw.has_position[0, raw.points.index("head")]:
            return observation
        placement, is_seated = self._placement, self.settings.posture == "seated"
        if self._recentres:
            placement = recentred(placement, raw)
            self._inertial = self._inertial.reheaded(raw, self.skeleton)
        if self._reseats or (self._recentres and is_seated):
            placement = raised(placement, raw, self._head_height() if is_seated else None)
        self._recentres = self._reseats = False
        if placement == self._placement:
            return observation
        self._placement = placement
        self._notes.append(self.placed())
        return through(self._door, frame, self._seen, placement, self._moments.begin_anew(moment))

    def _head_height(self) -> float:
        """Return the height (m) of this person's head in standing, in the body's world."""
        rest = (self._path @ self.skeleton.rest_offset)[:, 1]
        return self.settings.floor + float(rest[self.skeleton.index("head")] - rest.min())

    def _calibrate(self, stood: Sequence[Observation]) -> None:
        """Calibrate the person from a second of standing."""
        self._stood = None
        stance = "arms out" if self._arms_out else "standing"
        try:
            found = calibration(stood, self._told, stance, self.settings.floor, self._inertial)
            wearer = found.person
            if wearer is not None:
                height = round(float(stature(wearer.skeleton.rest_offset)), 3)
                self.settings = replace(self.settings, height=height)
        except BodysenseError as error:
            self._notes.append(Notice(str(error)))
            return
        self._inertial = found.inertial
        self._showing.lead_over()
        self._notes += [Notice(text) for text in found.said]
        self._base = self.calibrated = wearer or self._base.with_mounts(found.inertial.mounts)
        if wearer is None:
            return
        if found.worn:
            before = {name: joint for name, joint in self._worn.items() if joint not in found.worn.values()}
            self._worn = {**before, **found.worn}
            self._door = door(self.points, self.skeleton, self._worn)
        self._track(wearer)
        self.revision += 1


def rounded(skeleton: Skeleton) -> tuple[tuple[float, float, float], ...]:
    """Rest offsets as a message has them."""
    return tuple((round(x, 6), round(y, 6), round(z, 6)) for x, y, z in skeleton.rest_offset.tolist())
