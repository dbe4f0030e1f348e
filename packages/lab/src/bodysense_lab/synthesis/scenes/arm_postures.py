"""Postures of arms: hanging, with controllers, talking, resting, on the hips, crossed, behind the back and head."""

from __future__ import annotations

import numpy as np

from bodysense_lab.synthesis.scenes.moves import Draw
from bodysense_lab.synthesis.scenes.script import ArmPosture

PAIR = tuple[ArmPosture, ArmPosture]


def hanging(draw: Draw) -> PAIR:
    """Arms that hang, with slightly bent elbows."""

    def arm() -> ArmPosture:
        out, ahead = draw.between(0.06, 0.2), draw.between(-0.02, 0.14)
        wrist = (out, -draw.between(0.945, 0.98), ahead)
        return ArmPosture("gravity", wrist, (0.35, 0.0, -1.0), (-1.0, 0.0, -draw.between(0.0, 0.9)), 0.006)

    return arm(), arm()


def with_controllers(draw: Draw) -> PAIR:
    """Hands that hold controllers in front of the body."""
    out, up, ahead = draw.between(0.15, 0.45), draw.between(-0.75, -0.25), draw.between(0.45, 0.75)
    palm = draw.between(0.0, 1.0)

    def arm() -> ArmPosture:
        wrist = (out + draw.between(-0.08, 0.08), up + draw.between(-0.08, 0.08), ahead + draw.between(-0.08, 0.08))
        return ArmPosture("chest", wrist, (0.45, -1.0, -0.4), (palm - 1, -palm, 0.0), draw.between(0.008, 0.05))

    return arm(), arm()


def talking(draw: Draw) -> PAIR:
    """Hands that gesture in front of the body; at times one of them hangs or stays low."""
    first, second = with_controllers(draw)
    lively = draw.between(0.04, 0.1)
    first = ArmPosture(first.frame, first.wrist, first.elbow, first.palm, lively)
    if draw.chance(0.3):
        second = hanging(draw)[1]
    elif draw.chance(0.7):
        second = ArmPosture(second.frame, second.wrist, second.elbow, second.palm, lively)
    return (first, second) if draw.chance(0.5) else (second, first)


def on_hips(draw: Draw) -> PAIR:
    """Hands on the hips, elbows out."""
    out, up, back = draw.between(0.33, 0.4), draw.between(0.28, 0.42), draw.between(-0.12, 0.06)
    elbow = (1.0, draw.between(-0.1, 0.2), -draw.between(0.2, 0.7))
    one = ArmPosture("pelvis", (out, up, back), elbow, (-0.4, -0.6, 0.0), 0.003)
    return one, one


def behind_back(draw: Draw) -> PAIR:
    """Hands that hold each other behind the back."""
    up, back = draw.between(0.05, 0.4), draw.between(-0.32, -0.26)
    elbow = (1.0, 0.0, -draw.between(0.5, 0.9))
    return tuple(ArmPosture("pelvis", (draw.between(0.0, 0.12), up, back + d), elbow, (0.0, 0.2, -1.0), 0.003)
                 for d in (0.0, -0.04))  # type: ignore[return-value]  # fmt: skip


def behind_head(draw: Draw) -> PAIR:
    """Hands behind the head, elbows out."""
    up, elbow = draw.between(0.02, 0.14), (1.0, draw.between(0.0, 0.35), draw.between(-0.2, 0.3))
    one = ArmPosture("head", (0.2, up, -0.2), elbow, (-0.5, 0.0, 1.0), 0.003)
    return one, one


def crossed(draw: Draw) -> PAIR:
    """Arms crossed in front of the chest."""
    up, ahead = draw.between(-0.52, -0.36), draw.between(0.36, 0.44)
    elbow = (0.9, -0.9, 0.1)
    return (
        ArmPosture("chest", (-0.2, up, ahead), elbow, (0.0, -0.3, -1.0), 0.003),
        ArmPosture("chest", (-0.22, up + 0.1, ahead - 0.07), elbow, (0.0, -0.3, -1.0), 0.003),
    )


def folded_in_front(draw: Draw) -> PAIR:
    """Hands that hold each other low in front of the body."""
    up, ahead = draw.between(-0.05, 0.3), draw.between(0.3, 0.45)
    one = ArmPosture("pelvis", (draw.between(0.08, 0.14), up, ahead), (1.0, -0.4, -0.6), (-0.7, 0.0, -0.7), 0.003)
    return one, one


def on_thighs(draw: Draw) -> PAIR:
    """Hands on the thighs of a seated person."""
    along = draw.between(0.45, 0.8)

    def arm() -> ArmPosture:
        wrist = (draw.between(-0.06, 0.06), -along + draw.between(-0.08, 0.08), 0.19)
        return ArmPosture("thigh", wrist, (0.7, 1.0, -0.4), (-0.1, 0.0, -1.0), 0.004)

    return arm(), arm()


def guard(draw: Draw) -> PAIR:
    """Fists in front of the face, as in boxing."""
    one = ArmPosture("chest", (0.22, -0.02, 0.5), (0.5, -1.0, -0.1), (-1.0, 0.0, -0.3), draw.between(0.01, 0.04))
    other = ArmPosture("chest", (0.2, -0.05, draw.between(0.55, 0.9)), one.elbow, one.palm, one.motion)
    return (one, other) if draw.chance(0.5) else (other, one)


def raised(draw: Draw) -> PAIR:
    """One or both hands that reach up or ahead; the other hangs."""
    high, far = np.radians(draw.between(-5, 82)), draw.between(0.7, 1.0)
    wrist = (draw.between(0.0, 0.45), float(far * np.sin(high)), float(far * np.cos(high)))
    up = ArmPosture("chest", wrist, (0.8, -1.0, -0.3), (-0.3, -0.4, 1.0), 0.01)
    other = up if draw.chance(0.35) else hanging(draw)[0]
    return (up, other) if draw.chance(0.5) else (other, up)


EVERYDAY = (hanging, hanging, with_controllers, with_controllers, talking, talking, folded_in_front, on_hips)
SEATED = (on_thighs, on_thighs, with_controllers, talking, crossed)
