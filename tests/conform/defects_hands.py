"""Defects of hands and gestures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense_conform.subject import Step, Subject

from .conftest import SIDES, about, given_out
from .kit import Kit, defect

FINGERS = ("index", "middle", "ring", "pinky")
ALL = ("thumb", *FINGERS)


def hand(side: str = "left") -> tuple[str, ...]:
    return tuple(f"{side}_{finger}{k}" for finger in ALL for k in ("1", "2", "3", "_tip"))


def curl(*degrees: float, fingers: tuple[str, ...] = FINGERS) -> dict[str, np.ndarray]:
    """Fingers of both hands bent so."""
    return {
        f"{side}_{finger}{k}": about(z=-angle if side == "left" else angle)
        for side in SIDES
        for finger in fingers
        for k, angle in zip((1, 2, 3), degrees, strict=True)
    }


def about_wrist(kit: Kit, change: np.ndarray) -> Subject:
    """The left hand's points moved by a linear map in the wrist's frame."""
    position = kit.clean.position.copy()
    wrist, turn = kit.clean.at("left_wrist")[:, None], kit.clean.turn("left_wrist")[:, None]
    columns = kit.columns(*hand())
    local = quaternion_rotate(quaternion_conjugate(turn), position[:, columns] - wrist)
    position[:, columns] = np.nan_to_num(wrist + quaternion_rotate(turn, local @ change.T))
    return replace(kit.clean, position=position)


@defect("hands.complete")
def _(kit: Kit) -> Subject:
    return kit.without("left_ring2")


@defect("hands.coverage")
def _(kit: Kit) -> Subject:
    return kit.invalid(hand(), np.arange(len(kit.clean)) % 3 > 0)


@defect("hands.longest")
def _(kit: Kit) -> Subject:
    return about_wrist(kit, 1.8 * np.eye(3))


@defect("hands.shortest")
def _(kit: Kit) -> Subject:
    return about_wrist(kit, 0.5 * np.eye(3))


@defect("hands.bone_constancy")
def _(kit: Kit) -> Subject:
    return kit.stretched("left_ring3", 1 + 0.3 * np.sin(0.1 * np.arange(len(kit.clean))))


@defect("hands.proportions")
def _(kit: Kit) -> Subject:
    offset = kit.pose.skeleton.rest_offset.copy()
    for finger in ALL:
        for part in ("2", "3", "_tip"):
            offset[kit.pose.skeleton.index(f"left_{finger}{part}")] *= 0.4
    return given_out(replace(kit.pose, skeleton=kit.pose.skeleton.with_offsets(offset)), kit.steps)


@defect("hands.knuckle_order")
def _(kit: Kit) -> Subject:
    one = kit.columns(*(f"left_middle{k}" for k in ("1", "2", "3", "_tip")))
    two = kit.columns(*(f"left_ring{k}" for k in ("1", "2", "3", "_tip")))
    position = kit.clean.position.copy()
    position[:, [*one, *two]] = position[:, [*two, *one]]
    return replace(kit.clean, position=position)


@defect("hands.thumb_side")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    columns = kit.columns(*(f"left_thumb{k}" for k in ("1", "2", "3", "_tip")))
    across = kit.clean.at("left_pinky1") - kit.clean.at("left_index1")
    position[:, columns] += np.nan_to_num(2.0 * across)[:, None]
    return replace(kit.clean, position=position)


@defect("hands.chirality")
def _(kit: Kit) -> Subject:
    return about_wrist(kit, np.diag([1.0, -1.0, 1.0]))


@defect("hands.wrist_axes")
def _(kit: Kit) -> Subject:
    rotation = kit.clean.rotation.copy()
    columns = kit.columns("left_wrist")
    rotation[:, columns] = quaternion_multiply(rotation[:, columns], quaternion_exp(about(y=60)))
    return replace(kit.clean, rotation=rotation)


@defect("hands.shake")
def _(kit: Kit) -> Subject:
    noise = np.random.default_rng(1).normal(0, 0.004, (len(kit.clean), 1, 3))
    return kit.moved(hand(), noise)


@defect("hands.pop")
def _(kit: Kit) -> Subject:
    return kit.moved(("left_index_tip",), [0.0, 0.0, 0.2], slice(60, 61))


@defect("hands.frozen")
def _(kit: Kit) -> Subject:
    position = kit.clean.position.copy()
    inside = np.flatnonzero(kit.during("fist") | kit.during("pinch_index") | kit.during("pinch_middle"))
    wrist = kit.columns("left_wrist")
    position[np.ix_(inside, wrist)] = position[inside[0], wrist]
    position[np.ix_(inside, kit.columns(*hand()))] += 0.01 * np.sin(np.arange(len(inside)))[:, None, None]
    return replace(kit.clean, position=position)


defect("hands.flat")(lambda kit: kit.set(curl(60, 60, 40), "flat"))
defect("hands.fist")(lambda kit: kit.set(curl(20, 20, 20), "fist"))
STILL = {f"{side}_{part}": about() for side in SIDES for part in ("elbow", "wrist")}
defect("hands.wrist_rotate")(lambda kit: kit.set(STILL, "wrist_rotate"))


def pinch_defects(finger: str) -> None:
    other = FINGERS[(FINGERS.index(finger) + 2) % 4]

    def open_hand(kit: Kit) -> Subject:
        thumb = {f"{side}_thumb{k}": about() for side in SIDES for k in (1, 2, 3)}
        return kit.set(curl(0, 0, 0) | thumb, f"pinch_{finger}")

    def wrong_finger(kit: Kit) -> Subject:
        """The take of another pinch under this label."""
        steps = [Step(f"pinch_{finger}" if s.label == f"pinch_{other}" else s.label, s.start, s.end)
                 for s in kit.steps if s.label != f"pinch_{finger}"]  # fmt: skip
        return kit.script(*steps)

    defect(f"hands.pinch_{finger}")(open_hand)
    defect(f"hands.pinch_{finger}_which")(wrong_finger)


for each in FINGERS:
    pinch_defects(each)
