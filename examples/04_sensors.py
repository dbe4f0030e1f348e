"""One motion tracked by one sensor set after the other, on an unknown body: every sensor helps."""

import bodysense as bs

clip = bs.demo.performance_of_unseen_body()
clip = bs.Clip(clip.name, clip.pose[:300], clip.frame_rate)  # ten seconds
truth, _ = bs.forward_kinematics(clip.pose)
print(f"the wearer is {bs.Person(clip.pose.skeleton).stature:.2f} m tall")

for device in ("head", "three_point", "four_point", "six_point", "ten_point"):
    take = bs.track(clip, device=device, person=bs.Person())
    error = bs.metrics.joint_error(take.estimate.points, truth)[:, :22]
    print(f"{device:12} {error.mean():5.1f} cm, height {take.person.stature:.2f} m inferred")
