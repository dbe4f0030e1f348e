"""Observations made of others: their frames in one, their points together, and some of their points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bodysense.body.hands.hand import glove_marker
from bodysense.body.skeleton import Skeleton
from bodysense.observing.observation import Observation


def concatenated_frames(parts: Sequence[Observation]) -> Observation:
    """Concatenate consecutive observations (T, P) of the same points."""

    def whole(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts])

    names = ("position", "rotation", "has_position", "has_rotation", "accuracy", "time")
    acceleration = None if parts[0].acceleration is None else whole("acceleration")
    return replace(parts[0], **{name: whole(name) for name in names}, acceleration=acceleration)


def joined_points(one: Observation, other: Observation) -> Observation:
    """Merge the points of two observations (T, P) with equal times."""
    names = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    merged = {name: np.concatenate([getattr(one, name), getattr(other, name)], axis=1) for name in names}
    accelerations = [part.acceleration for part in (one, other)]
    if any(given is not None for given in accelerations):
        merged["acceleration"] = np.concatenate(
            [
                np.full_like(part.position, np.nan) if given is None else given
                for part, given in zip((one, other), accelerations, strict=True)
            ],
            axis=1,
        )
    return Observation(points=(*one.points, *other.points), time=one.time, **merged)


def without_gloves(observation: Observation) -> Observation:
    """Return the observation without the markers of gloves."""
    return chosen_points(observation, [k for k, name in enumerate(observation.points) if not glove_marker(name)])


def chosen_points(observation: Observation, places: Sequence[int]) -> Observation:
    """Return the points of an observation at the given indices."""
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
    """Return position, rotation, has_position and has_rotation of every point of a skeleton, in its order.

    Points without observations are hidden. Markers of gloves are dropped. Raises BodysenseError for any other point
    that the skeleton does not have.
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
