"""The three-point table: which joints, which poses, which clips, and averages over frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense_lab.data.datasets import DataSet, gather_results
from bodysense_lab.papers.unoc.score.upper_body_table import (
    MakeEstimator,
    is_standing,
    upper_body_errors,
    upper_body_report,
)
from bodysense_lab.papers.unoc.upper_body_ik import UpperBodyIk

SKELETON = default_skeleton()


@dataclass(frozen=True)
class Shifted:
    """Knows the truth and misses some of its joints, by given metres."""

    skeleton: Skeleton
    truth: np.ndarray
    error: Mapping[str, float]

    def start(self) -> None:
        return None

    def step(self, observation: Observation, state: None) -> tuple[PointEstimate, None]:
        assert observation.points == ("head", "left_wrist", "right_wrist")
        position = self.truth.copy()
        for name, error in self.error.items():
            position[:, self.skeleton.index(name), 0] += error
        unknown = np.zeros(position.shape[:-1])
        return PointEstimate(self.skeleton, position, unknown, unknown), None


def shifted(clip: Clip, **error: float) -> dict[str, float]:
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    return numbers_of([clip], {"network": lambda skeleton: Shifted(skeleton, truth, error)})


def numbers_of(clips: list[Clip], methods: Mapping[str, MakeEstimator]) -> dict[str, float]:
    found, census = gather_results(partial(upper_body_errors, methods=methods), clips, 1, lambda clip: None)
    return upper_body_report(found, census, DataSet("motion", Path("motion"))).numbers


def test_groups_of_joints(waving_clip: Clip) -> None:
    numbers = shifted(waving_clip, neck=0.01, left_shoulder=0.02, right_elbow=0.03, left_wrist=0.5, pelvis=0.7)
    expected = {
        "neck": (1.0, 1.0),
        "shoulders": (1.0, np.sqrt(4 / 2)),
        "elbows": (1.5, np.sqrt(9 / 2)),
        "all": (6 / 5, np.sqrt((1 + 4 + 9) / 5)),
    }
    for joints, (mean, root) in expected.items():
        assert numbers[f"network_{joints}_mpjpe_cm"] == pytest.approx(mean)
        assert numbers[f"network_{joints}_rmsjpe_cm"] == pytest.approx(root)


@pytest.mark.parametrize(
    ("category", "has_fingers", "suffixes"),
    [
        ("sit", True, {"", "_bending_wrists"}),
        ("talk_gesture", False, {""}),
        ("", False, {""}),
        ("sport", True, {"_sport"}),
        ("dance", False, {"_dance"}),
        ("juggling", True, {"_other"}),
    ],
)
def test_categories_are_scored_apart(waving_clip: Clip, category: str, has_fingers: bool, suffixes: set[str]) -> None:
    numbers = shifted(replace(waving_clip, category=category, has_fingers=has_fingers), neck=0.01)
    assert {key for key in numbers if key.startswith("network_neck_mpjpe_cm") and "standing" not in key} == {
        f"network_neck_mpjpe_cm{suffix}" for suffix in suffixes
    }


def posed(height: float, lean: float) -> np.ndarray:
    """Points of a standing body whose pelvis is at a share of its height, its trunk leaned by degrees."""
    pose = standing_pose(SKELETON)
    pose.rotation[0] = quaternion_exp(np.radians([lean, 0, 0]))
    root = np.array([2.0, height * -(SKELETON.path @ SKELETON.rest_offset)[:, 1].min(), 1.0])
    return np.asarray(forward_kinematics(Pose(SKELETON, root, pose.rotation))[0])


@pytest.mark.parametrize(
    ("height", "lean", "stands"),
    [(1.0, 0, True), (0.91, 0, True), (0.89, 0, False), (1.0, 25, True), (1.0, 40, False), (1.0, -40, False)],
)
def test_standing_frames_are_recognised(height: float, lean: float, stands: bool) -> None:
    points = posed(height, lean)
    assert is_standing(SKELETON, points) == stands
    np.testing.assert_array_equal(is_standing(SKELETON, np.stack([[points] * 3] * 2)), np.full((2, 3), stands))


def test_standing_poses_are_scored_apart(waving_clip: Clip) -> None:
    """A third of the frames kneel; there, and only there, the neck is missed."""
    root = waving_clip.pose.root_position.copy()
    root[:30, 1] -= 0.5
    clip = replace(waving_clip, pose=replace(waving_clip.pose, root_position=root))
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    wrong = truth.copy()
    wrong[:30, SKELETON.index("neck")] += [0.0, 0.0, 0.03]
    numbers = numbers_of([clip], {"ik": lambda skeleton: Shifted(skeleton, wrong, {})})
    assert numbers["standing_share"] == pytest.approx(2 / 3)
    assert numbers["ik_neck_mpjpe_cm"] == pytest.approx(1.0)
    assert numbers["ik_neck_mpjpe_cm_standing"] == pytest.approx(0.0, abs=1e-9)


def test_clips_are_scored_at_30_hz_and_averaged_over_frames(waving_clip: Clip) -> None:
    fast = resample(waving_clip, 120.0)
    short = replace(waving_clip, pose=waving_clip.pose[:9])
    numbers = numbers_of([fast, short], {"ik": UpperBodyIk})
    assert (numbers["clips"], numbers["seconds"]) == (2, pytest.approx(fast.seconds + 0.3, abs=0.05))
    parts = []
    for clip in (waving_clip, short):
        ik = UpperBodyIk(SKELETON)
        estimate, _ = ik.step(observe(clip.pose, clip.time, THREE_POINT), ik.start())
        error = estimate.position - forward_kinematics(clip.pose)[0]
        parts.append(100 * np.linalg.norm(error[:, SKELETON.index("neck")], axis=-1))
    assert numbers["ik_neck_mpjpe_cm"] == pytest.approx(np.concatenate(parts).mean(), rel=1e-6)
