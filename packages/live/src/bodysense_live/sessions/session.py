"""One session: a signal in, poses out; settings, clock and placement of one person. No sockets, no threads.

`receive` takes the newest frame, `job` returns the frame to complete, and `answer` makes a pose from the estimate.
`step` does both for a session that runs alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bodysense.body.person import Person
from bodysense.body.shape import Measured, stature
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.io.formats.protocol import SignalFrame, read_signal, signal_time
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.tracker import Tracker, TrackerSettings
from bodysense_live.protocols.webxr import (
    TRACKERS,
    UNASSIGNED,
    Placement,
    point_mapping,
    raised,
    recentred,
    to_observation,
)
from bodysense_live.server.message_text import changed
from bodysense_live.server.messages import (
    Calibrate,
    Notice,
    PlacementChanged,
    ProportionsChanged,
    Recentre,
    ServerMessage,
    Settings,
    UpdateSettings,
    Worn,
)
from bodysense_live.sessions.answer import Answer, CompletionJob
from bodysense_live.sessions.body_display import BodyDisplay
from bodysense_live.sessions.estimation import Pipeline, PipelineState, device_of, step_many
from bodysense_live.sessions.inertial import InertialSensors
from bodysense_live.sessions.signal_clock import SignalClock
from bodysense_live.sessions.standing_calibration import assignment_text, calibrate_standing, is_long_enough
from bodysense_live.sessions.worn_trackers import PlaceMatch

SKELETON_TOLERANCE = 0.001  # m; smaller changes of points of the T-pose are not sent
SKELETON_INTERVAL = 0.1  # s; skeletons are sent at most this often
_MOST_DOUBTS = 8  # sent of one session: a world is doubted in six ways, and a tracker that is reset finds them again
_INFERRED = 0.02  # m, standard deviation of an inferred height
_KNOWN = 0.01  # m, of a length that a person gives: joints cannot be seen from outside


class Session:
    """One tracked person.

    Raises ProtocolError for unknown points.

    Args:
        points: names of the signal's points.
        person: the wearer, as known if no height is set.
        settings: the client's settings.
        placement: of the signal's world in the body's.
        eased: ease the body over half a second if it would jump because a tracker is lost or found.
    """

    def __init__(
        self,
        points: Sequence[str],
        person: Person = Person(),
        settings: Settings = Settings(),
        placement: Placement = Placement(),
        eased: bool = False,
    ) -> None:
        self.points = tuple(points)
        self.settings = settings
        self.revision = 0  # rises with every change that clients learn from a welcome
        self.calibrated: Person | None = None  # result of the last calibration, until it is saved
        self._messages: list[ServerMessage] = []
        self._initial_person = person
        self._base = person  # as last calibrated; settings may override the height
        self._mounted: dict[tuple[str, str], RigidTransform] = {}  # by tracker and joint, of trackers that moved since
        self._clock = SignalClock()
        self._pending: tuple[SignalFrame | bytes, float, float] | None = None  # frame, moment, time received (s)
        self._busy = False
        self._placement = placement
        self._recentre_pending = False  # until a frame has the headset
        self._raise_pending = settings.posture == "seated"  # until a frame has the headset
        self._standing: list[Observation] | None = None  # frames of a running calibration
        self._arms_out = False  # stance of the running calibration
        self.doubts: list[str] = []  # about the signal's world, as sent to clients
        self._match = PlaceMatch()
        self._inertial = InertialSensors.of(person)
        self._skeleton_sent_at = -math.inf  # moment, s
        wearer = self._wearer()
        self.skeleton = wearer.skeleton  # as last sent to clients
        self._pipeline = Pipeline(
            Tracker(wearer, settings=self._tracking), device_of(points, wearer.skeleton, wearer.hands)
        )
        self._state = self._pipeline.start()
        self._display = BodyDisplay(self.skeleton, settings, eased)
        self._path = self.skeleton.path  # equal for all bodies
        self.set_points(self.points)

    def _wearer(self) -> Person:
        """Return the calibrated person with the height and the lengths of the settings."""
        height, base = self.settings.height, self._base
        known = {(one.start, one.end): Measured(one.metres, _KNOWN) for one in self.settings.lengths}
        if height is None and not known:
            return base
        if known or base.bone_deviation.any():
            lengths = {**base.lengths, **known}
            return Person(height=height or base.height, lengths=lengths, mounts=base.mounts, hands=base.hands)
        assert height is not None
        offset = base.skeleton.rest_offset
        scaled = base.skeleton.with_offsets(offset * (height / float(stature(offset))))
        return Person(scaled, mounts=base.mounts, hands=base.hands)

    @property
    def _tracking(self) -> TrackerSettings:
        return TrackerSettings(floor=self.settings.floor, hold_feet=self.settings.hold_feet)

    def _switch_pipeline(self, pipeline: Pipeline) -> None:
        """Replace the pipeline and keep the motion."""
        if not self._clock.has_started:  # no body was displayed yet, so its size may jump
            self._state = pipeline.start()
            self.skeleton = pipeline.tracker.people[0].skeleton
            self._mapping = point_mapping(self.points, self.skeleton, self._worn)
        else:
            self._state = pipeline.continued(self._pipeline, self._state)
        self._pipeline = pipeline

    def set_points(self, points: Sequence[str]) -> None:
        """Set the names of the signal's points."""
        self._mapping = point_mapping(points, self.skeleton, self._worn)
        self.points, self._pending, before = tuple(points), None, self.points
        if self.points != before:
            device = device_of(points, self.skeleton, self._base.hands)
            self._switch_pipeline(Pipeline(self._pipeline.tracker, device))
        self._update_visible()

    def _update_visible(self) -> None:
        """Select the points that settings do not hide."""
        hidden = set(self.settings.hidden)
        self._visible = np.array([name not in hidden for name in self.points], dtype=bool)

    @property
    def height(self) -> float:
        """Height in m of the skeleton that was last sent to clients."""
        return float(stature(self.skeleton.rest_offset))

    @property
    def is_ready(self) -> bool:
        """Whether a frame is pending and no job is running."""
        return self._pending is not None and not self._busy

    @property
    def has_pending(self) -> bool:
        """Whether a frame is pending; a newer one may replace it."""
        return self._pending is not None

    def receive(self, frame: SignalFrame | bytes, now: float) -> str | None:
        """Take a frame received at `now` s of the server's clock. Return why it or another one was dropped, or None.

        Bytes are decoded only when the frame is completed, so replaced frames cost little. Raises ProtocolError for
        bytes that are not a signal of these points.
        """
        moment = self._clock.time_of(signal_time(frame) if isinstance(frame, bytes) else frame.time)
        if moment is None:
            return "late"
        replaced = self._pending is not None
        self._pending = (frame, moment, now)
        return "replaced" if replaced else None

    def job(self) -> CompletionJob | None:
        """Return the next job, or None if no frame is pending or a job is running.

        Raises ProtocolError for a frame with an invalid value, and drops the frame.
        """
        if self._pending is None or self._busy:
            return None
        data, moment, received = self._pending
        self._pending = None
        frame = read_signal(data, len(self.points)) if isinstance(data, bytes) else data
        self._busy = True
        if self._standing and is_long_enough(self._standing):
            self._calibrate(self._standing)
        observation = to_observation(self._mapping, frame, self._visible, self._placement, moment)
        if self._recentre_pending or self._raise_pending:
            observation = self._update_placement(frame, moment, observation)
        if self._standing is not None:
            # Calibration assigns all trackers anew, so it needs them under their unassigned names.
            kept = {name: joint for name, joint in self._worn.items() if not joint or name not in UNASSIGNED}
            unassigned = point_mapping(self.points, self.skeleton, kept)
            time = float(observation.time[0])
            self._standing.append(to_observation(unassigned, frame, self._visible, self._placement, time))
        elif self._base.mounts and not set(UNASSIGNED).isdisjoint(observation.points):
            observation = self._match_trackers(frame, observation)
        self._inertial = self._inertial.with_missing_headings(observation, self.skeleton)
        observation = self._with_usable_rotations(observation)
        return CompletionJob(self._pipeline, observation, self._state, frame, received, self._placement)

    def assign_trackers(self, trackers: Mapping[str, str]) -> None:
        """Assign joints to trackers, by their names in the signal. Other trackers lose these joints."""
        before = self._worn
        if not trackers.items() - before.items():
            return
        kept = {name: joint for name, joint in before.items() if not joint or joint not in trackers.values()}
        worn = tuple(Worn(name, joint) for name, joint in {**kept, **trackers}.items())
        self.settings = replace(self.settings, worn=worn)
        self._mapping = point_mapping(self.points, self.skeleton, self._worn)
        self.revision += 1

    @property
    def tracker_joints(self) -> Mapping[str, str]:
        """Joints of unassigned trackers, by their names in the signal."""
        return {name: joint for name, joint in self._worn.items() if joint and name in UNASSIGNED}

    @property
    def _worn(self) -> dict[str, str]:
        """Joints of the settings by the names of trackers; '' for trackers that are ignored."""
        return {one.tracker: one.joint for one in self.settings.worn}

    def _move_trackers(self, before: Mapping[str, str]) -> None:
        """Use the joints of the settings in place of `before`. A mount is of one tracker on one joint.

        Mounts are forgotten where another tracker is worn, and known again when their tracker is moved back.
        """
        moved = before.items() ^ self._worn.items()
        joints = {joint for _, joint in moved} | {TRACKERS.get(name, "") for name, _ in moved}
        carried, carries = self._carried(before), self._carried(self._worn)
        mounts = {joint: mount for joint, mount in self._base.mounts.items() if joint not in joints}
        left = {joint: mount for joint, mount in self._base.mounts.items() if joint in joints and joint in carried}
        self._mounted |= {(carried[joint], joint): mount for joint, mount in left.items()}
        worn = ((carries[joint], joint) for joint in joints if joint in carries)
        mounts |= {joint: self._mounted[name, joint] for name, joint in worn if (name, joint) in self._mounted}
        self._base = self.calibrated = _with_mounts(self._base, mounts)
        self._mapping = point_mapping(self.points, self.skeleton, self._worn)
        self._set_wearer(_with_mounts(self._pipeline.tracker.people[0], mounts))

    def _carried(self, worn: Mapping[str, str]) -> dict[str, str]:
        """Return the trackers by the joints that carry them."""
        usual = {joint: name for name, joint in TRACKERS.items() if name in self.points and name not in worn}
        return usual | {joint: name for name, joint in worn.items() if joint}

    def _match_trackers(self, frame: SignalFrame, observation: Observation) -> Observation:
        """Assign trackers to joints by their positions. Return the frame with the joints that were found."""
        wearer = self._pipeline.tracker.people[0]
        self._match, found = self._match.step(observation, wearer, self._head_height())
        if not found:
            return observation
        self.assign_trackers(found)
        self.calibrated = self._base  # save their serials in the person's file
        self._messages.append(Notice(assignment_text(found)))
        return to_observation(self._mapping, frame, self._visible, self._placement, float(observation.time[0]))

    def _with_usable_rotations(self, observation: Observation) -> Observation:
        """Drop rotations of trackers whose mounting is unknown, and replace inertial sensors by joints."""
        unknown = self._mapping.strapped - self._pipeline.tracker.people[0].mounts.keys()
        if not unknown:
            return self._inertial.joints(observation)
        known = np.array([name not in unknown for name in observation.points])
        observation = replace(observation, has_rotation=observation.has_rotation & known)
        if unknown.isdisjoint(UNASSIGNED):
            return self._inertial.joints(observation)
        assigned = [k for k, name in enumerate(observation.points) if name not in UNASSIGNED]
        return self._inertial.joints(chosen_points(observation, assigned))

    def answer(self, job: CompletionJob, estimate: Estimate, state: PipelineState) -> Answer | None:
        """Finish a job. Return the pose, or None if the estimate contains NaN."""
        self._busy = False
        # Each of the tracker's doubts about the signal's world once: a tracker that is reset looks again.
        new = [text for text in estimate.notices if text not in self.doubts][: _MOST_DOUBTS - len(self.doubts)]
        self.doubts += new
        self._messages += [Notice(text) for text in new]
        root, rotation = np.asarray(estimate.pose.root_position[0]), np.asarray(estimate.pose.rotation[0])
        if not math.isfinite(np.vdot(root, root) + np.vdot(rotation, rotation)):
            self._state = self._pipeline.start()  # otherwise NaN would stay in the state
            return None
        is_current = job.pipeline is self._pipeline  # false if the person changed while the job ran
        self._state = state if is_current else self._pipeline.continued(job.pipeline, state)
        moment = float(job.observation.time[0])
        self._update_skeleton(estimate.rest_offset[0], moment)
        if is_current and state.tracker.contradicts_height():
            self._infer_height()
        pose, sent, points = self._display.step(self.skeleton, job.observation, estimate, job.frame)
        return Answer(job.frame, sent, pose, moment, job.received, points, job.placement)

    def step(self) -> Answer | None:
        """Complete the pending frame. Return its pose, or None without a frame."""
        job = self.job()
        if job is None:
            return None
        ((estimate, state),) = step_many([(job.pipeline, job.observation, job.state)])
        return self.answer(job, estimate, state)

    def abandon(self) -> None:
        """Drop the running job, which failed, and reset the tracker."""
        self._busy, self._state = False, self._pipeline.start()

    def reset_clock(self) -> None:
        """Start a new motion with the next frame, whatever its time."""
        self._clock.reset()

    def take_messages(self) -> list[ServerMessage]:
        """Return and remove messages for the clients."""
        messages, self._messages = self._messages, []
        return messages

    def apply(self, message: UpdateSettings | Recentre | Calibrate) -> None:
        """Apply a client's command. Raises ProtocolError for invalid settings."""
        if isinstance(message, Recentre):
            self._recentre_pending = True
            return
        if isinstance(message, Calibrate):
            if self.settings.posture == "seated":
                self._messages.append(Notice("to take your height, stand up and choose the posture 'standing' first"))
                return
            self._standing, self._arms_out = [], message.arms_out
            arms = ", arms out to the sides," if self._arms_out else ""
            self._messages.append(Notice(f"stand upright{arms} and look ahead for one second"))
            return
        before, self.settings = self.settings, changed(self.settings, message.settings)
        has_new_size = (self.settings.height, self.settings.lengths) != (before.height, before.lengths)
        if has_new_size or self._tracking != self._pipeline.tracker.settings:
            try:
                self._set_wearer(self._wearer() if has_new_size else self._pipeline.tracker.people[0])
            except BodysenseError as error:  # lengths that no person has together
                self.settings = replace(self.settings, height=before.height, lengths=before.lengths)
                self._messages.append(Notice(str(error)))
        if self.settings.worn != before.worn:
            self._move_trackers({one.tracker: one.joint for one in before.worn})
        self._update_visible()
        self._display.apply(self.settings)
        # How far a seated person is raised depends on height and floor.
        if self.settings.posture != before.posture or (
            self.settings.posture == "seated"
            and (self.settings.height, self.settings.floor) != (before.height, before.floor)
        ):
            self._raise_pending = True
        self.revision += 1

    def _set_wearer(self, wearer: Person) -> None:
        self._switch_pipeline(Pipeline(Tracker(wearer, settings=self._tracking), self._pipeline.device))

    def _infer_height(self) -> None:
        """Infer the height from now on, because the head is too high for the known one, and notify the wearer."""
        known, base = self._pipeline.tracker.people[0].height, self._base
        assert known is not None  # only a known height can be contradicted
        self._messages.append(
            Notice(
                f"your head is higher than a height of {known.value:.2f} m allows; your height is inferred from now on"
            )
        )
        self.settings = replace(self.settings, height=None)
        if base.height is not None:
            self._base = Person(lengths=base.lengths, mounts=base.mounts, hands=base.hands)
        self._set_wearer(self._wearer())
        self.revision += 1

    def resumable_state(self) -> tuple[Person, Placement]:
        """Return wearer (with the inferred height) and placement, to resume with the settings in another process."""
        base = self._base
        if base.height is None and base.bone_deviation.any() and self.settings.height is None:
            height = Measured(self.height, _INFERRED)
            base = Person(height=height, lengths=base.lengths, mounts=base.mounts, hands=base.hands)
        return base, self._placement

    def placement_message(self) -> PlacementChanged:
        """Return the current placement as a message."""
        return PlacementChanged(self._placement.offset, self._placement.heading)

    def truth(self, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a true pose, (3,) m and (J, 4) in the signal's world, placed and mirrored as the answer is."""
        turned = rotation.copy()
        turned[:1] = self._placement.turn(rotation[:1])
        root = self._placement.place(root[None])[0]
        return self._display.truth(self.skeleton, root, turned)

    def _update_skeleton(self, offset: np.ndarray, moment: float) -> None:
        """Adopt inferred proportions, rest offsets (P, 3) m, and send them to clients, if they changed noticeably."""
        if moment - self._skeleton_sent_at < SKELETON_INTERVAL:
            return
        self._skeleton_sent_at = moment
        if np.abs(self._path @ (offset - self.skeleton.rest_offset)).max() < SKELETON_TOLERANCE:
            return
        self.skeleton = self.skeleton.with_offsets(offset)
        if not self._mapping.is_plain:
            self._mapping = point_mapping(self.points, self.skeleton, self._worn)
        self._messages.append(ProportionsChanged(rounded(self.skeleton), round(self.height, 4)))

    def _update_placement(self, frame: SignalFrame, moment: float, observation: Observation) -> Observation:
        """Recentre and raise the world as requested, once the headset is tracked. Return the frame's observation."""
        if "head" not in observation.points:  # inertial sensors alone
            if self._recentre_pending:
                self._inertial = self._inertial.with_new_headings(observation, self.skeleton)
                self._recentre_pending = False
            return observation
        raw = to_observation(self._mapping, frame, self._visible, Placement(), moment)
        if not raw.has_position[0, raw.points.index("head")]:
            return observation
        placement, is_seated = self._placement, self.settings.posture == "seated"
        if self._recentre_pending:
            placement = recentred(placement, raw)
            self._inertial = self._inertial.with_new_headings(raw, self.skeleton)
        if self._raise_pending or (self._recentre_pending and is_seated):
            placement = raised(placement, raw, self._head_height() if is_seated else None)
        self._recentre_pending = self._raise_pending = False
        if placement == self._placement:
            return observation
        self._placement = placement
        self._messages.append(self.placement_message())
        return to_observation(self._mapping, frame, self._visible, placement, self._clock.reset_at(moment))

    def _head_height(self) -> float:
        """Return the height (m) of this person's head when standing, in the body's world."""
        rest = (self._path @ self.skeleton.rest_offset)[:, 1]
        return self.settings.floor + float(rest[self.skeleton.index("head")] - rest.min())

    def _calibrate(self, standing: Sequence[Observation]) -> None:
        """Calibrate the person with frames of one second in which the wearer stands."""
        self._standing = None
        stance = "arms out" if self._arms_out else "standing"
        try:
            found = calibrate_standing(standing, self._initial_person, stance, self.settings.floor, self._inertial)
            wearer = found.person
            if wearer is not None:
                height = round(float(stature(wearer.skeleton.rest_offset)), 3)
                self.settings = replace(self.settings, height=height)
        except BodysenseError as error:
            self._messages.append(Notice(str(error)))
            return
        self._inertial = found.inertial
        self._display.blend_next()
        self._messages += [Notice(text) for text in found.notices]
        self._base = self.calibrated = wearer or self._base.with_mounts(found.inertial.mounts)
        self._mounted = {}
        if wearer is None:
            return
        self.assign_trackers(found.tracker_joints)
        self._set_wearer(wearer)
        self.revision += 1


def _with_mounts(person: Person, mounts: Mapping[str, RigidTransform]) -> Person:
    """Return the person with these mounts in place of all others."""
    return Person(
        person.skeleton,
        height=person.height,
        bone_deviation=person.bone_deviation,
        mounts=mounts,
        lengths=person.lengths,
        hands=person.hands,
    )


def rounded(skeleton: Skeleton) -> tuple[tuple[float, float, float], ...]:
    """Return rest offsets (P, 3) in m, rounded to micrometres."""
    return tuple((round(x, 6), round(y, 6), round(z, 6)) for x, y, z in skeleton.rest_offset.tolist())
