"""Other arms on the same body: arms of another recording, and arms that wander from where they were recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bodysense.body.arms import ARM_JOINTS, arm_rotations, with_arms
from bodysense.body.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip

# Degrees by which a joint wanders, one deviation; of fingers every joint. Elbows stay hinges.
_WANDER = {"collar": 2.0, "shoulder": 12.0, "elbow": 4.0, "wrist": 12.0}
_WANDER_FINGER = 4.0
_WAVES, _SLOWEST, _FASTEST = 4, 0.05, 0.6  # Hz, so many sines are added
_HALF = len(ARM_JOINTS) // 2


def with_arms_of(clip: Clip, donors: Sequence[Clip], rng: np.random.Generator) -> Clip:
    """The clip with each arm, hand included, from some stretch of some donor of the same rate, or of its mirror image.

    A donor that is shorter goes back and forth.
    """
    arms = arm_rotations(clip.pose)
    frames = np.arange(len(arms))
    for side in (0, 1):
        theirs = arm_rotations(donors[int(rng.integers(len(donors)))].pose)
        first = rng.integers(max(1, len(theirs) - len(arms) + 1))
        place = (first + frames) % max(1, 2 * len(theirs) - 2)
        place = np.minimum(place, 2 * len(theirs) - 2 - place) if len(theirs) > 1 else place
        other = int(rng.integers(2))
        taken = theirs[place, other * _HALF : (other + 1) * _HALF]
        arms[:, side * _HALF : (side + 1) * _HALF] = taken if other == side else taken * [1.0, 1, -1, -1]
    return replace(clip, pose=with_arms(clip.pose, arms))


def with_wandering_arms(clip: Clip, share: float, rng: np.random.Generator) -> Clip:
    """The clip with every joint of arms and hands turned slowly to and fro, by `share` of what joints wander."""
    spread = np.array([_WANDER.get(name.partition("_")[2], _WANDER_FINGER) for name in ARM_JOINTS])
    shape = (_WAVES, len(ARM_JOINTS), 3)
    rate, phase, size = (
        rng.uniform(_SLOWEST, _FASTEST, shape),
        rng.uniform(0, 2 * np.pi, shape),
        rng.standard_normal(shape),
    )
    wave = np.einsum("tkja,kja->tja", np.sin(2 * np.pi * rate * clip.time[:, None, None, None] + phase), size)
    turn = np.radians(share * spread)[:, None] * wave * np.sqrt(2 / _WAVES)
    arms = quaternion_multiply(arm_rotations(clip.pose), quaternion_exp(turn))
    return replace(clip, pose=with_arms(clip.pose, np.asarray(quaternion_canonical(arms))))
