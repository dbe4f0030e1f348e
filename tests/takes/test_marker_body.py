"""Bodies fitted to optical markers: offsets and bones from a whole take, and joints whose markers are hidden.

Markers are on the skin of a made-up body; the offsets with which they are made are the independent truth.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from virtual_markers import BASELINE, LEGS, OPENSIM, PLUG_IN_GAIT, RIZZOLI, SPOTS, raw_of

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import performance_of_unseen_body
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.raw_markers import RawMarkers, points_alone
from bodysense.io.resample import resample
from bodysense.takes import marker_body
from bodysense.takes.fitting import Trunk
from bodysense.takes.marker_body import fit_markers, next_poses
from bodysense.takes.take import Take
from bodysense.takes.track import track
from bodysense.takes.worn_markers import SPINE, BodyPoses, SeenMarkers, WornMarkers, carried_markers

NOISE = 0.0005  # m, of a marker
ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")
LEG = ("RKNE", "RTIB", "RANK", "RHEE", "RTOE")


@cache
def hidden_take() -> tuple[Clip, RawMarkers, np.ndarray, np.ndarray]:
    """Return a motion, its markers with an arm hidden six times and a leg five times for 1 s, and both masks (T,)."""
    clip = performance_of_unseen_body()
    raw = raw_of(clip, PLUG_IN_GAIT)
    position = raw.position + np.random.default_rng(0).normal(0, NOISE, raw.position.shape)
    frames, second = len(clip), round(clip.frame_rate)
    masks = []
    for labels, count, shift in ((ARM, 6, 0.5), (LEG, 5, 0.7)):
        mask = np.zeros(frames, dtype=bool)
        for k in range(count):
            first = int((k + shift) / count * frames) - second // 2
            mask[first : first + second] = True
        for label in labels:
            position[mask, raw.names.index(label)] = np.nan
        masks.append(mask)
    return clip, replace(raw, position=position), masks[0], masks[1]


def distance(pose: Pose, clip: Clip, name: str, frames: np.ndarray) -> float:
    """Return the mean distance of a joint from its true place, m."""
    places = [
        np.asarray(forward_kinematics(one)[0])[frames, clip.pose.skeleton.index(name)] for one in (pose, clip.pose)
    ]
    return float(np.linalg.norm(places[0] - places[1], axis=-1).mean())


def fitted(path: Path, raw: RawMarkers, person: Person | None = None) -> Take:
    write_c3d(path, points_alone(raw.names, raw.position, raw.time), raw.frame_rate)
    return track(path, person=person)


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> tuple[Clip, Pose, np.ndarray, np.ndarray]:
    clip, raw, arm, leg = hidden_take()
    return clip, fitted(tmp_path_factory.mktemp("take") / "walk.c3d", raw).estimate.pose, arm, leg


def test_joints_with_seen_markers_are_at_their_places(take: tuple[Clip, Pose, np.ndarray, np.ndarray]) -> None:
    """Joint centres of single frames are 1.1 cm off."""
    clip, pose, arm, leg = take
    seen = ~(arm | leg)
    assert np.mean([distance(pose, clip, name, seen) for name in BODY]) < 0.006


def test_joints_with_hidden_markers_are_near_their_places(take: tuple[Clip, Pose, np.ndarray, np.ndarray]) -> None:
    """Bounds are what 1 s of hidden markers may cost; the thigh's marker stays seen and holds the knee."""
    clip, pose, arm, leg = take
    bounds = {
        "left_elbow": (arm, 0.04),
        "left_wrist": (arm, 0.065),
        "right_knee": (leg, 0.015),
        "right_ankle": (leg, 0.04),
    }
    errors = {name: distance(pose, clip, name, frames) for name, (frames, _) in bounds.items()}
    print({name: f"{100 * error:.1f} cm" for name, error in errors.items()})
    assert all(errors[name] <= bound for name, (_, bound) in bounds.items()), errors


def test_bones_are_nearer_to_the_wearers_than_the_trackers(take: tuple[Clip, Pose, np.ndarray, np.ndarray]) -> None:
    clip, pose, *_ = take
    limbs = [f"{side}_{part}" for side in ("left", "right") for part in ("knee", "ankle", "elbow", "wrist")]
    rows = clip.pose.skeleton.indices(limbs)
    lengths = [np.linalg.norm(one.skeleton.rest_offset[rows], axis=-1) for one in (pose, clip.pose)]
    assert np.abs(lengths[0] - lengths[1]).max() < 0.01


def test_a_known_body_keeps_its_bones_and_helps(
    tmp_path: Path, take: tuple[Clip, Pose, np.ndarray, np.ndarray]
) -> None:
    clip, pose, arm, leg = take
    known = fitted(tmp_path / "walk.c3d", hidden_take()[1], Person.known(clip.pose.skeleton)).estimate.pose
    assert (known.skeleton.rest_offset == clip.pose.skeleton.rest_offset).all()
    seen = ~(arm | leg)
    of_both = [np.mean([distance(one, clip, name, seen) for name in BODY]) for one in (known, pose)]
    assert of_both[0] <= of_both[1] + 0.0005


@pytest.mark.slow
@pytest.mark.parametrize("labels", [RIZZOLI, OPENSIM, BASELINE], ids=["Rizzoli", "OpenSim", "Baseline"])
def test_sliding_skin_makes_no_set_worse_than_single_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, labels: dict[str, str]
) -> None:
    """Skin that slides by 7 mm over a second is not taken for other bones."""
    clip = performance_of_unseen_body()
    raw = raw_of(clip, labels)
    window = np.hanning(round(clip.frame_rate) + 2)
    white = np.random.default_rng(1).normal(0, 0.007 / 3**0.5, (len(clip) + len(window) - 1, raw.position[0].size))
    skin = np.stack([np.convolve(one, window / np.linalg.norm(window), "valid") for one in white.T], axis=1)
    raw = replace(raw, position=raw.position + skin.reshape(raw.position.shape))
    errors = []
    for is_fitted in (True, False):
        if not is_fitted:
            monkeypatch.setattr(marker_body, "fit_markers", lambda pose, *rest, **options: pose)
        pose = fitted(tmp_path / "walk.c3d", raw).estimate.pose
        errors.append(np.mean([distance(pose, clip, name, np.ones(len(clip), dtype=bool)) for name in BODY]))
    assert errors[0] <= errors[1]


def test_markers_on_condyles_are_carried_by_the_bone_above(take: tuple[Clip, Pose, np.ndarray, np.ndarray]) -> None:
    """Carriers are those of the made-up body, also for a heel and a forearm, which are near to other joints."""
    pose = take[1]
    raw = hidden_take()[1]
    trunk = Trunk.of(pose.skeleton)
    seen = SeenMarkers(raw.position, (), raw.position[:, :0], np.zeros(0))
    worn = carried_markers(trunk.without_fingers(pose), seen)
    carriers = {raw.names[k]: worn.skeleton.joints[joint] for k, joint in zip(worn.columns, worn.joint, strict=True)}
    for spot, label in PLUG_IN_GAIT.items():
        truth = {"asis": "pelvis", "psis": "pelvis"}.get(spot) or SPOTS[spot][0]
        assert carriers[label] == truth, label


def test_bodies_without_chest_markers_keep_the_trackers_spine(tmp_path: Path) -> None:
    clip = performance_of_unseen_body()
    clip = replace(clip, pose=clip.pose[:200])
    raw = raw_of(clip, LEGS)
    pose = fitted(tmp_path / "legs.c3d", raw).estimate.pose
    bends = np.asarray(pose.rotation)[:, pose.skeleton.indices(SPINE)]
    assert not np.allclose(bends[:, 0], bends[:, 1], atol=1e-4)
    assert distance(pose, clip, "left_knee", np.ones(200, dtype=bool)) < 0.02


def test_corrections_between_fitted_frames_are_smooth() -> None:
    """At 120 Hz every fourth frame is fitted; the frames between are as near to the truth."""
    clip = performance_of_unseen_body()
    fast = resample(replace(clip, pose=clip.pose[:150]), 120.0)
    raw = raw_of(fast, PLUG_IN_GAIT)
    off = np.random.default_rng(2).normal(0, 0.02, len(fast.pose.skeleton.joints) * 3).reshape(-1, 3)
    turned = np.asarray(quaternion_multiply(fast.pose.rotation, quaternion_exp(off)[None]))
    start = Pose(fast.pose.skeleton, fast.pose.root_position, turned)
    seen = SeenMarkers(raw.position, (), raw.position[:, :0], np.zeros(0))
    pose = fit_markers(start, seen, 1 / 120, is_known=True)
    knots = np.arange(len(fast)) % 4 == 0
    for name in ("left_wrist", "right_ankle"):
        assert distance(pose, fast, name, ~knots) < distance(pose, fast, name, knots) + 0.001


def dense_step(
    worn: WornMarkers, now: BodyPoses, prior: BodyPoses, position: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Return the step (3 + 3 J) of one frame by the rows of its linearised fit."""
    joints, turn = now.kinematics(worn.skeleton)
    place, count = worn.place(joints, turn)[0], len(worn.skeleton.joints)
    rows, missed = [], []
    for marker, at in enumerate(position):
        if not np.isfinite(at).all():
            continue
        by_step = np.zeros((3, 3 + 3 * count))
        by_step[:, :3] = np.eye(3)
        joint = int(worn.joint[marker])
        while joint >= 0:
            by_step[:, 3 + 3 * joint : 6 + 3 * joint] = np.cross(np.eye(3), place[marker] - joints[0, joint]).T
            joint = worn.skeleton.parents[joint]
        rows.append(by_step / worn.noise[marker])
        missed.append((at - place[marker]) / worn.noise[marker])
    matrix = np.concatenate(rows) if rows else np.zeros((0, 3 + 3 * count))
    pull = weight * now.step_to(prior, turn)[0]
    return np.linalg.solve(matrix.T @ matrix + np.diag(weight), matrix.T @ np.concatenate([*missed, []]) + pull)


@pytest.mark.parametrize("hidden", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_steps_of_poses_solve_the_dense_equations(seed: int, hidden: float) -> None:
    rng, skeleton = np.random.default_rng(seed), Trunk.of(performance_of_unseen_body().pose.skeleton).skeleton
    frames, markers, joints = 5, 30, len(skeleton.joints)

    def poses() -> BodyPoses:
        return BodyPoses(
            3 * rng.normal(size=(1, 3)) + 0.02 * rng.normal(size=(frames, 3)),
            quaternion_exp(0.4 * rng.normal(size=(frames, joints, 3))),
        )

    worn = WornMarkers(
        skeleton,
        rng.integers(0, joints, markers),
        0.1 * rng.normal(size=(markers, 3)),
        np.full(markers, 0.03),
        rng.uniform(0.003, 0.05, markers),
        np.arange(markers),
    )
    now, prior = poses(), poses()
    position = worn.place(*now.kinematics(skeleton)) + 0.05 * rng.normal(size=(frames, markers, 3))
    position[rng.random((frames, markers)) < hidden, rng.integers(0, 3)] = np.nan
    weight = rng.uniform(1.0, 400.0, (frames, 3 + 3 * joints))
    done = next_poses(worn, now, prior, position, weight)
    for frame in range(frames):
        one = slice(frame, frame + 1)
        step = dense_step(worn, now[one], prior[one], position[frame], weight[frame])
        expected = now[one].moved(step[None], now[one].kinematics(skeleton)[1])
        np.testing.assert_allclose(done.root[one], expected.root, atol=1e-9)
        np.testing.assert_allclose(done.local[one], expected.local, atol=1e-9)
