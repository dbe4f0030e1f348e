"""Takes at high rates, of which only some frames are completed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_markers import PLUG_IN_GAIT, raw_of

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.demo import performance_of_unseen_body
from bodysense.geometry.rotation import geodesic_angle, normalize, quaternion_exp
from bodysense.io.clip import Clip
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.raw_markers import points_alone
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.takes import track as takes
from bodysense.takes.thinning import RATE, at_all_frames, kept_frames
from bodysense.takes.track import track
from bodysense.tracking.estimate import Estimate


def estimate_of(clip: Clip) -> tuple[Estimate, Observation]:
    """Return an estimate that equals a motion, and an observation of its head."""
    skeleton, frames = clip.pose.skeleton, len(clip)
    points = np.asarray(forward_kinematics(clip.pose)[0])
    head = points[:, [skeleton.index("head")]]
    seen = np.ones((frames, 1), dtype=bool)
    observation = Observation(
        ("head",), head, np.zeros((frames, 1, 4)), seen, ~seen, np.full((frames, 1), 0.001), clip.time
    )
    error = np.repeat(np.linspace(0.01, 0.02, frames)[:, None], points.shape[1], axis=1)
    measured = np.zeros(points.shape[:2], dtype=bool)
    offset = np.broadcast_to(skeleton.rest_offset, points.shape)
    return Estimate(clip.pose, points, measured, error, 2 * error, np.zeros((frames, 4)), offset), observation


@pytest.mark.parametrize("rate", [25.0, 59.0, 60.0, 100.0, 240.0])
def test_kept_frames_are_often_enough_and_have_both_sides_of_each_gap(rate: float) -> None:
    time = np.arange(500) / rate
    time[217:] += 3.0
    kept = kept_frames(time, 1 / rate, 1.0)
    assert {0, 216, 217, 499} <= set(kept.tolist())
    steps = np.diff(time[kept])[np.diff(kept) > 1]
    assert (np.delete(np.diff(time[kept]), kept.searchsorted(216)) < 1 / RATE + 1 / rate * (rate < RATE) + 1e-9).all()
    assert len(kept) == 500 if rate < 2 * RATE else np.median(steps) > 0.5 / RATE


def test_frames_between_kept_ones_follow_the_motion() -> None:
    """Joints swing at up to 3 Hz; straight lines between the kept frames are off by 20 mm and 0.7° at worst."""
    random, skeleton = np.random.default_rng(3), default_skeleton()
    time, joints = np.arange(600) / 120, (1, len(skeleton.joints), 1)
    phase, rate = random.uniform(0, 2 * np.pi, joints), random.uniform(0.5, 3.0, joints)
    axis = normalize(random.normal(size=(1, len(skeleton.joints), 3)))
    rotation = quaternion_exp(0.25 * np.sin(phase + 2 * np.pi * rate * time[:, None, None]) * axis)
    root = np.stack([np.sin(time), 0.1 * np.sin(5 * time), time], axis=1)
    clip = Clip("swinging", Pose(skeleton, root, np.asarray(rotation)), 120.0)
    whole, observation = estimate_of(clip)
    kept = kept_frames(clip.time, 1 / 120, 1.0)
    names = ("points", "measured", "confidence", "bound", "contact", "rest_offset")
    part = replace(whole, pose=clip.pose[kept], **{name: getattr(whole, name)[kept] for name in names})
    found = at_all_frames(part, kept, observation)
    off = np.linalg.norm(found.points - whole.points, axis=-1)
    angle = np.rad2deg(geodesic_angle(np.asarray(found.pose.rotation), np.asarray(clip.pose.rotation)))
    assert off[kept].max() < 1e-9 and angle[kept].max() < 1e-4
    inside = slice(4, -4)  # between frames with two neighbours
    assert off[inside].max() < 0.002 and angle[inside].max() < 0.1
    np.testing.assert_allclose(found.confidence, whole.confidence, atol=1e-9)
    head = clip.pose.skeleton.index("head")
    assert found.measured[:, head].all() and found.measured.sum() == len(clip)


def test_markers_at_100_hz_are_met_as_exactly_as_if_all_frames_were_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = resample(performance_of_unseen_body(), 100.0)
    clip = replace(clip, pose=clip.pose[:400])
    raw = raw_of(clip, PLUG_IN_GAIT)
    position = raw.position + np.random.default_rng(0).normal(0, 0.0005, raw.position.shape)
    write_c3d(tmp_path / "walk.c3d", points_alone(raw.names, position, raw.time), raw.frame_rate)
    joints = clip.pose.skeleton.indices(BODY)
    true = np.asarray(forward_kinematics(clip.pose)[0])[:, joints]

    def errors() -> np.ndarray:
        take = track(tmp_path / "walk.c3d")
        assert len(take.clip) == len(take.estimate.measured) == len(clip)
        found = np.asarray(forward_kinematics(take.clip.pose)[0])[:, joints]
        return np.linalg.norm(found - true, axis=-1)

    thinned = errors()
    monkeypatch.setattr(takes, "kept_frames", lambda time, *_: np.arange(len(time)))
    every = errors()
    assert thinned.mean() < every.mean() + 0.0002
    assert np.percentile(thinned, 99) < np.percentile(every, 99) + 0.001
