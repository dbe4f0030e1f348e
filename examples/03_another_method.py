"""A method of one's own: anything with `skeleton`, `start` and `step` is an estimator, and the tracker drives it."""

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.observation import Observation, observed_points


@dataclass(frozen=True)
class StandingUnderTheHead:
    """Whatever is hidden stands still under the head."""

    skeleton: Skeleton

    def start(self) -> None:
        return None

    def step(self, observation: Observation, state: None) -> tuple[PointEstimate, None]:
        position, _, seen, _ = observed_points(observation, self.skeleton)
        standing, _ = forward_kinematics(standing_pose(self.skeleton))
        head = self.skeleton.index("head")
        guess = standing - standing[head] + position[:, head, None]
        answer = np.where(seen[..., None], position, guess)
        return PointEstimate(self.skeleton, answer, (~seen).astype(float), np.where(seen, 0.0, 0.2)), None


skeleton = default_skeleton()
tracker = IkTracker(StandingUnderTheHead(skeleton))
observation = Observation(
    points=("head",),
    position=np.array([[[0.0, 1.6, 0.0]]]),
    rotation=np.array([[[1.0, 0.0, 0.0, 0.0]]]),
    has_position=np.array([[True]]),
    has_rotation=np.array([[True]]),
    accuracy=np.array([[0.001]]),
    time=np.array([0.0]),
)
pose, _, _ = tracker.step(observation, tracker.start())
print("pelvis at", np.round(pose.root_position[0], 2))
