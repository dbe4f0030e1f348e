"""Takes: causal or with past and future; files, persons, and invalid input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.shape import stature
from bodysense.body.skeleton import default_skeleton
from bodysense.cli import main
from bodysense.devices.simulated.device import DEVICES, DeviceName, simulate
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.formats.recording import Recording, read_recording, write_recording
from bodysense.observing.observation import Observation
from bodysense.sources.reading import read, write
from bodysense.takes.track import track
from bodysense.tracking.tracker import Tracker


@pytest.fixture(scope="module")
def short(waving_clip: Clip) -> Clip:
    return replace(waving_clip, name="short", pose=waving_clip.pose[:40])


@pytest.fixture(scope="module")
def three_points(short: Clip) -> Observation:
    return simulate(short, "three_point")


def positions(pose: Pose) -> np.ndarray:
    return np.asarray(forward_kinematics(pose)[0])


def test_a_causal_take_equals_live_tracking(three_points: Observation) -> None:
    """A causal take equals the output of a tracker frame by frame."""
    take = track(Recording(three_points, default_skeleton()), causal=True)
    tracker = Tracker(Person(default_skeleton()))
    state = tracker.start()
    for k in range(len(three_points)):
        estimate, state = tracker.step(three_points[k : k + 1], state)
        np.testing.assert_array_equal(take.estimate.points[k], estimate.points[0])
        np.testing.assert_allclose(positions(take.clip.pose[k]), estimate.points[0], atol=1e-3)


@pytest.mark.parametrize("ending", [".npz", ".jsonl"])
def test_raw_poses_of_devices_are_read_from_a_file(three_points: Observation, tmp_path: Path, ending: str) -> None:
    """A file with a headset and controllers gives what the tracker gives for the same frames."""
    raw = replace(three_points, points=("headset", "left_controller", "right_controller"))
    assert three_points.points == ("head", "left_wrist", "right_wrist")
    path = tmp_path / f"devices{ending}"
    write_recording(path, Recording(raw, default_skeleton(), known=False))
    take, tracker = track(path, causal=True), Tracker(Person())
    state = tracker.start()
    for k in range(len(raw)):
        estimate, state = tracker.step(read_recording(path).observation[k : k + 1], state)
        np.testing.assert_allclose(take.estimate.points[k], estimate.points[0], atol=1e-6)
    twice = replace(three_points, points=("head", "headset", "right_wrist"))
    write_recording(path, Recording(twice, default_skeleton(), known=False))
    with pytest.raises(BodysenseError, match="'headset' and 'head' are the same point"):
        track(path)


def test_the_command_has_a_causal_option(three_points: Observation, tmp_path: Path) -> None:
    """`track --causal` writes the motion of a live session; without it another motion is written."""
    write_recording(tmp_path / "seen.npz", Recording(three_points, default_skeleton()))
    for name, options in (("both", []), ("causal", ["--causal"])):
        assert main(["track", str(tmp_path / "seen.npz"), "-o", str(tmp_path / f"{name}.bvh"), *options]) == 0
    track(tmp_path / "seen.npz", causal=True).save(tmp_path / "live.bvh")
    both, causal, live = ((tmp_path / f"{name}.bvh").read_bytes() for name in ("both", "causal", "live"))
    assert causal == live != both


@pytest.mark.parametrize("device", DEVICES)
def test_every_device_is_tracked(short: Clip, device: str) -> None:
    take = track(short, device=device)
    assert len(take.clip) == len(short) and take.clip.frame_rate == pytest.approx(30)
    assert np.isfinite(positions(take.clip.pose)).all()
    assert (take.person.skeleton.rest_offset == short.pose.skeleton.rest_offset).all()


def test_the_command_line_knows_the_devices() -> None:
    assert tuple(name for part in get_args(DeviceName) for name in get_args(part)) == DEVICES


def test_the_measured_head_stays_on_inferred_proportions(three_points: Observation) -> None:
    """The clip is on the finally inferred body. Its head is at measured positions, and its bones keep their lengths."""
    take = track(three_points, height=1.85)
    skeleton = take.clip.pose.skeleton
    assert float(stature(skeleton.rest_offset)) == pytest.approx(1.85, abs=0.02)
    assert (skeleton.rest_offset == take.person.skeleton.rest_offset).all()
    head = positions(take.clip.pose)[:, skeleton.index("head")]
    np.testing.assert_allclose(head, three_points.position[:, 0], atol=1e-3)


def test_measured_points_stay_without_a_head(short: Clip, three_points: Observation) -> None:
    wrist = replace(three_points, has_position=three_points.has_position & [False, True, False])
    wrist = replace(wrist, has_rotation=wrist.has_position)
    take = track(wrist, height=1.6)
    place = take.clip.pose.skeleton.index("left_wrist")
    np.testing.assert_allclose(positions(take.clip.pose)[:, place], three_points.position[:, 1], atol=5e-3)


def test_the_wearer_is_given_by_person_or_height(three_points: Observation, tmp_path: Path) -> None:
    """The order of preference is person, height, body of the recording, unknown body."""
    tall = default_skeleton().scaled(1.9)
    path = tmp_path / "seen.npz"
    write_recording(path, Recording(three_points, tall))
    assert track(path).person.skeleton.height == pytest.approx(1.9)
    assert track(path, height=1.6).person.skeleton.height < 1.7
    assert track(path, person=Person(default_skeleton())).person.skeleton.height == pytest.approx(
        default_skeleton().height
    )
    write_recording(path, Recording(three_points, default_skeleton(), known=False))
    nobody = track(path).person
    assert nobody.bone_deviation.any()
    nobody.save(tmp_path / "me.json")
    assert track(path, person=Person.load(tmp_path / "me.json")).person.bone_deviation.any()
    with pytest.raises(BodysenseError, match="both a person and a height"):
        track(path, person=nobody, height=1.8)


def test_a_height_that_the_head_contradicts_is_a_remark(
    waving_clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = simulate(waving_clip, "three_point")
    height = float(stature(waving_clip.pose.skeleton.rest_offset))
    assert track(seen, height=height).remarks == ()
    for causal in (False, True):
        take = track(seen, height=1.5, causal=causal)
        assert take.person.height is None and take.person.stature > 1.6
        (line,) = take.remarks
        assert "a height of 1.50 m" in line and f"{take.person.stature:.2f} m" in line
    write_recording(tmp_path / "seen.npz", Recording(seen, default_skeleton(), known=False))
    command = ["track", str(tmp_path / "seen.npz"), "--height", "1.5", "-o", str(tmp_path / "out.bvh")]
    assert main(command) == 0 and f"WARNING: {track(seen, height=1.5).remarks[0]}" in capsys.readouterr().err


def test_unix_times_and_uneven_times(three_points: Observation) -> None:
    """Takes have a constant rate, and Unix times are valid times."""
    kept = np.delete(np.arange(40), [3, 4, 9, 15])
    odd = replace(three_points[:36], time=1.7e9 + kept / 60)
    take = track(odd)
    assert take.clip.frame_rate == pytest.approx(60, rel=1e-3) and len(take.clip) == 40


def test_one_frame_is_enough(three_points: Observation) -> None:
    assert len(track(three_points[:1]).clip) == 1


def test_noise_is_seeded(short: Clip) -> None:
    exact, one, again, other = (simulate(short, "six_point", noise) for noise in (None, 1, 1, 2))
    np.testing.assert_array_equal(one.position, again.position)
    assert 0 < np.nanmax(np.abs(one.position - exact.position)) < 0.1
    assert np.nanmax(np.abs(one.position - other.position)) > 0


def broken(observation: Observation, what: str) -> Recording | Observation:
    if what == "nothing":
        nowhere = np.zeros_like(observation.has_position)
        return replace(observation, has_position=nowhere, has_rotation=nowhere)
    if what == "no offsets":
        return Recording(observation, default_skeleton().with_offsets(np.zeros((65, 3))))
    if what == "far":
        position = observation.position.copy()
        position[3, 0, 0] = 1e30
        return replace(observation, position=position)
    if what == "slow":
        return replace(observation, time=observation.time * 3000)
    if what == "accuracy":
        return replace(observation, accuracy=-observation.accuracy)
    if what == "nose":
        return replace(observation, points=("nose", *observation.points[1:]))
    return replace(observation, time=observation.time[::-1].copy())


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("nothing", "nothing is tracked in its 40 frames"),
        ("no offsets", "a skeleton 0 m high; people are"),
        ("far", r"'head' is 1e\+30 m from the origin at frame 3"),
        ("slow", r"its frames are 100 s apart \(0.01 Hz\)"),
        ("accuracy", "the accuracy of 'head' at frame 0 is -0.001"),
        ("nose", "unknown joint 'nose'"),
        ("backwards", "times must increase"),
    ],
)
def test_invalid_input_is_refused(three_points: Observation, what: str, message: str) -> None:
    with pytest.raises(BodysenseError, match=message) as error:
        track(broken(three_points, what))
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(("recording: ", "observation: "))


def test_motions_and_recordings_are_distinguished(short: Clip, three_points: Observation, tmp_path: Path) -> None:
    write_bvh(tmp_path / "a.bvh", short)
    with pytest.raises(BodysenseError, match="unknown device 'kinect'; valid are head, three_point"):
        track(tmp_path / "a.bvh", device="kinect")
    with pytest.raises(BodysenseError, match="leave --device out"):
        track(three_points, device="head")
    with pytest.raises(BodysenseError, match="no such file"):
        track(tmp_path / "b.npz")


@pytest.fixture
def pictures(
    filmed: tuple[np.ndarray, Clip], landmarkers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A folder of four pictures of a drawn body."""
    from PIL import Image

    from bodysense.devices.video import landmarker_files

    for k, picture in enumerate(filmed[0][:4]):
        Image.fromarray(picture).save(tmp_path / f"{k:02d}.png")
    monkeypatch.setattr(landmarker_files, "landmarker_folder", lambda: landmarkers)
    return tmp_path


def test_a_video_is_tracked_with_a_number_of_the_person_and_a_roll_of_the_camera(pictures: Path) -> None:
    """With a given camera roll the person stands more obliquely."""
    with pytest.raises(BodysenseError, match="a video, not a motion; leave --device out"):
        track(pictures, device="head")
    spine = []
    for options in ({}, {"follow": 1, "roll": 20.0}):
        take = track(pictures, height=1.7, **options)
        place = positions(take.clip.pose)
        assert len(take.clip) == 4 and np.isfinite(place).all()
        skeleton = take.clip.pose.skeleton
        way = np.median(place[:, skeleton.index("neck")] - place[:, skeleton.index("pelvis")], axis=0)
        spine.append(way / np.linalg.norm(way))
    assert spine[0][1] > 0.95
    assert np.degrees(np.arccos(spine[0] @ spine[1])) == pytest.approx(20, abs=5)


def test_follow_is_refused_except_for_videos(short: Clip, three_points: Observation) -> None:
    with pytest.raises(BodysenseError, match="which alone has people to choose from and a camera; leave --follow out"):
        track(three_points, follow=1)
    with pytest.raises(BodysenseError, match="leave --roll out"):
        track(short, device="three_point", roll=5.0)


def test_reading_and_writing(short: Clip, three_points: Observation, tmp_path: Path) -> None:
    write(tmp_path / "a.bvh", short)
    write(tmp_path / "a.jsonl", Recording(three_points, default_skeleton(), known=False))
    clip, recording = read(tmp_path / "a.bvh"), read(tmp_path / "a.jsonl")
    assert isinstance(clip, Clip) and len(clip) == 40
    assert isinstance(recording, Recording) and not recording.known
    with pytest.raises(BodysenseError, match="complete it first"):
        write(tmp_path / "b.bvh", recording)
