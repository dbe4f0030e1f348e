"""Ways in which two hands meet: how each is held, and from where they come together.

In the frame of a meeting the left hand stands on the side of +x, +y is up and +z ahead. The right hand is mirrored as
always and so stands on the side of +x, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

Three = tuple[float, float, float]


@dataclass(frozen=True)
class Hold:
    """How one hand is held: directions of its fingers and of its back, and which of its points is in the middle."""

    fingers: Three
    back: Three
    point: str
    gestures: tuple[str, ...]  # one of them
    beside: float = 0.0  # m from the middle toward the thumb


@dataclass(frozen=True)
class Meeting:
    """A way in which hands meet."""

    name: str
    left: Hold
    right: Hold
    comes: Three  # from where the left hand comes; the right one comes from opposite
    slide: float = 0.008  # m, deviation of where they meet
    again: int = 0  # times at most that they part and meet once more
    rub: bool = False  # … without parting
    closing: str | None = None  # gesture toward which fingers close then, as far as flesh allows
    gap: tuple[float, float] = (0.0, 0.0)  # m between them, from, to
    often: float = 1.0


_FLAT = ("flat", "flat", "relaxed")
_X, _Y = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
_UPRIGHT = Hold((0.0, 1.0, 0.35), _X, "middle1", _FLAT)
_FORWARD = Hold((-0.1, 0.25, 1.0), _X, "middle1", _FLAT)
_FOLDED = Hold((-0.55, 0.5, 0.6), (0.8, 0.35, 0.4), "middle2", ("spread",))
_DOWN = Hold((-0.75, 0.0, 0.65), (0.0, 1.0, 0.0), "middle1", _FLAT)
_UP = Hold((-0.75, 0.0, 0.65), (0.0, -1.0, 0.0), "middle1", ("flat", "relaxed", "spread"))
_FIST = Hold((-1.0, 0.0, 0.4), (0.3, 0.9, 0.3), "middle1", ("fist", "fist_thumb_beside"))
_INDEX = Hold((-1.0, 0.1, 0.5), (0.3, 0.8, 0.4), "index_tip", ("one", "thumb_one"))
_PINCH = Hold((-0.8, -0.1, 0.7), (0.4, 0.8, 0.3), "index_tip", ("pinch_index", "pinch_middle", "key"))
_POKING = Hold((-0.5, -0.8, 0.4), (0.2, 0.4, 0.8), "index_tip", ("one", "thumb_one", "pinch_index"))
_HOLDING = Hold((-0.2, 0.2, 1.0), (0.9, -0.2, 0.2), "middle1", ("ball", "cylinder", "spread", "flat", "claw"))
_STEEPLE = Hold((-0.15, 1.0, 0.5), _X, "middle_tip", ("ball", "ball", "claw"))

MEETINGS = (
    Meeting("palms", _UPRIGHT, _UPRIGHT, _X),
    Meeting("rubbing", _FORWARD, _UPRIGHT, _X, slide=0.025, again=4, rub=True),
    Meeting("clapping", _FORWARD, replace(_FORWARD, fingers=(-0.1, 0.6, 0.9)), _X, again=7),
    Meeting("fingertips", _STEEPLE, _STEEPLE, _X, slide=0.003),
    Meeting("interlaced", _FOLDED, replace(_FOLDED, beside=0.012), _X, slide=0.004, closing="hook", often=1.5),
    Meeting("clasped", _FORWARD, _UPRIGHT, _X, closing="cylinder"),
    Meeting("left_over", _DOWN, _DOWN, (0.0, 1.0, 0.0), slide=0.02, again=1),
    Meeting("right_over", _DOWN, _DOWN, _Y, slide=0.02, again=1),
    Meeting("fist_in_palm", _FORWARD, _FIST, _X, slide=0.012, again=2),
    Meeting("palm_on_fist", _FIST, _FORWARD, _X, slide=0.012, again=2),
    Meeting("index_fingers", _INDEX, _INDEX, _X, slide=0.003),
    Meeting("pinches", _PINCH, _PINCH, _X, slide=0.006, again=3, often=1.5),
    Meeting("on_palm", _UP, _POKING, _Y, slide=0.025, again=4),
    Meeting("from_palm", _POKING, _UP, (0.0, 1.0, 0.0), slide=0.025, again=4),
    Meeting("holding", _HOLDING, _HOLDING, _X, slide=0.03, gap=(0.02, 0.3), often=3.0),
)
