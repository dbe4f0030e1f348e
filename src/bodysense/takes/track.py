"""Whole recordings: `track` completes one with past and future, or like a live session, and returns a `Take`.

A source becomes an Observation, the tracker completes it to an Estimate, and the Estimate becomes a Clip.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.hands.hand import glove_hands
from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.device import Device
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.resample import at_constant_rate
from bodysense.io.rigs.figure import blocks_of
from bodysense.observing.observation import Observation
from bodysense.observing.points import concatenated_frames, observed_points
from bodysense.observing.world_axes import check_world
from bodysense.sources.open import MarkerSource, MotionSource, RecordingSource, Source, open_source
from bodysense.sources.signals import Signal, check_size, refuse, signal_from
from bodysense.takes.marker_body import fit_to_markers, is_fitted
from bodysense.takes.take import FilledFile, Take
from bodysense.takes.thinning import at_all_frames, kept_frames
from bodysense.takes.two_way import Frames, TwoWayTracker, concatenate_estimates, start_of_take
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.model import CompletionModel
from bodysense.tracking.tracker import Tracker, TrackerSettings

if TYPE_CHECKING:
    from bodysense.sources.partial_motion import PartialMotion

ANCHORS = ("head", "pelvis")  # points that keep their measured position if proportions change, in order of preference
_FRAMES = 60  # frames in one call, between two reports of progress
_BLOCK = 1000  # frames that are computed at once
_USUAL_RATE = 30.0  # Hz, assumed for a single frame


def track(
    source: Source,
    *,
    device: str | Device | None = None,
    missing: str | Sequence[str] = (),
    person: Person | None = None,
    height: float | None = None,
    noise: int | None = None,
    settings: TrackerSettings = TrackerSettings(),
    network: CompletionModel | None = None,
    reading: ReadingOptions = AS_FOUND,
    follow: int | None = None,
    roll: float | None = None,
    causal: bool = False,
    advance: Callable[[int, int], None] = lambda done, frames: None,
) -> Take:
    """Complete a whole recording with its past and its future.

    Args:
        source: a file (a recording, a motion, markers, a video), a folder of images, a Clip, Observation or Recording
            in memory, or what `open_source` opened.
        device: motions: simulated device that tracks the motion, by name or as a `Device` (an object with a method
            `observe`). Without a device, holes of the motion are filled and known frames are kept; a complete motion is
            returned unchanged.
        missing: motions: missing joints, by the motion's names or ours: "left_hand"; "LeftForeArm+" with all its
            descendants; "left_hand:100-240" in some frames (from 0, both ends included). NaN values are missing, too.
            If omitted, limbs of a BVH or FBX file are also missing if their values are constant for half a second
            while the body moves.
        person: known properties of the wearer. If omitted: the body of the recording or motion, or the likeliest adult,
            whose proportions are inferred, if that is unknown.
        height: height of the wearer in metres, instead of a person; other proportions are inferred.
        noise: random seed of the errors of a simulated device; it tracks exactly if omitted.
        settings: floor, whether feet are held, whether proportions are inferred.
        network: completion network; the packaged ones, one for each direction in time, if omitted.
        reading: facts that the source omits: unit and upward axis; of a motion also floor and joints.
        follow: videos: number of the person to follow; people are numbered from left to right when they are first
            seen. The largest person if omitted.
        roll: videos: degrees by which upright things lean to the right in the picture; estimated from the standing
            person if omitted.
        causal: complete each frame only from the frames before it, exactly like a live session. Holes of a motion are
            filled in the same way, and may end with a step. Bodies of optical markers are not moved to their hips.
        advance: called with the number of done frames, and of all.

    Raises BodysenseError, naming the source and the fix, for sources that cannot be tracked.
    """
    opened = open_source(source, reading)
    completion = Completion(settings, network, causal, advance)
    if isinstance(opened, MotionSource) and device is None:
        kind = "a motion whose holes are filled, which has a body of its own"
        refuse(opened.name, kind, person=person, height=height, noise=noise, follow=follow, roll=roll)
        try:
            take = fill_take(opened.with_holes(missing), completion)
        except BodysenseError:
            check_size(opened)  # says more about a body that is too small or too large
            raise
        return replace(take, source=opened.joint_file, reading=opened.options)
    if missing not in ((), []):
        other = f"leave --device {device} out" if device is not None else "give a motion, such as a .bvh file"
        raise BodysenseError(f"{opened.name}: --missing is for a motion that no device watches; {other}")
    if isinstance(opened, RecordingSource):
        seen, given = opened.recording.observation, opened.options
        check_world(seen, opened.name, unit=given.unit, up=given.up, floor=settings.floor)
    signal = signal_from(opened, device=device, person=person, height=height, noise=noise, follow=follow, roll=roll)
    try:
        take = _track_signal(signal, completion, opened if isinstance(opened, MarkerSource) else None)
    except BodysenseError as error:
        text = str(error)
        raise error if signal.name in text else BodysenseError(f"{signal.name}: {text}") from None
    if isinstance(opened, MotionSource):
        remarks = (*opened.warnings, *take.remarks)
        return replace(take, source=opened.joint_file, reading=opened.options, remarks=remarks)
    return take


@dataclass(frozen=True, eq=False)
class Completion:
    """Options of the completion; fields as the arguments of `track`."""

    settings: TrackerSettings
    network: CompletionModel | None
    causal: bool
    advance: Callable[[int, int], None]


def fill_take(partial: PartialMotion, completion: Completion) -> Take:
    """Fill the holes of a motion."""
    from bodysense.takes.filling import whole_pose

    clip, person = partial.clip, Person(partial.clip.pose.skeleton)
    filling = _Filling(partial, completion)
    estimate = concatenate_estimates(filling.windows(), len(clip), person.skeleton.rest_offset)
    partial, filled = filling.filled()
    file = None if partial.file is None else partial.file.with_rotation(filled, partial.missing)
    whole = clip if partial.is_whole else replace(clip, pose=whole_pose(partial, filled))
    return Take(whole, estimate, person, clip.time, partial=partial, file=file, remarks=clip.warnings)


def fill_file(
    opened: MotionSource, missing: str | Sequence[str], rig: str | None, completion: Completion
) -> Take | FilledFile:
    """Fill the holes of a BVH or FBX file, to be written on its own rig, in memory for windows of it.

    Without a `rig`, a body without legs, arms or head is completed to a whole Take: it is written on our joints.
    Raises BodysenseError as `track` does.
    """
    try:
        partial = opened.with_holes(missing)
        if rig is None and partial.clip.lacks:
            return replace(fill_take(partial, completion), source=opened.joint_file, reading=opened.options)
        filling = _Filling(partial, completion)
        filling.run()
        partial, filled = filling.filled()
    except BodysenseError:
        check_size(opened)
        raise
    file, gone, time, person = partial.file, partial.missing, partial.clip.time, Person(partial.clip.pose.skeleton)
    assert file is not None
    # The poses of an hour are as large as its numbers, of which there will be two copies.
    partial = replace(partial, clip=replace(partial.clip, pose=partial.clip.pose[[0]]), trunk={}, file=None)
    del filling
    return FilledFile(file.with_rotation(filled, gone), partial, person, time, opened.options)


class _Filling:
    """The work of filling a motion, which keeps what the holes need of each completed window."""

    def __init__(self, partial: PartialMotion, completion: Completion) -> None:
        from bodysense.takes.filling import check_causal, holed_joints, missing_limbs

        if completion.causal:
            check_causal(partial)
        frames, self.partial, self.completion = len(partial.clip), partial, completion
        self.limbs = missing_limbs(partial.clip, partial.rig)
        self.guessed = {joint: np.empty((frames, 4)) for joint in holed_joints(partial)}
        self.limb_rotation, self.contact = np.empty((frames, len(self.limbs), 4)), np.empty((frames, 4))

    def run(self) -> None:
        """Complete the motion; only what its holes need is kept."""
        for _ in self.windows():
            pass

    def windows(self) -> Iterator[Estimate]:
        """Complete the motion and yield its windows."""
        from bodysense.takes.filling import KnownPoints, guessed_rotations

        known, settings, done = KnownPoints(self.partial), self.completion.settings, 0
        interval = _interval(known, settings)
        _check_height(known, settings.floor)
        parts, _ = _completed_windows(known, Person(self.partial.clip.pose.skeleton), self.completion, interval)
        for part in parts:
            frames = slice(done, done + len(part.contact))
            for joint, turns in guessed_rotations(self.partial, part.pose).items():
                self.guessed[joint][frames] = turns
            self.limb_rotation[frames] = part.pose.rotation[:, self.limbs]
            self.contact[frames], done = part.contact, frames.stop
            yield part

    def filled(self) -> tuple[PartialMotion, dict[int, np.ndarray]]:
        """Return the motion with the limbs that it lacks, and rotations (T, 4) of its joints with holes."""
        from bodysense.takes.filling import fill_rotations, hold_filled_feet, with_missing_limbs

        partial, causal, floor = self.partial, self.completion.causal, self.completion.settings.floor
        if self.limbs:
            partial = with_missing_limbs(partial, self.limb_rotation)
        filled = fill_rotations(partial, self.guessed, causal=causal)
        return partial, hold_filled_feet(partial, filled, self.contact, floor, causal=causal)


def _track_signal(signal: Signal, completion: Completion, markers: MarkerSource | None = None) -> Take:
    observation, settings = signal.observation, completion.settings
    interval = _interval(observation, settings)
    _check_height(observation, settings.floor)
    if not signal.infer:
        completion = replace(completion, settings=replace(settings, infer=False))
    if markers is not None and not completion.causal and is_fitted(observation, markers):
        kept = kept_frames(observation.time, interval, settings.longest_gap)
        tracked = observation[kept]
        estimate, believed = _complete(tracked, signal.person, completion, _interval(tracked, settings))
        estimate = estimate if len(kept) == len(observation) else at_all_frames(estimate, kept, observation)
    else:
        estimate, believed = _complete(observation, signal.person, completion, interval)
    pose = pose_on(estimate, believed)
    if markers is not None and not completion.causal:
        fitted = fit_to_markers(pose, observation, markers, interval, is_known=signal.person.is_known)
        if fitted is not pose:
            pose, estimate = fitted, _with_pose(estimate, fitted, observation)
            believed = believed if fitted.skeleton is believed.skeleton else believed.with_skeleton(fitted.skeleton)
    clip, warnings = Clip(signal.name, pose, 1 / interval), _height_warnings(signal.person, believed)
    if markers is not None:
        warnings += markers.warnings
    at_rate = at_constant_rate(clip, observation.time)
    return Take(at_rate, estimate, believed, observation.time, markers=markers, remarks=warnings)


def _height_warnings(known: Person, believed: Person) -> tuple[str, ...]:
    """Return a line about a known height that the tracker released because the head was too high; else nothing."""
    if known.height is None or believed.height is not None:
        return ()
    return (
        f"the head is higher than a height of {known.height.value:.2f} m allows: the height is inferred instead, "
        f"{believed.stature:.2f} m; give another height or none",
    )


def _with_pose(estimate: Estimate, pose: Pose, observation: Observation) -> Estimate:
    """Replace the pose of an estimate; expected errors are at least the distance from measured positions."""
    points = np.empty((len(observation), len(pose.skeleton.points), 3))
    confidence, bound = np.zeros_like(estimate.confidence), np.zeros_like(estimate.bound)
    for first in range(0, len(points), _BLOCK):
        block = slice(first, first + _BLOCK)
        points[block] = forward_kinematics(pose[block])[0]
        seen, _, measured, _ = observed_points(observation[block], pose.skeleton)
        off = np.linalg.norm(np.where(measured[..., None], seen - points[block], 0.0), axis=-1)
        confidence[block] = np.maximum(estimate.confidence[block], off)
        bound[block] = np.maximum(estimate.bound[block], off)
    return replace(
        estimate,
        pose=pose,
        points=points,
        confidence=confidence,
        bound=bound,
        rest_offset=np.broadcast_to(pose.skeleton.rest_offset, estimate.rest_offset.shape),
    )


def _complete(
    observation: Observation, person: Person, completion: Completion, interval: float
) -> tuple[Estimate, Person]:
    """Return the completed body, and the person as inferred at the end; if causal, exactly like a live session."""
    parts, believed = _completed_windows(observation, person, completion, interval)
    rest = None if completion.causal else believed().skeleton.rest_offset
    return concatenate_estimates(parts, len(observation), rest), believed()


def _completed_windows(
    observation: Frames, person: Person, completion: Completion, interval: float
) -> tuple[Iterator[Estimate], Callable[[], Person]]:
    """Return the completed windows, and a function for the person as inferred when they are done.

    If causal, they are exactly like a live session.
    """
    points = observation.points
    if not completion.causal:
        body = concatenated_frames(list(_body_points(observation, person))) if glove_hands(points) else observation
        both_ways = TwoWayTracker(person, completion.network, completion.settings)
        tracker, advance = both_ways.of_inferred(body, completion.advance)
        return tracker.windows(body, interval, advance), lambda: tracker.person
    live = Tracker(person, network=completion.network, settings=completion.settings)
    state = start_of_take(live)

    def parts() -> Iterator[Estimate]:
        nonlocal state
        done = 0
        for frames in _body_points(observation, person):
            estimate, state = live.step(frames, state)
            yield estimate
            done += len(frames)
            completion.advance(done, len(observation))

    def believed() -> Person:
        return state.person()

    return parts(), believed


def _body_points(observation: Frames, person: Person) -> Iterator[Observation]:
    """Yield the points of the body, some frames at a time; markers of gloves become joints of hands."""
    parts = (observation[k : min(k + _FRAMES, len(observation))] for k in range(0, len(observation), _FRAMES))
    if not glove_hands(observation.points):
        yield from parts
        return
    from bodysense.devices.gloves.device import check_calibrated, glove_device, gloved_sides

    sides = gloved_sides(observation.points)
    check_calibrated(observation.points, sides, person.hands)
    gloves = glove_device(person.skeleton, sides, calibrated=person.hands)
    state = gloves.start()
    for part in parts:
        joints, state = gloves.step(part, state)
        yield joints


def _interval(observation: Frames, settings: TrackerSettings) -> float:
    """Return the median seconds between frames. Raises BodysenseError if they are too far apart for one motion."""
    if len(observation) < 2:
        return 1 / _USUAL_RATE
    interval = float(np.median(np.diff(observation.time)))
    if interval > settings.longest_gap:
        raise BodysenseError(
            f"its frames are {interval:g} s apart ({1 / interval:.3g} Hz), too far for one motion; give at least "
            f"{1 / settings.longest_gap:g} Hz, or times in seconds"
        )
    return interval


def _check_height(observation: Frames, floor: float) -> None:
    """Raise BodysenseError if the head is below the floor."""
    if "head" not in observation.points:
        return
    head = observation.points.index("head")
    blocks = (observation[block] for block in blocks_of(len(observation)))
    height = np.concatenate([block.position[block.has_position[:, head], head, 1] for block in blocks])
    highest = float(np.percentile(height, 95)) - floor if height.size else 1.0
    if highest < 0:
        raise BodysenseError(
            f"the head is {-highest:.2f} m below the floor, which is y = {floor:g}; give positions over it, or the "
            "floor's height with --floor"
        )


def pose_on(estimate: Estimate, person: Person) -> Pose:
    """Return the pose of an estimate on the skeleton of a person, which may have other proportions.

    Rotations are unchanged. The root is placed so that the head keeps its measured position; without a tracked head
    the pelvis, else the point that was tracked in most frames.
    """
    skeleton, pose = person.skeleton, estimate.pose
    if (estimate.rest_offset == skeleton.rest_offset).all():
        return Pose(skeleton, pose.root_position, pose.rotation)
    share = estimate.measured.mean(axis=0)
    tracked = [name for name in ANCHORS if share[skeleton.index(name)] > 0]
    anchor = skeleton.index(tracked[0]) if tracked else int(share.argmax())  # nothing tracked: the root, which is first
    root = estimate.points[:, anchor].copy()
    for k in range(0, len(root), _BLOCK):
        rotation = pose.rotation[k : k + _BLOCK]
        moved = Pose(skeleton, np.zeros((len(rotation), 3)), rotation)
        root[k : k + _BLOCK] -= np.asarray(forward_kinematics(moved)[0])[:, anchor]
    return Pose(skeleton, root, pose.rotation)
