"""SlimeVR's trackers: packets, replies, and bodies whose legs they track."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_conjugate, quaternion_exp, quaternion_multiply
from bodysense.io.formats.osc import message_bytes
from bodysense.io.formats.protocol import SignalFrame
from bodysense.io.formats.unity import unity_position, unity_rotation
from bodysense.observing.observation import Observation
from bodysense_live.protocols.slimevr import MAX_TRACKERS, DatagramResult, SlimevrState, heartbeat, take
from bodysense_live.protocols.slimevr_link import SlimevrSettings
from bodysense_live.server.messages import Calibrate, Notice, Recentre
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.inertial import FACING, IMUS, InertialSensors, calibrate_sensors
from bodysense_live.sessions.session import Session

from ..conftest import Connecting, Serving, free_port

SKELETON = default_skeleton()
HERE = ("127.0.0.1", 50000)
MAC = bytes([0xAA, 1, 2, 3, 4, 5])
SERIAL = "AA:01:02:03:04:05"
Z_UP = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])  # from our world to theirs


def handshake(mac: bytes = MAC) -> bytes:
    firmware = b"test 1.0"
    numbers = struct.pack(">7i", 4, 0, 0, 0, 0, 0, 22)
    return struct.pack(">IQ", 3, 0) + numbers + bytes([len(firmware)]) + firmware + mac + b"\0"


def info(number: int, sensor: int = 0, position: int = 9) -> bytes:
    """Return the description of a sensor, on the left lower leg by default."""
    return struct.pack(">IQBBBHBBB2f", 15, number, sensor, 1, 0, 0, 1, position, 0, 0.0, 0.0)


def turned(number: int, rotation: np.ndarray, sensor: int = 0) -> bytes:
    """Return the packet of a sensor's rotation, wxyz in our world."""
    w, x, y, z = quaternion_multiply(Z_UP, rotation)
    return struct.pack(">IQBB4fB", 17, number, sensor, 1, x, y, z, w, 0)


def played(*packets: bytes, now: float = 0.0, known: frozenset[str] = frozenset()) -> DatagramResult:
    taken = DatagramResult(SlimevrState())
    for packet in packets:
        taken = take(packet, HERE, now, taken.state, known)
    return taken


def test_a_handshake_is_answered_by_the_greeting() -> None:
    taken = played(handshake())
    assert set(taken.state.trackers) == {SERIAL}
    assert len(taken.replies[0]) == 64 and taken.replies[0].startswith(b"\x03Hey OVR =D 5\0")
    assert heartbeat() == bytes([0, 0, 0, 1]) + bytes(8)
    assert played(handshake(bytes(6))).state.trackers.keys() == {"127.0.0.1:50000"}  # emulated: no MAC


def test_a_sensor_is_acknowledged_and_reports_its_joint() -> None:
    taken = played(handshake(), info(1))
    assert taken.replies == (bytes([0, 0, 0, 15, 0, 1]),)
    assert taken.state.trackers[SERIAL].sensors[0].joint == "left_knee"
    cut = struct.pack(">IQBBB", 15, 1, 0, 1, 0)  # old firmware ends early
    assert played(handshake(), cut).state.trackers[SERIAL].sensors[0].joint is None


def test_rotations_are_single_bundled_or_compact() -> None:
    rotation = quaternion_exp(np.array([0.3, -0.5, 0.2]))
    one = turned(1, rotation)
    body = one[:4] + one[12:]
    bundle = struct.pack(">IQ", 100, 1) + 2 * (struct.pack(">H", len(body)) + body)
    w, x, y, z = quaternion_multiply(Z_UP, rotation)
    small = bytes([23]) + struct.pack(">B4h3h", 0, *(round(32767 * value) for value in (x, y, z, w)), 0, 0, 0)
    compact = struct.pack(">IQ", 101, 1) + bytes([len(small)]) + small
    for packet in (one, bundle, compact):
        taken = played(handshake(), packet, now=3.0)
        sensor = taken.state.trackers[SERIAL].sensors[0]
        assert taken.reason is None and sensor.rotation is not None and sensor.at == 3.0
        assert geodesic_angle(sensor.rotation, rotation) < 1e-3


def test_late_and_unknown_datagrams_are_dropped() -> None:
    late = played(handshake(), turned(5, np.array([1.0, 0, 0, 0])), turned(4, quaternion_exp(np.array([1.0, 0, 0]))))
    assert late.reason is not None and late.reason.startswith("late")
    assert played(turned(1, np.array([1.0, 0, 0, 0]))).reason == "a tracker without a handshake"
    unknown = played(handshake(), known=frozenset({"BB:00:00:00:00:00"}))
    assert unknown.reason == f"the tracker {SERIAL} is not in the table" and not unknown.state.trackers
    assert played(handshake(), turned(1, np.array([1.0, 0, 0, 0]), 200)).reason is not None


@given(st.floats(width=32) | st.floats(0.875, 1.125, width=32), st.integers(0, 3))
def test_a_rotation_is_a_unit_quaternion(value: float, place: int) -> None:
    parts = [0.0, 0.0, 0.0, 0.0]
    parts[place] = value
    reason = played(handshake(), struct.pack(">IQBB4fB", 17, 1, 0, 1, *parts, 0)).reason
    assert (reason is None) == (0.99 < abs(value) < 1.01)
    assert reason in (None, "sensor 0: its rotation is not a unit quaternion")


def test_a_tracker_keeps_its_name_at_another_address() -> None:
    state = played(handshake(), info(1)).state
    relocated = take(handshake(), ("127.0.0.1", 50001), 0.0, state, frozenset()).state
    assert relocated.trackers[SERIAL].address[1] == 50001 and relocated.trackers[SERIAL].sensors[0].joint == "left_knee"


def test_the_number_of_trackers_is_limited() -> None:
    state = SlimevrState()
    for k in range(MAX_TRACKERS + 5):
        state = take(handshake(bytes([1, 0, 0, 0, 0, k])), ("127.0.0.1", 1000 + k), 0.0, state, frozenset()).state
    assert len(state.trackers) == MAX_TRACKERS


def test_buttons_and_features() -> None:
    commands = [played(handshake(), struct.pack(">IQB", 21, 1, action)).commands for action in (2, 3, 4, 5)]
    assert commands == [(Calibrate(),), (Recentre(),), (Calibrate(),), ()]
    assert played(handshake(), struct.pack(">IQB", 22, 1, 7)).replies == (struct.pack(">IQB", 22, 0, 3),)


def test_a_table_names_joints() -> None:
    with pytest.raises(BodysenseError, match=r"'left_toe' \(for 'AA:01:02:03:04:05'\).*valid are head, neck"):
        SlimevrSettings(joints={SERIAL: "left_toe"})


# ---- bodies


def about_y(angle: float) -> np.ndarray:
    return np.array([np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0])


class Wearer:
    """A wearer with a headset and sensors, each with its own unknown heading and mounting."""

    def __init__(self, seed: int, names: tuple[str, ...]) -> None:
        rng = np.random.default_rng(seed)
        self.names = names
        self.world = {name: about_y(rng.uniform(-np.pi, np.pi)) for name in names}
        self.strap = {}
        for name in names:
            tilt = quaternion_exp(np.array([rng.uniform(-0.5, 0.5), 0.0, rng.uniform(-0.5, 0.5)]))
            self.strap[name] = quaternion_multiply(about_y(FACING[IMUS[name]]), tilt)

    def observation(self, pose: Pose, time: float, head: bool = True) -> Observation:
        position, rotation = (np.asarray(values) for values in forward_kinematics(pose))
        floor = np.asarray(forward_kinematics(standing_pose(SKELETON))[0])[:, 1].min()
        points = ("head", *self.names) if head else self.names
        place, turn = np.full((1, len(points), 3), np.nan), np.full((1, len(points), 4), np.nan)
        if head:
            place[0, 0] = position[SKELETON.index("head")] - [0, floor, 0]
            turn[0, 0] = rotation[SKELETON.index("head")]
        for k, name in enumerate(self.names, start=int(head)):
            joint = rotation[SKELETON.index(IMUS[name])]
            turn[0, k] = quaternion_multiply(self.world[name], quaternion_multiply(joint, self.strap[name]))
        has_place, has_turn = np.asarray(np.isfinite(place[..., 0])), np.asarray(np.isfinite(turn[..., 0]))
        return Observation(points, place, turn, has_place, has_turn, np.full((1, len(points)), 0.01), np.array([time]))

    def frame(self, pose: Pose, time: float, head: bool = True) -> SignalFrame:
        seen = self.observation(pose, time, head)
        has = (seen.has_position[0] + 2 * seen.has_rotation[0]).astype(np.uint8)
        every = np.arange(len(seen.points), dtype=np.uint8)
        place, turn = np.nan_to_num(seen.position[0]), np.nan_to_num(seen.rotation[0])
        return SignalFrame(round(1000 * time), time, every, has, place.astype(np.float32), turn.astype(np.float32))


LEGS = ("pelvis_imu", "left_hip_imu", "right_hip_imu", "left_knee_imu", "right_knee_imu")


def squatting(facing: float = 0.0, depth: float = 0.6) -> Pose:
    pose = standing_pose(SKELETON)
    pose.rotation[0] = quaternion_multiply(about_y(facing), pose.rotation[0])
    for side in ("left", "right"):
        pose.rotation[SKELETON.index(f"{side}_hip")] = quaternion_exp(np.array([-depth, 0, 0]))
        pose.rotation[SKELETON.index(f"{side}_knee")] = quaternion_exp(np.array([2 * depth, 0, 0]))
    return pose


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.floats(-3, 3))
def test_calibrated_sensors_give_the_rotations_of_joints(seed: int, facing: float) -> None:
    wearer = Wearer(seed, LEGS)
    stands = standing_pose(SKELETON)
    stands.rotation[0] = quaternion_multiply(about_y(facing), stands.rotation[0])
    sensors = calibrate_sensors(wearer.observation(stands, 0.0), SKELETON, "standing", InertialSensors())
    squat = squatting(facing)
    seen = sensors.joints(wearer.observation(squat, 1.0))
    turns = np.asarray(forward_kinematics(squat)[1])
    assert seen.points == ("head", *(IMUS[name] for name in LEGS))
    for k, joint in enumerate(seen.points[1:], start=1):
        # A tilted strap changes the heading only to second order: by degrees, not tens of degrees.
        assert geodesic_angle(seen.rotation[0, k], turns[SKELETON.index(joint)]) < 0.15


def test_recentring_corrects_a_drifted_heading() -> None:
    wearer = Wearer(1, LEGS)
    sensors = calibrate_sensors(
        wearer.observation(standing_pose(SKELETON), 0.0), SKELETON, "standing", InertialSensors()
    )
    before = sensors.joints(wearer.observation(squatting(), 1.0)).rotation
    wearer.world = {name: quaternion_multiply(about_y(0.7), turn) for name, turn in wearer.world.items()}
    drifted = sensors.joints(wearer.observation(squatting(), 2.0)).rotation
    assert geodesic_angle(drifted[0, 2], before[0, 2]) > 0.5
    again = sensors.with_new_headings(wearer.observation(standing_pose(SKELETON), 3.0), SKELETON)
    assert geodesic_angle(again.joints(wearer.observation(squatting(), 4.0)).rotation, before).max() < 1e-6


def test_mounts_of_sensors_are_kept_in_the_persons_file(tmp_path: Path) -> None:
    """Sensors that are saved, loaded and restarted with new headings give the same body."""
    wearer = Wearer(5, LEGS)
    one, _ = played_session(wearer, head=True)
    assert one.calibrated is not None and set(one.calibrated.mounts) == set(LEGS)
    one.calibrated.save(tmp_path / "me.json")

    def played(session: Session) -> Any:
        answer = None
        for k, pose in enumerate([*90 * [standing_pose(SKELETON)], *60 * [squatting()]]):
            session.receive(wearer.frame(pose, 10 + k / 30), 0.0)
            answer = session.step()
        return answer

    before = played(one)
    wearer.world = {name: quaternion_multiply(about_y(k), turn) for k, (name, turn) in enumerate(wearer.world.items())}
    after = played(Session(one.points, Person.load(tmp_path / "me.json"), one.settings))
    legs = SKELETON.indices([IMUS[name] for name in LEGS])
    assert geodesic_angle(after.turns[legs], before.turns[legs]).max() < 0.01
    assert np.abs(after.points - before.points).max() < 0.005


def test_a_tracker_of_the_same_joint_takes_precedence() -> None:
    wearer = Wearer(2, ("left_knee_imu",))
    seen = wearer.observation(standing_pose(SKELETON), 0.0)
    sensors = calibrate_sensors(seen, SKELETON, "standing", InertialSensors())
    both = replace(seen, points=("left_knee", "left_knee_imu"))
    assert sensors.joints(both).points == ("left_knee",)
    np.testing.assert_array_equal(sensors.joints(both).rotation[0, 0], seen.rotation[0, 0])
    lost = replace(both, has_rotation=np.array([[False, True]]), has_position=np.zeros((1, 2), dtype=bool))
    assert sensors.joints(lost).has_rotation.all()


def test_recentring_works_with_sensors_alone() -> None:
    wearer = Wearer(4, LEGS)
    one, _ = played_session(wearer, head=False)
    wearer.world = {name: quaternion_multiply(about_y(1.0), turn) for name, turn in wearer.world.items()}
    one.apply(Recentre())
    answer = None
    for k, pose in enumerate([*30 * [standing_pose(SKELETON)], *60 * [squatting()]]):
        one.receive(wearer.frame(pose, 10 + k / 30, head=False), 0.0)
        answer = one.step()
    assert answer is not None
    assert geodesic_angle(answer.turns[SKELETON.index("left_hip")], quaternion_exp(np.array([-0.6, 0, 0]))) < 0.3


def played_session(wearer: Wearer, head: bool) -> tuple[Session, Any]:
    """Return a session whose wearer was calibrated and then squatted, and its last answer."""
    one = Session(("head", *wearer.names) if head else wearer.names)
    one.apply(Calibrate())
    answer, k = None, 0
    for pose, count in ((standing_pose(SKELETON), 50), (squatting(), 60)):
        for _ in range(count):
            one.receive(wearer.frame(pose, k / 30, head), 0.0)
            answer, k = one.step(), k + 1
    return one, answer


@pytest.mark.parametrize("head", [True, False])
def test_legs_follow_their_sensors(head: bool) -> None:
    wearer = Wearer(3, LEGS)
    one, answer = played_session(wearer, head)
    notices = [message.text for message in one.take_messages() if isinstance(message, Notice)]
    assert f"{len(LEGS)} inertial sensors are worn as you stand" in notices
    assert answer is not None and np.isfinite(answer.points).all()
    turns = np.asarray(forward_kinematics(answer.pose)[1])
    wanted = np.asarray(forward_kinematics(squatting())[1])
    for name in LEGS[1:]:
        joint = SKELETON.index(IMUS[name])
        assert geodesic_angle(turns[joint], wanted[joint]) < np.deg2rad(20), name


class Emulated:
    """A simulated tracker with one sensor."""

    def __init__(self, port: int, mac: bytes) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5)
        self.server, self.mac, self.number = ("127.0.0.1", port), mac, 0

    def send(self, packet: bytes) -> None:
        self.socket.sendto(packet, self.server)

    def connect(self) -> None:
        self.send(handshake(self.mac))
        assert self.socket.recv(100) == b"\x03Hey OVR =D 5".ljust(64, b"\0")
        self.number += 1
        self.send(info(self.number))
        heard = {self.socket.recv(100) for _ in range(2)}
        assert heard == {bytes([0, 0, 0, 15, 0, 1]), heartbeat()}

    def turn(self, rotation: np.ndarray) -> None:
        self.number += 1
        self.send(turned(self.number, rotation))


@contextmanager
def sending(step: Any) -> Iterator[None]:
    over = threading.Event()

    def run() -> None:
        while not over.wait(0.02):
            step()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.mark.slow
def test_a_tracker_joins_a_headset_of_vmc(
    server_of: Serving, connect: Connecting, capsys: pytest.CaptureFixture[str]
) -> None:
    vmc, slime = free_port(), free_port()
    server = server_of(ServerSettings(vmc_in=vmc, slimevr=SlimevrSettings("127.0.0.1", slime)))
    client = connect(server, points=(), watch="vmc")
    tracker = Emulated(slime, MAC)
    tracker.connect()
    bent = threading.Event()
    position = forward_kinematics(standing_pose(SKELETON))[0]
    floor = np.asarray(position)[:, 1].min()
    head = np.asarray(position)[SKELETON.index("head")] - [0, floor, 0] + [0.0, 0.07, 0.08]
    upright = np.array([1.0, 0, 0, 0])
    headset = (*unity_position(head).tolist(), *unity_rotation(upright).tolist())

    def step() -> None:
        tracker.socket.sendto(message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "HMD", *headset), ("127.0.0.1", vmc))
        shin = quaternion_exp(np.array([1.2, 0, 0])) if bent.is_set() else upright
        tracker.turn(quaternion_multiply(about_y(2.0), quaternion_multiply(shin, about_y(FACING["left_knee"]))))

    with tracker.socket, sending(step):
        client.send_message(Calibrate())
        texts = [client.text("said")["text"] for _ in range(3)]
        assert "1 inertial sensors are worn as you stand" in texts
        bent.set()
        until, found = time.monotonic() + 10, None
        while time.monotonic() < until:
            pose = client.pose()
            body = Pose(SKELETON, pose.root_position, pose.rotation)
            found = np.asarray(forward_kinematics(body)[1])[SKELETON.index("left_knee")]
            if geodesic_angle(found, quaternion_exp(np.array([1.2, 0, 0]))) < np.deg2rad(20):
                break
        else:
            raise AssertionError(f"the shin does not follow: {found}")
    assert f"SlimeVR tracker {SERIAL} on left_knee" in capsys.readouterr().out


def test_trackers_without_a_headset_are_an_input_of_their_own(server_of: Serving, connect: Connecting) -> None:
    slime = free_port()
    server = server_of(ServerSettings(slimevr=SlimevrSettings("127.0.0.1", slime, {SERIAL: "left_hip"})))
    client = connect(server, points=(), watch="slimevr")
    tracker = Emulated(slime, MAC)
    with tracker.socket:
        tracker.connect()
        with sending(lambda: tracker.turn(quaternion_conjugate(np.array([1.0, 0, 0, 0])))):
            assert np.isfinite(client.pose().rotation).all()
        with suppress(TimeoutError):
            while True:  # drain packets that were sent meanwhile
                client.socket.recv(timeout=0.2)
        unknown = Emulated(slime, bytes([9] * 6))
        with unknown.socket:
            unknown.socket.settimeout(0.3)
            unknown.send(handshake(unknown.mac))
            with pytest.raises(TimeoutError):
                unknown.socket.recv(100)
