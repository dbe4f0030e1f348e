"""Draw docs/figures/three_point.png: the packaged performance seen by a headset and two hands, and by the headset."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.estimators.three_point import packaged_three_point
from bodysense.export.picture import RESULT, Panel, draw_strip
from bodysense.occlusion.three_point import HEAD_ONLY, ThreePoint, observe

OUT = Path(__file__).parents[1] / "docs" / "figures" / "three_point.png"


def main() -> None:
    """Write the picture."""
    clip = packaged_performance()
    skeleton = clip.pose.skeleton
    truth = np.asarray(forward_kinematics(clip.pose)[0])

    def completed(device: ThreePoint) -> np.ndarray:
        tracker = IkTracker(packaged_three_point(skeleton))
        pose, _, _ = tracker.step(observe(clip.pose, clip.time, device), tracker.start())
        return np.asarray(forward_kinematics(pose)[0])

    untracked = np.ones(truth.shape[:2], dtype=bool)
    untracked[:, skeleton.indices(("head", "left_wrist", "right_wrist"))] = False
    panels = [
        Panel("truth (not tracked: red)", truth, untracked),
        Panel("from headset and two hands", completed(ThreePoint()), color=RESULT),
        Panel("from the headset alone", completed(HEAD_ONLY), color=RESULT),
    ]
    draw_strip(OUT, skeleton, panels, clip.time)
    print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
