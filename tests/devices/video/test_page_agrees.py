"""Bodies of landmarks that the page's tests compare with the page's own (web/tests/sources/landmarks.test.ts)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.devices.video.device import POINTS
from bodysense.devices.video.landmarks import BODY_LANDMARKS

from ...people.filmed import seated_pose
from ..conftest import SKELETON, seen_by

FIXTURE = Path(__file__).parents[3] / "web" / "tests" / "sources" / "landmarks.json"
NAMES = ("left_shoulder", "right_shoulder", "left_knee", "right_knee", "left_ankle", "right_ankle")
LEGS = {"whole": (), "feet hidden": ("ankle", "heel", "toe"), "legs hidden": ("knee", "ankle", "heel", "toe")}


def expected(make_device: Any) -> dict[str, Any]:
    """Return landmarks of still people, and the points that `track` makes of them."""
    device, people = make_device(0.0), {}
    for name, seat in (("standing", None), ("chair", 0.45), ("stool", 0.6)):
        one = standing_pose(SKELETON) if seat is None else seated_pose(SKELETON, seat)
        pose = Pose(SKELETON, np.tile(one.root_position, (4, 1)), np.tile(one.rotation, (4, 1, 1)))
        for legs, hidden in LEGS.items():
            for tilt in (0, 12):
                person = seen_by(pose, device.focal, np.radians(tilt))
                marks = [BODY_LANDMARKS.index(f"{side}_{part}") for side in ("left", "right") for part in hidden]
                person.visible[:, marks] = 0.05
                frames, _ = device.step(person, device.start())
                people[f"{name}, {legs}, {tilt}"] = {
                    "world": person.world[0].round(4).tolist(),
                    "picture": person.picture[0].round(4).tolist(),
                    "visible": person.visible[0].tolist(),
                    "height": {
                        point: round(float(frames.observation.position[-1, POINTS.index(point), 1]), 3)
                        for point in NAMES
                    },
                }
    return {"focal": device.focal, "frames": 4, "rate": 30, "people": people}


def test_the_pages_landmarks_are_those_of_this_device(make_device: Any) -> None:
    """To renew the file, write `json.dumps(expected(make_device))` into it."""
    assert json.loads(FIXTURE.read_text()) == json.loads(json.dumps(expected(make_device)))
