"""Scripts: steps that a performer was asked to do, with their times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bodysense.errors import BodysenseError
from bodysense.files import read_json
from bodysense_conform.subject import Step

_FINGERS = ("index", "middle", "ring", "pinky")
LABELS = ("stand", "a_pose", "t_pose", "squat", "arms_up", "left_arm_raise", "right_arm_raise", "left_leg_raise",
          "right_leg_raise", "march", "sit", "remount", "flat", "fist", "wrist_rotate",
          *(f"pinch_{finger}" for finger in _FINGERS), "other")  # fmt: skip
_ALSO = {
    "neutral_stance": "stand",
    "a_pose_still": "a_pose",
    "t_pose_hold_open": "t_pose",
    "t_pose_hold_close": "t_pose",
    "squat_x2": "squat",
    "march_in_place": "march",
    "open_hand_open": "flat",
    "open_hand_close": "flat",
    "pinch": "pinch_index",
    "pinch_little": "pinch_pinky",
    "thumb_to_little": "pinch_pinky",
    **{f"thumb_to_{finger}": f"pinch_{finger}" for finger in _FINGERS},
    "right_grasps_left_fist": "other",
    "left_grasps_right_fist": "other",
    "clap": "other",
}
"""Other names of our steps: plain ones, and those of the public acceptance suite for robots' trackers."""


def read_script(path: Path) -> tuple[Step, ...]:
    """Read the steps of a script: JSON with `steps` of `label`, `start` and `end` (s), or `start_ns` and `end_ns`.

    Raises BodysenseError, naming the step and what would be valid, for other files.
    """
    document = read_json(path, "give a script, an object with 'steps', see docs/conform.md")
    rows = document.get("steps") if isinstance(document, dict) else None
    if not isinstance(rows, list) or not rows:
        raise BodysenseError(f"{path}: has no 'steps'; a script is an object with a list of them, see docs/conform.md")
    return tuple(_step(path, number, row) for number, row in enumerate(rows, start=1))


def script_beside(path: Path) -> Path | None:
    """Return TAKE.labels.json in the folder of a take, or None if it does not exist."""
    beside = path.with_name(f"{path.stem}.labels.json")
    return beside if beside.is_file() else None


def _step(path: Path, number: int, row: Any) -> Step:
    if not isinstance(row, dict) or not isinstance(row.get("label"), str):
        raise BodysenseError(f"{path}: step {number} has no 'label'; give one of {', '.join(LABELS)}")
    label = _ALSO.get(row["label"], row["label"])
    if label not in LABELS:
        raise BodysenseError(f"{path}: step {number}: unknown label {row['label']!r}; valid are {', '.join(LABELS)}")
    times = []
    for name in ("start", "end"):
        nanoseconds = row.get(f"{name}_ns")
        time = row.get(name, nanoseconds / 1e9 if type(nanoseconds) is int else None)
        if type(time) not in (int, float) or not abs(time) < 1e11:
            raise BodysenseError(f"{path}: step {number} ({label}) has no {name!r}; give seconds, or {name}_ns")
        times.append(float(time))
    return Step(label, *times)
