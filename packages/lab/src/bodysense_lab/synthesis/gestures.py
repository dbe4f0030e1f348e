"""Key poses of a hand in its 26 degrees of freedom: a table of gestures, and random poses around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from bodysense.body.hands.hand import FINGERS, FREEDOMS, limits

Four = tuple[float, float, float, float]  # of index, middle, ring and little finger
Place = Literal["tip", "back", "side"]  # of a finger: its tip, the back or the thumb's side of its middle segment

STRAIGHT: Four = (2.0, 2.0, 4.0, 5.0)
LAST_OF_MIDDLE = 2 / 3  # flexion of a finger's last joint per flexion of its middle joint (Rijpkema and Girard, 1991)
_SPREAD = np.array([-14.0, -1.0, 10.0, 20.0])  # abduction, degrees, of fingers spread wide
_ROLL = np.array([-0.10, -0.02, 0.0, 0.10])  # twist of a finger per flexion of its base joint: the palm folds


@dataclass(frozen=True)
class Gesture:
    """A hand gesture; angles in degrees."""

    name: str
    base: Four  # flexion of the fingers' first joints
    middle: Four  # of their middle joints; the last ones follow
    # Flexion, abduction and twist of the thumb's base, and flexion of its two other joints.
    thumb: tuple[float, float, float, float, float]
    spread: float = 0.0  # 0 closed, 1 wide
    touch: tuple[int, Place] | None = None  # the finger, 0 to 3, that the thumb's tip touches, and the place on it
    weight: float = 1.0  # relative frequency


_OPEN, _ALONG, _RELAXED = (-18.0, 20.0, 0.0, 0.0, -5.0), (15.0, 32.0, 0.0, 5.0, 0.0), (10.0, 5.0, 10.0, 10.0, 12.0)
_OPPOSED, _ACROSS, _OVER = (
    (22.0, -18.0, 22.0, 16.0, 22.0),
    (42.0, 0.0, 25.0, 35.0, 45.0),
    (25.0, -25.0, 30.0, 25.0, 45.0),
)


def _fist(*straight: int) -> tuple[Four, Four]:
    """Return the flexion of base and middle joints with all fingers folded except the `straight` ones."""

    def four(folded: Four) -> Four:
        a, b, c, d = (STRAIGHT[k] if k in straight else folded[k] for k in range(4))
        return a, b, c, d

    return four((76.0, 82.0, 82.0, 80.0)), four((96.0, 100.0, 98.0, 94.0))


def _pinch(finger: int, others: float) -> Gesture:
    """Return a pinch of thumb and `finger`; the other fingers are flexed by a share `others` of its flexion."""

    def four(flexion: Four) -> Four:
        a, b, c, d = (flexion[k] * (1.0 if k == finger else others) for k in range(4))
        return a, b, c, d

    base, middle = four((46.0, 46.0, 48.0, 52.0)), four((48.0, 51.0, 54.0, 57.0))
    return Gesture(f"pinch_{FINGERS[1 + finger]}", base, middle, _OPPOSED, 0.3, (finger, "tip"), 0.7)


GESTURES = (
    Gesture("flat", STRAIGHT, (0.0, 0.0, 0.0, 0.0), _ALONG, weight=1.5),
    Gesture("spread", (-4.0, -4.0, -4.0, -4.0), STRAIGHT, _OPEN, 1.0, weight=1.5),
    Gesture("relaxed", (15.0, 20.0, 23.0, 25.0), (25.0, 26.0, 28.0, 28.0), _RELAXED, 0.2, weight=3.0),
    Gesture("fist", *_fist(), _OVER, touch=(1, "back"), weight=1.5),
    Gesture("fist_thumb_beside", *_fist(), _ALONG, touch=(0, "side")),
    Gesture("thumb_up", *_fist(), (-22.0, 5.0, 0.0, -8.0, -12.0)),
    Gesture("one", *_fist(0), _OVER, touch=(1, "back"), weight=1.5),
    Gesture("thumb_one", *_fist(0), _OPEN),
    Gesture("two", *_fist(0, 1), _OVER, 0.6, (2, "back")),
    Gesture("thumb_two", *_fist(0, 1), _OPEN, 0.5),
    Gesture("three", *_fist(0, 1, 2), _ACROSS, 0.5),
    Gesture("four", STRAIGHT, STRAIGHT, _ACROSS, 0.5),
    Gesture("horns", *_fist(0, 3), _OVER, 0.3, (1, "back")),
    Gesture("little_finger", *_fist(3), _OVER, 0.3, (1, "back"), 0.5),
    Gesture("crossed", (-6.0, 36.0, 82.0, 80.0), (4.0, 10.0, 98.0, 94.0), _OVER, -1.0, (2, "back")),
    Gesture("claw", (-2.0, 0.0, 2.0, 4.0), (62.0, 66.0, 64.0, 60.0), _OPPOSED, 0.6),
    Gesture("hook", (4.0, 4.0, 6.0, 8.0), (92.0, 95.0, 92.0, 90.0), _ALONG),
    Gesture("table", (72.0, 76.0, 76.0, 74.0), (6.0, 6.0, 8.0, 8.0), _OPPOSED),
    Gesture("cylinder", (44.0, 48.0, 50.0, 52.0), (46.0, 48.0, 48.0, 46.0), _OPPOSED, 0.3, weight=1.5),
    Gesture("ball", (24.0, 26.0, 28.0, 30.0), (34.0, 36.0, 36.0, 34.0), _OPPOSED, 0.9),
    Gesture("key", (48.0, 56.0, 62.0, 66.0), (62.0, 70.0, 74.0, 74.0), (12.0, 22.0, 8.0, 15.0, 15.0), 0.0, (0, "side")),
    Gesture("beak", (52.0, 54.0, 54.0, 52.0), (34.0, 34.0, 32.0, 28.0), _OPPOSED, -0.4, (1, "tip")),
    *(_pinch(finger, others) for finger in range(4) for others in (0.1, 0.55, 1.0)),
)
NAMES = tuple(gesture.name for gesture in GESTURES)
_FREE = 0.25  # share of poses that are no gesture: each finger is drawn independently
# Deviations of neighbouring fingers correlate, ring and little finger most (Häger-Ross and Schieber, 2000).
_TOGETHER = np.linalg.cholesky(
    np.array([[1.0, 0.4, 0.2, 0.1], [0.4, 1.0, 0.6, 0.4], [0.2, 0.6, 1.0, 0.75], [0.1, 0.4, 0.75, 1.0]])
)


@dataclass(frozen=True, eq=False)
class KeyPoses:
    """K key poses, and the touches that `lab.synthesis.hand_contact` makes in them."""

    angles: np.ndarray  # (K, 26) rad, within the limits
    finger: np.ndarray  # (K,) finger that the thumb's tip touches, 0 to 3; −1: no touch
    place: np.ndarray  # (K,) touched place: 0 the finger's tip, 1 the back and 2 the side of its middle segment


def draw_key_poses(count: int, rng: np.random.Generator) -> KeyPoses:
    """Draw random poses: gestures, more or less complete, and some poses with independent fingers."""
    chance = np.array([gesture.weight for gesture in GESTURES])
    gesture = rng.choice(len(GESTURES), count, p=chance / chance.sum())
    return key_poses(np.where(rng.random(count) < _FREE, -1, gesture), rng)


def key_poses(gesture: np.ndarray, rng: np.random.Generator) -> KeyPoses:
    """Draw random poses around gestures (K,), indices into GESTURES; −1: independent fingers."""
    base, middle, thumb, spread, finger, place = (part[gesture] for part in _gesture_columns())
    count, free = len(gesture), gesture < 0
    touching = finger >= 0
    # Poses are between a relaxed hand and the full gesture. Gestures with touches are complete.
    relaxed = [part[NAMES.index("relaxed")] for part in _gesture_columns()]
    share = np.where(touching, 1.0, rng.uniform(0.55, 1.08, count))[:, None]
    base, middle, thumb = (
        low + share * (part - low) for low, part in zip(relaxed, (base, middle, thumb), strict=False)
    )
    curl = rng.beta(0.8, 0.8, (count, 4)) if count else np.zeros((0, 4))
    curl[:, 3] = 0.35 * curl[:, 3] + 0.65 * curl[:, 2]
    base = np.where(free[:, None], -12 + 95 * np.clip(curl + rng.normal(0, 0.2, (count, 4)), 0, 1), base)
    middle = np.where(free[:, None], 108 * curl, middle)
    lowest = np.array([-25.0, -32.0, -25.0, -15.0, -15.0])
    loose = lowest + rng.random((count, 5)) * (np.array([48.0, 38.0, 45.0, 50.0, 70.0]) - lowest)
    thumb = np.where(free[:, None], loose, thumb)
    spread = np.where(free, rng.uniform(-0.4, 1.0, count), spread + rng.normal(0, 0.12, count))

    calm = np.where(touching, 0.6, 1.0)[:, None]
    base = base + 6 * calm * (rng.normal(size=(count, 4)) @ _TOGETHER.T)
    middle = middle + 7 * calm * (rng.normal(size=(count, 4)) @ _TOGETHER.T)
    last = LAST_OF_MIDDLE * middle + rng.normal(0, 5, (count, 4))
    thumb = thumb + calm * rng.normal(0, 1, (count, 5)) * [5.0, 5.0, 5.0, 5.0, 7.0]
    # Flexed fingers cannot be spread.
    sideways = np.cos(np.radians(np.clip(base, 0, 90))) * (
        spread[:, None] * _SPREAD + rng.normal(0, 1.5, (count, 4)) + 2
    )
    crossed = (gesture == NAMES.index("crossed"))[:, None]
    sideways = np.where(crossed, [12.0, -10.0, 3.0, 3.0], sideways)
    twist = _ROLL * base + rng.normal(0, 3, (count, 4))
    degrees = np.zeros((count, len(FREEDOMS)))
    degrees[:, [0, 1, 2, 3, 5]] = thumb
    degrees[:, 4] = rng.normal(0, 2, count)
    for k, part in enumerate((base, sideways, twist, middle, last)):
        degrees[:, 6 + k :: 5] = part
    low, high = limits()
    return KeyPoses(np.clip(np.radians(degrees), low, high), finger, place)


@lru_cache(maxsize=1)
def _gesture_columns() -> tuple[np.ndarray, ...]:
    """Return the columns of GESTURES. Their last row, at index −1, is a relaxed hand that touches nothing."""
    rows = [*GESTURES, GESTURES[NAMES.index("relaxed")]]
    places = ("tip", "back", "side")
    return (
        *(np.array([getattr(row, name) for row in rows]) for name in ("base", "middle", "thumb", "spread")),
        np.array([-1 if row.touch is None else row.touch[0] for row in rows]),
        np.array([0 if row.touch is None else places.index(row.touch[1]) for row in rows]),
    )
