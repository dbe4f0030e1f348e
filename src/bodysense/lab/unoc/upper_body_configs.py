"""The upper body from a headset and two controllers (UNOC, section 5.2).

Reads positions, forward and up vectors of head and both wrists (see `models.point_network.AXES`) and places the upper
body's joints. What ships also knows how high the head is and how long the wearer's bones are, and says how far off it
expects to be.
"""

from __future__ import annotations

from dataclasses import replace

from bodysense.lab.unoc.point_network import PointNetworkConfig
from bodysense.occlusion.three_point import POINTS

TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck")
ARMS = tuple(f"{side}_{part}" for part in ("collar", "shoulder", "elbow") for side in ("left", "right"))

UPPER_BODY = PointNetworkConfig(reads=POINTS, places=(*TRUNK, *ARMS), wearer=True, judge_branch=(64,))
# Section 5.2, but for the axes, which turn with the head's heading.
PAPER_UPPER_BODY = replace(UPPER_BODY, wearer=False, judge_branch=None, hidden=512, branch=(512, 512), window=27)
