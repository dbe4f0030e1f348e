"""Scoring of window networks: the same as frame by frame, figures as counted by hand, nothing counted twice."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.takes.last_known import KNOWN, Hold
from bodysense_lab.core.scoring import UNOC_EVAL_JOINTS
from bodysense_lab.data.datasets import DataSet
from bodysense_lab.papers.unoc.network.network import PAPER, BodyNetwork, read_weights, tracked_of
from bodysense_lab.papers.unoc.score import variant_scores as variants
from bodysense_lab.papers.unoc.score.kept_scores import scores_path
from bodysense_lab.papers.unoc.score.variant_scores import (
    Shipped,
    Work,
    complete,
    errors_of,
    networks_in,
    read_observation,
    score,
    score_clip,
)


def never(clip: Clip) -> None:
    raise AssertionError("nothing is to be counted")


def noted(clip: Clip) -> None:
    """Ignore progress."""


@pytest.mark.parametrize("name", ["gru", "tcn", "head_local", "mask_given"])
def test_batches_equal_frame_by_frame(untrained: Path, waving_clip: Clip, name: str) -> None:
    """BodyNetwork.forward, called with a frame at a time and the state it returned; every third frame is scored."""
    skeleton = waving_clip.pose.skeleton.scaled(1.9)
    pose = replace(waving_clip.pose, skeleton=skeleton)[:30]
    observation = observe(pose, waving_clip.time[:30], HEADSET_CAMERA)
    model = read_weights(untrained / f"{name}.pt", default_skeleton())
    state, tracked, rows = model.start(1), tracked_of(observation, skeleton), []
    whole = ("bone_length", "height")
    for t in range(30):
        now = tracked._replace(
            **{key: value[:, t : t + 1] for key, value in tracked._asdict().items() if key not in whole}
        )
        with torch.no_grad():
            completed, state = model(now, state)
        rows.append(completed.position[0, 0].numpy())
    frames = np.arange(0, 30, 3)
    ours = complete(model, read_observation(model, observation, skeleton), frames)
    np.testing.assert_allclose(ours, np.stack(rows)[frames], atol=2e-5)


def test_last_known_equals_hold(waving_clip: Clip) -> None:
    parts = score_clip(waving_clip, Work({}, stride=3))
    assert {key[0] for key in parts} == {"constant_velocity", *(f"last_known_{frame}" for frame in KNOWN)}
    skeleton = waving_clip.pose.skeleton
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    tested = [p for p, name in enumerate(skeleton.points) if name.partition("_")[2] in UNOC_EVAL_JOINTS]
    for frame in KNOWN:
        hold = Hold(skeleton, frame)
        position = hold.step(observation, hold.start())[0].position
        errors = [
            100 * np.linalg.norm(position[t, p] - truth[t, p])
            for t in range(0, len(truth), 3)
            for p in tested
            if not observation.has_position[t, p]
        ]
        tally = parts[f"last_known_{frame}", "main", "body", "occluded"]
        assert tally.count == len(errors)
        assert tally.rmsjpe == pytest.approx(np.sqrt(np.mean(np.square(errors))))
        assert tally.mpjpe == pytest.approx(np.mean(errors))


@pytest.mark.parametrize("name", ["gru", "head_local"])
def test_figures_are_those_of_naive_loops(untrained: Path, waving_clip: Clip, name: str) -> None:
    """A tall wearer: errors are in their real size; fingers from their wrist, but with the body in the world."""
    skeleton = waving_clip.pose.skeleton.scaled(1.95)
    clip = replace(waving_clip, pose=replace(waving_clip.pose, skeleton=skeleton)[:20])
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
    model = read_weights(untrained / f"{name}.pt", default_skeleton())
    with torch.no_grad():
        completed, _ = model(tracked_of(observation, skeleton), model.start(1))
    ours, truth = completed.position[0].numpy(), np.asarray(forward_kinematics(clip.pose)[0])
    errors: dict[tuple[str, str], list[float]] = {}
    for t in range(len(clip)):
        for p, point in enumerate(skeleton.points):
            wrist, parent = skeleton.wrist_of[p], skeleton.parents[p]
            world, share = ours[t, p] - truth[t, p], "all" if observation.has_position[t, p] else "occluded"
            bone, true_bone = ours[t, p] - ours[t, parent], truth[t, p] - truth[t, parent]
            kinds = {}
            if point.partition("_")[2] in UNOC_EVAL_JOINTS:
                kinds = {"body": world, "parent_body": bone - true_bone}
                kinds["bone_body"] = np.array([np.linalg.norm(bone) - np.linalg.norm(true_bone)])
            if wrist >= 0:
                kinds = {"finger": world - (ours[t, wrist] - truth[t, wrist])}
            if kinds:
                kinds |= {"body_and_finger": world, "parent_all": bone - true_bone}
                kinds["bone_all"] = np.array([np.linalg.norm(bone) - np.linalg.norm(true_bone)])
            for kind, error in kinds.items():
                for which in {share, "all"}:
                    errors.setdefault((kind, which), []).append(100 * float(np.linalg.norm(error)))
    parts = score_clip(clip, Work({name: untrained / f"{name}.pt"}))
    for (kind, share), values in errors.items():
        if share == "occluded" and kind.startswith(("parent", "bone")):
            continue
        tally = parts[name, "main", kind, share]
        assert tally.count == len(values), (kind, share)
        assert tally.rmsjpe == pytest.approx(np.sqrt(np.mean(np.square(values))), rel=1e-4), (kind, share)
        assert tally.mpjpe == pytest.approx(np.mean(values), rel=1e-4), (kind, share)


def test_a_body_that_is_right_has_no_error(waving_clip: Clip) -> None:
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])
    hidden = np.arange(truth.shape[0] * truth.shape[1]).reshape(truth.shape[:2]) % 3 == 0
    parts = errors_of(truth, truth, hidden, waving_clip)
    assert all(tally.count and tally.rmsjpe == 0 for tally in parts.values())
    no_fingers = errors_of(truth, truth, hidden, replace(waving_clip, has_fingers=False, category="dance"))
    assert {part for _, part, _ in no_fingers} == {"body", "every_point", "parent_body", "bone_body"}
    assert {group for group, _, _ in no_fingers} == {"dance"}


def test_scores_are_kept_beside_the_networks(untrained: Path, data: DataSet, tmp_path: Path) -> None:
    folder = tmp_path / "networks"
    folder.mkdir()
    for name in ("gru", "rnn"):
        (folder / f"{name}.pt").write_bytes((untrained / f"{name}.pt").read_bytes())
    work = Work(networks_in(folder, ["gru", "rnn"]), stride=4)
    seen: list[str] = []
    first = score(data, folder, work, 1, lambda clip: seen.append(clip.name))
    assert len(seen) == 2 and scores_path(folder, "gru", data).is_file()
    assert first["gru"].census.clips == 2
    again = score(data, folder, work, 1, never)
    assert {name: one.tallies for name, one in again.items()} == {name: one.tallies for name, one in first.items()}
    # A network that changed is scored again, and it alone.
    before = scores_path(folder, "gru", data).stat().st_mtime_ns
    time.sleep(0.01)
    (folder / "rnn.pt").write_bytes((untrained / "lstm.pt").read_bytes())
    variants._network.cache_clear()
    changed = score(data, folder, work, 1, noted)
    assert changed["rnn"].tallies != first["rnn"].tallies and changed["gru"].tallies == first["gru"].tallies
    assert scores_path(folder, "gru", data).stat().st_mtime_ns == before


def test_the_shipped_predictor(data: DataSet, tmp_path: Path, small_network: Path) -> None:
    """Before IK measured points are at their places; after it the bones have the wearer's lengths."""
    scores = score(data, tmp_path, Work({}, Shipped(small_network), stride=2), 1, noted)
    best, tracker = scores["best"], scores["tracker"]
    assert best.get("body", "occluded").squared == pytest.approx(best.get("body", "all").squared)
    assert tracker.get("bone_all", "all").rmsjpe < 1e-6 < best.get("bone_all", "all").rmsjpe
    assert score(data, tmp_path, Work({}, Shipped(small_network), stride=2), 1, never).keys() == scores.keys()


def test_missing_networks_and_networks_of_another_kind(untrained: Path, tmp_path: Path, waving_clip: Clip) -> None:
    with pytest.raises(BodysenseError) as error:
        networks_in(tmp_path, ["gru", "tcn"])
    assert "gru, tcn" in str(error.value) and "bodysense train unoc-tables" in str(error.value)
    model = BodyNetwork(replace(PAPER, window=None, hidden=8, branch=(8,), judge_branch=(8,)), default_skeleton())
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    reading = read_observation(model, observation, waving_clip.pose.skeleton)
    with pytest.raises(BodysenseError, match="carries its state"):
        complete(model, reading, np.arange(3))
