"""Contact of a body with itself (Parger et al. 2021, UNOC, section 3): enlarged primitives that interpenetrate.

The paper says neither by how much it enlarges them nor which bones it calls adjacent. Here the trunk, from pelvis to
head with the collars, is one bone, and so is a hand; bones are adjacent if they meet or hang on the same bone, as the
thighs do on the trunk. A box counts as the rounded slab of parallel capsules that fills it, so that every test is one
of two capsules.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bodysense.body.capsules import Primitives, fit_primitives
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.rays import segment_distance_squared
from bodysense.geometry.rotation import quaternion_to_matrix

_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar")
_CAPSULES_IN_BOX = 3
_BLOCK = 128  # frames at a time


@dataclass(frozen=True, eq=False)
class ContactPrediction:
    """Where a body touches itself."""

    body: np.ndarray  # (...) bool: two bones of trunk, head, arms or legs touch (the paper's self-contact)
    hand: np.ndarray  # (...) bool: a hand touches the other one or the body (the paper's hand-body contact)


def self_contact(pose: Pose, margin: float = 0.005) -> ContactPrediction:
    """Whether a body, with any leading axes, touches itself; every primitive is enlarged by `margin` (m).

    Raises BodysenseError for a skeleton of another tree than the default body's.
    """
    position, rotation = (np.asarray(part) for part in forward_kinematics(pose))
    batch = position.shape[:-2]
    position = position.reshape(-1, *position.shape[-2:])
    rotation = rotation.reshape(-1, *rotation.shape[-2:])
    capsules = _capsules(fit_primitives(pose.skeleton))
    pairs = _pairs()
    body, hand = np.zeros((2, len(position)), dtype=bool)
    for first in range(0, len(position), _BLOCK):
        block = slice(first, first + _BLOCK)
        touching = _touching(capsules, position[block], rotation[block], pairs, margin)
        frame, pair = np.nonzero(touching)
        body[first + frame[~pairs.of_hand[pair]]] = True
        hand[first + frame[pairs.of_hand[pair]]] = True
    return ContactPrediction(body.reshape(batch), hand.reshape(batch))


@dataclass(frozen=True, eq=False)
class _Capsules:
    """Capsules alone, in the frames of the joints that carry them."""

    joint: np.ndarray  # (K,)
    start: np.ndarray  # (K, 3) m
    end: np.ndarray  # (K, 3) m
    radius: np.ndarray  # (K,) m


@lru_cache(maxsize=64)
def _capsules(primitives: Primitives) -> _Capsules:
    """The primitives with every box filled by capsules as thick as it, side by side along its longest side."""
    joint = list(primitives.joint[: len(primitives.radius)])
    start, end, radius = list(primitives.start), list(primitives.end), list(primitives.radius)
    boxes = primitives.joint[len(primitives.radius) :]
    for carrier, center, half_size in zip(boxes, primitives.center, primitives.half_size, strict=True):
        thin, broad, long = np.argsort(half_size)
        thickness = half_size[thin]
        spread = half_size[broad] - thickness
        along = np.eye(3)[long] * (half_size[long] - thickness)
        for offset in np.linspace(-spread, spread, _CAPSULES_IN_BOX):
            middle = center + np.eye(3)[broad] * offset
            joint, radius = [*joint, carrier], [*radius, thickness]
            start, end = [*start, middle - along], [*end, middle + along]
    return _Capsules(np.array(joint), np.array(start), np.array(end), np.array(radius))


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of capsules whose bones are not adjacent."""

    first: np.ndarray  # (M,)
    second: np.ndarray  # (M,)
    of_hand: np.ndarray  # (M,) bool: one of the two belongs to a hand


@lru_cache(maxsize=1)
def _pairs() -> _Pairs:
    """The pairs that `self_contact` tests, the same for all skeletons."""
    skeleton = default_skeleton()
    joint = _capsules(fit_primitives(skeleton)).joint
    parent = np.maximum(skeleton.parents, 0)
    bone = np.arange(len(skeleton.points))
    bone[skeleton.indices(_TRUNK)] = skeleton.index("pelvis")
    for side in ("left", "right"):
        wrist = skeleton.index(f"{side}_wrist")
        bone[skeleton.path[:, wrist] > 0] = wrist
    above = bone[parent[bone]]
    is_hand = np.isin(bone, skeleton.indices(["left_wrist", "right_wrist"]))

    first, second = np.triu_indices(len(joint), k=1)
    a, b = joint[first], joint[second]
    adjacent = (bone[a] == bone[b]) | (above[a] == bone[b]) | (bone[a] == above[b]) | (above[a] == above[b])
    return _Pairs(first[~adjacent], second[~adjacent], (is_hand[a] | is_hand[b])[~adjacent])


def _touching(
    capsules: _Capsules, position: np.ndarray, rotation: np.ndarray, pairs: _Pairs, margin: float
) -> np.ndarray:
    """(F, M) bool: the pairs of enlarged capsules that meet."""
    first, second = pairs.first, pairs.second
    turn = quaternion_to_matrix(rotation)[:, capsules.joint]
    origin = position[:, capsules.joint]
    start = origin + np.einsum("fkij,kj->fki", turn, capsules.start)
    along = np.einsum("fkij,kj->fki", turn, capsules.end - capsules.start)
    radius = capsules.radius + margin

    middle = start + along / 2
    reach = radius + np.linalg.norm(capsules.end - capsules.start, axis=-1) / 2
    squared = np.einsum("fkc,fkc->fk", middle, middle)
    apart = squared[:, :, None] + squared[:, None] - 2 * middle @ middle.swapaxes(1, 2)
    near = apart[:, first, second] < (reach[first] + reach[second]) ** 2
    frame, pair = np.nonzero(near)
    a, b = first[pair], second[pair]
    start, along = np.moveaxis(start, -1, 0), np.moveaxis(along, -1, 0)
    gap = segment_distance_squared(start[:, frame, a], along[:, frame, a], start[:, frame, b], along[:, frame, b])
    near[frame, pair] = gap <= (radius[a] + radius[b]) ** 2
    return near
