"""A headset and two controllers, a frame at a time, as a device would give them; one hand is lost for a second."""

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.estimators.three_point import packaged_three_point
from bodysense.occlusion.three_point import observe

clip = packaged_performance()
device = observe(clip.pose, clip.time)  # head and wrists, positions and rotations in the world, floor at y = 0

skeleton = clip.pose.skeleton  # or default_skeleton().scaled(1.75), the wearer's height
tracker = IkTracker(packaged_three_point(skeleton))
state, poses = tracker.start(), []
for k in range(len(device)):
    frame = device[k : k + 1]
    if 2 <= frame.time[0] < 3:
        frame.has_position[:, 1] = frame.has_rotation[:, 1] = False  # the left controller is out of sight
    pose, estimate, state = tracker.step(frame, state)
    poses.append(pose)

place, turn = forward_kinematics(poses[-1])
head = skeleton.index("head")
print("local rotations of", len(skeleton.joints), "joints; the pelvis at", np.round(poses[-1].root_position[0], 2))
print(f"the head is {1000 * np.linalg.norm(place[0, head] - device.position[-1, 0]):.1f} mm from the headset")
