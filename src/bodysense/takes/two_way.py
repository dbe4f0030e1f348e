"""Completion with past and future: a recording is tracked forward and backward in time, and both passes are joined.

one pass infers the person → short gaps are bridged
→ windows: forward pass, continued from the window before | at the same time, backward pass, from some seconds later
→ joined → limbs fitted to measured points → feet on the floor → crossfade between windows
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import mean_rotation, quaternion_exp, quaternion_multiply
from bodysense.geometry.series import fade_out
from bodysense.observing.guard import LOOKED
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.takes.bridging import LONGEST, bridge_gaps
from bodysense.takes.feet import plant_feet
from bodysense.takes.fitting import Trunk, fit_limbs, fit_trunk
from bodysense.takes.joining import future_share, keep_tracked_rotations, lead_to_returns
from bodysense.takes.joining_network import JoiningNetwork, PassPair, packaged_joining
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.model import CompletionModel, packaged_model
from bodysense.tracking.tracker import Tracker, TrackerSettings, TrackerState

Array = np.ndarray
WINDOW = 60.0  # s that are completed at a time
BESIDE = 5.0  # s before and after a window that are completed with it; the backward pass warms up in those after
_EASE = 1e-4  # s; points that are seen again are reached at once, and the rest of the body is still eased
FADE = 1.0  # s of the crossfade between windows
_FRAMES = 60  # frames in one call of the pass that infers the person
# Parts of `_FRAMES` from which the person is inferred, spread over the take. Twice as many as were needed: with half of
# them, bones of two longer clips of CMU were 5 and 10 mm off in the mean, with all frames 7 and 12 mm.
_PARTS = 60
_ARRAYS = ("points", "measured", "confidence", "bound", "contact", "rest_offset")


class Frames(Protocol):
    """A recording (T, P) whose frames are taken a window at a time: an Observation, or what makes it of a motion."""

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points."""
        ...

    @property
    def time(self) -> Array:
        """(T,) s."""
        ...

    def __len__(self) -> int: ...

    def __getitem__(self, frames: slice, /) -> Observation: ...


@dataclass(frozen=True, eq=False)
class TwoWayTracker:
    """Completes whole recordings of one person with fixed proportions.

    Omitted networks are the packaged ones. If only `network` is given, it serves both directions.
    """

    person: Person
    network: CompletionModel | None
    settings: TrackerSettings
    backward_network: CompletionModel | None = None
    joining: JoiningNetwork | None = None

    @cached_property
    def tracker(self) -> Tracker:
        """The tracker of the forward pass: points that are seen again are reached at once."""
        return Tracker(self.person, self.network, replace(self.settings, infer=False, ease=_EASE))

    @cached_property
    def backward_tracker(self) -> Tracker:
        """The tracker of the backward pass."""
        network = self.backward_network or self.network or packaged_model(backward=True)
        return Tracker(self.person, network, replace(self.settings, infer=False, ease=_EASE))

    def complete(
        self, observation: Observation, seconds: float, advance: Callable[[int], None] = lambda frames: None
    ) -> Estimate:
        """Complete a recording (T, P) with frames `seconds` apart; `advance` gets the number of newly done frames."""
        parts = self.windows(observation, seconds, advance)
        return concatenate_estimates(parts, len(observation), self.person.skeleton.rest_offset)

    def of_inferred(
        self, observation: Frames, advance: Callable[[int, int], None] = lambda done, frames: None
    ) -> tuple[TwoWayTracker, Callable[[int], None]]:
        """Return this tracker for the person that a recording (T, P) reveals, and the `advance` of its completion.

        `observation` has points of the body, without gloves. `advance` gets the number of done frames, and of all.
        """
        frames, done, settings = len(observation), 0, self.settings
        infers = settings.infer and bool(self.person.bone_deviation.any() or self.person.mounts)
        steps = 2 * frames + infers * min(frames, _PARTS * _FRAMES)

        def advance_by(more: int) -> None:
            nonlocal done
            done += more
            advance(min(done * frames // steps, frames), frames)

        person = self.inferred_person(observation, advance_by) if infers else self.person
        return replace(self, person=person), lambda more: advance_by(2 * more)

    def inferred_person(self, observation: Frames, advance: Callable[[int], None] = lambda frames: None) -> Person:
        """Infer unknown properties of the person in one pass over all frames, or over parts of a long take."""
        tracker = Tracker(self.person, self.network, self.settings)
        state, starts = start_of_take(tracker), range(0, len(observation), _FRAMES)
        for k in sorted({round(place) for place in np.linspace(0, len(starts) - 1, _PARTS).tolist()}):
            first = starts[k]
            part = observation[first : first + _FRAMES]
            _, state = tracker.step(part, state)
            advance(len(part))
        return state.person()

    def windows(
        self, observation: Frames, seconds: float, advance: Callable[[int], None] = lambda frames: None
    ) -> Iterator[Estimate]:
        """Yield the estimates of `complete`, of consecutive frames, a window at a time."""
        ends = np.flatnonzero(np.diff(observation.time) > self.settings.longest_gap) + 1
        for begin, end in zip([0, *ends.tolist()], [*ends.tolist(), len(observation)], strict=True):
            yield from self._windows(observation, range(begin, end), seconds, advance)

    def _windows(
        self, observation: Frames, span: range, seconds: float, advance: Callable[[int], None]
    ) -> Iterator[Estimate]:
        """Yield estimates of a span of frames without a gap in time, a window at a time."""
        frames, size, beside = len(span), round(WINDOW / seconds), round(BESIDE / seconds)
        half, state, forward, before = round(FADE / seconds / 2), start_of_take(self.tracker), None, None
        for begin in range(0, frames, size):
            end = begin + size if begin + size + beside < frames else frames
            first, last = max(begin - beside, 0), min(end + beside, frames)
            margin = round(LONGEST / seconds) + 2  # frames around a window that bridging needs
            start = max(first - margin, 0)
            near = observation[span.start + start : span.start + min(last + margin, frames)]
            seen = bridge_gaps(near, seconds)[first - start : last - start]
            with ThreadPoolExecutor(1) as beside_forward:  # the core releases the GIL
                backward = beside_forward.submit(self.backward, seen)
                forward, state = self._forward(seen, forward, state)
            joined = self.joined(forward, backward.result(), self.turned(seen), seconds)
            lead = 0 if begin == 0 else half
            part = estimate_frames(joined, slice(begin - lead - first, min(end + half, frames) - first))
            if before is not None:
                part = crossfade(before, part, 2 * lead)
            stop = len(part.contact) - (2 * half if end < frames else 0)
            tracked = near[begin - lead - start : begin - lead - start + stop]
            yield replace(
                estimate_frames(part, slice(stop)), measured=observed_points(tracked, self.person.skeleton)[2]
            )
            advance(stop)
            before = estimate_frames(part, slice(stop, None))
            if end == frames:
                return

    def _forward(self, seen: Observation, known: Estimate | None, state: TrackerState) -> tuple[Estimate, TrackerState]:
        """Return the forward pass of a window; `known` has the frames before the state."""
        if known is None:
            return self.tracker.step(seen, state)
        overlap = int(np.searchsorted(seen.time, state.time(), side="right"))
        kept = estimate_frames(known, slice(len(known.contact) - overlap, None))
        more, state = self.tracker.step(seen[overlap:], state)
        return concatenate_estimates([kept, more], len(seen)), state

    def backward(self, observation: Observation) -> Estimate:
        """Return the backward pass, in the order of the frames."""
        estimate, _ = self.backward_tracker.step(reverse_time(observation), start_of_take(self.backward_tracker))
        return estimate_frames(estimate, slice(None, None, -1))

    def turned(self, observation: Observation) -> Array:
        """Return the joints (T, J) whose rotation is tracked."""
        skeleton = self.person.skeleton
        return np.asarray(observed_points(observation, skeleton)[3])[:, : len(skeleton.joints)]

    def passes(self, forward: Estimate, backward: Estimate, turned: Array, seconds: float) -> PassPair:
        """Return both passes of the same frames, `seconds` apart, each leading to points that are seen again."""
        skeleton, measured = forward.pose.skeleton, forward.measured
        head = skeleton.index("head")
        past = _pose_at_head(
            skeleton, *lead_to_returns(forward.pose.rotation, forward.points[:, head], measured, seconds)
        )
        rotation, place = lead_to_returns(
            backward.pose.rotation[::-1], backward.points[::-1, head], measured[::-1], seconds
        )
        future = _pose_at_head(skeleton, rotation[::-1], place[::-1])
        return PassPair(
            skeleton=skeleton,
            past=np.asarray(past[0].rotation),
            future=np.asarray(future[0].rotation),
            past_points=past[1],
            future_points=future[1],
            past_error=forward.confidence,
            future_error=backward.confidence,
            past_bound=forward.bound,
            future_bound=backward.bound,
            past_contact=forward.contact,
            future_contact=backward.contact,
            share=future_share(forward.confidence, backward.confidence, seconds),
            measured=measured,
            turned=turned,
            floor=self.settings.floor,
            seconds=seconds,
        )

    def joined(self, forward: Estimate, backward: Estimate, turned: Array, seconds: float) -> Estimate:
        """Join both passes of frames, `seconds` apart; joints that are `turned` (T, J) keep their tracked rotation."""
        passes = self.passes(forward, backward, turned, seconds)
        skeleton, measured = passes.skeleton, passes.measured
        head, pelvis, share = skeleton.index("head"), skeleton.index("pelvis"), passes.share[:, None, None]
        between = (1 - share) * passes.past_points + share * passes.future_points
        points = np.where(measured[..., None], (forward.points + backward.points) / 2, between)
        found = (self.joining or packaged_joining())(passes)
        rotation = mean_rotation(passes.past, passes.future, found.share[..., None])
        rotation = quaternion_multiply(rotation, quaternion_exp(found.turn))
        world = mean_rotation(*(np.asarray(forward_kinematics(one.pose)[1]) for one in (forward, backward)))
        rotation = keep_tracked_rotations(skeleton, rotation, world, turned)
        pose, position = _pose_at_head(skeleton, rotation, points[:, head])
        by_pelvis = measured[:, [pelvis]] & ~measured[:, [head]]
        off = np.where(by_pelvis, points[:, pelvis] - position[:, pelvis], 0.0)
        trunk, whole = Trunk.of(skeleton), pose
        pose = trunk.without_fingers(replace(pose, root_position=pose.root_position + off))
        goal, known = points[:, trunk.points], measured[:, trunk.points]
        pose = fit_trunk(pose, goal, known)
        position, world = (np.asarray(part) for part in forward_kinematics(pose))
        pose = fit_limbs(pose, np.where(known[..., None], goal, position), known, seconds, (position, world))
        contact = (1 - share[..., 0]) * forward.contact + share[..., 0] * backward.contact
        if self.settings.hold_feet:
            pose = plant_feet(pose, contact, known, turned[:, trunk.joints], self.settings.floor, seconds)
        pose = trunk.with_fingers(pose, whole)
        return Estimate(
            pose=pose,
            points=np.asarray(forward_kinematics(pose)[0]),
            measured=measured,
            confidence=found.error,
            bound=found.bound,
            contact=contact,
            rest_offset=forward.rest_offset,
        )


def start_of_take(tracker: Tracker) -> TrackerState:
    """Return the state before the first frame, which looks for no wrong world: a take has no notices of an estimate."""
    state = tracker.start()
    return replace(state, guards=(LOOKED,) * len(state.guards))


def reverse_time(observation: Observation) -> Observation:
    """Reverse a recording (T, P) in time. Accelerations keep their sign."""

    def flip(values: Array) -> Array:
        return np.ascontiguousarray(values[::-1])

    names = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    acceleration = None if observation.acceleration is None else flip(observation.acceleration)
    arrays = {name: flip(getattr(observation, name)) for name in names}
    return replace(observation, **arrays, acceleration=acceleration, time=flip(-observation.time))


def estimate_frames(estimate: Estimate, frames: slice) -> Estimate:
    """Return some frames of an estimate (T,)."""
    arrays = {name: getattr(estimate, name)[frames] for name in _ARRAYS}
    return replace(estimate, pose=estimate.pose[frames], **arrays)


def concatenate_estimates(parts: Iterable[Estimate], frames: int, rest_offset: Array | None = None) -> Estimate:
    """Concatenate consecutive estimates of `frames` frames in all, copying one part at a time.

    `rest_offset` (P, 3) m is the offset of every frame, if it is fixed. It is stored once.
    """
    names = [name for name in _ARRAYS if name != "rest_offset" or rest_offset is None]
    whole: dict[str, Any] = {}  # arrays by their names
    done, skeleton = 0, None
    for part in parts:
        arrays = {name: getattr(part, name) for name in names}
        arrays |= {"root_position": part.pose.root_position, "rotation": part.pose.rotation}
        for name, values in arrays.items():
            if not done:
                whole[name] = np.empty((frames, *values.shape[1:]), values.dtype)
            whole[name][done : done + len(values)] = values
        done, skeleton = done + len(part.contact), part.pose.skeleton
    assert skeleton is not None
    if rest_offset is not None:
        whole["rest_offset"] = np.broadcast_to(rest_offset, (frames, *rest_offset.shape))
    return Estimate(Pose(skeleton, whole.pop("root_position"), whole.pop("rotation")), **whole)


def crossfade(before: Estimate, after: Estimate, frames: int) -> Estimate:
    """Fade the first frames of an estimate from another estimate of the same frames to its own."""
    share = 1 - fade_out(frames)
    pose, old = after.pose, before.pose
    rotation, root = np.array(pose.rotation), np.array(pose.root_position)
    rotation[:frames] = mean_rotation(old.rotation[:frames], pose.rotation[:frames], share[:, None, None])
    root[:frames] += (1 - share)[:, None] * (old.root_position[:frames] - pose.root_position[:frames])
    pose = Pose(pose.skeleton, root, rotation)
    points = np.array(after.points)
    points[:frames] = np.asarray(forward_kinematics(pose[:frames])[0])
    return replace(after, pose=pose, points=points)


def _pose_at_head(skeleton: Skeleton, rotation: Array, head: Array) -> tuple[Pose, Array]:
    """Return the pose of local rotations (T, J, 4) with its head at positions (T, 3) m, and its points (T, P, 3) m."""
    origin = Pose(skeleton, np.zeros_like(head), rotation)
    position = np.asarray(forward_kinematics(origin)[0])
    root = head - position[:, skeleton.index("head")]
    return replace(origin, root_position=root), position + root[:, None]
