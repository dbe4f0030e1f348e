"""Feet that stand: held in place along the floor, and on the floor, never under it."""

from dataclasses import dataclass, field

import numpy as np

from .vectors import length

HOLD, RELEASE = 0.5, 0.1  # probability of contact from which a foot is held, and let go
SURE = 0.7  # probability of contact from which a foot is put on the floor entirely
FADE = 0.16  # s in which half of what a released foot was held back by fades
DRAG = 0.04  # m: a foot that its leg drags farther slides along
DRAG_STILL = 0.12  # m: so far, if both feet stand for a while
LEAK = 6.0  # s in which half of what a standing foot is held back by is given up
SETTLE = 0.06  # s in which half of a foot's height over the floor is taken away
SOLE = 0.01  # m: a foot that is over its rest height by less stands: recorded feet do
FLAT_FROM = 0.15  # s: a foot that stands on its heel for longer is flat on the floor
FLAT_UNTIL = 0.3  # probability of an ankle's contact until which it goes on to be flat
STILL = 0.6  # of SOLE: what is left out for those who stand still
REACH = 0.25  # m: a foot is moved no farther up or down to the floor


@dataclass
class Foot:
    """One foot as it would be without the floor."""

    ankle: np.ndarray  # m, from base
    ball: np.ndarray
    toe: np.ndarray
    ankle_rest: float  # m, heights over the floor in the rest pose
    ball_rest: float
    ankle_contact: float  # probability
    ball_contact: float
    seen: bool  # a point of the foot is measured: it is where it is

    def part(self, name: str) -> tuple[np.ndarray, float, float]:
        """Place, height at rest and probability of contact of the ankle or the ball."""
        if name == "ankle":
            return self.ankle, self.ankle_rest, self.ankle_contact
        return self.ball, self.ball_rest, self.ball_contact


@dataclass
class FootState:
    """The memory of a foot."""

    held: str = ""  # "ankle" or "ball", by which the foot is held; empty: free
    anchor: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m, from base: where the held part stands
    slide: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m, along the floor: how far it is held back
    stood: float = 0.0  # s since the ankle rests on the floor
    drop: float = 0.0  # m: how far the foot is lowered onto the floor; below 0: raised

    @property
    def flatness(self) -> float:
        """How flat the foot is on the floor, 0 to 1."""
        return float(np.clip((self.stood - FLAT_FROM) / FLAT_FROM, 0, 1))


def too_high(height: float, rest: float, floor: float, sole: float) -> float:
    """How far a part of a foot is too high to stand, or too low: below 0 (m). It may be `sole` over its rest."""
    over = height - rest - floor
    return over - float(np.clip(over, 0, sole))


def holding(foot: Foot, before: str) -> str:
    """Which part holds now: the one that held stays as long as it may, then the surer one."""
    if foot.seen:
        return ""
    if before and foot.part(before)[2] >= RELEASE:
        return before
    if max(foot.ankle_contact, foot.ball_contact) < HOLD:
        return ""
    return "ankle" if foot.ankle_contact > foot.ball_contact + 1e-5 else "ball"


def hold_feet(
    feet: list[Foot], floor: float, interval: float, upright: float, states: list[FootState]
) -> list[np.ndarray]:
    """How far (m) to move each foot so that it stands still, on the floor and not under it.

    `upright` is 1 if the body stands (then one foot at least is on the floor), 0 if it sits, lies or jumps.
    """
    fade, settle = 2 ** (-interval / FADE), 1 - 2 ** (-interval / SETTLE)
    still = min(state.flatness for state in states)
    sole = SOLE * (1 - STILL * still)  # those who stand still stand lower
    drag = DRAG + (DRAG_STILL - DRAG) * still  # and do not step because the prediction sways
    heights = [
        too_high(place[1], rest, floor, sole)
        for foot in feet
        for place, rest, _ in (foot.part("ankle"), foot.part("ball"))
    ]
    hovering = 0.0 if any(foot.seen for foot in feet) else max(min(heights), 0.0)
    moves = []
    for foot, state in zip(feet, states, strict=True):
        part = holding(foot, state.held)
        slide, drop = fade * state.slide, 0.0
        if part:
            place, rest, contact = foot.part(part)
            if part == state.held:
                slide = (state.anchor - place) * 2 ** (-interval / LEAK)
            slide = slide * [1, 0, 1]
            most = max(drag, fade * length(state.slide))
            if length(slide) > most:
                slide = slide * (most / length(slide))
            state.anchor = place + slide
            drop = too_high(place[1], rest, floor, sole)
            drop *= float(np.clip((contact - RELEASE) / (SURE - RELEASE), 0, 1))
        if hovering > 0:
            drop = max(drop, upright * hovering)  # a standing body has a foot on the floor
        rests = foot.ankle_contact >= (FLAT_UNTIL if state.stood > 0 else HOLD) and not foot.seen
        state.stood = state.stood + interval if rests else 0.0
        state.held, state.slide = part, slide
        state.drop += settle * (float(np.clip(drop, -REACH, REACH)) - state.drop)
        move = np.zeros(3)
        if foot.seen:
            state.slide, state.drop = np.zeros(3), 0.0
        else:
            lowest = min(foot.ankle[1], foot.ball[1], foot.toe[1]) - state.drop - floor
            under = min(-lowest, 2 * REACH) if lowest < 0 else 0.0
            move = np.array([slide[0], under - state.drop, slide[2]])
        moves.append(move)
    return moves
