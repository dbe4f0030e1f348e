"""Several people in one call; each is completed as if alone."""

from dataclasses import replace

import bodysense as bs

seen = bs.simulate(bs.demo.packaged_performance(), "three_point")
trackers = [bs.Tracker(bs.Person(height=height)) for height in (1.60, 1.75, 1.90)]
states = [tracker.start() for tracker in trackers]

estimates = []
for k in range(60):
    # Each wearer has a clock and sensors of their own; here the third has no controllers.
    frames = [replace(seen[k : k + 1], time=seen.time[k : k + 1] + start) for start in (0.0, 7.5, 1.7e9)]
    frames[2].has_position[:, 1:] = frames[2].has_rotation[:, 1:] = False
    done = bs.step_together(list(zip(trackers, frames, states, strict=True)))
    estimates, states = [estimate for estimate, _ in done], [state for _, state in done]

for estimate in estimates:
    print("pelvis at", estimate["pelvis"].position[0].round(2))
