"""Unassigned trackers after a restart: known by serial, or matched by position; and the person's file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.formats.protocol import SignalFrame
from bodysense.observing.observation import Observation
from bodysense_live.protocols.links import signal_of
from bodysense_live.server.messages import Calibrate, Notice, UpdateSettings
from bodysense_live.server.session_slot import SessionSlot, WearerFile
from bodysense_live.sessions.session import Session
from bodysense_live.sessions.tracked_devices import SIGNALS, DeviceState, TrackedDevice, TrackedDevices
from bodysense_live.sessions.worn_trackers import read_trackers, save_wearer

SKELETON = default_skeleton()
# Mounts in the joints' axes: offset in m (8 to 14 cm), rotation vector in rad.
STRAPPED = {
    "pelvis": ((0.03, 0.05, 0.10), (0.0, 0.4, 0.0)),
    "left_ankle": ((0.02, 0.05, 0.09), (0.6, 0.2, 0.0)),
    "right_ankle": ((-0.02, 0.05, 0.07), (0.0, -0.7, 0.1)),
}
MOUNTS = {
    joint: RigidTransform(np.array(place), quaternion_exp(np.array(turn))) for joint, (place, turn) in STRAPPED.items()
}
WEARER = Person(SKELETON, mounts=MOUNTS)
SERIALS = {"left_ankle": "LHR-A", "right_ankle": "LHR-B", "pelvis": "LHR-C"}
TRACKERS = {serial: joint for joint, serial in SERIALS.items()}


def frames(
    count: int, order: Sequence[str] = tuple(SERIALS), lowered: float = 0.0, start: int = 0
) -> list[SignalFrame]:
    """Return signals of a standing wearer whose unassigned trackers arrive in this order of joints."""
    position, rotation = (np.asarray(x) for x in forward_kinematics(standing_pose(SKELETON)))
    up = np.array([0.0, lowered + position[:, 1].min(), 0.0])
    devices, state, found = TrackedDevices(), DeviceState(), []
    head = position[SKELETON.index("head")] - up + [0.0, 0.07, 0.08]
    for k in range(start, start + count):
        now = k / 30
        poses = [("HMD", TrackedDevice("Hmd", head, np.array([1.0, 0.0, 0.0, 0.0]), now, raw=True))]
        for joint in order:
            j = SKELETON.index(joint)
            tracker = RigidTransform(position[j] - up, rotation[j]) @ MOUNTS[joint]
            poses.append((SERIALS[joint], TrackedDevice("Tra", tracker.translation, tracker.rotation, now, raw=True)))
        state, _ = devices.put(poses, state)
        observation = devices.observation(now, state)
        assert observation is not None
        found.append(signal_of(observation, SIGNALS, k, now))
    return found


def play(one: Session, signals: Sequence[SignalFrame]) -> list[Observation]:
    """Play signals. Return the observation of each job."""
    found = []
    for frame in signals:
        one.receive(frame, 0.0)
        job = one.job()
        assert job is not None
        found.append(job.observation)
        one.abandon()
    return found


def tracked(observation: Observation) -> set[str]:
    return {name for k, name in enumerate(observation.points) if observation.has_rotation[0, k]}


def test_trackers_with_known_serials_are_used_from_the_first_frame(tmp_path: Path) -> None:
    path = tmp_path / "me.json"
    save_wearer(WEARER, TRACKERS, path)
    assert Person.load(path).mounts.keys() == WEARER.mounts.keys() and read_trackers(path) == TRACKERS
    order = ("pelvis", "right_ankle", "left_ankle")  # differs from the saved order
    slot = SessionSlot("", "", "", "", Session(SIGNALS, WEARER))
    slot.serials = lambda: {SERIALS[joint]: f"tracker_{k}" for k, joint in enumerate(order, start=1)}
    WearerFile(path, read_trackers(path)).assign_known_trackers(slot)
    (first,) = play(slot.session, frames(1, order))
    assert tracked(first) == {"head", *STRAPPED}


def test_trackers_with_unknown_serials_are_matched_by_position(tmp_path: Path) -> None:
    one = Session(SIGNALS, WEARER)
    crouched = play(one, frames(30, lowered=0.3))
    assert tracked(crouched[-1]) == {"head"}
    standing = play(one, frames(30, start=30))
    assert tracked(standing[0]) == {"head"} and tracked(standing[-1]) == {"head", *STRAPPED}
    notices = [message.text for message in one.take_messages() if isinstance(message, Notice)]
    assert notices == ["worn: tracker_1 on left_ankle, tracker_2 on right_ankle, tracker_3 on pelvis"]
    slot = SessionSlot("", "", "", "", one)
    slot.serials = lambda: {serial: f"tracker_{k}" for k, serial in enumerate(TRACKERS, start=1)}
    path = tmp_path / "me.json"
    WearerFile(path, {"LHR-OLD": "pelvis", "LHR-ELBOW": "left_elbow"}).save_calibrated(slot)
    assert read_trackers(path) == {"LHR-ELBOW": "left_elbow", **TRACKERS}  # a replaced tracker is forgotten


def test_only_joints_with_mounts_are_matched() -> None:
    one = Session(SIGNALS, Person(SKELETON, mounts={"pelvis": MOUNTS["pelvis"]}))
    assert tracked(play(one, frames(60))[-1]) == {"head", "pelvis"}
    unknown = Session(SIGNALS, Person(SKELETON))
    assert tracked(play(unknown, frames(60))[-1]) == {"head"}


def test_calibration_reassigns_trackers_that_are_worn_elsewhere() -> None:
    one = Session(SIGNALS, WEARER)
    one.assign_trackers({"tracker_1": "right_ankle", "tracker_2": "left_ankle", "tracker_3": "pelvis"})  # feet swapped
    one.apply(Calibrate())
    play(one, frames(40))
    assert one.tracker_joints == {"tracker_1": "left_ankle", "tracker_2": "right_ankle", "tracker_3": "pelvis"}


def worn(**joints: str) -> UpdateSettings:
    return UpdateSettings({"worn": [{"tracker": name, "joint": joint} for name, joint in joints.items()]})


def places(observation: Observation) -> dict[str, list[float]]:
    return {
        name: observation.position[0, k].round(6).tolist()
        for k, name in enumerate(observation.points)
        if observation.has_position[0, k]
    }


def test_trackers_are_moved_ignored_and_forgotten_by_settings() -> None:
    one = Session(SIGNALS, WEARER)
    one.assign_trackers({"tracker_1": "left_ankle", "tracker_2": "right_ankle", "tracker_3": "pelvis"})
    (first,) = play(one, frames(1))
    before, revision = places(first), one.revision
    one.apply(worn(tracker_1="right_ankle", tracker_2="left_ankle", tracker_3=""))
    (second,) = play(one, frames(1, start=1))
    now = places(second)
    assert now["left_ankle"] == before["right_ankle"] and now["right_ankle"] == before["left_ankle"]
    assert "pelvis" not in now  # ignored
    assert tracked(second) == {"head"}  # the mounts were those of other trackers
    assert one.revision > revision and one.calibrated is not None and not one.calibrated.mounts
    assert one.tracker_joints == {"tracker_1": "right_ankle", "tracker_2": "left_ankle"}
    one.apply(worn(tracker_1="right_ankle"))
    assert one.tracker_joints == {"tracker_1": "right_ankle"}  # the others wait for a calibration again


def test_a_tracker_that_is_moved_back_has_its_mount_again() -> None:
    one = Session(SIGNALS, WEARER)
    usual = {"tracker_1": "left_ankle", "tracker_2": "right_ankle", "tracker_3": "pelvis"}
    one.assign_trackers(usual)
    (first,) = play(one, frames(1))
    for other in (
        {"tracker_1": "right_ankle", "tracker_2": "left_ankle", "tracker_3": "pelvis"},
        {**usual, "tracker_3": ""},
        {**usual, "tracker_3": "spine3"},
    ):
        one.apply(worn(**other))
        assert (
            one.calibrated is not None and one.calibrated.mounts.keys() < MOUNTS.keys()
        )  # of another tracker, or joint
        one.apply(worn(**usual))
        assert one.calibrated.mounts == MOUNTS
    (again,) = play(one, frames(1, start=1))
    assert tracked(again) == tracked(first) > {"head"}


def test_ignored_trackers_stay_ignored_when_the_wearer_is_measured() -> None:
    one = Session(SIGNALS, WEARER)
    one.apply(worn(tracker_2=""))
    one.apply(Calibrate())
    play(one, frames(40))
    assert one.tracker_joints == {"tracker_1": "left_ankle", "tracker_3": "pelvis"}


def test_a_tracker_is_worn_elsewhere_than_its_name_says() -> None:
    one = Session(("headset", "left_knee_tracker", "right_knee_tracker"), WEARER)
    one.apply(worn(left_knee_tracker="left_ankle"))
    seen = SignalFrame(
        0, 0.0, np.arange(3), np.full(3, 3), np.eye(3, dtype=np.float32), np.eye(4, dtype=np.float32)[:3]
    )
    (observation,) = play(one, [seen])
    assert set(places(observation)) == {"head", "left_ankle", "right_knee"}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (
            {"worn": [{"tracker": "tracker_1", "joint": "left_toe"}]},
            "tracker_1 on 'left_toe'; a tracker is worn on pelv",
        ),
        (
            {"worn": [{"tracker": "a", "joint": "pelvis"}, {"tracker": "b", "joint": "pelvis"}]},
            "'pelvis' is named twice",
        ),
        ({"worn": [{"tracker": "a", "joint": ""}, {"tracker": "a", "joint": ""}]}, "'a' is named twice"),
        ({"lengths": [{"start": "left_hip", "end": "knee", "metres": 0.4}]}, "a length from 'knee'; valid are"),
        ({"lengths": [{"start": "left_hip", "end": "left_knee", "metres": 40}]}, "left_hip to left_knee: 40 m; give"),
    ],
)
def test_impossible_places_and_lengths_are_refused(change: dict[str, object], reason: str) -> None:
    one = Session(SIGNALS, WEARER)
    with pytest.raises(BodysenseError, match=reason):
        one.apply(UpdateSettings(change))
    assert not one.settings.worn and not one.settings.lengths


def test_known_lengths_are_those_of_the_body() -> None:
    one = Session(SIGNALS, Person())
    thighs = [{"start": f"{side}_hip", "end": f"{side}_knee", "metres": 0.46} for side in ("left", "right")]
    one.apply(UpdateSettings({"lengths": thighs, "height": 1.75}))
    assert one.height == pytest.approx(1.75, abs=0.02)
    thigh = one.skeleton.rest_offset[one.skeleton.index("left_knee")]
    assert np.linalg.norm(thigh) == pytest.approx(0.46, abs=0.012)
    one.apply(UpdateSettings({"lengths": []}))
    assert abs(np.linalg.norm(one.skeleton.rest_offset[one.skeleton.index("left_knee")]) - 0.46) > 0.02


@pytest.mark.parametrize(
    ("trackers", "reason"),
    [
        ('["LHR-A"]', "'trackers' must be a table, serial to one of pelvis"),
        ('{"LHR-A": 3}', "'trackers' must be a table"),
        ('{"LHR-A": "toe"}', "'trackers' has 'toe'; a tracker is worn on pelvis"),
    ],
)
def test_an_invalid_table_is_refused(tmp_path: Path, trackers: str, reason: str) -> None:
    path = tmp_path / "me.json"
    save_wearer(WEARER, TRACKERS, path)
    text = path.read_text()
    path.write_text(text[: text.index('"trackers"')] + f'"trackers": {trackers}\n}}\n')
    with pytest.raises(BodysenseError, match=reason):
        read_trackers(path)


def test_a_person_without_trackers_is_saved_unchanged(tmp_path: Path) -> None:
    save_wearer(WEARER, {}, tmp_path / "a.json")
    WEARER.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_text() == (tmp_path / "b.json").read_text()
    assert read_trackers(tmp_path / "a.json") == {}
