"""From observations to the arrays that the graph reads: all points of the skeleton, in its order, finite everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from bodysense.body.person import Person
from bodysense.body.rotation import quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.observation import STRAPPED, Observation, check_observation

POINTS, JOINTS = len(default_skeleton().points), len(default_skeleton().joints)
ABSENT_ACCURACY = 0.001  # m, of points that are not tracked: any positive number
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Frames:
    """What was tracked of B people in T frames, the joint in place of the tracker that it carries."""

    position: np.ndarray  # (T, B, 65, 3) float32 m, world; 0 where not tracked
    rotation: np.ndarray  # (T, B, 52, 4) float32 wxyz, world ← joint; identity where not tracked
    has_position: np.ndarray  # (T, B, 65) bool
    has_rotation: np.ndarray  # (T, B, 52) bool
    accuracy: np.ndarray  # (T, B, 65) float32 m
    time: np.ndarray  # (T, B) s
    acceleration: np.ndarray  # (T, B, 12, 3) float32 m/s², world, of `STRAPPED`; 0 where not told
    has_acceleration: np.ndarray  # (T, B, 12) bool

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, frame: int) -> Frames:
        """One frame, without its axis T."""
        return Frames(
            self.position[frame],
            self.rotation[frame],
            self.has_position[frame],
            self.has_rotation[frame],
            self.accuracy[frame],
            self.time[frame],
            self.acceleration[frame],
            self.has_acceleration[frame],
        )

    def taken(self, people: np.ndarray) -> Frames:
        """A single frame of some of several people."""
        return Frames(**{each.name: getattr(self, each.name)[people] for each in fields(self)})

    @classmethod
    def stacked(cls, parts: Sequence[Frames]) -> Frames:
        """Single frames of several people as one of all of them."""
        return cls(**{each.name: np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)})


def frames_of(observation: Observation, people: Sequence[Person], batched: bool) -> Frames:
    """The arrays of an observation of one person (T, P), or, where `batched`, of several (B, T, P).

    A tracker that is worn as its person's `mounts` say, and has a position and a rotation, gives its joint's pose.
    Raises BodysenseError for an observation that is not well formed, and for points that no skeleton has.
    """
    check_observation(observation)
    count, lead = len(people), observation.position.shape[:-3]
    if lead != ((count,) if batched else ()):
        raise BodysenseError(
            f"observation: batch axes {lead}, but the tracker is of "
            f"{f'{count} people: give ({count}, T, P, 3)' if batched else 'one person: give (T, P, 3)'}"
        )
    place, turns = _places(observation.points)
    shape = (len(observation), count)

    def by_frame(values: np.ndarray) -> np.ndarray:
        return np.moveaxis(values, 0, 1) if batched else values[:, None]

    has_position = np.zeros((*shape, POINTS), dtype=bool)
    has_rotation = np.zeros((*shape, JOINTS), dtype=bool)
    position = np.zeros((*shape, POINTS, 3), dtype=np.float32)
    rotation = np.broadcast_to(_UPRIGHT, (*shape, JOINTS, 4)).copy()
    accuracy = np.full((*shape, POINTS), ABSENT_ACCURACY, dtype=np.float32)
    seen, turned = by_frame(observation.has_position), by_frame(observation.has_rotation)
    where, orientation = by_frame(observation.position), by_frame(observation.rotation)
    if any(person.mounts for person in people):
        where, orientation = _unmounted(where, orientation, seen & turned, observation.points, people)
    has_position[..., place] = seen
    has_rotation[..., place[turns]] = turned[..., turns]
    position[..., place, :] = np.where(seen[..., None], where, 0.0)
    rotation[..., place[turns], :] = np.where(turned[..., turns, None], orientation[..., turns, :], _UPRIGHT)
    accuracy[..., place] = np.where(seen, by_frame(observation.accuracy), ABSENT_ACCURACY)
    time = np.broadcast_to(np.asarray(observation.time, dtype=np.float64)[:, None], shape)
    felt, has_felt = np.zeros((*shape, len(STRAPPED), 3), dtype=np.float32), np.zeros((*shape, len(STRAPPED)), bool)
    if observation.acceleration is not None:
        those = [(k, STRAPPED.index(name)) for k, name in enumerate(observation.points) if name in STRAPPED]
        points, sensors = np.array(those, dtype=int).reshape(-1, 2).T
        told = by_frame(observation.acceleration)[..., points, :]
        has_felt[..., sensors] = np.isfinite(told).all(axis=-1)
        felt[..., sensors, :] = np.where(has_felt[..., sensors, None], told, 0.0)
    return Frames(position, rotation, has_position, has_rotation, accuracy, time, felt, has_felt)


@lru_cache(maxsize=256)
def _places(points: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Where points are among those of the skeleton, and which of them are joints."""
    place = default_skeleton().indices(points)
    return place, np.flatnonzero(place < JOINTS)


def frames_together(observations: Sequence[Observation], people: Sequence[Person]) -> Frames:
    """One frame each of several people, of whatever points and times, as one of all of them."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for k, observation in enumerate(observations):
        alike.setdefault(observation.points, []).append(k)
    parts, order = [], []
    for points, those in alike.items():
        few = [observations[k] for k in those]
        together = Observation(
            points=points,
            position=np.stack([one.position for one in few]),
            rotation=np.stack([one.rotation for one in few]),
            has_position=np.stack([one.has_position for one in few]),
            has_rotation=np.stack([one.has_rotation for one in few]),
            accuracy=np.stack([one.accuracy for one in few]),
            time=np.zeros(1),
            acceleration=_accelerations(few),
        )
        frame = frames_of(together, [people[k] for k in those], batched=True)[0]
        parts.append(replace(frame, time=np.array([one.time[0] for one in few], dtype=np.float64)))
        order += those
    return parts[0] if len(parts) == 1 else Frames.stacked(parts).taken(np.argsort(order))


def _accelerations(observations: Sequence[Observation]) -> np.ndarray | None:
    """Accelerations of observations of the same points, (B, T, P, 3)."""
    if all(one.acceleration is None for one in observations):
        return None
    return np.stack(
        [np.full_like(one.position, np.nan) if one.acceleration is None else one.acceleration for one in observations]
    )


def _unmounted(
    position: np.ndarray, rotation: np.ndarray, posed: np.ndarray, points: tuple[str, ...], people: Sequence[Person]
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, B, P) of the joints that carry trackers, from those of the trackers, where both parts are `posed`."""
    position, rotation = np.array(position, dtype=np.float64), np.array(rotation, dtype=np.float64)
    for k, person in enumerate(people):
        for joint, mount in person.mounts.items():
            if joint not in points:
                continue
            p = points.index(joint)
            known = posed[:, k, p]
            back = mount.inverse()  # T_tracker_joint
            turn = rotation[known, k, p]
            position[known, k, p] += quaternion_rotate(turn, np.broadcast_to(back.translation, (len(turn), 3)))
            rotation[known, k, p] = quaternion_multiply(turn, np.broadcast_to(back.rotation, turn.shape))
    return position, rotation
