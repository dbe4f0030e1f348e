"""The paper's baselines of markers (section 3.2.1), and inverse kinematics of fingers (section 6.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.hand import FINGERS, HAND_JOINTS, joint_bases
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.gap_fillers import MARKER_COUNT, missing
from bodysense.geometry.rotation import (
    cross,
    dot,
    euler_to_quaternion,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_identity,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_euler,
    shortest_arc,
)


@dataclass(frozen=True)
class LastKnown:
    """Keep a hidden marker at its last known position."""

    def start(self, hands: int) -> np.ndarray:
        """Return the state without known markers: all NaN."""
        return np.full((hands, MARKER_COUNT, 3), np.nan)

    def fill(self, markers: np.ndarray, interval: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `GapFiller`."""
        filled = np.where(np.isnan(markers), state, markers)
        return filled, filled


class AverageState(NamedTuple):
    """The last output, velocities, and recent steps: (interval, step, whether known)."""

    place: np.ndarray  # (H, 9, 3) m
    velocity: np.ndarray  # (H, 9, 3) m/s
    known: np.ndarray  # (H, 9) bool
    steps: tuple[tuple[float, np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class MovingAverage:
    """Move a hidden marker with its mean velocity over the last `seconds` in which it was known."""

    seconds: float = 1 / 3

    def start(self, hands: int) -> AverageState:
        """Nothing known."""
        shape = (hands, MARKER_COUNT, 3)
        return AverageState(np.full(shape, np.nan), np.zeros(shape), np.zeros(shape[:2], dtype=bool), ())

    def fill(self, markers: np.ndarray, interval: float, state: AverageState) -> tuple[np.ndarray, AverageState]:
        """See `GapFiller`."""
        known = ~missing(markers)
        filled = np.where(known[..., None], markers, state.place + interval * state.velocity)
        both = (known & state.known)[..., None]
        steps = (*state.steps, (interval, np.where(both, filled - state.place, 0.0), both))
        while len(steps) > 1 and sum(step[0] for step in steps) > self.seconds + 1e-9:
            steps = steps[1:]
        time = sum(step[0] * step[2] for step in steps)
        mean = sum(step[1] for step in steps) / np.where(time > 0, time, 1.0)
        return filled, AverageState(filled, np.where(known[..., None], mean, state.velocity), known, steps)


class AffineState(NamedTuple):
    """The last complete frame, which markers were known in it and in the one before, and the weights in use."""

    place: np.ndarray  # (H, 9, 3) m
    known: np.ndarray  # (H, 9) bool
    before: np.ndarray  # (H, 9) bool
    weights: np.ndarray  # (H, 9, 9)


@dataclass(frozen=True)
class AffineCombination:
    """A hidden marker is the affine combination of the known ones that it was in the frame before it was hidden.

    Equations 3 to 8. Weights are those of the frame before the last change of known markers; a marker that comes back
    takes part from its second frame on. Coordinates are taken from the known markers' mean, so that nothing depends on
    the origin. Needs one known marker.
    """

    regularization: float = 1e-8  # m², λ

    def start(self, hands: int) -> AffineState:
        """Nothing known."""
        known = np.zeros((hands, MARKER_COUNT), dtype=bool)
        place = np.full((hands, MARKER_COUNT, 3), np.nan)
        return AffineState(place, known, known, np.zeros((hands, MARKER_COUNT, MARKER_COUNT)))

    def fill(self, markers: np.ndarray, interval: float, state: AffineState) -> tuple[np.ndarray, AffineState]:
        """See `GapFiller`."""
        hidden = missing(markers)
        known = ~hidden
        if not hidden.any():
            return markers, AffineState(markers, known, state.known, state.weights)
        used = known & state.known
        changed = ((known != state.known) | (state.known & ~state.before)).any(axis=1)
        weights = state.weights
        if changed.any():
            weights = np.where(changed[:, None, None], self._weights(state.place, used), weights)
        center = _mean(markers, used)
        guess = weights @ np.where(used[..., None], markers - center, 0.0) + center
        guess[~used.any(axis=1) | np.isnan(state.place[..., 0]).any(axis=1)] = np.nan
        filled = np.where(known[..., None], markers, guess)
        return filled, AffineState(filled, known, state.known, weights)

    def _weights(self, place: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Return weights (H, 9, 9) of each marker, 0 for unused ones: equation 8 in its 4 × 4 form."""
        of = np.concatenate([np.nan_to_num(place - _mean(place, used)), np.ones_like(place[..., :1])], axis=-1)
        by = of * used[..., None]
        normal = by.swapaxes(1, 2) @ by + self.regularization * np.eye(4)
        return of @ np.linalg.solve(normal, by.swapaxes(1, 2))


def _mean(markers: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return the mean (H, 1, 3) m of the markers used; 0 if no marker is used."""
    weight = used / np.maximum(used.sum(axis=1), 1)[:, None]
    return weight[:, None] @ np.where(used[..., None], markers, 0.0)


_AXIS = np.array([0.0, 0.0, 1.0])  # of a joint's own axes: fingers flex about −z (`body.hand`)


@dataclass(frozen=True)
class FingerLimits:
    """Limits in degrees: of base joints to either side, of hinges the flexion (two-hands, section 6.2.2)."""

    flexion: float = 45.0
    abduction: float = 45.0
    twist: float = 20.0
    hinge: tuple[float, float] = (-10.0, 90.0)


def solve_fingers(hand: Skeleton, tips: np.ndarray, limits: FingerLimits | None = None, rounds: int = 30) -> np.ndarray:
    """Solve for points (N, 21, 3) m, from the wrist in its axes, whose fingertips reach for `tips` (N, 5, 3) m.

    Starts from the flat hand. Without limits every joint is a ball; with them the outer ones are hinges. `tips` are in
    the order of `body.hand.FINGERS`.
    """
    chains = np.stack([hand.indices([f"{finger}{k}" for k in ("1", "2", "3", "_tip")]) for finger in FINGERS])
    joints = [[HAND_JOINTS.index(f"{finger}{k}") - 1 for k in (1, 2, 3)] for finger in FINGERS]
    bones, bases = hand.rest_offset[chains], np.array(joint_bases())[joints]
    turns = np.zeros((len(tips), len(FINGERS), 3, 4))
    turns[..., 0] = 1.0
    for _ in range(rounds):
        for joint in (2, 1, 0):
            turns[:, :, joint] = _turned(turns, joint, bones, bases[:, joint], tips, limits)
    points = np.zeros((len(tips), len(hand.points), 3))
    points[:, chains] = _places(turns, bones)[0]
    return points


def _turned(
    turns: np.ndarray, joint: int, bones: np.ndarray, basis: np.ndarray, goal: np.ndarray, limits: FingerLimits | None
) -> np.ndarray:
    """Return local rotations (N, 5, 4) of one joint of each finger that bring its tip nearest to its goal (N, 5, 3)."""
    places, world = _places(turns, bones)
    parent = world[:, :, joint - 1] if joint else quaternion_identity(places[:, :, 0])
    into = quaternion_conjugate(parent)
    here, there = (quaternion_rotate(into, end - places[:, :, joint]) for end in (places[:, :, -1], goal))
    before = turns[:, :, joint]
    if limits is None or not joint:
        turned = quaternion_multiply(shortest_arc(here, there), before)
        return turned if limits is None else _held(turned, basis, limits)
    return _hinged(before, here, there, quaternion_rotate(basis, np.broadcast_to(_AXIS, (len(FINGERS), 3))), limits)


def _held(turn: np.ndarray, basis: np.ndarray, limits: FingerLimits) -> np.ndarray:
    """Clip rotations (N, 5, 4) of base joints to limits of the angles about the joints' own axes."""
    own = quaternion_multiply(quaternion_multiply(quaternion_conjugate(basis), turn), basis)
    most = np.radians([limits.flexion, limits.abduction, limits.twist])
    held = euler_to_quaternion(np.clip(quaternion_to_euler(own, "ZYX"), -most, most), "ZYX")
    return quaternion_multiply(quaternion_multiply(basis, held), quaternion_conjugate(basis))


def _hinged(
    turn: np.ndarray, here: np.ndarray, there: np.ndarray, axis: np.ndarray, limits: FingerLimits
) -> np.ndarray:
    """Turn hinges about `axis` (5, 3) from `here` toward `there`, within limits; return rotations (N, 5, 4)."""
    here, there = here - dot(here, axis) * axis, there - dot(there, axis) * axis
    more = np.arctan2(dot(cross(here, there), axis), dot(here, there))
    before = 2 * np.arctan2(dot(turn[..., 1:], axis), turn[..., :1])
    angle = (before + more + np.pi) % (2 * np.pi) - np.pi
    low, high = np.radians(limits.hinge)
    return quaternion_exp(np.clip(angle, -high, -low) * axis)


def _places(turns: np.ndarray, bones: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints and tips (N, 5, 4, 3) m of fingers and how the joints are turned (N, 5, 3, 4), in the hand's axes."""
    place, world = np.broadcast_to(bones[:, 0], (*turns.shape[:2], 3)), turns[:, :, 0]
    places, worlds = [place], [world]
    for joint in range(1, 4):
        place = place + quaternion_rotate(world, np.broadcast_to(bones[:, joint], place.shape))
        places.append(place)
        if joint < 3:
            world = quaternion_multiply(world, turns[:, :, joint])
            worlds.append(world)
    return np.stack(places, axis=2), np.stack(worlds, axis=2)
