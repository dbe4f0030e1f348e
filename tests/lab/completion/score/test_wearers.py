"""Recorded heads stand on the floor, with palms that face the given direction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_rotate
from bodysense.observing.checks import check_observation
from bodysense_lab.completion.score.sight.wearers import (
    FILE,
    TAKES,
    HeadPath,
    Palms,
    head_paths,
    known_body,
    rest_heights,
    with_hands,
)


def test_palms_face_the_given_direction() -> None:
    skeleton = known_body(1.7)
    path = HeadPath("still", np.tile([0.0, 1.6, 0.0], (2, 1)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
    expected: dict[Palms, list[int]] = {"down": [0, -1, 0], "inward": [-1, 0, 0], "hanging": [-1, 0, 0]}
    for palms, left in expected.items():
        seen = check_observation(with_hands(path, palms, skeleton))
        facing = quaternion_rotate(seen.rotation[0, 1:], np.tile([0.0, -1.0, 0.0], (2, 1)))
        assert facing[0] @ np.array(left) > 0.9 and facing[1] @ (np.array(left) * [-1, 1, 1]) > 0.9
        assert seen.position[0, 1, 0] > 0 > seen.position[0, 2, 0]
    assert with_hands(path, "none", skeleton).points == ("head",)


def test_recorded_heads_stand_on_the_floor(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"--headset .*: it has no headset_takes.npz"):
        list(head_paths(tmp_path, known_body(1.7)))
    time = np.arange(300) / 72
    rows = {}
    for name in TAKES:
        rows |= {f"{name}__time_s": time, f"{name}__moving_from_to_s": np.array([1.0, 4.0])}
        rows[f"{name}__device_pos_m"] = np.tile([0.0, 5.0, 0.0], (300, 1))
        rows[f"{name}__device_quat_xyzw"] = np.tile([0.0, 0.0, 0.0, 1.0], (300, 1))
    np.savez(tmp_path / FILE, **rows)
    skeleton = known_body(1.7)
    paths = list(head_paths(tmp_path, skeleton))
    assert [path.name for path in paths] == list(TAKES) and len(paths[0].position) == 90
    np.testing.assert_allclose(paths[0].position[:, 1], rest_heights(skeleton)[skeleton.index("head")])
    np.testing.assert_allclose(paths[0].rotation, np.tile([1.0, 0, 0, 0], (90, 1)))
