"""A glove: nine markers on a hand, three of them on its back to find the hand by (two-hands, sections 2.1 and 2.2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from bodysense.body.hand import Side, hand_skeleton
from bodysense.body.pose import Pose, as_like, forward_kinematics
from bodysense.body.rotation import Array, quaternion_rotate
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError

# In the order of the paper's release. The first, second and third are on the back of the hand and move with it.
MARKERS = (
    *("pinky_base", "wrist", "index_base"),
    *("ring_tip", "pinky_tip", "index_tip", "middle_tip", "thumb_middle", "thumb_tip"),
)
ALIGNMENT = (0, 1, 2)
# The template of the release, metres: y toward the wrist, x into the palm, z toward the thumb.
_TEMPLATE = (
    *((-0.0059, -0.0796, -0.0325), (-0.0300, 0.0, 0.0), (-0.0155, -0.0869, 0.0319)),
    *((-0.0006, -0.1787, -0.0125), (0.0037, -0.1562, -0.0293), (-0.0013, -0.1761, 0.0250)),
    *((-0.0052, -0.1889, 0.0067), (-0.0014, -0.0512, 0.0558), (0.0116, -0.1038, 0.0948)),
)


@dataclass(frozen=True, eq=False)
class Glove:
    """Where markers are worn: each at a point of the hand, `offset` from it in the frame of the joint that carries it.

    Offsets are those of a hand whose wrist is `size` m from the tip of its middle finger; on other hands they scale.
    """

    markers: tuple[str, ...]
    points: tuple[str, ...]  # of the hand's skeleton
    carried_by: tuple[str, ...]  # joints of the hand's skeleton
    offset: np.ndarray = field(repr=False)  # (M, 3) m
    size: float

    def __post_init__(self) -> None:
        count = len(self.markers)
        if not (len(self.points) == len(self.carried_by) == len(self.offset) == count):
            raise BodysenseError(
                f"glove: {count} markers need as many points, joints and offsets, "
                f"but got {len(self.points)}, {len(self.carried_by)} and {len(self.offset)}"
            )


@lru_cache(maxsize=1)
def default_glove() -> Glove:
    """The glove of the paper's release, on our hand.

    Markers on the back of the hand stand where the template has them; those of fingers sit at fingertips and the
    thumb's middle joint, where the template has them as well, to within the difference between two people's hands.
    """
    hand = hand_skeleton(default_skeleton(), "left")
    points = ("pinky1", "wrist", "index1", "ring_tip", "pinky_tip", "index_tip", "middle_tip", "thumb2", "thumb_tip")
    carried_by = ("wrist", "wrist", "wrist", "ring3", "pinky3", "index3", "middle3", "thumb2", "thumb3")
    template = paper_template()
    offset = np.zeros((len(MARKERS), 3))
    back = list(ALIGNMENT)
    offset[back] = template[back] - (hand.path @ hand.rest_offset)[hand.indices([points[k] for k in back])]
    return Glove(MARKERS, points, carried_by, offset, hand_size(hand))


def paper_template() -> np.ndarray:
    """(9, 3) m, the markers of the release's glove on a flat left hand, in our axes."""
    return np.array(_TEMPLATE)[:, [1, 0, 2]] * [-1, -1, 1]


def hand_size(hand: Skeleton) -> float:
    """Metres from the wrist to the tip of the middle finger, at rest."""
    position = hand.path @ hand.rest_offset
    return float(np.linalg.norm(position[hand.index("middle_tip")]))


def marker_positions(glove: Glove, pose: Pose, offset: Array | None = None) -> Array:
    """Where the markers of a posed hand are, (..., M, 3) m; `offset` (..., M, 3) m, not to be scaled, for the glove's.

    Markers on the back of the hand stand about where the base of the finger is at rest: it does not move in the hand.
    """
    hand = pose.skeleton
    position, world = forward_kinematics(pose)
    points, carriers = hand.indices(glove.points), hand.indices(glove.carried_by)
    if offset is None:
        offset = as_like(glove.offset * (hand_size(hand) / glove.size), position)
    return position[..., points, :] + quaternion_rotate(world[..., carriers, :], offset)


def template(glove: Glove, hand: Skeleton) -> np.ndarray:
    """Markers (M, 3) m on a flat hand whose wrist is the origin: what markers are registered to."""
    rest = np.zeros((len(hand.joints), 4))
    rest[:, 0] = 1.0
    return np.asarray(marker_positions(glove, Pose(hand, np.zeros(3), rest)))


@lru_cache(maxsize=64)
def glove_points(hand: str) -> tuple[str, ...]:
    """Names of a hand's markers as points of an observation: 'left_glove_pinky_base' … for the hand 'left'."""
    side_of(hand)
    return tuple(f"{hand}_glove_{marker}" for marker in MARKERS)


@lru_cache(maxsize=4096)
def glove_marker(point: str) -> tuple[str, str] | None:
    """The hand and the marker that a point's name says; None for a point that is no marker of a glove."""
    hand, _, marker = point.partition("_glove_")
    return (hand, marker) if marker in MARKERS and hand.startswith(("left", "right")) else None


def glove_hands(points: Iterable[str]) -> tuple[str, ...]:
    """The hands whose markers are among the points, in order of first mention."""
    return tuple(dict.fromkeys(found[0] for found in map(glove_marker, points) if found))


def side_of(hand: str) -> Side:
    """Whether a hand, 'left', 'right', 'left2' …, is a left or a right one."""
    for side in ("left", "right"):
        if hand.startswith(side):
            return side
    raise BodysenseError(f"glove: the hand {hand!r} is neither left nor right; begin its name with 'left' or 'right'")
