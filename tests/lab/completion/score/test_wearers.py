"""Scripted wearers stand, sit and raise their arms as described, and all figures are present."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.cli import main
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense.observing.observation import check_observation
from bodysense_lab.completion.score.rare_poses import RARE, rare_pose
from bodysense_lab.completion.score.sight import wearer_scores
from bodysense_lab.completion.score.sight.sight import backward_knees, knee_flexion
from bodysense_lab.completion.score.sight.wearers import (
    FILE,
    RAISES,
    TAKES,
    Palms,
    RaiseDirection,
    arms_raised,
    head_paths,
    known_body,
    rest_heights,
    seated,
    standing_head,
    with_hands,
)


@pytest.mark.parametrize("height", [1.55, 1.88])
def test_a_seated_wearer_has_feet_on_the_floor_and_level_thighs(height: float) -> None:
    skeleton = known_body(height)
    position = np.asarray(forward_kinematics(seated(skeleton))[0])
    at = skeleton.index
    np.testing.assert_allclose(position[:, at("left_ankle"), 1], rest_heights(skeleton)[at("left_ankle")], atol=0.01)
    np.testing.assert_allclose(position[:, at("left_knee"), 1], position[:, at("left_hip"), 1], atol=0.05)
    ahead = position[:, at("left_knee"), 2] - position[:, at("left_hip"), 2]
    assert (ahead > 0.2 * height).all()
    assert (position[:, at("head"), 1] > position[:, 0, 1] + 0.3 * height).all()
    wrist = position[:, at("left_wrist")] - position[:, at("left_knee")]
    assert (wrist[:, 1] > 0).all() and (np.linalg.norm(wrist, axis=-1) < 0.35).all()


@pytest.mark.parametrize("way", RAISES)
def test_raised_arms_are_seen_first_and_then_lost(way: RaiseDirection) -> None:
    skeleton = known_body(1.7)
    pose = arms_raised(skeleton, way)
    time = np.arange(len(pose.root_position)) / 30
    seen = observe(pose, time, SENSOR_SETS["headset_camera"]).has_position
    wrists = skeleton.indices(["left_wrist", "right_wrist"])
    assert seen[:50, wrists].all() and not seen[85:, wrists].any()
    position = np.asarray(forward_kinematics(pose)[0])
    assert (position[90:, wrists, 1] > position[90:, skeleton.index("head"), 1][:, None] + 0.2).all()


def test_palms_face_the_given_direction() -> None:
    skeleton = known_body(1.7)
    path = standing_head(skeleton, 0.0)
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


@pytest.mark.parametrize("name", RARE)
def test_a_rare_pose_is_on_the_floor_with_knees_bent_forward(name: str) -> None:
    skeleton = known_body(1.7)
    pose = rare_pose(skeleton, name)
    position = np.asarray(forward_kinematics(pose)[0])
    at = {point: position[-1, skeleton.index(point)] for point in skeleton.points}
    assert not backward_knees(pose.rotation[:, skeleton.indices(["left_knee", "right_knee"])]).any()
    assert position[..., 1].min() > 0 and position[..., 1].min(axis=-1).max() < 0.09
    np.testing.assert_allclose(position[0, 0], standing_pose(skeleton).root_position, atol=1e-6)
    bent = [knee_flexion(*(at[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle"))) for side in ("left", "right")]
    where = {
        "handstand": at["left_ankle"][1] > at["pelvis"][1] > at["head"][1] > at["left_wrist"][1],
        "lying": max(at["head"][1], at["pelvis"][1], at["left_knee"][1]) < 0.2,
        "plank": 0.1 < at["left_wrist"][1] < 0.2 and 0.4 < at["pelvis"][1] < 0.6 and max(bent) < 5,
        "lunge": at["left_knee"][2] > 0.3 and at["right_ankle"][2] < -0.3 and at["pelvis"][1] < 0.8,
        "kneeling_on_one": at["right_knee"][1] < 0.15 and at["left_knee"][1] > 0.4,
        "kneeling_on_both": max(at["left_knee"][1], at["right_knee"][1]) < 0.15 and at["pelvis"][1] > 0.5,
        "crouch": min(bent) > 120 and at["left_foot"][1] < 0.1,
        "bow": at["head"][2] > 0.4 and at["left_wrist"][1] < 0.7 and max(bent) < 5,
        "split_stance": at["left_ankle"][2] - at["right_ankle"][2] > 0.5,
        "arms_crossed_behind": max(at["left_wrist"][2], at["right_wrist"][2]) < -0.08
        and at["left_wrist"][0] < at["left_elbow"][0] - 0.15,
    }
    assert where[name]


def test_rare_poses_count_hidden_joints_in_their_bounds_and_knees(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of ten poses is 3 cm off, beyond bounds of 2 cm; in another the left knee bends backward."""
    skeleton = known_body(1.7)
    poses = [rare_pose(known_body(1.7), name) for name in RARE]
    points = np.stack([np.asarray(forward_kinematics(pose)[0]) for pose in poses])
    rotation = np.stack([pose.rotation for pose in poses])
    points[1, :, :, 0] += 0.03
    points[:, :, skeleton.index("head"), 0] += 0.5  # tracked joints do not count
    rotation[2, :, skeleton.index("left_knee")] = quaternion_exp(np.radians([-20.0, 0.0, 0.0]))
    estimate = SimpleNamespace(
        points=points, bound=np.full(points.shape[:-1], 0.02), pose=SimpleNamespace(rotation=rotation)
    )
    monkeypatch.setattr(wearer_scores, "_track", lambda people, seen, network: estimate)
    found = {one.key: one.value for one in wearer_scores._rare(None)}
    for sensors in ("three_point", "head", "six_point"):
        assert found[f"rare_{sensors}_covered"] == pytest.approx(0.9)
    assert 0.85 < found["rare_headset_camera_covered"] < 0.95
    for sensors in wearer_scores.RARE_SETS:
        assert found[f"rare_{sensors}_least_covered"] == 0
        assert found[f"rare_{sensors}_backward_knee_share"] == pytest.approx(1 / 20)


@pytest.mark.slow
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    numbers = tmp_path / "sight.json"
    assert main(["evaluate", "sight", "--json", str(numbers)]) == 0
    found = json.loads(numbers.read_text())
    assert found.pop("processor")
    assert {"standing_down_ball_cm", "seated_188_head_height_cm", "raised_sideways_deg", "rare_head_covered"} <= set(
        found
    )
    assert all(np.isfinite(value) for value in found.values())
    assert found["raised_ahead_truth_deg"] > 65
    assert "arms raised out of view" in capsys.readouterr().out


def test_a_body_at_rest_does_not_float() -> None:
    skeleton = known_body(1.8)
    rest = np.tile(rest_heights(skeleton)[:, None] * [0.0, 1.0, 0.0], (3, 1, 1))
    np.testing.assert_allclose(wearer_scores._lower_ball(skeleton, rest), 0, atol=1e-9)
