"""Complete one frame at a time, as they come from a device that tracks a head and, at times, two wrists."""

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.estimators.learned import Learned, load_model
from bodysense.observation import Observation

skeleton = default_skeleton().scaled(1.80)  # the wearer
tracker = IkTracker(Learned(load_model(), skeleton))
state = tracker.start()
points = ("head", "left_wrist", "right_wrist")
lost = skeleton.index("left_wrist")

for frame in range(90):  # 90 Hz, one second
    position = np.array([[[0.0, 1.65, 0.0], [0.25, 1.0, 0.2], [-0.25, 1.0, 0.2 + 0.001 * frame]]])
    rotation = np.full((1, 3, 4), np.nan)
    rotation[0, 0] = 1.0, 0.0, 0.0, 0.0
    seen = np.array([[True, frame < 60, True]])  # the left hand gets lost
    position[~seen] = np.nan
    observation = Observation(
        points=points,
        position=position,
        rotation=rotation,
        has_position=seen,
        has_rotation=np.array([[True, False, False]]),
        accuracy=np.full((1, 3), 0.001),  # m: headset and controllers
        time=np.array([frame / 90]),
    )
    pose, estimate, state = tracker.step(observation, state)
    if frame % 30 == 29:
        place, doubt = estimate.position[0, lost], estimate.confidence[0, lost]
        print(f"{frame / 90:.2f} s: left wrist at {np.round(place, 2)} ± {100 * doubt:.1f} cm")
