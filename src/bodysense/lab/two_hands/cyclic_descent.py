"""Fingers by cyclic coordinate descent: the inverse kinematics that Table 4 of two-hands compares with.

From the joint next to the tip to the finger's base, again and again, each joint turns so that the tip comes as near to
its marker as that joint alone can bring it (Wang and Chen, 1991). A finger has no other marker, so that how it bends is
left to the order of the joints and, where they are given, to limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.hand import FINGERS, HAND_JOINTS, joint_bases
from bodysense.body.rotation import (
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
from bodysense.body.skeleton import Skeleton

_AXIS = np.array([0.0, 0.0, 1.0])  # of a joint's own axes: fingers flex about −z (`body.hand`)


@dataclass(frozen=True)
class FingerLimits:
    """Degrees: of base joints to either side, of the others the flexion (two-hands, section 6.2.2)."""

    flexion: float = 45.0
    abduction: float = 45.0
    twist: float = 20.0
    hinge: tuple[float, float] = (-10.0, 90.0)


def solve_fingers(hand: Skeleton, tips: np.ndarray, limits: FingerLimits | None = None, rounds: int = 30) -> np.ndarray:
    """Points (N, 21, 3) m of hands, from the wrist in its axes, whose fingertips reach for `tips` (N, 5, 3) m.

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
    """The local rotation (N, 5, 4) of one joint of each finger that brings its tip nearest to its goal (N, 5, 3)."""
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
    """Rotations (N, 5, 4) of base joints, their angles about the joints' own axes within limits."""
    own = quaternion_multiply(quaternion_multiply(quaternion_conjugate(basis), turn), basis)
    most = np.radians([limits.flexion, limits.abduction, limits.twist])
    held = euler_to_quaternion(np.clip(quaternion_to_euler(own, "ZYX"), -most, most), "ZYX")
    return quaternion_multiply(quaternion_multiply(basis, held), quaternion_conjugate(basis))


def _hinged(
    turn: np.ndarray, here: np.ndarray, there: np.ndarray, axis: np.ndarray, limits: FingerLimits
) -> np.ndarray:
    """Rotations (N, 5, 4) of hinges after the turn about `axis` (5, 3) from `here` toward `there`, within limits."""
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
