"""Body of optical markers: poses that the seen markers determine, and plausible ones where markers are hidden.

Joint centres follow from the markers of a frame alone (`io.markers.centres`) within a few centimetres. Over a whole
take, the markers' motion tells more: where each is on the body, and how long the bones are (`worn_markers`). With these
the pose of each frame is fitted to its markers. A joint with hidden markers is bridged from both sides of the gap, and
the markers that are still seen correct it.
"""

from __future__ import annotations

import ctypes
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import ARM
from bodysense.files import load_library
from bodysense.geometry import gaps
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
)
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.takes.filling import TRUST
from bodysense.takes.fitting import Trunk, fit_hips
from bodysense.takes.worn_markers import (
    ROOT,
    TURN,
    BodyPoses,
    SeenMarkers,
    WornMarkers,
    fit_worn_markers,
)

if TYPE_CHECKING:
    from bodysense.sources.open import MarkerSource

Array = np.ndarray
HIDDEN_TURN = 0.1  # rad; deviation of a joint with hidden markers from the bridge over the gap
DETERMINED = 3  # markers that determine a joint's rotation
RATE = 30.0  # Hz; at higher rates, corrections of the tracker's poses are interpolated between fitted frames
_STEPS = 3  # Gauss-Newton steps of a pose
_FADED = 1.0  # s; a frame's markers change the hips of no frame that is farther away
_HIPS_AT_ONCE = 1000  # frames whose hips are fitted at once
_INTERPOLATED_AT_ONCE = 1000  # frames, in the processor's cache
_BLOCK = 64  # frames that are solved at once, in the processor's cache


def fit_to_markers(
    pose: Pose, observation: Observation, markers: MarkerSource, interval: float, *, is_known: bool
) -> Pose:
    """Fit the pose of a body of markers to its hips, unless the head is more certain, and let unknown arms hang.

    The tracker keeps the head at its measured position. If that is a guess, pelvis and legs would be lifted. It was
    not trained on markers of legs alone, for which it would raise the arms. Then the pose, and the bones unless they
    are known, are fitted to markers on the skin.
    """
    if _hips_are_surest(observation):
        beside = round(_FADED / interval)
        root, rotation = np.zeros_like(pose.root_position), np.zeros_like(pose.rotation)
        for first in range(0, len(root), _HIPS_AT_ONCE):
            start, end = max(first - beside, 0), min(first + _HIPS_AT_ONCE, len(root))
            near = slice(start, end + beside)
            points, _, measured, turned = observed_points(observation[near], pose.skeleton)
            fitted = fit_hips(pose[near], points, measured, turned, interval)[first - start :]
            root[first:end], rotation[first:end] = fitted.root_position[: end - first], fitted.rotation[: end - first]
        pose = Pose(pose.skeleton, root, rotation)
    if markers.found is not None and markers.found.arms_hang:
        rotation, skeleton = np.array(pose.rotation), pose.skeleton
        arms = skeleton.indices([f"{side}_{part}" for side in ("left", "right") for part in ARM])
        rotation[:, arms] = standing_pose(skeleton).rotation[arms]
        pose = replace(pose, rotation=rotation)
    if markers.found is None or markers.found.layout is None or not markers.found.layout.is_on_skin:
        return pose
    raw, columns = markers.found.raw, list(markers.found.layout.columns.values())
    accuracy = np.median(observation.accuracy, axis=0)
    seen = SeenMarkers(
        markers.found.world.to_ours(raw.position[:, columns]), observation.points, observation.position, accuracy
    )
    return fit_markers(pose, seen, interval, is_known=is_known)


def _hips_are_surest(observation: Observation) -> bool:
    """Whether the hips of markers are at least as certain as the head."""
    error = dict(zip(observation.points, np.median(observation.accuracy, axis=0), strict=True))
    return {"head", "left_hip", "right_hip"} <= set(error) and bool(error["head"] >= error["left_hip"])


def is_fitted(observation: Observation, markers: MarkerSource) -> bool:
    """Whether the body is fitted to markers on the skin in every frame, hips first (`fit_to_markers`)."""
    layout = None if markers.found is None else markers.found.layout
    return layout is not None and layout.is_on_skin and _hips_are_surest(observation)


def fit_markers(pose: Pose, seen: SeenMarkers, seconds: float, *, is_known: bool) -> Pose:
    """Fit a body to its markers, and its bones, too, unless they are known.

    Args:
        pose: (T,) of the tracker.
        seen: markers of these frames.
        seconds: time between frames.
        is_known: whether the pose's skeleton is the wearer's own.

    Returns the pose on the fitted bones; the same pose if too few markers are seen.
    """
    trunk = Trunk.of(pose.skeleton)
    start = trunk.without_fingers(pose)
    worn = fit_worn_markers(start, seen, is_known=is_known)
    if worn is None:
        return pose
    poses, count = BodyPoses.of(start), len(seen.position)
    knots = np.unique(np.r_[np.arange(0, count, max(1, round(1 / (RATE * seconds)))), count - 1])
    position = seen.columns(worn.columns, knots)
    fitted = _fitted(worn, poses[knots], position, seconds * float(np.diff(knots).max(initial=1)))
    if len(knots) < count:
        fitted = _between(poses, fitted, knots)
    rest = np.array(pose.skeleton.rest_offset)
    rest[trunk.points] = worn.skeleton.rest_offset
    whole = replace(pose.skeleton, rest_offset=rest)
    trunk = replace(trunk, whole=whole, skeleton=worn.skeleton)
    return trunk.with_fingers(
        Pose(worn.skeleton, fitted.root, fitted.local), Pose(whole, pose.root_position, pose.rotation)
    )


def _between(poses: BodyPoses, fitted: BodyPoses, knots: Array) -> BodyPoses:
    """Return poses (T,) whose corrections are interpolated between frames `knots` with `fitted` poses."""
    turn = quaternion_multiply(quaternion_conjugate(poses.local[knots]), fitted.local)
    correction = np.concatenate(
        [fitted.root - poses.root[knots], np.asarray(quaternion_log(turn)).reshape(len(knots), -1)], axis=1
    )
    root, local = np.zeros_like(poses.root), np.zeros_like(poses.local)
    for first in range(0, len(root), _INTERPOLATED_AT_ONCE):
        block = slice(first, first + _INTERPOLATED_AT_ONCE)
        frames = np.arange(*block.indices(len(root)))
        after = np.clip(np.searchsorted(knots, frames, side="right"), 1, len(knots) - 1)
        share = ((frames - knots[after - 1]) / (knots[after] - knots[after - 1]))[:, None]
        between = (1 - share) * correction[after - 1] + share * correction[after]
        turns = quaternion_exp(between[:, 3:].reshape(len(frames), -1, 3))
        root[block] = poses.root[block] + between[:, :3]
        local[block] = quaternion_canonical(quaternion_multiply(poses.local[block], turns))
    return BodyPoses(root, local)


def _fitted(worn: WornMarkers, poses: BodyPoses, position: Array, seconds: float) -> BodyPoses:
    """Fit the poses of frames to markers (T, M, 3)."""
    prior, joints = worn.start(poses), len(worn.skeleton.joints)
    weight = np.full((len(position), 3 + 3 * joints), 1 / TURN**2)
    weight[:, :3] = 1 / ROOT**2
    now = _solved(worn, prior, position, weight)
    local, hidden = np.array(now.local), _hidden_joints(worn, position)
    for joint in np.flatnonzero(hidden.any(axis=0)).tolist():
        trust = TRUST.get(worn.skeleton.joints[joint].rpartition("_")[2], TRUST["body"])
        local[:, joint] = gaps.fill(local[:, joint], hidden[:, joint], seconds, prior.local[:, joint], trust)
    rows = np.flatnonzero(hidden.any(axis=1))
    if not rows.size:
        return now
    weight = weight[rows]
    weight[:, 3:] = np.repeat(np.where(hidden[rows], 1 / HIDDEN_TURN**2, 1 / TURN**2), 3, axis=1)
    bridged = _solved(worn, BodyPoses(now.root[rows], local[rows]), position[rows], weight)
    root = np.array(now.root)
    root[rows], local[rows] = bridged.root, bridged.local
    return BodyPoses(root, local)


def _hidden_joints(worn: WornMarkers, position: Array) -> Array:
    """Return (T, J) bool: joints with markers of which too few are seen to determine the rotation, but not always."""
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    hidden = np.zeros((len(seen), len(worn.skeleton.joints)), dtype=bool)
    for joint in set(worn.joint.tolist()):
        own = seen[:, worn.joint == joint]
        hidden[:, joint] = own.sum(axis=1) < min(own.shape[1], DETERMINED)
    return hidden & ~hidden.all(axis=0)


def _solved(worn: WornMarkers, prior: BodyPoses, position: Array, weight: Array) -> BodyPoses:
    """Return the likeliest poses, from `prior` with inverse variances `weight` (T, 3 + 3 J), by markers (T, M, 3)."""
    root, local = np.zeros_like(prior.root), np.zeros_like(prior.local)
    for first in range(0, len(position), _BLOCK):
        block = slice(first, first + _BLOCK)
        now = prior[block]
        for _ in range(_STEPS):
            now = next_poses(worn, now, prior[block], position[block], weight[block])
        root[block], local[block] = now.root, now.local
    return BodyPoses(root, local)


def next_poses(worn: WornMarkers, now: BodyPoses, prior: BodyPoses, position: Array, weight: Array) -> BodyPoses:
    """Return the poses after a Gauss-Newton step, which the core computes."""
    joints, turn = (np.ascontiguousarray(part) for part in now.kinematics(worn.skeleton))
    step, count = weight * now.step_to(prior, turn), len(worn.skeleton.joints)
    held = (
        *(np.ascontiguousarray(part, np.int32) for part in (worn.skeleton.parents[:count], worn.joint)),
        *(np.ascontiguousarray(part, float) for part in (worn.offset, worn.noise)),
    )
    arrays = (np.ascontiguousarray(position), joints, turn, weight, step, np.empty(9 * (count + 1) ** 2 + 19 * count))
    body = _Worn(count, len(worn.joint), *(part.ctypes.data for part in held))
    _core().bs_step_to_markers(ctypes.byref(body), len(step), *(part.ctypes.data for part in arrays))
    return now.moved(step, turn)


class _Worn(ctypes.Structure):
    """`bs_worn_markers`."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in ("joints", "markers")),
        *((name, ctypes.c_void_p) for name in ("parent", "joint", "offset", "noise")),
    ]


@lru_cache(maxsize=1)
def _core() -> ctypes.CDLL:
    """Return the compiled core, whose steps of takes are not part of `bodysense.h`."""
    loaded = load_library("_core")
    loaded.bs_step_to_markers.restype = None
    loaded.bs_step_to_markers.argtypes = [ctypes.POINTER(_Worn), ctypes.c_size_t, *[ctypes.c_void_p] * 6]
    return loaded
