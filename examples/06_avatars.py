"""A body for avatars: one take as files that viewers, VRM avatars and motion tools play."""

import tempfile
from pathlib import Path

import bodysense as bs

clip = bs.demo.packaged_performance()
seen = bs.simulate(clip, "three_point")  # or: bs.read("take.npz"), a recording of a real headset
take = bs.track(seen, height=1.75)
print(take)

with tempfile.TemporaryDirectory() as folder:
    for name, rig in (("motion.glb", None), ("motion.vrma", None), ("motion.bvh", None), ("mixamo.bvh", "mixamo")):
        take.save(Path(folder) / name, rig)
        print(f"{name}: {(Path(folder) / name).stat().st_size / 1e6:.1f} MB")
