"""A whole body from a headset and two hands by a network: arms that reach the hands, feet that stand.

The network (`models/three_point_network.py`) gives every joint's rotation. Then each arm is bent so that its hand is
where it is measured, and each leg so that a foot in contact with the floor stays where it stands (`foot_lock`,
`limbs`). Fingers are relaxed.

What is not as it should be:

- Without a headset in a frame, its last pose is repeated; before its first, the body stands at the origin, facing +Z.
  Where it is found everything starts afresh if it was lost for more than `longest_gap`; otherwise feet come free.
- A hand that the arm cannot reach is shown where it is measured, while the pose only points at it: the tracker's
  inverse kinematics then moves the body.
- A hand that is not tracked is the network's guess. Where a hand is lost or found again, what is shown moves to its new
  place within a few frames, without a jump.
- A pose that cannot be one counts as not tracked: not finite, a quaternion that is not of unit length, farther than
  `FARTHEST` from the origin, a hand farther from the head than `REACH` of the wearer's height.
- After more than `longest_gap` without a frame everything starts afresh. A point that is named twice (two headsets)
  and time that does not increase are errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.foot_lock import released
from bodysense.estimators.three_point_answers import ThreePointModel, load_three_point
from bodysense.estimators.three_point_many import step_together
from bodysense.estimators.three_point_state import ThreePointSettings, ThreePointState
from bodysense.estimators.whole_body import WholeBody
from bodysense.observation import Observation
from bodysense.occlusion.three_point import POINTS


@dataclass(frozen=True)
class ThreePoint:
    """A body from `head`, `left_wrist` and `right_wrist`, each where tracked; see the module's text.

    Raises BodysenseError for a skeleton that lacks
    one of the 22 joints.
    """

    skeleton: Skeleton
    model: ThreePointModel
    settings: ThreePointSettings = ThreePointSettings()

    def __post_init__(self) -> None:
        wanted = (*self.model.card["joints"], "left_toe", "right_toe")
        missing = [name for name in wanted if name not in self.skeleton.points]
        if missing or tuple(self.model.card["joints"]) != BODY:
            raise BodysenseError(
                f"{self.model.name} turns the joints {', '.join(BODY[:3])} …; the skeleton given has no "
                f"{missing[0] if missing else 'such order'}: bring the motion to the default skeleton with "
                "`bodysense.data.canonical`"
            )

    @cached_property
    def body(self) -> WholeBody:
        """The skeleton as it is completed."""
        return WholeBody(self.skeleton)

    @cached_property
    def points(self) -> np.ndarray:
        """(3,) places of head and hands among the skeleton's points."""
        return self.skeleton.indices(POINTS)

    @cached_property
    def rest_offset(self) -> np.ndarray:
        """(22, 3) m: what the network is told of the wearer's bones."""
        return self.skeleton.rest_offset[self.body.joints].astype(np.float32)

    @cached_property
    def _fresh(self) -> ThreePointState:
        position, rotation = forward_kinematics(standing_pose(self.skeleton))
        head, *hands = self.points
        return ThreePointState(
            memories=(),
            time=None,
            head=(position[head], rotation[head]),
            headset=None,
            measured=np.zeros((2, 2), dtype=bool),
            hand=position[hands] - position[head],
            hand_rotation=rotation[hands],
            jump=np.zeros((2, 2, 3)),
            closing=np.zeros((2, 2, 3)),
            feet=released(),
        )

    def start(self) -> ThreePointState:
        """Nothing seen yet: a standing body that faces +Z."""
        return self._fresh

    def step(self, observation: Observation, state: ThreePointState) -> tuple[PointEstimate, ThreePointState]:
        """Complete T frames, one after the other.

        Raises BodysenseError for a point that is named twice and for time that does not increase.
        """
        return step_together([(self, observation, state)])[0]


def packaged_three_point(skeleton: Skeleton) -> ThreePoint:
    """The packaged network on a wearer's skeleton."""
    return ThreePoint(skeleton, load_three_point())
