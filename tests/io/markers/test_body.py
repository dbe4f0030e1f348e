"""Body from markers on the skin of our model: recognition of the set, joints, units and axes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_markers import (
    LABORATORIES,
    LEGS,
    OPENSIM,
    PAIRS,
    PLUG_IN_GAIT,
    SETS,
    VARIANTS,
    errors,
    found,
    marker_positions,
    raw_of,
)

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import performance_of_unseen_body
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.markers.formats.c3d import write_c3d
from bodysense.io.markers.marker_sets import marker_sets, recognised
from bodysense.io.markers.raw_markers import MarkerFormat, points_alone
from bodysense.takes.track import track
from bodysense.tracking.tracker import Tracker

HARDEST = {"foot": 0.03, "neck": 0.03, "elbow": 0.028}  # m; other joints 1.5 cm
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # our axes → those of most laboratories


@pytest.mark.parametrize("name", SETS)
def test_joints_and_rotations_match_the_motion(unseen_body: Clip, name: str) -> None:
    raw = raw_of(unseen_body, SETS[name])
    known = recognised(raw.names)
    assert known is not None and known.markers.name == name
    far = errors(raw, unseen_body)
    wanted = {f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "foot", "shoulder")}
    assert wanted | {"left_elbow", "right_wrist", "head", "neck", "pelvis"} <= set(far)
    for joint, error in far.items():
        assert error < HARDEST.get(joint.rpartition("_")[2], 0.018), joint
    seen, truth = found(raw).observation, np.asarray(forward_kinematics(unseen_body.pose)[1])
    turned = [k for k in range(len(seen.points)) if seen.has_rotation[:, k].any()]
    assert {"head", "pelvis", "spine3", "left_wrist", "right_wrist"} <= {seen.points[k] for k in turned}
    for k in turned:
        angle = geodesic_angle(seen.rotation[:, k], truth[:, unseen_body.pose.skeleton.index(seen.points[k])])
        assert np.rad2deg(np.mean(angle)) < 6, seen.points[k]


@pytest.mark.parametrize("name", LABORATORIES)
def test_sets_of_laboratories(unseen_body: Clip, name: str) -> None:
    """Every joint of the limbs follows, within 2 cm; balls of feet and necks within 3."""
    raw = raw_of(unseen_body, LABORATORIES[name])
    known = recognised(raw.names)
    assert known is not None and known.markers.name == name and len(known.columns) == len(raw.names)
    far = errors(raw, unseen_body)
    parts = ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")
    assert {"pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in parts)} <= set(far)
    for joint, error in far.items():
        of_top = joint == "head" and name.startswith("OpenSim")  # from the top of the head alone
        assert error < (0.06 if of_top else {**HARDEST, "head": 0.02}.get(joint.rpartition("_")[2], 0.02)), joint


@pytest.mark.parametrize("name", VARIANTS)
def test_other_labels_of_laboratories(unseen_body: Clip, name: str) -> None:
    of, labels = VARIANTS[name]
    raw = raw_of(unseen_body, labels)
    known = recognised(raw.names)
    assert known is not None and known.markers.name == of and len(known.columns) == len(raw.names)
    far = errors(raw, unseen_body)
    parts = ("hip", "ankle", "foot", "shoulder", *(["elbow"] if "elbow_in" in labels else []))
    assert {"pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in parts)} <= set(far)
    assert ("left_knee" in far) == ("knee" in labels)
    for joint, error in far.items():
        of_top = joint == "head" and "head_top" in labels
        assert error < (0.06 if of_top else HARDEST.get(joint.rpartition("_")[2], 0.02)), joint


@pytest.mark.parametrize(
    ("scale", "unit", "turn"),
    [(1000.0, "mm", np.eye(3)), (1000.0, "mm", Z_UP), (100.0, "cm", np.diag([1.0, -1.0, -1.0]))],
)
def test_unit_and_up_are_found(unseen_body: Clip, scale: float, unit: str, turn: np.ndarray) -> None:
    raw = raw_of(unseen_body, PLUG_IN_GAIT, scale)
    raw = replace(raw, position=raw.position @ turn.T)
    seen, truth = found(raw), found(raw_of(unseen_body, PLUG_IN_GAIT)).observation
    assert any(f"the numbers are {unit}" in remark for remark in seen.remarks)
    assert any("is up" in remark for remark in seen.remarks) == bool((turn != np.eye(3)).any())
    both = (seen.observation, truth)
    ends = [[one.position[:, one.points.index(name)] for name in ("head", "left_foot")] for one in both]
    apart = [np.linalg.norm(head - foot, axis=-1) for head, foot in ends]
    np.testing.assert_allclose(apart[0], apart[1], atol=1e-6)
    heights = [one.position[..., 1] for one in (seen.observation, truth)]
    np.testing.assert_allclose(heights[0], heights[1], atol=1e-6)


def test_the_floor_is_moved_to_zero(unseen_body: Clip) -> None:
    raw = raw_of(unseen_body, PLUG_IN_GAIT)
    high = replace(raw, position=raw.position + np.array([0, 0.5, 0]))
    lowered = found(high)
    assert any("the floor was moved" in remark for remark in lowered.remarks)
    low, kept = (np.nanmin(one.observation.position[..., 1]) for one in (lowered, found(high, MarkerFormat(floor=0.5))))
    assert abs(low) < 0.08 and kept == pytest.approx(low + 0.5, abs=0.08)


def test_a_mirrored_body_is_refused(unseen_body: Clip) -> None:
    raw = raw_of(unseen_body, PLUG_IN_GAIT)
    with pytest.raises(BodysenseError, match=r"walk\.c3d: the body is a body only in a mirror: .* --left-handed"):
        found(replace(raw, position=raw.position * [-1, 1, 1]))
    seen = found(replace(raw, position=raw.position * [-1, 1, 1]), MarkerFormat(left_handed=True))
    np.testing.assert_allclose(seen.observation.position, found(raw).observation.position, atol=1e-9)


def test_a_wrong_unit_is_reported(unseen_body: Clip) -> None:
    raw = raw_of(unseen_body, PLUG_IN_GAIT, 1000.0, "mm")
    with pytest.raises(BodysenseError, match="the numbers are mm: give --unit mm"):
        found(raw, MarkerFormat(unit="m"))
    with pytest.raises(BodysenseError, match="times as far apart as on a person; see that the labels are right"):
        found(replace(raw, position=raw.position * 30))


def test_hidden_markers_hide_the_joints_that_need_them(unseen_body: Clip) -> None:
    raw = raw_of(unseen_body, PLUG_IN_GAIT)
    position = raw.position.copy()
    position[5:9, raw.names.index("LWRA")] = np.nan
    seen = found(replace(raw, position=position)).observation
    wrist = seen.points.index("left_wrist")
    np.testing.assert_array_equal(np.flatnonzero(~seen.has_position[:, wrist]), [5, 6, 7, 8])
    assert not seen.has_rotation[5:9, wrist].any() and seen.has_rotation[9:, wrist].all()
    assert seen.has_position[:, seen.points.index("right_wrist")].all()


@pytest.mark.parametrize(("name", "hidden"), [("Plug-in Gait", 0.85), ("OptiTrack Baseline", 0.95)])
def test_most_markers_may_be_hidden(unseen_body: Clip, name: str, hidden: float) -> None:
    raw, rng = raw_of(unseen_body, SETS[name]), np.random.default_rng(int(100 * hidden))
    gone = rng.random(raw.position.shape[:2]) < hidden
    seen = found(replace(raw, position=np.where(gone[..., None], np.nan, raw.position))).observation
    assert np.isfinite(seen.position[seen.has_position]).all()
    np.testing.assert_allclose(np.linalg.norm(seen.rotation[seen.has_rotation], axis=-1), 1, atol=1e-9)


def test_medial_markers_improve_joint_centres(unseen_body: Clip) -> None:
    both = PLUG_IN_GAIT | {"knee_in": "LKNM", "elbow_in": "LELM", "ankle_in": "LANM"}
    far = errors(raw_of(unseen_body, both), unseen_body)
    assert far["left_knee"] < 0.015 and far["left_elbow"] < 0.01
    gone = raw_of(unseen_body, both)
    hidden = [gone.names.index(name) for name in ("LKNM", "RKNM")]
    position = gone.position.copy()
    position[3:, hidden] = np.nan
    assert errors(replace(gone, position=position), unseen_body)["left_knee"] < 0.018


@pytest.mark.parametrize("style", ["Anna:{}", "Skeleton 001_{}", "x_{}", "{}"])
def test_labels_may_have_a_subject(style: str) -> None:
    known = recognised([style.format(name) for name in PLUG_IN_GAIT.values()])
    assert known is not None and known.markers.name == "Plug-in Gait" and len(known.columns) == len(PLUG_IN_GAIT)


def test_a_walking_trial_without_markers_on_knees_keeps_its_feet(unseen_body: Clip, tmp_path: Path) -> None:
    raw = raw_of(unseen_body, VARIANTS["a walking trial of gait2354"][1])
    write_c3d(tmp_path / "walk.c3d", points_alone(raw.names, raw.position, raw.time), raw.frame_rate)
    take = track(tmp_path / "walk.c3d")
    found, truth = (forward_kinematics(clip.pose)[0] for clip in (take.clip, unseen_body))
    for joint, most in (("ankle", 0.03), ("knee", 0.06)):
        for side in ("left", "right"):
            k = unseen_body.pose.skeleton.index(f"{side}_{joint}")
            off = np.linalg.norm(np.asarray(found)[:, k] - np.asarray(truth)[:, k], axis=-1)
            assert off[20:].mean() < most, joint


def test_marker_sets_are_consistent() -> None:
    points = set().union(*({recipe.name for recipe in one.points} for one in marker_sets()))
    assert len(marker_sets()) == 10 and {"left_hip", "right_wrist", "head"} <= points
    for one in marker_sets():
        labels = set(one.labels.values())
        made = {recipe.name for recipe in one.points}
        frames = {frame.name for frame in one.frames}
        for recipe in one.points:
            assert set(recipe.markers) <= labels | made, recipe
            assert set(recipe.frames) <= frames and 0 < recipe.accuracy < 0.05
        for frame in one.frames:
            assert {name for _, start, end in frame.axes for name in (*start, *end)} <= labels
        assert {name for span in one.spans for name in span[:2]} <= labels
        assert {*one.low, *one.high, *(name for name, _ in one.floor)} <= labels


@pytest.mark.parametrize("name", ["Plug-in Gait", *(pytest.param(n, marks=pytest.mark.slow) for n in list(SETS)[1:])])
def test_a_body_is_tracked_from_markers(tmp_path: Path, name: str) -> None:
    """A file of a body of unknown size with noisy markers is completed to 3 cm on average."""
    clip = performance_of_unseen_body()
    clip = replace(clip, pose=clip.pose[300:510:3], frame_rate=10.0)
    places = marker_positions(clip.pose, SETS[name])
    position = np.stack(list(places.values()), axis=1)
    position = position + np.random.default_rng(0).normal(0, 0.002, position.shape)
    write_c3d(tmp_path / "walk.c3d", points_alone(tuple(places), position, clip.time), 10.0)
    take = track(tmp_path / "walk.c3d")
    truth = np.asarray(forward_kinematics(clip.pose)[0])[:, clip.pose.skeleton.indices(BODY)]
    far = np.linalg.norm(take.estimate.points[:, clip.pose.skeleton.indices(BODY)] - truth, axis=-1)[20:]
    assert far.mean() < 0.03
    assert take.person.skeleton.height == pytest.approx(clip.pose.skeleton.height, abs=0.06)


def test_limbs_with_unknown_labels_are_reported(unseen_body: Clip) -> None:
    """A warning names the labels of arms that no set knows, on a body whose legs are known."""
    arms = {"acromion", "elbow", "elbow_in", "wrist_thumb", "wrist_pinky", "head_front", "head_back", "c7", "sternum"}
    odd = {spot: f"Lzz{k}" if spot in arms else label for k, (spot, label) in enumerate(PAIRS.items())}
    odd |= {spot: f"Lyy{spot}" for spot in ("upper_arm", "forearm", "hand", "head_side", "thigh", "shin")}
    (line,) = found(raw_of(unseen_body, odd)).warnings
    assert line.startswith("left arm and right arm: hang at the sides") and "'Lzz" in line and "--names" in line
    assert not found(raw_of(unseen_body, PAIRS)).warnings
    few = {"asis": "LASI", "psis": "LPSI", "knee": "LKNE", "ankle": "LANK"}
    few |= {spot: f"Lzz{spot}" for spot in ("heel", "thigh", "shin", "elbow")}
    with pytest.raises(BodysenseError, match=r"too few to be sure; 8 are unknown: 'Lzzheel'"):
        found(raw_of(unseen_body, few))


def test_legs_alone_hang_the_arms(unseen_body: Clip, tmp_path: Path) -> None:
    raw = raw_of(unseen_body, LEGS)
    write_c3d(tmp_path / "legs.c3d", points_alone(raw.names, raw.position, raw.time), raw.frame_rate)
    take = track(tmp_path / "legs.c3d")
    (line,) = take.remarks
    assert line.startswith("left arm and right arm: hang at the sides, guessed (wrists ±") and "unknown" not in line
    place, skeleton = np.asarray(forward_kinematics(take.clip.pose)[0]), take.clip.pose.skeleton
    np.testing.assert_allclose(take.estimate.points, place, atol=1e-6)
    for side in ("left", "right"):
        wrist, shoulder = (place[:, skeleton.index(f"{side}_{part}")] for part in ("wrist", "shoulder"))
        assert np.median(shoulder[:, 1] - wrist[:, 1]) > 0.3


@pytest.mark.parametrize("names", [LEGS, PLUG_IN_GAIT])
def test_a_causal_take_equals_a_live_session(unseen_body: Clip, tmp_path: Path, names: dict[str, str]) -> None:
    """Frame by frame, with hips that are hidden at times."""
    raw = raw_of(unseen_body, names)
    hips = [k for k, label in enumerate(raw.names) if label.endswith(("ASI", "PSI"))]
    raw.position[20:30, hips] = np.nan
    write_c3d(tmp_path / "walk.c3d", points_alone(raw.names, raw.position, raw.time), raw.frame_rate)
    take = track(tmp_path / "walk.c3d", causal=True)
    assert hips and take.markers is not None
    tracker, seen = Tracker(), take.markers.recording.observation
    state = tracker.start()
    for k in range(len(seen)):
        live, state = tracker.step(seen[k : k + 1], state)
        np.testing.assert_array_equal(take.estimate.points[k], live.points[0])
        np.testing.assert_array_equal(take.estimate.pose.rotation[k], live.pose.rotation[0])
        np.testing.assert_array_equal(take.estimate.bound[k], live.bound[0])


@pytest.mark.parametrize("names", [OPENSIM, PLUG_IN_GAIT])
def test_a_guessed_head_does_not_move_the_legs(unseen_body: Clip, tmp_path: Path, names: dict[str, str]) -> None:
    """Knees and ankles of a bowing body stay at their markers, whatever the height of the head."""
    rotation, spine = np.array(unseen_body.pose.rotation), unseen_body.pose.skeleton.index("spine1")
    bow = quaternion_exp(np.sin(np.arange(len(rotation)) / 5)[:, None] ** 2 * [0.7, 0.0, 0.0])
    rotation[:, spine] = quaternion_multiply(rotation[:, spine], bow)
    raw = raw_of(replace(unseen_body, pose=replace(unseen_body.pose, rotation=rotation)), names)
    on_head = np.array([label == "Top.Head" or label.endswith("HD") for label in raw.names])
    position = raw.position + on_head[:, None] * [0.0, 0.06, 0.0]
    write_c3d(tmp_path / "bow.c3d", points_alone(raw.names, position, raw.time), raw.frame_rate)
    take = track(tmp_path / "bow.c3d")
    assert take.markers is not None
    seen, skeleton = take.markers.recording.observation, take.clip.pose.skeleton
    for place in (take.estimate.points, np.asarray(forward_kinematics(take.clip.pose)[0])):
        for joint in (f"{side}_{part}" for side in ("left", "right") for part in ("knee", "ankle")):
            apart = place[:, skeleton.index(joint)] - seen.position[:, seen.points.index(joint)]
            assert np.linalg.norm(apart, axis=-1).mean() < 0.01, joint


def test_a_limb_without_joints_is_reported(unseen_body: Clip) -> None:
    """The network guesses an arm without markers, or both arms, and a warning reports it."""
    arm = ("elbow", "elbow_in", "wrist_thumb", "wrist_pinky")
    raw = raw_of(unseen_body, PAIRS)
    bare = {PAIRS[spot] for spot in arm}
    kept = [k for k, label in enumerate(raw.names) if label not in bare]
    one = replace(raw, names=tuple(raw.names[k] for k in kept), position=raw.position[:, kept])
    (line,) = found(one).warnings
    assert line.startswith("left arm: guessed by the network") and "unknown labels" not in line
    trunk = found(raw_of(unseen_body, {**LEGS, **{spot: PAIRS[spot] for spot in ("c7", "clavicle", "sternum")}}))
    assert "neck" in trunk.observation.points and not trunk.arms_hang
    assert trunk.warnings[0].startswith("left arm and right arm: guessed by the network")


def test_a_duplicate_label_is_reported(unseen_body: Clip) -> None:
    raw = raw_of(unseen_body, PAIRS)
    twice = replace(raw, names=(*raw.names, "LSHO"), position=np.concatenate([raw.position, raw.position[:, :1]], 1))
    (line,) = found(twice).warnings
    assert line.startswith("duplicate labels: 'LSHO'")


def test_a_set_of_fingers_is_no_body() -> None:
    names = ["hand_left", *(f"{finger}{k}_left" for finger in ("index", "middle", "ring") for k in (1, 2, 3))]
    assert recognised(names) is None
    dots = recognised([f"{side}.{part}" for side in "LR" for part in ("Bicep", "Hip", "Wrist", "Elbow", "Hand")])
    assert dots is None or not {"left_shoulder", "right_shoulder"} & set(dots.columns)
