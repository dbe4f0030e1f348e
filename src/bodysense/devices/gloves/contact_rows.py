"""Linear problem of `contact`: motion of points by a change of a hand, and the smallest change that meets demands."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import combinations, product

import numpy as np

from bodysense.body.hands.hand import FINGERS, HAND_JOINTS, joint_bases
from bodysense.body.hands.hand_capsules import NAMES
from bodysense.devices.gloves.collisions import COUNT
from bodysense.devices.gloves.fingers import HandPoses, HandShape, finger_chains
from bodysense.errors import BodysenseError
from bodysense.geometry.products import cross, to_matrix

_MOST_ROUNDS = 40  # active sets tried before the last solution is returned


@dataclass(frozen=True)
class ContactSettings:
    """Settings of hand contact. Lengths in metres."""

    tolerance: float = 5e-4  # penetration that is ignored
    max_iterations: int = 3  # maximum number of linear steps in a frame
    touching: float = 0.020  # distance of fingertip markers below which the fingertips are brought as close
    apart: float = 0.030  # distance above which fingertips are unchanged; in between they are moved in part
    missed: float = 0.0015  # smaller differences of a distance of fingertips from that of their markers are ignored
    half_life: float = 0.05  # s in which half of an unnecessary correction fades
    speed: float = 0.2  # m/s, maximum speed of a correction: 3.3 mm a frame at 60 Hz
    seen_weight: float = 4.0  # stiffness of a finger or hand with seen markers, relative to unseen ones
    hand_weight: float = 10.0  # stiffness of a whole hand relative to a finger
    keeping: float = 0.005  # fingertips closer than this stay in touch
    nearby: float = 0.005  # gaps narrower than this are kept while others are widened

    def __post_init__(self) -> None:
        for field in fields(self):
            if not getattr(self, field.name) > 0:
                raise BodysenseError(
                    f"contact settings: {field.name} is {getattr(self, field.name):g}; it must be positive"
                )
        if not self.touching < self.apart:
            raise BodysenseError(
                f"contact settings: touching is {self.touching:g} m and apart {self.apart:g} m; apart must be more"
            )


ANGLES, PARTS = 45, 48  # numbers in a change of a hand: three angles of every finger joint; with the wrist's shift
_BASIS = to_matrix(np.array(joint_bases()))  # (15, 3, 3) the hand's axes ← the joint's own, at rest
_JOINTS_OF = np.array([[joint[:-1] == name[:-1] and joint <= name for joint in HAND_JOINTS[1:]] for name in NAMES])
# (C, 48) 0/1: parts of a hand's change that move each capsule: joints before it in its finger, and the wrist.
_PARTS_OF_CAPSULE = np.concatenate([_JOINTS_OF.repeat(3, axis=1), np.ones((COUNT, 3), bool)], axis=1).astype(float)


def growth_rows(
    posed: HandPoses,
    axes: np.ndarray,
    flip: np.ndarray,
    capsule: np.ndarray,
    place: np.ndarray,
    toward: np.ndarray,
) -> np.ndarray:
    """Return how much each part of a change moves pairs of points apart along `toward`: (K, H · 48).

    Args:
        posed: H hands, each in its own mirrored world.
        axes: (H, 15, 3, 3) axes of the joints' angles (`turning_axes`).
        flip: (H, 3) factors from a hand's own world to the world.
        capsule: (2, K) capsules that carry the points; capsule c of hand h is number h · C + c.
        place: (2, K, 3) m, positions of the points in the world.
        toward: (K, 3) directions in the world.
    """
    hands, count = len(flip), len(toward)
    hand = capsule // COUNT
    away = np.stack([-toward, toward]) * flip[hand]
    # A joint at p that turns about a takes a point x along w by a · (x × w) + (p × a) · w.
    wrench = np.concatenate([cross(place * flip[hand], away), away], axis=-1)
    screws = np.zeros((hands, PARTS, 6))
    screws[:, :ANGLES, :3] = axes.reshape(hands, ANGLES, 3)
    screws[:, :ANGLES, 3:] = cross(posed.position[:, 1:16, None], axes).reshape(hands, ANGLES, 3)
    screws[:, ANGLES:, 3:] = np.eye(3)
    parts = (screws[hand] @ wrench[..., None])[..., 0] * _PARTS_OF_CAPSULE[capsule % COUNT]
    rows = np.zeros((count, hands, PARTS))
    for end in (0, 1):
        rows[np.arange(count), hand[end]] += parts[end]
    return rows.reshape(count, -1)


def turning_axes(shape: HandShape, posed: HandPoses, angles: np.ndarray) -> np.ndarray:
    """Return the axes (H, 15, 3, 3) in the world about which each of a joint's `angles` (H, 15, 3) turns.

    The third index is the angle, the last one a component of its axis.
    """
    wrist = to_matrix(posed.rotation[:, 0])[:, None, None]
    _, turned = finger_chains(shape.rest, posed.rotation[:, 1:])
    parent = np.concatenate([np.broadcast_to(wrist, turned[:, :, :1].shape), wrist @ turned[:, :, :2]], axis=2)
    (sf, sa), (cf, ca) = ((of[..., 0], of[..., 1]) for of in (np.sin(angles), np.cos(angles)))
    own = np.zeros((*angles.shape, 3))
    own[..., 0, 2] = -1.0
    own[..., 1, 0], own[..., 1, 1] = sf, cf  # turned by the flexion
    own[..., 2, 0], own[..., 2, 1], own[..., 2, 2] = ca * cf, -ca * sf, -sa  # and by the abduction
    return own @ (parent.reshape(-1, 15, 3, 3) @ _BASIS).swapaxes(-1, -2)


def tip_capsules(tips: np.ndarray) -> np.ndarray:
    """Return the numbers of the capsules that end in fingertips, number hand · 5 + finger."""
    return tips // len(FINGERS) * COUNT + tips % len(FINGERS) * 3 + 2


def tip_pairs(hands: int) -> list[tuple[int, int]]:
    """Return pairs of fingertips that can pinch: a thumb and a finger of its hand, or two of different hands."""
    count = len(FINGERS)
    pairs = [(count * hand, count * hand + finger) for hand in range(hands) for finger in range(1, count)]
    for one, other in combinations(range(hands), 2):
        pairs += [(count * one + a, count * other + b) for a, b in product(range(count), repeat=2)]
    return pairs


def least_change(
    rows: np.ndarray,
    demand: np.ndarray,
    exact: np.ndarray,
    compliance: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    softness: np.ndarray,
) -> np.ndarray:
    """Return the x (N,) that minimises Σ x² / compliance with rows · x ≥ demand, or = demand where `exact`.

    Args:
        rows: (K, N).
        demand: (K,).
        compliance: (N,) of each part; 0 if fixed.
        bounds: (N,), (N,) smallest and largest x, 0 between them; they take precedence over demands.
        softness: (K,) > 0: a demand is missed by softness times the force that it takes.

    Primal-dual active sets (Hintermüller, Ito and Kunisch, 2003): the active demands are solved as equations until the
    active set stays the same. Parts beyond their bounds are then fixed there.
    """
    low, high = bounds
    pushing, stop, stopped = exact | (demand > 0), np.zeros_like(compliance), compliance == 0
    x = stop
    for _ in range(_MOST_ROUNDS):
        eased = rows[pushing] * np.where(stopped, 0.0, compliance)
        matrix = eased @ rows[pushing].T + np.diag(softness[pushing])
        force = np.zeros_like(demand)
        force[pushing] = np.linalg.solve(matrix, demand[pushing] - rows[pushing] @ stop)
        x = stop + force[pushing] @ eased
        before, pushing = pushing, exact | np.where(pushing, force > 0, rows @ x < demand - 1e-12)
        if (pushing == before).all():
            over = ~stopped & ((x < low) | (x > high))
            if not over.any():
                break
            stop, stopped = np.where(over, np.clip(x, low, high), stop), stopped | over
    return np.clip(x, low, high)
