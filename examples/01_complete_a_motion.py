"""Complete a motion from what a headset's cameras see of it."""

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.estimators.learned import Learned, load_model
from bodysense.occlusion.headset_camera import observe

clip = packaged_performance()  # or: canonical(read_bvh("mine.bvh"))
observation = observe(clip.pose, clip.time)  # hidden joints are NaN

tracker = IkTracker(Learned(load_model(), clip.pose.skeleton))
pose, estimate, _ = tracker.step(observation, tracker.start())

truth, _ = forward_kinematics(clip.pose)
result, _ = forward_kinematics(pose)
hidden = ~observation.has_position
error = np.linalg.norm(result - truth, axis=-1)
print(f"{hidden.mean():.0%} of points were hidden; they came out {100 * error[hidden].mean():.1f} cm from the truth")
