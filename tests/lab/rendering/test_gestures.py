from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense_lab.rendering.take import GESTURES, gesture

WRISTS = {  # s, and where the left wrist is then from its shoulder, in lengths of the arm
    "t_pose": (2.2, (1.0, 0.0, 0.0)),
    "arms_up": (2.1, (0.22, 0.97, 0.0)),
    "arms_ahead": (2.0, (0.0, 0.0, 1.0)),
    "punches": (0.8, (0.22, 0.03, 0.97)),  # from a chest turned to the right
    "waves": (1.2, (0.11, 0.09, 0.48)),
}


@pytest.mark.parametrize("name", GESTURES)
def test_arms_are_where_the_script_has_them(name: str) -> None:
    clip = gesture(name)
    assert clip.category == name and clip.has_fingers and np.isfinite(clip.pose.rotation).all()
    places = clip.pose.skeleton.indices(["left_shoulder", "left_elbow", "left_wrist"])
    shoulder, elbow, wrist = np.moveaxis(np.asarray(forward_kinematics(clip.pose)[0])[:, places], 1, 0)
    length = np.linalg.norm(elbow - shoulder, axis=-1) + np.linalg.norm(wrist - elbow, axis=-1)
    time, wanted = WRISTS[name]
    frame = round(time * clip.frame_rate)
    reach = (wrist - shoulder)[frame] / length[frame]
    assert np.linalg.norm(np.abs(reach) - np.abs(wanted)) < 0.25
