"""OpenXR runtimes by SolarXR: bundles, read by their slots, and a simulated runtime."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect as open_socket
from websockets.typing import Origin

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense_live.protocols.solarxr.runtime_messages import Requests, Updates, read_bundle, settings_bundle
from bodysense_live.protocols.solarxr.solarxr_body import BONES, TRACKERS, body_frame, body_layout
from bodysense_live.protocols.solarxr.solarxr_input import InputReader, read_fields
from bodysense_live.protocols.solarxr.solarxr_link import INPUT, RPC, SolarxrLink, SolarxrSettings, runtime_folder
from bodysense_live.protocols.webxr import between_eyes
from bodysense_live.security.safety import local_refusal_reason
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.tracked_devices import SIGNALS

from ...conftest import Connecting, Serving, free_port
from .client import bundle, request, update

SKELETON = default_skeleton()
EYES = between_eyes(SKELETON)
UPDATES = Updates(body_layout(SKELETON, EYES))


def standing(facing: float = 0.0) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    pose = standing_pose(SKELETON)
    pose.rotation[0] = quaternion_exp(np.array([0.0, facing, 0.0]))
    position, rotation = forward_kinematics(pose)
    places = dict(zip(SKELETON.points, np.asarray(position), strict=True))
    return places, dict(zip(SKELETON.joints, np.asarray(rotation), strict=True))


def test_requests_are_read() -> None:
    assert read_bundle(request()) == Requests(polls=True, settings=(None,))
    assert read_bundle(request(False, 5, 77)) == Requests(interval=0.005, settings=(77,))
    assert read_bundle(b"") == "0 bytes are not a bundle of SolarXR"


def test_settings_switch_trackers_on() -> None:
    (answer,) = bundle(settings_bundle(77)).rows(1)
    assert answer.value(0, "I") == 77 and answer.value(1, "B") == 7
    inside = answer.row(2)
    toggles = None if inside is None else inside.row(0)
    assert toggles is not None
    assert [slot for slot in range(15) if toggles.value(slot, "?", False)] == [0, 1, 7, 8, 9, 10, 11, 12]
    (without,) = bundle(settings_bundle(None)).rows(1)
    assert without.at(0) is None


@pytest.mark.parametrize("facing", [0.0, np.pi, 1.0])
def test_trackers_and_bones_match_the_body(facing: float) -> None:
    places, turns = standing(facing)
    decoded = update(UPDATES.packet(body_frame(places, turns, EYES)))
    trackers, bones = decoded.rows(1), decoded.rows(2)
    assert len(trackers) == len(TRACKERS) and len(bones) == len(BONES) + 1
    numbers = set()
    for tracker, (part, name, place) in zip(trackers, TRACKERS, strict=True):
        identity, info = tracker.row(0), tracker.row(1)
        assert identity is not None and info is not None
        assert identity.at(0) is None  # a tracker with a device would be echoed
        numbers.add(identity.value(1, "B"))
        assert info.value(1, "B") == part and info.text(7) == name and tracker.value(2, "B") == 2
        assert tracker.at(8) is None  # a driver would take an acceleration for a velocity
        there = tracker.floats(4, 3)
        assert there is not None
        np.testing.assert_allclose(there, places[place], atol=1e-6)
    assert len(numbers) == len(TRACKERS)
    by_part = {bone.value(0, "B"): bone for bone in bones}
    for bone in BONES:
        row = by_part[bone.body_part]
        turn, head, length = row.floats(1, 4), row.floats(3, 3), row.value(2, "f")
        assert turn is not None and head is not None and abs(np.linalg.norm(turn) - 1) < 1e-6
        np.testing.assert_allclose(head, places[bone.start], atol=1e-6)
        tail = head + quaternion_rotate(np.roll(turn, 1), np.array([0.0, -length, 0.0]))
        np.testing.assert_allclose(tail, places[bone.end], atol=1e-5)


def test_hanging_limbs_that_face_forward_have_the_identity_rotation() -> None:
    """Legs and arms of a standing wearer who faces −Z are close to the identity."""
    decoded = update(UPDATES.packet(body_frame(*standing(np.pi), EYES)))
    for row in decoded.rows(1):
        turn = row.floats(3, 4)
        assert turn is not None and abs(turn[3]) > np.cos(np.deg2rad(20) / 2)
    by_part = {row.value(0, "B"): row.floats(1, 4) for row in decoded.rows(2)}
    for part in (6, 7, 8, 9, 14, 15, 16, 17, 3, 4, 5):
        turn = by_part[part]
        assert turn is not None and abs(turn[3]) > np.cos(np.deg2rad(25) / 2), part


def test_without_a_tracked_wearer_trackers_have_no_poses() -> None:
    decoded = update(UPDATES.without_body)
    assert all(row.value(2, "B") == 1 and row.at(3) is None and row.at(4) is None for row in decoded.rows(1))
    assert all(row.at(1) is None and row.value(2, "f") > 0 for row in decoded.rows(2))


# ---- a runtime's headset


def message(number: int, inside: bytes) -> bytes:
    return bytes([number << 3 | 2, len(inside)]) + inside


def added(identity: int, role: int) -> bytes:
    return message(3, bytes([0x08, identity]) + b"\x12\x03abc" + bytes([0x20, role]))


def position(identity: int, place: tuple[float, float, float], turn: tuple[float, ...] = (0, 0, 0, 1)) -> bytes:
    numbers = b"".join(bytes([k << 3 | 5]) + struct.pack("<f", x) for k, x in enumerate((*place, *turn), start=2))
    padded = bytes([0x08, identity | 0x80, 0x80, 0x80, 0x80, 0x00])  # five bytes, as Monado writes it
    return message(1, padded + numbers)


def test_a_headset_and_controllers_are_read() -> None:
    reader = InputReader()
    state = reader.start()
    for packet in (added(1, 19), added(2, 13), added(3, 14), added(4, 0)):
        state, reason = reader.take(packet, 0.0, state)
        assert reason is None
    for identity, place in ((1, (0.0, 1.6, 0.0)), (2, (-0.3, 1.0, -0.3)), (3, (0.3, 1.0, -0.3)), (4, (0.0, 0.0, 0.0))):
        state, reason = reader.take(position(identity, place), 0.1, state)
        assert reason is None
    seen = reader.observation(0.1, state)
    assert seen is not None
    known = {name: k for k, name in enumerate(seen.points) if seen.has_position[0, k]}
    assert set(known) == {"headset", "left_controller", "right_controller"}
    np.testing.assert_allclose(seen.position[0, known["left_controller"]], [-0.3, 1.0, -0.3], atol=1e-6)
    assert seen.has_rotation[0, known["headset"]] and not seen.has_rotation[0, known["left_controller"]]
    np.testing.assert_allclose(np.abs(seen.rotation[0, known["headset"]]), [1, 0, 0, 0], atol=1e-9)
    state, _ = reader.take(message(4, bytes([0x08, 1, 0x10, 4])), 0.2, state)  # occluded
    state, _ = reader.take(position(1, (9.0, 9.0, 9.0)), 0.2, state)
    later = reader.observation(0.2, state)
    assert later is not None and later.position[0, known["headset"], 0] == 0.0
    for wrong in (position(2, (float("nan"), 0, 0)), b"\x0a\xff", b"\x0b", message(1, b"\x0d\x00")):
        assert reader.take(wrong, 0.3, state)[1] is not None


def test_protobuf_fields() -> None:
    assert read_fields(b"\x08\x96\x01\x12\x02hi\x1d\x00\x00\x80\x3f") == {1: 150, 2: b"hi", 3: 1.0}


class Runtime:
    """A simulated runtime, like Monado's driver and WiVRn's feeder."""

    def __init__(self, folder: Path) -> None:
        self.rpc, self.input = (socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) for _ in range(2))
        for one, name in ((self.rpc, RPC), (self.input, INPUT)):
            one.settimeout(10)
            one.connect(str(folder / name))

    def say(self, packet: bytes) -> None:
        self.rpc.sendall(struct.pack("<I", 4 + len(packet)) + packet)

    def send(self, packet: bytes) -> None:
        self.input.sendall(struct.pack("<I", 4 + len(packet)) + packet)

    def heard(self) -> bytes:
        return self._whole(struct.unpack("<I", self._whole(4))[0] - 4)

    def _whole(self, size: int) -> bytes:
        found = b""
        while len(found) < size:
            part = self.rpc.recv(size - len(found))
            assert part, "the server hung up"
            found += part
        return found

    def __enter__(self) -> Runtime:
        return self

    def __exit__(self, *_: object) -> None:
        self.rpc.close()
        self.input.close()


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    if not hasattr(socket, "AF_UNIX"):
        pytest.skip("this system has no such sockets")
    yield tmp_path


def test_a_runtime_gets_a_body(server_of: Serving, folder: Path, connect: Connecting) -> None:
    server_of(ServerSettings(solarxr=SolarxrSettings(folder, 0)))
    with Runtime(folder) as runtime:
        runtime.say(request(polls=True, asks=0))
        first, second = runtime.heard(), runtime.heard()
        assert len(update(first).rows(1)) == len(TRACKERS)  # the first message is an update
        assert bundle(second).rows(1)[0].value(1, "B") == 7
        runtime.say(request(polls=False, starts=1, asks=None))
        for packet in (added(1, 19), added(2, 13), added(3, 14)):
            runtime.send(packet)
        until, seen, decoded = time.monotonic() + 20, False, update(first)
        while not seen and time.monotonic() < until:
            decoded = update(runtime.heard())  # the runtime sends its headset after each update
            for identity, place in ((1, (0.0, 1.6, 0.0)), (2, (-0.3, 1.0, -0.3)), (3, (0.3, 1.0, -0.3))):
                runtime.send(position(identity, place))
            seen = all(row.value(2, "B") == 2 for row in decoded.rows(1))
        assert seen
        waist = decoded.rows(1)[0].floats(4, 3)
        assert waist is not None and 0.7 < waist[1] < 1.2 and np.hypot(waist[0], waist[2]) < 0.5
        begun, count = time.monotonic(), 0
        while time.monotonic() - begun < 0.5:
            runtime.heard()
            count += 1
        assert count <= 75  # at most 120 per second
        until = time.monotonic() + 10
        while time.monotonic() < until and update(runtime.heard()).rows(1)[0].value(2, "B") != 1:
            pass  # the headset was taken off
        assert time.monotonic() < until


def test_slimevrs_programs_get_the_same_body_by_a_websocket(server_of: Serving, folder: Path) -> None:
    port = free_port()
    server_of(ServerSettings(solarxr=SolarxrSettings(folder, port)))
    with Runtime(folder) as runtime, open_socket(f"ws://127.0.0.1:{port}/") as program:

        def heard() -> bytes:
            packet = program.recv(timeout=10)
            assert isinstance(packet, bytes)
            return packet

        program.send("a text of the older protocol")
        program.send(b"nonsense")
        program.send(request(polls=True, asks=9))
        assert len(update(heard()).rows(1)) == len(TRACKERS)
        (answer,) = bundle(heard()).rows(1)
        assert (answer.value(0, "I"), answer.value(1, "B")) == (9, 7)
        for who in (program.send, runtime.say):
            who(request(polls=False, starts=1, asks=None))
        for packet in (added(1, 19), added(2, 13), added(3, 14)):
            runtime.send(packet)
        until, seen, decoded = time.monotonic() + 20, False, update(heard())
        while not seen and time.monotonic() < until:
            for identity, place in ((1, (0.0, 1.6, 0.0)), (2, (-0.3, 1.0, -0.3)), (3, (0.3, 1.0, -0.3))):
                runtime.send(position(identity, place))
            decoded = update(heard())
            seen = all(row.value(2, "B") == 2 for row in decoded.rows(1))
        waist = decoded.rows(1)[0].floats(4, 3)
        assert seen and waist is not None and 0.7 < waist[1] < 1.2


@pytest.mark.parametrize("origin", [None, "http://localhost:5173", "tauri://localhost"])
def test_programs_and_pages_of_this_machine_are_admitted(origin: str | None) -> None:
    assert local_refusal_reason("127.0.0.1:21110", origin) is None


def test_other_pages_and_names_are_refused(server_of: Serving, folder: Path) -> None:
    port = free_port()
    server_of(ServerSettings(solarxr=SolarxrSettings(folder, port)))
    with pytest.raises(InvalidStatus) as refused:
        open_socket(f"ws://127.0.0.1:{port}/", origin=Origin("https://evil.example.org"))
    assert refused.value.response.status_code == 403
    assert local_refusal_reason("evil.example.org:21110", None) and local_refusal_reason("localhost", "null")


def test_malformed_messages_are_ignored_or_close_the_connection(server_of: Serving, folder: Path) -> None:
    server_of(ServerSettings(solarxr=SolarxrSettings(folder, 0)))
    with Runtime(folder) as broken:
        broken.rpc.sendall(b"\xff\xff\xff\xff")
        assert broken.rpc.recv(10) == b""
    with Runtime(folder) as runtime:
        runtime.say(b"nonsense")
        runtime.send(b"nonsense")
        runtime.say(request())
        assert update(runtime.heard())


def test_sockets_that_cannot_be_bound(folder: Path) -> None:
    def link(where: Path) -> SolarxrLink:
        return SolarxrLink(SolarxrSettings(where, 0), Metrics(), InputReader(), SIGNALS)

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(folder / RPC))
        other.listen()
        with pytest.raises(BodysenseError, match="is in use: SlimeVR, or another bodysense"):
            link(folder)
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(BodysenseError, match=f"--solarxr-port {port} is in use"):
            SolarxrLink(SolarxrSettings(folder, port), Metrics(), InputReader(), SIGNALS)
    stale = link(folder)  # an abandoned socket is replaced
    stale.close()
    assert not (folder / RPC).exists() and not (folder / INPUT).exists()
    with pytest.raises(BodysenseError, match="set XDG_RUNTIME_DIR to a folder of yours"):
        link(folder / "nowhere")
    with pytest.raises(BodysenseError, match="XDG_RUNTIME_DIR is not set"):
        runtime_folder({})
