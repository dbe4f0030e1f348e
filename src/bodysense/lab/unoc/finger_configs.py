"""Finger synthesis: plausible fingers from the motion of a body that has none (UNOC, section 5.3).

Reads the positions of all body joints and the forward and up vectors of head and wrists (a wrist's: where the hand
points, +X of the left and −X of the right one, and the back of the hand, +Y) and places 30 finger joints and 10
fingertips in their wrist's axes. The paper's hand has 16 joints and 5 tips; SMPL-H's has 15 and 5, for it has no bone
inside the palm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.lab.unoc.point_network import PointNetworkConfig

_FINGER = default_skeleton().wrist_of >= 0
BODY = tuple(np.array(default_skeleton().joints)[~_FINGER[: len(default_skeleton().joints)]].tolist())
HANDS = tuple(np.array(default_skeleton().points)[_FINGER].tolist())

# What ships: few recordings have fingers, so it is small and forgets some of what it reads.
FINGERS = PointNetworkConfig(reads=BODY, places=HANDS, from_wrists=True, hidden=64, branch=(64,), dropout=0.5)
# Section 5.3, but for the axes, which turn with the head's heading.
PAPER_FINGERS = replace(FINGERS, from_wrists=False, hidden=512, branch=(512, 512), dropout=0.0, window=27)
