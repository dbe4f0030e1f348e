"""Two gloves with markers, a frame at a time; a finger and then a whole hand are hidden for a while."""

import numpy as np

from bodysense.body.hand import hand_skeleton
from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.estimators.carried import Carried
from bodysense.estimators.gloved import Gloved
from bodysense.estimators.gloves.hands import Hands, load_glove_models
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.occlusion.glove import observe

clip = packaged_performance()
seen = observe(clip.pose, clip.time)  # points 'left_glove_index_tip' …: positions alone, NaN where hidden

skeleton = clip.pose.skeleton  # or default_skeleton().scaled(1.75), the wearer's height
hands = Hands({side: hand_skeleton(skeleton, side) for side in ("left", "right")}, load_glove_models())
# With a headset as well, its network completes the body: Gloved(hands, packaged_three_point(skeleton)).
tracker = IkTracker(Gloved(hands, Carried(skeleton)))

index_tip = seen.points.index("left_glove_index_tip")
right = [k for k, name in enumerate(seen.points) if name.startswith("right")]
state, poses, errors = tracker.start(), [], []
for k in range(120):
    frame = seen[k : k + 1]
    if 1 <= frame.time[0] < 2:
        frame.has_position[:, index_tip] = False
    if 2 <= frame.time[0] < 3:
        frame.has_position[:, right] = False
    pose, estimate, state = tracker.step(frame, state)
    poses.append(pose)
    errors.append(estimate.confidence[0, skeleton.indices(["left_index_tip", "right_wrist"])])

truth, _ = forward_kinematics(clip.pose)
tip = skeleton.index("left_index_tip")
missed = [np.linalg.norm(forward_kinematics(pose)[0][0, tip] - truth[k, tip]) for k, pose in enumerate(poses)]
print(f"the tip of the left index finger: {1000 * np.mean(missed[:30]):.1f} mm off while its marker is seen, ", end="")
print(f"{1000 * np.mean(missed[30:60]):.1f} mm while it is hidden")
last = [1000 * errors[59][0], 1000 * errors[89][1]]
print(f"expected just before they are found again: finger {last[0]:.0f} mm, hand {last[1]:.0f} mm")
