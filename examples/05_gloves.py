"""Two gloves with markers, a frame at a time; a finger and then a whole hand are hidden for a while."""

import numpy as np

import bodysense as bs

clip = bs.demo.packaged_performance()
seen = bs.simulate(clip, "gloves")  # points 'left_glove_index_tip' …: positions alone, NaN where hidden

skeleton = clip.pose.skeleton
gloves = bs.glove_device(skeleton)  # markers → joints of hands, observed like any other points
tracker = bs.Tracker(bs.Person(skeleton))

index_tip = seen.points.index("left_glove_index_tip")
right = [k for k, name in enumerate(seen.points) if name.startswith("right")]
hands, state, tips, errors = gloves.start(), tracker.start(), [], []
for k in range(120):
    frame = seen[k : k + 1]
    if 1 <= frame.time[0] < 2:
        frame.has_position[:, index_tip] = False
    if 2 <= frame.time[0] < 3:
        frame.has_position[:, right] = False
    joints, hands = gloves.step(frame, hands)
    estimate, state = tracker.step(joints, state)
    tips.append(estimate["left_index_tip"].position[0])
    errors.append([estimate[name].confidence[0] for name in ("left_index_tip", "right_wrist")])

truth, _ = bs.forward_kinematics(clip.pose)
missed = 1000 * np.linalg.norm(np.array(tips) - truth[:120, skeleton.index("left_index_tip")], axis=-1)
print(f"the tip of the left index finger: {missed[:30].mean():.1f} mm off while its marker is seen, ", end="")
print(f"{missed[30:60].mean():.1f} mm while it is hidden")
last = [1000 * errors[59][0], 1000 * errors[89][1]]
print(f"expected just before they are found again: finger {last[0]:.0f} mm, hand {last[1]:.0f} mm")
