"""People in right and wrong worlds: every upward axis, unit, height of the floor, exchanged hands and unit of time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from people.made import LYING, lying_clip

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.geometry.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.observing.observation import EXACT_ACCURACY, Observation
from bodysense.observing.world_axes import TURNS, UNITS
from bodysense_lab.synthesis.scenes import sequence

RATE, SECONDS = 15.0, 12
SETS: dict[str, tuple[tuple[str, ...], bool]] = {  # points, and whether they are turned, too
    "head": (("head",), True),
    "three points": (("head", "left_wrist", "right_wrist"), True),
    "three places": (("head", "left_wrist", "right_wrist"), False),
    "six points": (("head", "left_wrist", "right_wrist", "pelvis", "left_ankle", "right_ankle"), True),
    "legs and pelvis": (("pelvis", "left_ankle", "right_ankle"), True),
    "places of the body": (BODY, False),
}
UPRIGHT = ("stand", "walk", "turn", "step_back", "hands_on_hips", "sit", "lean_on_wall")  # kinds of scenes


@dataclass(frozen=True)
class World:
    """How someone wrote a body down; the default is right."""

    up: str = "y"
    unit: str = "m"
    floor: float = 0.0  # m, height of the floor in the data
    swapped: bool = False
    second: float = 1.0  # of time


@dataclass(frozen=True, eq=False)
class Body:
    """A person in the right world."""

    kind: str
    time: np.ndarray  # (T,) s
    place: np.ndarray  # (T, P, 3) m, of `BODY`
    rotation: np.ndarray  # (T, P, 4) wxyz, world ← joint

    def seen(self, points: tuple[str, ...], turned: bool) -> Observation:
        """Return the observation of some points."""
        columns = [BODY.index(name) for name in points]
        place = self.place[:, columns]
        known = np.ones(place.shape[:2], bool)
        rotation = self.rotation[:, columns] if turned else np.full((*place.shape[:2], 4), np.nan)
        accuracy = np.full(known.shape, EXACT_ACCURACY)
        return Observation(points, place, rotation, known, known if turned else ~known, accuracy, self.time)


def drawn_body(kind: str, rng: np.random.Generator) -> Body:
    """Draw a person: a scene of `KINDS`, a way to lie of `LYING`, 'jump', 'child' or 'seated child'; anywhere."""
    frames = round(RATE * SECONDS)
    if kind in LYING:
        clip = lying_clip(kind, frames, RATE, int(rng.integers(1000)))
        pose, size = clip.pose, 1.0
    else:
        scene = {"jump": "stand", "child": "walk", "seated child": "sit"}.get(kind, kind)
        pose, size = sequence(rng, frames, RATE, kind=scene).pose, 0.6 if "child" in kind else 1.0
    points, turns = forward_kinematics(Pose(pose.skeleton, np.asarray(pose.root_position), pose.rotation))
    columns = pose.skeleton.indices(BODY)
    place, rotation = size * np.asarray(points)[:, columns], np.asarray(turns)[:, columns]
    if kind == "jump":
        place[..., 1] += 0.5 * np.abs(np.sin(3.0 * np.arange(frames) / RATE))[:, None]
    heading = quaternion_exp(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
    place = np.asarray(quaternion_rotate(heading, place)) + np.array([*rng.uniform(-2, 2, 2), 0.0])[[0, 2, 1]]
    return Body(kind, np.arange(frames) / RATE, place, np.asarray(quaternion_multiply(heading, rotation)))


def written(right: Observation, world: World) -> Observation:
    """Return an observation as someone wrote it down in a world."""
    seen = exchanged(right) if world.swapped else right
    back = np.asarray(quaternion_conjugate(TURNS[world.up]))
    place = seen.position + np.array([0.0, world.floor, 0.0])
    return replace(
        seen,
        position=np.asarray(quaternion_rotate(back, place)) / UNITS[world.unit],
        rotation=np.asarray(quaternion_multiply(back, seen.rotation)),
        time=seen.time / world.second,
    )


def exchanged(seen: Observation) -> Observation:
    """Return an observation whose wrists have each other's poses."""
    other = {"left_wrist": "right_wrist", "right_wrist": "left_wrist"}
    columns = [seen.points.index(other.get(name, name)) for name in seen.points]
    return replace(seen, position=seen.position[:, columns], rotation=seen.rotation[:, columns])
