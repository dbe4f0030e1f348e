"""A webcam of the server's machine: its person goes to avatars, and a webcam that is taken away comes back."""

from __future__ import annotations

import socket
import time
from collections.abc import Generator
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.video.device import POINTS
from bodysense.devices.video.pictures import VideoBrokenError
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.formats.osc import read_packet
from bodysense.observing.observation import Observation
from bodysense_live.protocols import camera_link
from bodysense_live.protocols.camera_link import CameraSettings, Look, is_dark
from bodysense_live.protocols.datagrams import Receiver
from bodysense_live.server.settings import ServerSettings

from ..conftest import Connecting, Serving

SKELETON = default_skeleton()
RATE = 30.0  # Hz
CURL = 0.8  # rad, of each joint of the left fingers


def before_the_camera(curl: float) -> Observation:
    """A standing person with curled left fingers: `POINTS` of one frame."""
    pose = standing_pose(SKELETON)
    curled = quaternion_exp(np.array([0.0, 0.0, -curl]))
    for k, name in enumerate(SKELETON.joints):
        if name.startswith("left_") and name[-1] in "123" and "thumb" not in name:
            pose.rotation[k] = curled
    position, rotation = (np.asarray(part) for part in forward_kinematics(pose))
    where = SKELETON.indices(POINTS)
    placed = np.array([name in ("head", "left_shoulder", "right_shoulder") or "ankle" in name for name in POINTS])
    turned = np.array([k < len(SKELETON.joints) for k in where])
    rows = np.full((len(POINTS), 4), np.nan)
    rows[turned] = rotation[np.array(where)[turned]]
    return Observation(
        points=POINTS,
        position=np.where(placed[:, None], position[where], np.nan)[None],
        rotation=rows[None],
        has_position=placed[None],
        has_rotation=turned[None],
        accuracy=np.full((1, len(POINTS)), 0.05),
        time=np.zeros(1),
    )


class Webcam:
    """A webcam that shows a person for some pictures, is taken away, and comes back."""

    def __init__(self, pictures: int) -> None:
        self.pictures, self.opened = pictures, 0

    def frames(self, settings: CameraSettings, skeleton: Skeleton) -> Generator[Look, None, None]:
        self.opened += 1
        if self.opened == 2:
            raise BodysenseError("webcam 0: not found, or used by another program; give another index or a file")
        for _ in range(self.pictures):
            yield Look(before_the_camera(CURL))
            time.sleep(1 / RATE)
        raise VideoBrokenError("webcam 0: no more pictures; those before were used")


@pytest.fixture
def webcam(monkeypatch: pytest.MonkeyPatch) -> Webcam:
    found = Webcam(60)
    monkeypatch.setattr(camera_link, "camera_frames", found.frames)
    monkeypatch.setattr(camera_link, "RETRY", 0.05)
    return found


def finger_turn(packet: bytes) -> float | None:
    """The angle (rad) of the left index finger's first joint in a packet of VMC; None if it is not in it."""
    messages = read_packet(packet)
    assert not isinstance(messages, str)
    for message in messages:
        if message.address == "/VMC/Ext/Bone/Pos" and message.arguments[0] == "LeftIndexProximal":
            w = message.arguments[7]
            assert isinstance(w, float)
            return 2 * float(np.arccos(min(abs(w), 1.0)))
    return None


def test_fingers_go_to_avatars_and_a_webcam_comes_back(
    server_of: Serving, webcam: Webcam, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as avatar:
        avatar.bind(("127.0.0.1", 0))
        avatar.settimeout(20)
        receiver = Receiver("vmc", "127.0.0.1", avatar.getsockname()[1])
        server_of(ServerSettings(camera=CameraSettings(0), receivers=(receiver,)))
        until, turned = time.monotonic() + 30, 0.0
        while (webcam.opened < 3 or turned < 0.6) and time.monotonic() < until:
            found = finger_turn(avatar.recv(65536))
            turned = turned if found is None else found
        assert webcam.opened >= 3 and turned == pytest.approx(CURL, abs=0.2)
    told = capfd.readouterr().out
    assert "webcam 0: a person is seen" in told
    assert "webcam 0: no more pictures; it is opened again when it comes back" in told
    assert "give another index or a file; it is opened again" in told


def test_a_page_watches_the_webcam(server_of: Serving, connect: Connecting, webcam: Webcam) -> None:
    client = connect(server_of(ServerSettings(camera=CameraSettings(0))), points=(), watch="camera")
    assert client.pose().hidden[SKELETON.index("head")] < 0.5


def test_a_webcam_that_cannot_be_opened_is_an_error_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(settings: CameraSettings, skeleton: Skeleton) -> Generator[Look, None, None]:
        raise BodysenseError("webcam 7: not found")
        yield Look(before_the_camera(0.0))

    monkeypatch.setattr(camera_link, "camera_frames", none)
    with pytest.raises(BodysenseError, match="webcam 7: not found"):
        camera_link.CameraLink(CameraSettings(7), SKELETON)


def nobody() -> Observation:
    there = before_the_camera(CURL)
    none = np.zeros_like(there.has_position)
    return replace(
        there,
        position=np.full_like(there.position, np.nan),
        rotation=np.full_like(there.rotation, np.nan),
        has_position=none,
        has_rotation=none,
    )


def test_a_covered_lens_is_reported_and_the_person_is_followed_on(
    server_of: Serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each state is printed once: a person, a covered lens, an empty room, two people, and a person again."""
    states = (
        ("a person is seen", Look(before_the_camera(CURL))),
        ("the picture is black: uncover the lens, or switch a light on", Look(nobody(), is_dark=True)),
        ("nobody is seen", Look(nobody())),
        (
            "2 people are seen, one of them is followed; if it is the wrong one, let the others leave the picture for "
            "a moment",
            Look(before_the_camera(CURL), people=2),
        ),
        ("a person is seen", Look(before_the_camera(CURL))),
    )
    lines: list[str] = []

    def frames(settings: CameraSettings, skeleton: Skeleton) -> Generator[Look, None, None]:
        for count, (_, look) in enumerate(states, start=1):
            until = time.monotonic() + 20
            while len(lines) < count and time.monotonic() < until:
                yield look
                time.sleep(1 / RATE)

    monkeypatch.setattr(camera_link, "ABSENT", 0.05)
    monkeypatch.setattr(camera_link, "camera_frames", frames)
    monkeypatch.setattr(camera_link, "print", lambda line, flush: lines.append(line), raising=False)
    server_of(ServerSettings(camera=CameraSettings(0)))
    until = time.monotonic() + 60
    while len(lines) < len(states) and time.monotonic() < until:
        time.sleep(0.1)
    assert lines[: len(states)] == [f"webcam 0: {state}" for state, _ in states]


@pytest.mark.parametrize("seed", range(4))
def test_a_covered_lens_is_black_but_for_noise_and_a_dim_room_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    covered = np.clip(rng.normal(3, 3, (480, 640, 3)), 0, 255).astype(np.uint8)
    dim = covered.copy()
    row, column = rng.integers(40, 380, 2)
    dim[row : row + 80, column : column + 120] += 40  # a face by the light of a screen
    assert is_dark(covered) and not is_dark(dim)
