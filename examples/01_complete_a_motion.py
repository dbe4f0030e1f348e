"""Complete a motion from what a headset's cameras see of it."""

import tempfile
from pathlib import Path

import bodysense as bs

clip = bs.demo.packaged_performance()  # or: bs.read("mine.bvh")
take = bs.track(clip, device="headset_camera")  # a recording of a real device: bs.track("take.npz")

with tempfile.TemporaryDirectory() as folder:
    take.save(Path(folder) / "result.bvh")  # or .glb, .vrma

truth, _ = bs.forward_kinematics(clip.pose)
result, _ = bs.forward_kinematics(take.clip.pose)
hidden = ~take.estimate.measured
error = bs.metrics.joint_error(result, truth)  # cm
print(f"{hidden.mean():.0%} of points were hidden; they came out {error[hidden].mean():.1f} cm from the truth,")
print(f"and {100 * take.estimate.confidence[hidden].mean():.1f} cm were expected")
