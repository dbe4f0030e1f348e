"""The same motion from ever more sensors, on a wearer of whom nothing is known: every sensor helps."""

import numpy as np

import bodysense as bs
from bodysense.body.pose import forward_kinematics
from bodysense.body.shape import stature
from bodysense.demo import performance_of_stranger

clip = performance_of_stranger()
clip = bs.Clip(clip.name, clip.pose[:300], clip.frame_rate)  # ten seconds
truth, _ = forward_kinematics(clip.pose)
print(f"the wearer is {float(stature(clip.pose.skeleton.rest_offset)):.2f} m tall")

for device in ("head", "three_point", "four_point", "six_point", "ten_point"):
    take = bs.track(clip, device=device, person=bs.Person())
    error = np.linalg.norm(take.estimate.points - truth, axis=-1)[:, :22]
    height = float(stature(take.person.skeleton.rest_offset))
    print(f"{device:12} {100 * error.mean():5.1f} cm, height {height:.2f} m inferred")
