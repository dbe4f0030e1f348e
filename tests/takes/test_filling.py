"""Motions with holes: known frames are bit-identical, missing ones are filled without jumps and above the floor."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bodysense
from bodysense.body.footing import side_clearance
from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp
from bodysense.io.clip import Clip
from bodysense.io.formats import bvh_text
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.io.formats.bvh_text import BvhFile, open_bvh
from bodysense.io.holes import missing_items
from bodysense.io.motion_files import write_motion
from bodysense.io.rigs import figure
from bodysense.sources.open import MotionSource, open_source
from bodysense.sources.partial_motion import open_partial
from bodysense.takes import track as takes
from bodysense.takes import two_way
from bodysense.takes.filling import (
    KnownPoints,
    expected_deviations,
    fill_motion,
    fill_rotations,
    guessed_rotations,
    hold_filled_feet,
    holed_joints,
    known_points,
    with_filled,
)
from bodysense.takes.take import FilledFile
from bodysense.takes.track import Completion, fill_file, track
from bodysense.takes.two_way import TwoWayTracker
from bodysense.tracking.estimate import CONTACT_POINTS, Estimate
from bodysense.tracking.tracker import TrackerSettings


@pytest.fixture(scope="module")
def steps() -> Clip:
    """Two seconds of the packaged performance with steps and gestures."""
    clip = packaged_performance()
    return Clip("steps", clip.pose[-100:-20], clip.frame_rate)


@pytest.fixture(scope="module")
def take(steps: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("takes") / "take.bvh"
    write_bvh(path, steps)
    return path


def motion_of(path: Path) -> Clip:
    opened = open_source(path)
    assert isinstance(opened, MotionSource)
    return opened.clip


def points(clip: Clip) -> np.ndarray:
    return np.asarray(forward_kinematics(clip.pose)[0])


def changed_channels(before: BvhFile, after: BvhFile) -> np.ndarray:
    """Return the mask (T, J) of joints with a changed value."""
    words = [np.array([line.split() for line in file.lines]) for file in (before, after)]
    differs = words[0] != words[1]
    return np.stack([differs[:, list(columns)].any(axis=1) for columns in before.columns], axis=1)


@pytest.mark.parametrize("missing", ["left_elbow+:20-59", "right_hip+:30-60,left_wrist:0-10", "right_thumb1+", "head"])
def test_known_frames_are_bit_identical(take: Path, tmp_path: Path, missing: str) -> None:
    done = track(take, missing=missing)
    done.save(tmp_path / "out.bvh")
    before, after = open_bvh(take), open_bvh(tmp_path / "out.bvh")
    assert done.partial is not None
    assert before.head == after.head
    assert not (changed_channels(before, after) & ~done.partial.holes).any()
    for old, new, touched in zip(before.lines, after.lines, np.asarray(done.partial.holes.any(axis=1)), strict=True):
        assert touched or old == new
    np.testing.assert_allclose(points(motion_of(tmp_path / "out.bvh")), points(done.clip), atol=2e-4)


def test_a_filled_limb_is_accurate_and_smooth_and_keeps_its_bones(take: Path, steps: Clip) -> None:
    done, skeleton = track(take, missing="left_shoulder+:25-55,right_hip+:30-60"), steps.pose.skeleton
    truth, found = points(steps), points(done.clip)
    for name, frames in (("left_wrist", slice(25, 56)), ("right_ankle", slice(30, 61))):
        k = skeleton.index(name)
        assert np.linalg.norm(truth - found, axis=-1)[frames, k].mean() < 0.2
        speed, real = (np.linalg.norm(np.diff(x[:, k], axis=0), axis=-1) * 30 for x in (found, truth))
        assert speed.max() < 1.2 * real.max() + 0.3
    others = [k for k, name in enumerate(skeleton.points) if not name.startswith(("left_", "right_"))]
    np.testing.assert_allclose(found[:, others], truth[:, others], atol=1e-6)
    bones = np.linalg.norm(found[:, 1:] - found[:, list(skeleton.parents[1:])], axis=-1)
    np.testing.assert_allclose(bones, np.broadcast_to(skeleton.bone_length[1:], bones.shape), atol=1e-5)
    lowest = side_clearance(truth, skeleton, "right").min()
    assert side_clearance(found, skeleton, "right").min() > min(0.0, lowest) - 0.01


@pytest.mark.parametrize(
    ("root", "count"), [("left_shoulder", 1), ("left_shoulder", 40), ("right_hip", 12), ("spine1", 1), ("spine1", 12)]
)
def test_position_and_speed_are_continuous_at_both_edges(steps: Clip, root: str, count: int) -> None:
    """Velocities change at an edge by no more than in the true motion, plus the change for a turn of the limb."""
    first, skeleton = 18, steps.pose.skeleton
    end = first + count
    tip = skeleton.index({"left_shoulder": "left_wrist", "right_hip": "right_ankle", "spine1": "head"}[root])
    truth = points(steps)[:, tip]
    found = points(track(steps, missing=f"{root}+:{first}-{end - 1}").clip)[:, tip]
    change, usual = (np.linalg.norm(np.diff(place, 2, axis=0), axis=-1) * 30 for place in (found, truth))
    assert max(change[[first - 2, first - 1, end - 2, end - 1]]) < 1.5 * usual.max() + 0.2
    np.testing.assert_allclose(np.delete(found, range(first, end), axis=0), np.delete(truth, range(first, end), axis=0))


@pytest.mark.parametrize("missing", [
    "left_shoulder+:25-55",
    "right_hip+:30-60,left_knee:40-44",
    "left_hip+:0-70",
    "left_wrist+",
    "right_thumb1+:20-79,left_index2:38-39",
])  # fmt: skip
def test_causal_filling_does_not_depend_on_later_frames(steps: Clip, missing: str) -> None:
    pose, now = steps.pose, 45
    rotation, root = np.array(pose.rotation), np.array(pose.root_position)
    rotation[now:], root[now:] = rotation[now - 1 :: -1][: len(root) - now], root[0] + 0.3
    other = replace(steps, pose=replace(pose, rotation=rotation, root_position=root))
    one, two = (track(clip, missing=missing, causal=True) for clip in (steps, other))
    np.testing.assert_allclose(one.clip.pose.rotation[:now], two.clip.pose.rotation[:now], atol=1e-12)
    np.testing.assert_allclose(one.estimate.points[:now], two.estimate.points[:now], atol=1e-12)
    assert one.partial is not None
    known = ~one.partial.holes
    np.testing.assert_array_equal(np.asarray(one.clip.pose.rotation)[known], np.asarray(pose.rotation)[known])


def test_causal_filling_continues_known_frames_and_is_accurate(steps: Clip) -> None:
    missing, skeleton = "left_shoulder+:25-55,right_hip+:30-60", steps.pose.skeleton
    truth, found = points(steps), points(track(steps, missing=missing, causal=True).clip)
    for name, first, end in (("left_wrist", 25, 56), ("right_ankle", 30, 61)):
        k = skeleton.index(name)
        assert np.linalg.norm(truth - found, axis=-1)[first:end, k].mean() < 0.25
        speed, real = (np.linalg.norm(np.diff(x[:, k], axis=0), axis=-1) * 30 for x in (found, truth))
        assert speed[first - 1 : end - 1].max() < 1.2 * real.max() + 0.3
    lowest = side_clearance(truth, skeleton, "right").min()
    assert side_clearance(found, skeleton, "right").min() > min(0.0, lowest) - 0.01


def test_root_joints_are_not_filled_causally(steps: Clip) -> None:
    with pytest.raises(BodysenseError, match=r"steps: 'pelvis' is missing in some frames.*leave --causal out"):
        track(steps, missing="pelvis:20-30", causal=True)


def test_deviations_are_predicted_only_in_gaps_with_two_known_sides(steps: Clip) -> None:
    partial = open_partial(steps, missing_items("left_shoulder+:20-50,right_hip+:0-10,left_thumb1:30-40"))
    found = expected_deviations(partial)
    moved = {partial.rig.joints[k] for k, turns in found.items() if turns.any()}
    assert {"left_shoulder", "left_elbow", "left_wrist"} <= moved
    assert not any("thumb" in name or "hip" in name for name in moved)
    turning = np.any([turns.any(axis=1) for turns in found.values()], axis=0)
    assert np.flatnonzero(turning)[[0, -1]].tolist() == [20, 50]


def test_the_same_hole_on_a_rig_with_other_axes_is_filled_alike(steps: Clip, tmp_path: Path) -> None:
    write_motion(tmp_path / "mixamo.bvh", steps, "mixamo")
    ours = points(track(steps, missing="left_shoulder+:20-50,right_hip+:30-60").clip)
    theirs = track(tmp_path / "mixamo.bvh", missing="mixamorig:LeftArm+:20-50,mixamorig:RightUpLeg+:30-60")
    places = steps.pose.skeleton.indices(["left_elbow", "left_wrist", "right_knee", "right_ankle"])
    assert np.linalg.norm(points(theirs.clip) - ours, axis=-1)[20:61, places].max() < 0.02


def test_known_joints_are_observed_exactly(take: Path, steps: Clip) -> None:
    seen = known_points(open_partial(take, missing_items("left_elbow:10-20")))
    skeleton = steps.pose.skeleton
    hidden = {name for name, has in zip(seen.points, seen.has_position[15], strict=True) if not has}
    assert {"left_wrist", "left_index1", "left_thumb_tip"} <= hidden
    assert "left_elbow" not in hidden and not any(name.startswith("right") for name in hidden)
    assert not seen.has_rotation[15, skeleton.index("left_elbow")] and seen.has_rotation[9].sum() == 52
    assert (seen.accuracy == 0.001).all()
    np.testing.assert_allclose(seen.position[15, skeleton.index("left_elbow")], points(steps)[15, 18], atol=1e-5)


def test_holes_are_found_in_the_file(take: Path, tmp_path: Path) -> None:
    """NaN values and an arm with constant values are holes."""
    file = open_bvh(take)
    values, changed = file.values.copy(), np.zeros(file.values.shape, dtype=bool)
    arm = [c for j in ("left_shoulder", "left_elbow", "left_wrist") for c in file.columns[file.joints.index(j)]]
    values[20:50, arm] = values[20, arm]
    changed[20:50, arm] = True
    text = file.with_values(values, changed).text().decode().splitlines()
    start, knee = len(text) - len(list(file.lines)), file.columns[file.joints.index("right_knee")][0]
    for row in range(start + 60, start + 65):
        words = text[row].split()
        text[row] = " ".join([*words[:knee], "nan", *words[knee + 1 :]])
    partial = tmp_path / "partial.bvh"
    partial.write_text("\n".join(text) + "\n")
    done = track(partial)
    assert done.partial is not None
    missing = {(file.joints[j], int(t)) for t, j in np.argwhere(done.partial.holes)}
    assert {("left_elbow", 30), ("right_knee", 62)} <= missing
    done.save(tmp_path / "out.bvh")
    truth, found = open_bvh(take), open_bvh(tmp_path / "out.bvh")
    knee_joint = file.joints.index("right_knee")
    assert np.rad2deg(geodesic_angle(truth.rotation, found.rotation))[60:65, knee_joint].max() < 5
    assert not np.isnan(found.values).any()
    whole = track(tmp_path / "out.bvh")
    assert whole.partial is not None and whole.partial.is_whole


def test_the_root_is_interpolated_between_known_frames(take: Path, steps: Clip, tmp_path: Path) -> None:
    track(take, missing="pelvis:30-34").save(tmp_path / "out.bvh")
    found = read_bvh(tmp_path / "out.bvh")
    error = np.linalg.norm(found.pose.root_position - steps.pose.root_position, axis=-1)
    assert 0 < error[30:35].max() < 0.02 and np.delete(error, range(30, 35)).max() < 1e-6


def test_a_clip_is_filled_through_the_public_interface(steps: Clip, tmp_path: Path) -> None:
    done = bodysense.track(steps, missing=("left_hand", "right_forearm+:10-20"))
    kept = np.ones(done.clip.pose.rotation.shape[:2], dtype=bool)
    assert done.partial is not None and done.file is None
    kept &= ~done.partial.holes
    np.testing.assert_array_equal(done.clip.pose.rotation[kept], steps.pose.rotation[kept])
    done.save(tmp_path / "out.bvh")
    assert len(read_bvh(tmp_path / "out.bvh")) == len(steps)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ("left_han", "valid are pelvis, left_hip"),
        ("pelvis", "'pelvis' is missing in every frame, and everything hangs on it"),
        ("pelvis+", "everything hangs on it"),
        ("left_wrist:70-90", "frames 0 to 79"),
    ],
)
def test_invalid_items_are_refused(take: Path, missing: str, message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        track(take, missing=missing)


def test_missing_is_for_motions(take: Path, steps: Clip) -> None:
    with pytest.raises(BodysenseError, match="leave --device three_point out"):
        track(take, device="three_point", missing="left_hand")
    with pytest.raises(BodysenseError, match="leave --height out"):
        track(take, missing="left_hand", height=1.8)
    recording = bodysense.track(steps, device="three_point")
    with pytest.raises(BodysenseError, match=r"only a \.bvh or \.fbx file has a rig"):
        recording.save("out.bvh", "source")
    assert replace(recording, source=take).source == take


def test_filled_standing_feet_do_not_slide(steps: Clip) -> None:
    """Filled feet slide less than without correction; known frames and joints are bit-identical."""
    partial = open_partial(steps, missing_items("left_hip+:20-60"))
    done = track(steps, missing="left_hip+:20-60")
    contact = done.estimate.contact
    filled = fill_rotations(partial, guessed_rotations(partial, done.estimate.pose))
    held, free = (
        with_filled(partial, hold_filled_feet(partial, filled, chance, 0.0))
        for chance in (contact, np.zeros_like(contact))
    )
    np.testing.assert_array_equal(held[~partial.missing], partial.rotation[~partial.missing])
    rests = contact[:, [CONTACT_POINTS.index("left_ankle"), CONTACT_POINTS.index("left_foot")]].max(axis=1) > 0.6
    both = rests[21:60] & rests[20:59]
    ball = steps.pose.skeleton.index("left_foot")
    slid = []
    for turned in (held, free):
        pose = replace(steps.pose, rotation=turned)
        place = np.asarray(forward_kinematics(pose)[0])[:, ball]
        slid.append(np.linalg.norm(np.diff(place[20:60, [0, 2]], axis=0), axis=-1)[both].mean() * steps.frame_rate)
    assert both.sum() > 10 and slid[0] < 0.5 * slid[1]


def test_a_whole_motion_is_written_unchanged(take: Path, steps: Clip, tmp_path: Path) -> None:
    done = track(take)
    done.save(tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_bytes() == take.read_bytes()
    assert done.partial is not None and done.partial.is_whole
    in_memory = track(steps)
    np.testing.assert_array_equal(in_memory.clip.pose.rotation, steps.pose.rotation)


def test_a_range_holds_for_the_names_before_it() -> None:
    items = {item.name: item.frames for item in missing_items("left_elbow,left_wrist:10-20,head,neck:1-2,pelvis")}
    assert items == {
        "left_elbow": (10, 20), "left_wrist": (10, 20), "head": (1, 2), "neck": (1, 2), "pelvis": None
    }  # fmt: skip
    assert missing_items(("head", "neck:1-2"))[0].frames is None


def test_frames_are_counted_per_joint(take: Path) -> None:
    from bodysense.cli.summary import holes_line

    partial = open_partial(take, missing_items("left_elbow,left_wrist:10-20,head:5-6"))
    assert holes_line(partial) == "filled frames, of 80: left_wrist 11, left_elbow 11, head 2"


@pytest.mark.parametrize(("seconds", "corrected"), [(0.25, False), (0.4, True)])
def test_legs_of_short_gaps_are_not_corrected(take: Path, seconds: float, corrected: bool) -> None:
    """In a gap of less than 0.3 s interpolation is nearer to the truth than a leg that is bent for the floor."""
    rate = motion_of(take).frame_rate
    motion = open_partial(take, missing_items(f"right_hip+:30-{29 + round(seconds * rate)}"))
    gap = np.asarray(motion.missing.any(axis=1))
    assert gap.sum() == round(seconds * rate)
    filled = {joint: motion.rotation[:, joint] for joint in holed_joints(motion)}
    filled[motion.rig.ours["right_knee"]][gap] = quaternion_exp(np.array([0.0, 0.0, 0.0]))
    high = np.ones((len(gap), len(CONTACT_POINTS)))  # sure contacts: sliding feet are stopped
    held = hold_filled_feet(motion, filled, high, 0.3)  # and a floor above the soles
    assert (max(np.abs(held[joint] - filled[joint]).max() for joint in filled) > 1e-3) == corrected


@pytest.mark.parametrize("seed", range(3))
def test_a_file_is_filled_by_windows_and_blocks_as_in_one_piece(
    steps: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Over random holes of a take that is longer than two windows; its text is read again when it is written."""
    rng, path = np.random.default_rng(seed), tmp_path / "long.bvh"
    monkeypatch.setattr(two_way, "WINDOW", 6.0)  # s; with the 60 s of takes it would need ten times the frames
    write_bvh(path, replace(steps, frame_rate=5.0))
    roots = rng.choice(["left_shoulder", "right_elbow", "left_hip", "right_knee", "head", "spine2", "pelvis"], 3, False)
    spans = [sorted(rng.choice(80, 2, replace=False).tolist()) for _ in roots]
    missing = [
        f"{root}{'+' * (root != 'pelvis')}:{first}-{last}" for root, (first, last) in zip(roots, spans, strict=True)
    ]
    partial = open_partial(path, missing_items(missing))
    assert len(partial.clip) > 2.5 * two_way.WINDOW * 5
    tracker = TwoWayTracker(Person(partial.clip.pose.skeleton), None, TrackerSettings())
    whole = tracker.complete(known_points(partial), float(np.median(np.diff(partial.clip.time))))
    rotation = fill_motion(partial, whole)
    assert partial.file is not None
    expected = partial.file.with_rotation(dict(enumerate(rotation.swapaxes(0, 1))), partial.missing)
    expected.write(tmp_path / "expected.bvh")
    monkeypatch.setattr(figure, "BLOCK", 47)
    monkeypatch.setattr(bvh_text, "_LARGE_TEXT", 0)
    monkeypatch.setattr(bvh_text, "_PART", 1000)
    completion = Completion(TrackerSettings(), None, False, lambda done, frames: None)
    done = fill_file(MotionSource(str(path), path), missing, None, completion)
    assert isinstance(done, FilledFile)
    np.testing.assert_array_equal(done.file.values, expected.values)
    done.save(tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_bytes() == (tmp_path / "expected.bvh").read_bytes()
    take = track(path, missing=missing)
    np.testing.assert_array_equal(take.estimate.points, whole.points)
    path.write_bytes(path.read_bytes() + b"\n")
    with pytest.raises(BodysenseError, match="changed since it was read; run the same command again"):
        done.save(tmp_path / "late.bvh")
    assert not (tmp_path / "late.bvh").exists()


@pytest.mark.slow
def test_an_hour_is_filled_in_little_memory(steps: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An hour at 30 Hz of a body with fingers needs 520 MB for the holes of an arm, besides the tracker's memory."""

    def windows(
        known: KnownPoints, person: Person, completion: Completion, interval: float
    ) -> tuple[Iterator[Estimate], object]:
        """Stand in for the tracker, whose memory does not grow with the file."""
        tracemalloc.reset_peak()  # reading takes as much of any long file
        starts = range(0, len(known), 500)
        return (standing_estimate(known.motion.clip.pose[np.arange(k, min(k + 500, len(known)))]) for k in starts), None

    monkeypatch.setattr(takes, "_completed_windows", windows)
    monkeypatch.setattr(bvh_text, "_LARGE_TEXT", 0)
    completion = Completion(TrackerSettings(), None, False, lambda done, frames: None)
    frames, path = 12_000, tmp_path / "long.bvh"
    write_bvh(path, replace(steps, pose=steps.pose[np.arange(frames) % len(steps)]))
    tracemalloc.start()
    done = fill_file(MotionSource(str(path), path), f"left_elbow+:300-{frames - 500}", None, completion)
    done.save(tmp_path / "out.bvh")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak / frames * 30 * 3600 < 520e6  # an hour's, with what does not grow


def standing_estimate(pose: Pose) -> Estimate:
    """Return an estimate that is certain of a pose whose feet rest."""
    points = np.asarray(forward_kinematics(pose)[0])
    count = points.shape[:2]
    return Estimate(
        pose=pose,
        points=points,
        measured=np.zeros(count, dtype=bool),
        confidence=np.zeros(count),
        bound=np.zeros(count),
        contact=np.ones((len(points), len(CONTACT_POINTS))),
        rest_offset=np.broadcast_to(pose.skeleton.rest_offset, points.shape),
    )
