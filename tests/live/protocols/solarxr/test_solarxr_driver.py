"""Drivers of SlimeVR 22: the messages, read by their slots, and a simulated driver."""

from __future__ import annotations

import shutil
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bodysense.geometry.rotation import quaternion_rotate
from bodysense_live.protocols.solarxr.driver_input import DriverReader, DriverState
from bodysense_live.protocols.solarxr.driver_messages import (
    BONE_IDS,
    BoneParts,
    SkeletonUpdates,
    is_hello,
)
from bodysense_live.protocols.solarxr.solarxr_body import BONES, body_frame, body_layout
from bodysense_live.protocols.solarxr.solarxr_link import RPC, SolarxrSettings
from bodysense_live.server.settings import ServerSettings

from ...conftest import Serving
from . import client
from .test_solarxr import EYES, SKELETON, standing

LAYOUT = body_layout(SKELETON, EYES)
ROTATION, ORIENTATION, START, END = (2, 4), (3, 4), (4, 3), (5, 3)  # slot and numbers of a bone's parts


def bones_of(packet: bytes) -> dict[int, client.Row]:
    kind, content, _ = client.driver_answer(packet)
    assert kind == client.SKELETON
    return {row.value(0, "H"): row for row in content.rows(0)}


@pytest.mark.parametrize("facing", [0.0, np.pi, 1.0])
def test_bones_match_the_body(facing: float) -> None:
    places, turns = standing(facing)
    updates = SkeletonUpdates(LAYOUT, BoneParts(True, True, True, True, True))
    rows = bones_of(updates.packet(body_frame(places, turns, EYES)))
    assert sorted(rows) == list(range(1, 22))
    for bone in BONES:
        row = rows[BONE_IDS[bone.key]]
        turn, start, end = row.floats(*ORIENTATION), row.floats(*START), row.floats(*END)
        assert turn is not None and start is not None and end is not None
        np.testing.assert_allclose(start, places[bone.start], atol=1e-6)
        np.testing.assert_allclose(end, places[bone.end], atol=1e-5)
        along = quaternion_rotate(np.roll(turn, 1), np.array([0.0, -row.value(1, "f"), 0.0]))
        np.testing.assert_allclose(start + along, end, atol=1e-5)
    hip = rows[BONE_IDS["hip"]].floats(*END)
    assert hip is not None
    np.testing.assert_allclose(hip, (places["left_hip"] + places["right_hip"]) / 2, atol=1e-5)


def test_a_rest_pose_has_identity_rotations_and_feet_that_point_forward() -> None:
    rows = bones_of(SkeletonUpdates(LAYOUT, BoneParts(rotation=True, orientation=True)).packet(
        body_frame(*standing(np.pi), EYES)
    ))  # fmt: skip
    for name in ("left_foot", "right_foot", "left_lower_leg", "right_upper_leg", "upper_waist"):
        turn = rows[BONE_IDS[name]].floats(*ROTATION)
        assert turn is not None and abs(turn[3]) > np.cos(np.deg2rad(25) / 2), name
    foot = rows[BONE_IDS["left_foot"]].floats(*ORIENTATION)
    assert foot is not None
    along = quaternion_rotate(np.roll(foot, 1), np.array([0.0, -1.0, 0.0]))
    assert along[2] < -0.8  # −Z is forward
    assert rows[1].at(4) is None and rows[1].at(1) is None  # parts that are not requested are missing


def test_a_mask_without_a_body_leaves_ids_and_lengths() -> None:
    rows = bones_of(SkeletonUpdates(LAYOUT, BoneParts(length=True, start=True)).without_body)
    assert len(rows) == 21 and all(row.value(1, "f") > 0 and row.at(4) is None for row in rows.values())


def test_the_first_message_tells_the_protocol() -> None:
    assert is_hello(client.connection_message(client.HELLO, 2))
    assert is_hello(client.connection_message(client.HELLO, 3))
    for older in (client.request(), client.request(False, 5, 77), client.request(False, None, 3), b"", b"nonsense"):
        assert not is_hello(older)


def answers(reader: DriverReader, state: DriverState, *packets: bytes) -> DriverState:
    for packet in packets:
        state, reason = reader.take(packet, 0.0, state)
        assert reason is None
    return state


def configured(reader: DriverReader) -> DriverState:
    hello = client.connection_message(client.HELLO, 2)
    return answers(reader, reader.start(), hello, client.connection_message(client.CONFIGURED))


def test_a_connection_is_configured() -> None:
    reader = DriverReader()
    state = answers(reader, reader.start(), client.connection_message(client.HELLO, 2))
    kind, content = client.connection_answer(state.replies[0])
    assert kind == client.SERVER_HELLO and content.value(0, "B") == 0 and content.value(1, "I") == 2
    early = answers(reader, state, client.register("driver", None, 5))
    assert client.connection_answer(early.replies[0])[0] == client.ERROR and not early.name
    state = answers(reader, state, client.connection_message(client.ASK_BONES))
    kind, content = client.connection_answer(state.replies[0])
    bones = {row.text(1): (row.value(0, "H"), row.value(3, "H")) for row in content.rows(0)}
    assert kind == client.BONES and bones["slimevr:head"] == (1, 0) and bones["slimevr:hip"] == (7, 6)
    assert bones["slimevr:left_foot"] == (12, 10) and bones["slimevr:right_shoulder"] == (21, 2)
    assert sorted(number for number, _ in bones.values()) == list(range(1, 22))
    assert {parent for _, parent in bones.values()} < {0, *range(1, 22)}
    state = answers(reader, state, client.connection_message(client.CONFIGURED))
    assert client.connection_answer(state.replies[0])[0] == client.CONFIGURED
    assert client.driver_answer(state.replies[1])[0] == client.AVAILABLE


def test_another_version_is_refused() -> None:
    state = answers(DriverReader(), DriverState(), client.connection_message(client.HELLO, 3))
    _, content = client.connection_answer(state.replies[0])
    assert (content.value(0, "B"), content.value(1, "I"), state.closes) == (1, 2, True)


@pytest.mark.parametrize(("name", "status"), [("steamvr", 0), ("", 1), (None, 1), ("monado", 2)])
def test_drivers_register_by_name(name: str | None, status: int) -> None:
    reader = DriverReader(names=lambda: ["monado", ""])
    state = answers(reader, configured(reader), client.register(name, (1,), 41))
    kind, content, reply_to = client.driver_answer(state.replies[0])
    assert (kind, content.value(0, "B"), reply_to) == (client.REGISTERED, status, 41)
    assert state.mask == (BoneParts(rotation=True) if status == 0 else None)


def test_a_headset_and_controllers_are_read() -> None:
    reader = DriverReader()
    state = configured(reader)
    refused = answers(reader, state, client.add_tracker("abc", 1, 3))
    assert client.driver_answer(refused.replies[0])[1].value(0, "B") == 2  # an error: no driver has registered
    state = answers(reader, state, client.register("steamvr", None, 1))
    for number, (identity, bone) in enumerate((("hmd", 1), ("left", 18), ("right", 19), ("hip", 7), ("any", 0)), 1):
        state = answers(reader, state, client.add_tracker(identity, bone, 10 + number))
        kind, content, reply_to = client.driver_answer(state.replies[0])
        assert (kind, content.value(0, "B"), reply_to) == (client.ADDED, 0, 10 + number)
        assert content.value(1, "H") == number
    again = answers(reader, state, client.add_tracker("left", 18, 30))
    _, content, _ = client.driver_answer(again.replies[0])
    assert (content.value(0, "B"), content.value(1, "H")) == (1, 2)
    half = (0.0, 1.0, 0.0, 0.0)  # half a turn about +Y
    for tracker, place in ((1, (0.0, 1.6, 0.0)), (2, (-0.3, 1.0, -0.3)), (3, (0.3, 1.0, -0.3)), (4, (0.0, 0.9, 0.1))):
        state = answers(reader, state, client.tracker_pose(tracker, place, half))
    seen = reader.observation(0.0, state)
    assert seen is not None
    known = {name: k for k, name in enumerate(seen.points) if seen.has_position[0, k]}
    assert set(known) == {"headset", "left_controller", "right_controller", "pelvis_tracker"}
    np.testing.assert_allclose(seen.position[0, known["left_controller"]], [-0.3, 1.0, -0.3], atol=1e-6)
    assert seen.has_rotation[0, known["headset"]] and not seen.has_rotation[0, known["left_controller"]]
    np.testing.assert_allclose(np.abs(seen.rotation[0, known["headset"]]), [0, 0, 1, 0], atol=1e-6)
    state = answers(reader, state, client.tracker_status(1, 5), client.tracker_pose(1, (9.0, 9.0, 9.0)))
    later = reader.observation(0.0, state)
    assert later is not None and later.position[0, known["headset"], 0] == 0.0
    assert reader.take(client.tracker_pose(2, (float("nan"), 0.0, 0.0)), 0.0, state)[1] is not None


class Driver:
    """A simulated driver, like SlimeVR's for SteamVR."""

    def __init__(self, folder: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.settimeout(10)
        self.socket.connect(str(folder / RPC))

    def say(self, packet: bytes) -> None:
        self.socket.sendall(struct.pack("<I", 4 + len(packet)) + packet)

    def heard(self) -> bytes:
        return self._whole(struct.unpack("<I", self._whole(4))[0] - 4)

    def _whole(self, size: int) -> bytes:
        found = b""
        while len(found) < size:
            part = self.socket.recv(size - len(found))
            assert part, "the server hung up"
            found += part
        return found


@pytest.fixture
def driver(server_of: Serving, tmp_path: Path) -> Iterator[Driver]:
    if not hasattr(socket, "AF_UNIX"):
        pytest.skip("this system has no such sockets")
    server_of(ServerSettings(solarxr=SolarxrSettings(tmp_path, 0)))
    found = Driver(tmp_path)
    yield found
    found.socket.close()


def test_a_driver_gets_a_body(driver: Driver) -> None:
    driver.say(client.connection_message(client.HELLO, 2))
    driver.say(client.connection_message(client.ASK_BONES))
    driver.say(client.connection_message(client.CONFIGURED))
    kinds = [client.connection_answer(driver.heard())[0] for _ in range(3)]
    assert kinds == [client.SERVER_HELLO, client.BONES, client.CONFIGURED]
    assert client.driver_answer(driver.heard())[0] == client.AVAILABLE
    driver.say(client.register("steamvr", (3,), 1))
    assert client.driver_answer(driver.heard())[1].value(0, "B") == 0
    for number, bone in enumerate((1, 18, 19), start=1):
        driver.say(client.add_tracker(f"device {number}", bone, number))
    until, waist = time.monotonic() + 20, None
    while waist is None and time.monotonic() < until:
        for tracker, place in ((1, (0.0, 1.6, 0.0)), (2, (-0.3, 1.0, -0.3)), (3, (0.3, 1.0, -0.3))):
            driver.say(client.tracker_pose(tracker, place))
        packet = driver.heard()
        if client.driver_answer(packet)[0] == client.SKELETON:
            waist = bones_of(packet)[BONE_IDS["hip"]].floats(*START)
    assert waist is not None and 0.7 < waist[1] < 1.2 and np.hypot(waist[0], waist[2]) < 0.5
    driver.say(client.register("steamvr", None, 2))  # no updates any more
    until = time.monotonic() + 10
    while client.driver_answer(driver.heard())[2] != 2 and time.monotonic() < until:
        pass
    driver.socket.settimeout(0.3)
    with pytest.raises(TimeoutError):
        driver.heard()


def test_a_client_that_is_refused_is_disconnected(driver: Driver) -> None:
    driver.say(client.connection_message(client.HELLO, 3))
    assert client.connection_answer(driver.heard())[1].value(0, "B") == 1
    assert driver.socket.recv(10) == b""


@pytest.mark.skipif(shutil.which("flatc") is None, reason="needs flatc 2.0.8")
def test_the_code_is_that_of_the_schemas() -> None:
    script = Path(__file__).parents[4] / "scripts" / "make_protocol_types.py"
    version = subprocess.run(["flatc", "--version"], capture_output=True, text=True, check=True).stdout
    if "2.0.8" not in version:
        pytest.skip(f"{version.strip()} writes other code than 2.0.8")
    assert subprocess.run([sys.executable, str(script), "--solarxr", "--check"], check=False).returncode == 0
