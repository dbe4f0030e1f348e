"""SteamVR by VMT: packets read and written, and a simulated driver."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest
from pythonosc.osc_message import OscMessage
from pythonosc.osc_packet import OscPacket

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.formats.osc import message_bytes
from bodysense_live.protocols.links import DeviceInput
from bodysense_live.protocols.steamvr.vmt import VmtReader, VmtState, subscriptions
from bodysense_live.protocols.steamvr.vmt_hands import BONES, hand_bones, hand_packet
from bodysense_live.protocols.steamvr.vmt_link import VmtSettings
from bodysense_live.protocols.virtual_trackers import TURNED_BY
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.tracked_devices import SIGNALS, TrackedDevices

from ..conftest import Serving

SKELETON = default_skeleton()
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LIST = "0:HEAD-1\n1:LHR-A\n2:LHR-B\n3:VMT_0\n4:LHB-9\n"


def device(serial: str, place: tuple[float, ...] = (0.0, 1.6, 0.0), turn: tuple[float, ...] = UPRIGHT) -> bytes:
    return message_bytes("/VMT/Out/SubscribedDevice", "sfffffff", serial, *place, *turn)


def taken(*packets: bytes, reader: VmtReader = VmtReader()) -> VmtState:
    state = reader.start()
    for packet in packets:
        state, reason = reader.take(packet, 0.0, state)
        assert reason is None
    return state


def seen(state: VmtState, reader: VmtReader = VmtReader()) -> set[str]:
    observation = reader.observation(0.0, state)
    assert observation is not None
    return {name for name, has in zip(observation.points, observation.has_position[0], strict=True) if has}


def test_two_devices_outside_the_table_are_the_controllers() -> None:
    listed = message_bytes("/VMT/Out/Devices/List", "s", LIST)
    state = taken(listed, device("HEAD-1"), device("LHR-A", (0.3, 1.0, -0.3)), device("LHR-B", (-0.3, 1.0, -0.3)))
    assert state.others == ("LHR-A", "LHR-B")  # without VMT's own devices and base stations
    assert seen(state) == {"headset", "left_controller", "right_controller"}
    assert state.devices.hands == {"LHR-B": "left_controller", "LHR-A": "right_controller"}  # −Z forward, +X right


def test_with_more_devices_the_table_must_name_the_controllers() -> None:
    more = message_bytes("/VMT/Out/Devices/List", "s", LIST + "5:LHR-C\n")
    rows = device("HMD"), device("LHR-A", (0.3, 1, 0)), device("LHR-C", (0.1, 0.1, 0))
    assert seen(taken(more, *rows)) == {"headset", "tracker_1", "tracker_2"}
    named = VmtReader(TrackedDevices({"LHR-A": "right_controller", "LHR-C": "left_ankle"}))
    found = seen(taken(more, *rows, reader=named), named)
    assert found == {"headset", "right_controller", "left_ankle_tracker"}


def test_requests_have_the_types_that_the_driver_expects() -> None:
    state = taken(message_bytes("/VMT/Out/Devices/List", "s", LIST), message_bytes("/VMT/Out/Unavailable", "is", 1, ""))
    requests = [OscMessage(packet) for packet in subscriptions(state, "127.0.0.1", 39575)]
    assert [one.address for one in requests][:2] == ["/VMT/Set/Destination", "/VMT/Get/Devices/List"]
    assert [one.params[0] for one in requests[2:5]] == ["HEAD-1", "LHR-A", "LHR-B"]
    assert requests[-1].address == "/VMT/Set/RoomMatrix/Temporary" and len(requests[-1].params) == 12


def body(curl: float = 0.0) -> Pose:
    pose = rest_pose(SKELETON)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        for k in (1, 2, 3):
            pose.rotation[SKELETON.index(f"{side}_index{k}")] = quaternion_exp(np.array([0.0, 0.0, sign * curl]))
    return pose


def hand(side: str, curl: float = 0.0) -> tuple[RigidTransform, list[RigidTransform], dict[str, np.ndarray]]:
    position, rotation = forward_kinematics(body(curl))
    places = dict(zip(SKELETON.points, np.asarray(position), strict=True))
    turns = dict(zip(SKELETON.joints, np.asarray(rotation), strict=True))
    root, *bones = (RigidTransform(row[:3], row[3:]) for row in hand_bones(side, SKELETON, places, turns))
    return root, bones, places


@pytest.mark.parametrize("side", ["left", "right"])
def test_bones_match_the_joints_with_openvrs_axes(side: str) -> None:
    root, bones, places = hand(side, 0.5)
    assert len(bones) == BONES
    world = [root, root @ bones[1]]
    for k in range(2, 26):
        world.append(world[1 if k in (2, 6, 11, 16, 21) else k - 1] @ bones[k])
    for first, finger in ((2, "thumb"), (7, "index"), (12, "middle"), (17, "ring"), (22, "pinky")):
        names = [f"{side}_{finger}{end}" for end in ("1", "2", "3", "_tip")]
        for k, name in enumerate(names):
            np.testing.assert_allclose(world[first + k].translation, places[name], atol=1e-9)
    sign = 1.0 if side == "left" else -1.0
    for k in (8, 9, 10, 13, 14, 15):  # a finger's bones are along ±X of their parents
        along = bones[k].translation
        assert along[0] * sign > 0.95 * np.linalg.norm(along)
    for k in (26, 27, 28, 29, 30):
        np.testing.assert_allclose((root @ bones[k]).translation, world[(4, 9, 14, 19, 24)[k - 26]].translation)
    assert world[1].apply(np.array([[0, 0, 0.1]]))[0][0] * sign > world[1].translation[0] * sign  # +Z to the fingers


@pytest.mark.parametrize("side", ["left", "right"])
def test_fingers_curl_about_plus_z_on_both_hands(side: str) -> None:
    straight, curled = hand(side)[1][9].rotation, hand(side, 0.5)[1][9].rotation
    turn = RigidTransform(np.zeros(3), straight).inverse() @ RigidTransform(np.zeros(3), curled)
    assert turn.rotation[3] > 0.2 and abs(turn.rotation[3]) > 5 * np.abs(turn.rotation[1:3]).max()


def test_a_hand_is_one_bundle_that_python_osc_reads() -> None:
    position, rotation = forward_kinematics(body(0.3))
    places = dict(zip(SKELETON.points, np.asarray(position), strict=True))
    turns = dict(zip(SKELETON.joints, np.asarray(rotation), strict=True))
    packet = hand_packet("left", 8, SKELETON, places, turns)
    assert len(packet) <= 4098
    messages = [one.message for one in OscPacket(packet).messages]
    assert [one.address for one in messages] == [
        "/VMT/Raw/Driver",
        *(BONES * ["/VMT/Skeleton/Driver"]),
        "/VMT/Skeleton/Apply",
    ]
    assert [one.params[1] for one in messages[1:-1]] == list(range(BONES))
    assert all(abs(np.linalg.norm(one.params[-4:]) - 1) < 1e-6 for one in messages[:-1])


class Driver:
    """A simulated driver of VMT in a running SteamVR."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(10)
        self.waiting: list[OscMessage] = []
        self.port: int = self.socket.getsockname()[1]
        self.restart()

    def restart(self) -> None:
        self.out: tuple[str, int] | None = None
        self.subscribed: set[str] = set()

    def heard(self) -> OscMessage:
        if not self.waiting:
            self.waiting = [one.message for one in OscPacket(self.socket.recv(5000)).messages]
        message = self.waiting.pop(0)
        if message.address == "/VMT/Set/Destination":
            self.out = (message.params[0], message.params[1])
        elif message.address == "/VMT/Get/Devices/List" and self.out:
            self.socket.sendto(message_bytes("/VMT/Out/Devices/List", "s", LIST), self.out)
        elif message.address == "/VMT/Subscribe/Device":
            self.subscribed.add(message.params[0])
        return message

    def subscribe_all(self) -> None:
        while not {"HEAD-1", "LHR-A", "LHR-B"} <= self.subscribed:
            self.heard()

    def tracked(self) -> None:
        assert self.out
        for serial, x, y in (("HEAD-1", 0.0, 1.6), ("LHR-A", 0.3, 1.0), ("LHR-B", -0.3, 1.0)):
            self.socket.sendto(device(serial, (x, y, -0.2 * (y < 1.5))), self.out)


@pytest.fixture
def driver() -> Iterator[Driver]:
    found = Driver()
    with found.socket:
        yield found


def switched_devices(driver: Driver, enable: int) -> set[int]:
    """Return the indices of virtual devices that are switched on or off, after waiting for all."""
    found: set[int] = set()
    until = time.monotonic() + 10
    while len(found) < len(TURNED_BY) and time.monotonic() < until:
        if enable:
            driver.tracked()
        message = driver.heard()
        if message.address == "/VMT/Raw/Driver" and message.params[1] == enable:
            found.add(message.params[0])
    return found


def test_a_body_is_sent_to_steamvr_and_again_after_a_restart(server_of: Serving, driver: Driver) -> None:
    server_of(ServerSettings(vmt=VmtSettings(driver_port=driver.port, port=0)))
    for _ in range(2):
        driver.subscribe_all()
        assert switched_devices(driver, 1) == set(range(8))
        driver.restart()
    assert switched_devices(driver, 0) == set(range(8))  # no device is tracked any more


def test_a_second_sender_is_ignored() -> None:
    metrics = Metrics()
    link = DeviceInput(lambda frame: None, metrics, VmtReader(), SIGNALS, sender="127.0.0.1")
    link.datagram_received(device("HMD"), ("192.168.0.9", 39570))
    assert 'reason="second sender"} 1.0' in metrics.text()[0].decode() and not link.state.devices.devices
