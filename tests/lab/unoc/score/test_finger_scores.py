"""The finger synthesis table: its baselines do what they say."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose
from bodysense.body.resting import hand_length
from bodysense.cli import main
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.data.clips import open_clips
from bodysense_lab.data.datasets import Census, DataSet, census_of, gather_results
from bodysense_lab.papers.unoc.learned_upper_body import LearnedUpperBody, load_upper_body
from bodysense_lab.papers.unoc.point_model import load_point_model
from bodysense_lab.papers.unoc.score.finger_scores import (
    METHODS,
    Examples,
    body_features,
    examples_of,
    finger_errors,
    finger_offsets,
    finger_report,
)
from bodysense_lab.papers.unoc.score.upper_body_table import upper_body_errors
from bodysense_lab.papers.unoc.upper_body_ik import UpperBodyIk


@pytest.fixture(scope="module")
def examples(waving_clip: Clip) -> Examples:
    return examples_of([waving_clip, replace(waving_clip, has_fingers=False)])


def test_examples_are_the_frames_and_their_mirror_images(examples: Examples, waving_clip: Clip) -> None:
    assert len(examples.features) == len(examples.hand) == 2 * len(waving_clip)
    size = hand_length(waving_clip.pose.skeleton)
    np.testing.assert_allclose(examples.hand[: len(waving_clip)] * size, finger_offsets(waving_clip), atol=1e-6)


def test_the_nearest_is_the_nearest(examples: Examples) -> None:
    rng = np.random.default_rng(0)
    queries = examples.features[rng.integers(len(examples.features), size=40)]
    queries = (queries + rng.normal(scale=0.05, size=queries.shape)).astype(np.float32)
    _, place = KDTree(examples.features).query(queries)
    np.testing.assert_array_equal(examples.nearest(queries), examples.hand[place])


def test_features_do_not_depend_on_heading_and_height(waving_clip: Clip) -> None:
    pose = waving_clip.pose
    turn = Rotation.from_rotvec([0, 1.2, 0])
    rotation = pose.rotation.copy()
    rotation[:, 0] = (turn * Rotation.from_quat(rotation[:, 0], scalar_first=True)).as_quat(scalar_first=True)
    taller = pose.skeleton.scaled(2.0)
    root = turn.apply(pose.root_position) * (2.0 / pose.skeleton.height) + np.array([1.0, 0, 0])
    moved = replace(waving_clip, pose=Pose(taller, root, rotation))
    np.testing.assert_allclose(body_features(moved), body_features(waving_clip), atol=1e-9)


def test_the_table(examples: Examples, waving_clip: Clip) -> None:
    """On a clip that is among the examples the nearest frame is the frame itself."""
    found = finger_errors(waving_clip, examples, load_point_model("fingers"))
    numbers = finger_report(found, census_of(waving_clip), DataSet("motion", Path("motion"))).numbers
    assert numbers["clips"] == 1
    assert numbers["nearest_rmsjpe_cm"] == pytest.approx(0, abs=1e-3)
    for method in METHODS:
        assert numbers[f"{method}_rmsjpe_cm"] >= numbers[f"{method}_mpjpe_cm"]
    truth = finger_offsets(waving_clip)
    mean = 100 * np.linalg.norm(truth - examples.mean * hand_length(waving_clip.pose.skeleton), axis=-1)
    assert numbers["mean_pose_mpjpe_cm"] == pytest.approx(mean.mean(), rel=1e-5)


def test_motion_without_fingers_is_refused(waving_clip: Clip) -> None:
    bare = replace(waving_clip, has_fingers=False)
    with pytest.raises(BodysenseError, match="no clip of the train split has fingers"):
        examples_of([bare])
    with pytest.raises(BodysenseError, match="no clip of the split has fingers"):
        finger_report({}, Census(), DataSet("motion", Path("motion")))


@pytest.mark.slow
def test_the_packaged_network_beats_both_baselines(motion_data: Path, tmp_path: Path) -> None:
    """On people's actions that it has not seen, by some percent: half an hour of animation teaches no more.

    Only Rocketbox's clips have fingers.
    """
    given = ["--data", str(motion_data / "rocketbox"), "--json", str(tmp_path / "a.json")]
    assert main(["evaluate", "finger-synthesis", *given]) == 0
    numbers = json.loads((tmp_path / "a.json").read_text())
    for baseline in ("mean_pose", "nearest"):
        for measure in ("rmsjpe", "mpjpe"):
            assert numbers[f"network_{measure}_cm"] < 0.96 * numbers[f"{baseline}_{measure}_cm"]


@pytest.mark.slow
def test_the_packaged_upper_body_beats_inverse_kinematics(motion_data: Path) -> None:
    """On some clips of people that it has not seen."""
    model = load_upper_body()
    clips = [clip for clip in islice(open_clips(motion_data, "test", ("talk_gesture", "everyday")), 0, 60, 4)]
    methods = {"network": lambda skeleton: LearnedUpperBody(skeleton, model), "ik": UpperBodyIk}
    found, _ = gather_results(partial(upper_body_errors, methods=methods), clips, 1, lambda clip: None)
    for joints in ("neck", "shoulders", "elbows"):
        network, ik = (found["main", ("all", joints), method, "error"].rmsjpe for method in ("network", "ik"))
        assert network < 0.75 * ik, joints
