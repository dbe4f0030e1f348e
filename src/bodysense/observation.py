"""The waist: everything that tracks becomes an Observation, everything that completes returns an Estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, isnan

import numpy as np

from bodysense.body.hand import glove_marker
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

# Points whose inertial sensors' acceleration is heeded, and toward which point along the bone each is strapped; None:
# at the joint itself.
STRAPPED_TOWARD: dict[str, str | None] = {
    "pelvis": None,
    "spine3": None,
    **{
        f"{side}_{joint}": f"{side}_{end}"
        for joint, end in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "foot"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
        )
        for side in ("left", "right")
    },
}
STRAPPED = tuple(STRAPPED_TOWARD)
UNIT_TOLERANCE = 0.01  # how far from 1 the length of a quaternion may be
STRONGEST = 1000.0  # m/s²: no sensor on a body measures more
FARTHEST = 1000.0  # m from the origin: beyond it single precision is too coarse for a body
CONTACT_POINTS = ("left_ankle", "right_ankle", "left_foot", "right_foot")  # the feet are the balls

# Expected error (m) of a measured position by kind of device, where the device does not give its own.
EXACT_ACCURACY = 0.001  # the true motion, simulated devices without noise
HEADSET_ACCURACY = 0.001  # headsets and controllers
OPTICAL_ACCURACY = 0.001  # markers of optical motion capture
TRACKER_ACCURACY = 0.01  # trackers on the body: clothes and skin move under the strap
CAMERA_ACCURACY = 0.01  # hands and joints seen by the cameras of a headset
LANDMARK_ACCURACY = 0.05  # landmarks of a video
_HEADSET_POINTS = {"head", "left_wrist", "right_wrist", "headset", "left_controller", "right_controller"}


@dataclass(frozen=True, eq=False)
class Observation:
    """What was tracked: named points over time, world frame (+Y up, metres). Hidden values are NaN."""

    points: tuple[str, ...]  # joint or end-site names, 'head' for the headset's wearer, marker names …
    position: np.ndarray  # (..., T, P, 3) m, world
    rotation: np.ndarray  # (..., T, P, 4) wxyz, world ← point
    has_position: np.ndarray  # (..., T, P) bool
    has_rotation: np.ndarray  # (..., T, P) bool
    accuracy: np.ndarray  # (..., T, P) m, expected error of a measured position
    time: np.ndarray  # (T,) s, increasing; from any origin
    # (..., T, P, 3) m/s², world, without gravity, of inertial sensors strapped along the bones that begin at their
    # points; NaN where there is none, None where no point has one.
    acceleration: np.ndarray | None = None

    def __getitem__(self, key: slice) -> Observation:
        """Frames `key` (a slice), of all people."""
        return replace(
            self,
            position=self.position[..., key, :, :],
            rotation=self.rotation[..., key, :, :],
            has_position=self.has_position[..., key, :],
            has_rotation=self.has_rotation[..., key, :],
            accuracy=self.accuracy[..., key, :],
            time=self.time[key],
            acceleration=None if self.acceleration is None else self.acceleration[..., key, :, :],
        )

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A whole body for every frame of an observation. P counts all points of the pose's skeleton.

    Proportions that are inferred change while the tracker runs: `points` and `rest_offset` are those of each frame, the
    pose's skeleton has those of the last one. Of several people the pose's skeleton is the first one's; `of` gives
    each person's own.
    """

    pose: Pose  # (..., T), on the person's skeleton
    points: np.ndarray  # (..., T, P, 3) m, world
    measured: np.ndarray  # (..., T, P) bool: pinned to a measurement
    confidence: np.ndarray  # (..., T, P) m, expected position error, calibrated
    bound: np.ndarray  # (..., T, P) m, within which the position error is in nine of ten cases
    contact: np.ndarray  # (..., T, 4) probability that each of `CONTACT_POINTS` rests on something
    rest_offset: np.ndarray  # (..., T, P, 3) m

    def of(self, person: int) -> Estimate:
        """One person's part of an estimate that leads with an axis of people."""
        offset = self.rest_offset[person]
        pose = Pose(
            self.pose.skeleton.with_offsets(offset[-1]), self.pose.root_position[person], self.pose.rotation[person]
        )
        return Estimate(
            pose=pose,
            points=self.points[person],
            measured=self.measured[person],
            confidence=self.confidence[person],
            bound=self.bound[person],
            contact=self.contact[person],
            rest_offset=offset,
        )


def observe(
    time: float,
    poses: Mapping[str, tuple[np.ndarray | Sequence[float] | None, np.ndarray | Sequence[float] | None]],
    accuracy: float | None = None,
) -> Observation:
    """One frame of named points, as a device tells them.

    Args:
        time: s, from any origin.
        poses: by name, as a joint's 'left_wrist': position (3,) m and rotation (4,) wxyz, both in the world; None for
            what is not tracked.
        accuracy: m, expected error of the positions; the usual one of each point if omitted.

    Raises BodysenseError for what is no position or rotation.
    """
    count = len(poses)
    position, rotation = np.full((1, count, 3), np.nan), np.full((1, count, 4), np.nan)
    placed, turned = np.zeros((1, count), dtype=bool), np.zeros((1, count), dtype=bool)
    wanted = (("position", position, placed), ("rotation", rotation, turned))
    for place, (name, pose) in enumerate(poses.items()):
        for value, (what, values, has) in zip(pose, wanted, strict=True):
            if value is None:
                continue
            if np.shape(value) != values.shape[2:]:
                raise BodysenseError(
                    f"{name}: its {what} has shape {np.shape(value)}; give {values.shape[2]} numbers, or None"
                )
            values[0, place], has[0, place] = value, True
    usual = usual_accuracy(tuple(poses)) if accuracy is None else np.full(count, accuracy)
    observation = Observation(tuple(poses), position, rotation, placed, turned, usual[None], np.array([time]))
    return check_observation(observation, "observe")


def check_shapes(observation: Observation, name: str = "observation") -> None:
    """Raise BodysenseError, naming the fix, where arrays do not fit together; their values are not looked at."""
    frames, count = len(observation.time), len(observation.points)
    expected = {"position": (3,), "rotation": (4,), "has_position": (), "has_rotation": (), "accuracy": ()}
    if len(set(observation.points)) != count:
        raise BodysenseError(f"{name}: a point is named twice; names must differ")
    if observation.time.ndim != 1:
        raise BodysenseError(f"{name}: time has shape {observation.time.shape}; give one number a frame, in seconds")
    if observation.acceleration is not None:
        expected["acceleration"] = (3,)
    batch = observation.position.shape[:-3]
    for field, tail in expected.items():
        shape = getattr(observation, field).shape
        wanted = (*batch, frames, count, *tail)
        if shape != wanted:
            raise BodysenseError(f"{name}: {field} has shape {shape}; {frames} frames of {count} points need {wanted}")


def check_observation(observation: Observation, name: str = "observation", farthest: float = FARTHEST) -> Observation:
    """Return the observation if it is well formed; raise BodysenseError, naming the fix, if not.

    Well formed: shapes agree, times increase, and what the masks call tracked is finite, at most `farthest` m from the
    origin, turned by unit quaternions and of positive accuracy.
    """
    check_shapes(observation, name)
    if not np.isfinite(observation.time).all():
        bad = int(np.argmin(np.isfinite(observation.time)))
        raise BodysenseError(f"{name}: the time of frame {bad} is not a number; give seconds, increasing")
    backwards = np.flatnonzero(np.diff(observation.time) <= 0)
    if backwards.size:
        k = int(backwards[0]) + 1
        before, after = (_seconds(time) for time in observation.time[k - 1 : k + 1])
        raise BodysenseError(
            f"{name}: time goes from {before} to {after} at frame {k}; "
            "times must increase: sort the frames and drop repeats"
        )
    if not _is_sound(observation, farthest):
        _refuse(observation, name, farthest)
    if observation.acceleration is not None:
        _check_acceleration(observation, observation.acceleration, name)
    return observation


def _check_acceleration(observation: Observation, acceleration: np.ndarray, name: str) -> None:
    """Raise BodysenseError for an acceleration that no body has."""
    with np.errstate(invalid="ignore"):
        present = ~np.isnan(acceleration).any(axis=-1)
        broken = present & ~(np.abs(acceleration) <= STRONGEST).all(axis=-1)
    if broken.any():
        *_, frame, point = place = tuple(np.argwhere(broken)[0])
        raise BodysenseError(
            f"{name}: the acceleration of {observation.points[point]!r} at frame {frame} is "
            f"{np.abs(acceleration[place]).max():.4g} m/s², but at most {STRONGEST:g} is possible; give m/s² in the "
            "world without gravity, or NaN where there is none"
        )


def _is_sound(observation: Observation, farthest: float) -> bool:
    """Whether everything that is tracked is finite, near, turned by unit quaternions and of positive accuracy."""
    accuracy, rotation = observation.accuracy, observation.rotation
    with np.errstate(all="ignore"):  # NaN compares false
        placed = (np.abs(observation.position) <= farthest).all(axis=-1) & (accuracy > 0) & (accuracy < np.inf)
        turned = np.abs(np.sqrt(np.einsum("...i,...i->...", rotation, rotation)) - 1) < UNIT_TOLERANCE
    return bool((placed | ~observation.has_position).all() and (turned | ~observation.has_rotation).all())


def _refuse(observation: Observation, name: str, farthest: float) -> None:
    """Raise BodysenseError for the first of the tracked values that is not as it must be."""
    for mask, field in (("has_position", "position"), ("has_rotation", "rotation")):
        present = getattr(observation, mask)
        broken = present & ~np.isfinite(getattr(observation, field)).all(axis=-1)
        if broken.any():
            *_, frame, point = np.argwhere(broken)[0]
            raise BodysenseError(
                f"{name}: {mask} says that {observation.points[point]!r} is tracked at frame {frame}, "
                f"but its {field} is not finite; clear the mask there"
            )
    with np.errstate(invalid="ignore"):
        far = observation.has_position & ~(np.abs(observation.position).max(axis=-1, initial=0.0) <= farthest)
        vague = observation.has_position & ~((observation.accuracy > 0) & (observation.accuracy < np.inf))
    if far.any():
        *_, frame, point = place = tuple(np.argwhere(far)[0])
        raise BodysenseError(
            f"{name}: {observation.points[point]!r} is {np.abs(observation.position[place]).max():.4g} m from the "
            f"origin at frame {frame}, but at most {farthest:g} m is possible; give metres, or move the origin nearer"
        )
    if vague.any():
        *_, frame, point = place = tuple(np.argwhere(vague)[0])
        raise BodysenseError(
            f"{name}: the accuracy of {observation.points[point]!r} at frame {frame} is "
            f"{observation.accuracy[place]:g}; give the expected error of its position in metres, above 0, such as 0.01"
        )
    with np.errstate(over="ignore"):
        length = np.linalg.norm(observation.rotation, axis=-1)
    broken = observation.has_rotation & ~(np.abs(length - 1) < UNIT_TOLERANCE)
    if broken.any():
        *_, frame, point = place = tuple(np.argwhere(broken)[0])
        raise BodysenseError(
            f"{name}: the rotation of {observation.points[point]!r} at frame {frame} has length {length[place]:g}; "
            "give unit quaternions w, x, y, z, or clear the mask there"
        )


def check_order(time: float, before: float | None, name: str) -> None:
    """Raise BodysenseError, beginning with `name`, unless a frame at `time` s may follow one at `before` s.

    None or NaN: there was no frame before.
    """
    if before is not None and isnan(before):
        before = None
    if isfinite(time) and (before is None or time > before):
        return
    after = "" if before is None else f" came after one at {_seconds(before)}"
    raise BodysenseError(f"{name}: a frame at {_seconds(time)}{after}; give frames in order of time, in seconds")


def _seconds(time: float) -> str:
    """A time in words, to the microsecond, also where it is Unix time."""
    return f"{round(float(time), 6):.15g} s"


def accuracy_like(has_position: np.ndarray, metres: float | np.ndarray) -> np.ndarray:
    """`metres`, one for all points or (P,), as the accuracy of points whose mask is `has_position` (..., T, P)."""
    return np.broadcast_to(np.asarray(metres, dtype=float), np.shape(has_position)).copy()


def usual_accuracy(points: Sequence[str]) -> np.ndarray:
    """(P,) m: the accuracy of points of which nothing but the name is known.

    A headset's and controllers' for head and wrists, optical for markers of gloves, a body tracker's for the rest.
    """
    return np.array([_usual_accuracy(name) for name in points], dtype=float)


def _usual_accuracy(name: str) -> float:
    if name in _HEADSET_POINTS:
        return HEADSET_ACCURACY
    return OPTICAL_ACCURACY if glove_marker(name) else TRACKER_ACCURACY


def concatenated_frames(parts: Sequence[Observation]) -> Observation:
    """Consecutive observations (T, P) of the same points as one."""

    def whole(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts])

    names = ("position", "rotation", "has_position", "has_rotation", "accuracy", "time")
    acceleration = None if parts[0].acceleration is None else whole("acceleration")
    return replace(parts[0], **{name: whole(name) for name in names}, acceleration=acceleration)


def without_gloves(observation: Observation) -> Observation:
    """The same without the markers of gloves."""
    return chosen_points(observation, [k for k, name in enumerate(observation.points) if not glove_marker(name)])


def chosen_points(observation: Observation, places: Sequence[int]) -> Observation:
    """The points of an observation at some places."""
    return Observation(
        points=tuple(observation.points[k] for k in places),
        position=observation.position[..., places, :],
        rotation=observation.rotation[..., places, :],
        has_position=observation.has_position[..., places],
        has_rotation=observation.has_rotation[..., places],
        accuracy=observation.accuracy[..., places],
        time=observation.time,
        acceleration=None if observation.acceleration is None else observation.acceleration[..., places, :],
    )


def observed_points(
    observation: Observation, skeleton: Skeleton
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position, rotation and their masks for every point of a skeleton, in its order; what was not observed is hidden.

    A glove's markers are no points of a skeleton and are left out. Raises BodysenseError for any other point that the
    skeleton does not have.
    """
    if observation.points == skeleton.points:
        return observation.position, observation.rotation, observation.has_position, observation.has_rotation
    if any(map(glove_marker, observation.points)):
        observation = without_gloves(observation)
    place = skeleton.indices(observation.points)
    batch, count = observation.position.shape[:-2], len(skeleton.points)
    position, rotation = np.full((*batch, count, 3), np.nan), np.full((*batch, count, 4), np.nan)
    has_position, has_rotation = np.zeros((*batch, count), dtype=bool), np.zeros((*batch, count), dtype=bool)
    position[..., place, :], rotation[..., place, :] = observation.position, observation.rotation
    has_position[..., place], has_rotation[..., place] = observation.has_position, observation.has_rotation
    return position, rotation, has_position, has_rotation
