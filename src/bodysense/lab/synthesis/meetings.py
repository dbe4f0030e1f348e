"""Ways in which two hands meet: how each is held, and from where they come together.

In the frame of a meeting the left hand stands on the side of +x, +y is up and +z ahead. The right hand is mirrored as
always and so stands on the side of +x, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

Three = tuple[float, float, float]


@dataclass(frozen=True)
class HeldMeeting:
    """How one hand is held: directions of its fingers and of its back, and which of its points is in the middle."""

    fingers: Three
    back: Three
    point: str
    gestures: tuple[str, ...]  # one of them
    beside: float = 0.0  # m from the middle toward the thumb


@dataclass(frozen=True)
class HandMeeting:
    """A way in which hands meet."""

    name: str
    left: HeldMeeting
    right: HeldMeeting
    comes: Three  # from where the left hand comes; the right one comes from opposite
    slide: float = 0.008  # m, deviation of where they meet
    again: int = 0  # times at most that they part and meet once more
    rub: bool = False  # … without parting
    closing: str | None = None  # gesture toward which fingers close then, as far as flesh allows
    gap: tuple[float, float] = (0.0, 0.0)  # m between them, from, to
    often: float = 1.0


_FLAT = ("flat", "flat", "relaxed")
_X, _Y = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
_UPRIGHT = HeldMeeting((0.0, 1.0, 0.35), _X, "middle1", _FLAT)
_FORWARD = HeldMeeting((-0.1, 0.25, 1.0), _X, "middle1", _FLAT)
_FOLDED = HeldMeeting((-0.55, 0.5, 0.6), (0.8, 0.35, 0.4), "middle2", ("spread",))
_DOWN = HeldMeeting((-0.75, 0.0, 0.65), (0.0, 1.0, 0.0), "middle1", _FLAT)
_UP = HeldMeeting((-0.75, 0.0, 0.65), (0.0, -1.0, 0.0), "middle1", ("flat", "relaxed", "spread"))
_FIST = HeldMeeting((-1.0, 0.0, 0.4), (0.3, 0.9, 0.3), "middle1", ("fist", "fist_thumb_beside"))
_INDEX = HeldMeeting((-1.0, 0.1, 0.5), (0.3, 0.8, 0.4), "index_tip", ("one", "thumb_one"))
_PINCH = HeldMeeting((-0.8, -0.1, 0.7), (0.4, 0.8, 0.3), "index_tip", ("pinch_index", "pinch_middle", "key"))
_POKING = HeldMeeting((-0.5, -0.8, 0.4), (0.2, 0.4, 0.8), "index_tip", ("one", "thumb_one", "pinch_index"))
_HOLDING = HeldMeeting((-0.2, 0.2, 1.0), (0.9, -0.2, 0.2), "middle1", ("ball", "cylinder", "spread", "flat", "claw"))
_STEEPLE = HeldMeeting((-0.15, 1.0, 0.5), _X, "middle_tip", ("ball", "ball", "claw"))

MEETINGS = (
    HandMeeting("palms", _UPRIGHT, _UPRIGHT, _X),
    HandMeeting("rubbing", _FORWARD, _UPRIGHT, _X, slide=0.025, again=4, rub=True),
    HandMeeting("clapping", _FORWARD, replace(_FORWARD, fingers=(-0.1, 0.6, 0.9)), _X, again=7),
    HandMeeting("fingertips", _STEEPLE, _STEEPLE, _X, slide=0.003),
    HandMeeting("interlaced", _FOLDED, replace(_FOLDED, beside=0.012), _X, slide=0.004, closing="hook", often=1.5),
    HandMeeting("clasped", _FORWARD, _UPRIGHT, _X, closing="cylinder"),
    HandMeeting("left_over", _DOWN, _DOWN, (0.0, 1.0, 0.0), slide=0.02, again=1),
    HandMeeting("right_over", _DOWN, _DOWN, _Y, slide=0.02, again=1),
    HandMeeting("fist_in_palm", _FORWARD, _FIST, _X, slide=0.012, again=2),
    HandMeeting("palm_on_fist", _FIST, _FORWARD, _X, slide=0.012, again=2),
    HandMeeting("index_fingers", _INDEX, _INDEX, _X, slide=0.003),
    HandMeeting("pinches", _PINCH, _PINCH, _X, slide=0.006, again=3, often=1.5),
    HandMeeting("on_palm", _UP, _POKING, _Y, slide=0.025, again=4),
    HandMeeting("from_palm", _POKING, _UP, (0.0, 1.0, 0.0), slide=0.025, again=4),
    HandMeeting("holding", _HOLDING, _HOLDING, _X, slide=0.03, gap=(0.02, 0.3), often=3.0),
)
