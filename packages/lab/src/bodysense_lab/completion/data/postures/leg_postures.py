"""Postures of the trunk and the legs: seated, kneeling, crouching, striding, bowing, with random proportions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import default_skeleton

_TALL = 0.95  # m, rest height of the pelvis of the body to which the heights below refer
_KNEE, _SOLE = 0.06, 0.08  # m, heights of a knee on the floor, and of the ankle of a standing foot


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg of a posture, relative to the hip: +Z is forward, and +X is outward, to the left of a left leg."""

    ankle: np.ndarray  # (3,) m; its height is over the floor
    pole: np.ndarray  # (3,) direction of the knee
    toes_down: float  # radians
    toes_out: float  # radians


@dataclass(frozen=True, eq=False)
class LegPosture:
    """Pelvis, trunk and legs of a posture."""

    height: float  # m, of the hips over the floor
    back: float  # m by which the pelvis moves backward
    tilt: float  # radians, of the pelvis, forward
    lean: float  # radians, of the trunk, forward
    legs: tuple[Leg, Leg]


@dataclass(frozen=True)
class _Bones:
    """Lengths of a body that scale postures, m."""

    scale: float  # size of the body relative to that of `_TALL`; no unit
    thigh: float
    shin: float

    @property
    def leg(self) -> float:
        return self.thigh + self.shin

    @classmethod
    def of(cls, offset: np.ndarray) -> _Bones:
        """Return the lengths of a body with rest offsets (65, 3) m."""
        knee, ankle = offset[default_skeleton().indices(["left_knee", "left_ankle"])]
        return cls(float(offset[0, 1]) / _TALL, float(np.linalg.norm(knee)), float(np.linalg.norm(ankle)))


def _degrees(mean: float, deviation: float, rng: np.random.Generator) -> float:
    """Draw a normally distributed angle, given in degrees, and return it in radians."""
    return float(np.radians(rng.normal(mean, deviation)))


def _standing_leg(
    bones: _Bones,
    forward: float,
    sideways: float,
    rng: np.random.Generator,
    *,
    raised: bool = False,
    knees_out: float = 0.0,
) -> Leg:
    """Return a leg whose foot stands flat or, if `raised`, on its ball."""
    heel = float(rng.uniform(0.03, 0.1)) * bones.scale if raised else 0.0
    toes_down = float(np.radians(rng.uniform(15, 45))) if raised else 0.0
    ankle = np.array([sideways, _SOLE * bones.scale + heel, forward])
    return Leg(ankle, np.array([knees_out, 1.0, 0.7]), toes_down, float(np.radians(rng.uniform(-5, 28))))


def _kneeling_leg(bones: _Bones, height: float, sideways: float, rng: np.random.Generator) -> Leg:
    """Return a leg with its knee on the floor and the shin behind it."""
    down = min(height - _KNEE, 0.995 * bones.thigh)
    behind = float(np.sqrt(bones.thigh**2 - down**2)) - 0.99 * bones.shin
    tucked = rng.uniform() < 0.5  # toes on the floor, or the back of the foot
    high, turned = (0.13, rng.uniform(70, 100)) if tucked else (0.06, rng.uniform(145, 175))
    ankle = np.array([sideways, high * bones.scale, behind])
    return Leg(ankle, np.array([0.0, -0.6, 1.0]), float(np.radians(turned)), 0.0)


def _foot_spread(bones: _Bones, rng: np.random.Generator) -> float:
    """Draw the distance of a foot outward from its hip, m."""
    return float(rng.uniform(-0.05, 0.22)) * bones.scale


def _in_random_order(front: Leg, rear: Leg, rng: np.random.Generator) -> tuple[Leg, Leg]:
    return (front, rear) if rng.uniform() < 0.5 else (rear, front)


def _chair_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    height, out = float(rng.uniform(0.26, 0.72)) * bones.scale, _foot_spread(bones, rng)
    reach = float(np.sqrt(max(0.02, (0.97 * bones.leg) ** 2 - (height - _SOLE * bones.scale) ** 2)))
    forward, spread = float(rng.uniform(0.12, max(0.2, reach))), float(rng.uniform(-0.1, 0.5))
    unlike = 0.18 if rng.uniform() < 0.25 else 0.03

    def leg() -> Leg:
        ahead = float(np.clip(forward + rng.normal(0, unlike), 0.05, reach))
        raised = bool(rng.uniform() < 0.2)
        return _standing_leg(bones, ahead, out + float(rng.normal(0, 0.03)), rng, raised=raised, knees_out=spread)

    back = float(rng.uniform(0.2, 0.5)) * bones.scale
    return LegPosture(height, back, _degrees(-8, 10, rng), _degrees(4, 9, rng), (leg(), leg()))


def _floor_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    """Draw a posture on the floor, cross-legged or with the legs in front."""
    crossed, out = rng.uniform() < 0.55, _foot_spread(bones, rng)
    forward = float(rng.uniform(0.3, 0.96)) * bones.leg

    def leg() -> Leg:
        if not crossed:
            return _standing_leg(bones, float(np.clip(forward + rng.normal(0, 0.1), 0.25, 0.97 * bones.leg)), out, rng)
        ankle = np.array([rng.uniform(-0.22, -0.02), 0.07, rng.uniform(0.16, 0.34)]) * bones.scale
        pole = np.array([1.0, rng.uniform(0.1, 0.5), 0.35])
        return Leg(ankle, pole, float(np.radians(rng.uniform(10, 50))), float(np.radians(rng.uniform(20, 60))))

    height, back = float(rng.uniform(0.08, 0.2)) * bones.scale, float(rng.uniform(0, 0.4))
    return LegPosture(height, back, _degrees(-22, 10, rng), _degrees(12, 10, rng), (leg(), leg()))


def _kneeling_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    """Draw a posture on both knees, from sitting on the heels to upright."""
    height, out = float(rng.uniform(0.2 * bones.scale, bones.thigh + _KNEE)), _foot_spread(bones, rng)
    legs = _kneeling_leg(bones, height, out, rng), _kneeling_leg(bones, height + float(rng.normal(0, 0.01)), out, rng)
    return LegPosture(height, 0.0, _degrees(0, 8, rng), _degrees(5, 10, rng), legs)


def _half_kneeling_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    height = float(rng.uniform(0.32 * bones.scale, bones.thigh + _KNEE))
    front = _standing_leg(bones, float(rng.uniform(0.2, 0.5)) * bones.scale, _foot_spread(bones, rng), rng)
    legs = _in_random_order(front, _kneeling_leg(bones, height, 0.02, rng), rng)
    return LegPosture(height, 0.0, _degrees(3, 8, rng), _degrees(8, 10, rng), legs)


def _lunge_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    height = float(rng.uniform(0.45, 0.75)) * bones.scale
    front = _standing_leg(bones, float(rng.uniform(0.25, 0.55)) * bones.scale, 0.02, rng)
    ankle = np.array([0.02, 0.14 * bones.scale, -float(rng.uniform(0.3, 0.6)) * bones.scale])
    rear = Leg(ankle, np.array([0.0, -0.5, 1.0]), float(np.radians(rng.uniform(35, 65))), 0.0)
    return LegPosture(height, 0.0, _degrees(8, 8, rng), _degrees(8, 10, rng), _in_random_order(front, rear, rng))


def _crouch_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    height, back = float(rng.uniform(0.18, 0.72)) * bones.scale, float(rng.uniform(0.0, 0.2)) * bones.scale
    raised, spread, out = bool(rng.uniform() < 0.5), float(rng.uniform(0.0, 0.8)), _foot_spread(bones, rng)
    forward = back + float(rng.uniform(-0.02, 0.1)) * bones.scale

    def leg() -> Leg:
        return _standing_leg(bones, forward + float(rng.normal(0, 0.04)), out, rng, raised=raised, knees_out=spread)

    tilt, lean = np.radians(rng.uniform(5, 35)), np.radians(rng.uniform(10, 55))
    return LegPosture(height, back, float(tilt), float(lean), (leg(), leg()))


def _stride_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    """Draw an upright stance with one foot in front of the other."""
    ahead, behind = float(rng.uniform(0.05, 0.35)) * bones.scale, float(rng.uniform(-0.35, 0.0)) * bones.scale
    reach = float(np.sqrt((rng.uniform(0.96, 0.995) * bones.leg) ** 2 - max(ahead, -behind) ** 2))
    raised, out = bool(rng.uniform() < 0.3), _foot_spread(bones, rng)
    front, rear = _standing_leg(bones, ahead, out, rng), _standing_leg(bones, behind, out, rng, raised=raised)
    return LegPosture(
        reach + _SOLE * bones.scale, 0.0, _degrees(0, 5, rng), _degrees(2, 5, rng), _in_random_order(front, rear, rng)
    )


def _bow_posture(bones: _Bones, rng: np.random.Generator) -> LegPosture:
    """Draw a bow with straight legs, the hips behind the feet."""
    back, out = float(rng.uniform(0.03, 0.2)) * bones.scale, _foot_spread(bones, rng)
    reach = float(np.sqrt((rng.uniform(0.97, 0.997) * bones.leg) ** 2 - back**2))
    legs = _standing_leg(bones, back, out, rng), _standing_leg(bones, back + float(rng.normal(0, 0.02)), out, rng)
    tilt, lean = np.radians(rng.uniform(10, 65)), np.radians(rng.uniform(5, 45))
    return LegPosture(reach + _SOLE * bones.scale, back, float(tilt), float(lean), legs)


_POSTURES = {
    "stride": _stride_posture,
    "bow": _bow_posture,
    "chair": _chair_posture,
    "floor": _floor_posture,
    "kneeling": _kneeling_posture,
    "half kneeling": _half_kneeling_posture,
    "lunge": _lunge_posture,
    "crouch": _crouch_posture,
}


def draw_posture(kind: str, offset: np.ndarray, rng: np.random.Generator) -> LegPosture:
    """Draw a posture of a kind for a body with rest offsets (65, 3) m."""
    return _POSTURES[kind](_Bones.of(offset), rng)
