"""Two gloves with markers, a frame at a time; a finger and then a whole hand are hidden for a while."""

import numpy as np

import bodysense as bs
from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.devices.gloves.device import glove_device
from bodysense.devices.simulated.glove import observe

clip = packaged_performance()
seen = observe(clip.pose, clip.time)  # points 'left_glove_index_tip' …: positions alone, NaN where hidden

skeleton = clip.pose.skeleton
gloves = glove_device(skeleton)  # markers → joints of hands, observed like any other points
tracker = bs.Tracker(bs.Person(skeleton))

index_tip = seen.points.index("left_glove_index_tip")
right = [k for k, name in enumerate(seen.points) if name.startswith("right")]
hands, state, tips, errors = gloves.start(), tracker.start(), [], []
tip, places = skeleton.index("left_index_tip"), skeleton.indices(["left_index_tip", "right_wrist"])
for k in range(120):
    frame = seen[k : k + 1]
    if 1 <= frame.time[0] < 2:
        frame.has_position[:, index_tip] = False
    if 2 <= frame.time[0] < 3:
        frame.has_position[:, right] = False
    joints, hands = gloves.step(frame, hands)
    estimate, state = tracker.step(joints, state)
    tips.append(estimate.points[0, tip])
    errors.append(estimate.confidence[0, places])

truth, _ = forward_kinematics(clip.pose)
missed = np.linalg.norm(np.array(tips) - truth[:120, tip], axis=-1)
print(f"the tip of the left index finger: {1000 * np.mean(missed[:30]):.1f} mm off while its marker is seen, ", end="")
print(f"{1000 * np.mean(missed[30:60]):.1f} mm while it is hidden")
last = [1000 * errors[59][0], 1000 * errors[89][1]]
print(f"expected just before they are found again: finger {last[0]:.0f} mm, hand {last[1]:.0f} mm")
