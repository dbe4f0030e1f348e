"""Complete one frame at a time, as they come from a device that tracks a head and, at times, two wrists."""

import bodysense as bs

tracker = bs.Tracker(bs.Person(height=1.80))  # or bs.Person(): the height is inferred, too
state = tracker.start()
out = None  # memory of the last step, which the next one reuses

for frame in range(90):  # 90 Hz, one second
    poses = {  # position, m, and rotation, wxyz, in the world
        "head": ([0.0, 1.65, 0.0], [1.0, 0.0, 0.0, 0.0]),
        "left_wrist": ([0.25, 1.0, 0.2] if frame < 60 else None, None),  # it gets lost
        "right_wrist": ([-0.25, 1.0, 0.2 + 0.001 * frame], None),
    }
    estimate, state = out = tracker.step(bs.observe(frame / 90, poses), state, out=out)
    if frame % 30 == 29:
        wrist = estimate["left_wrist"]
        print(f"{frame / 90:.2f} s: left wrist at {wrist.position[0].round(2)} ± {100 * wrist.confidence[0]:.1f} cm")
