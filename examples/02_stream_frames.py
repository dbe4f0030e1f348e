"""Complete one frame at a time, as they come from a device that tracks a head and, at times, two wrists."""

import numpy as np

import bodysense as bs

tracker = bs.Tracker(bs.Person(height=1.80))  # or bs.Person(): the height is inferred, too
state = tracker.start()
points = ("head", "left_wrist", "right_wrist")

for frame in range(90):  # 90 Hz, one second
    position = np.array([[[0.0, 1.65, 0.0], [0.25, 1.0, 0.2], [-0.25, 1.0, 0.2 + 0.001 * frame]]])
    rotation = np.full((1, 3, 4), np.nan)
    rotation[0, 0] = 1.0, 0.0, 0.0, 0.0
    seen = np.array([[True, frame < 60, True]])  # the left hand gets lost
    position[~seen] = np.nan
    observation = bs.Observation(
        points=points,
        position=position,
        rotation=rotation,
        has_position=seen,
        has_rotation=np.array([[True, False, False]]),
        accuracy=np.full((1, 3), 0.001),  # m: headset and controllers
        time=np.array([frame / 90]),
    )
    estimate, state = tracker.step(observation, state)
    if frame % 30 == 29:
        lost = estimate.pose.skeleton.index("left_wrist")
        place, doubt = estimate.points[0, lost], estimate.confidence[0, lost]
        print(f"{frame / 90:.2f} s: left wrist at {np.round(place, 2)} ± {100 * doubt:.1f} cm")
