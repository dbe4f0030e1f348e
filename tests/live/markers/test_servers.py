"""Clients of the three servers of markers, against twins that send packets as documented."""

from __future__ import annotations

import csv
import socket
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="needs packages/live")

from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SIGNAL, read_pose, read_signal
from bodysense.io.markers.raw_markers import MarkerFormat
from bodysense.io.markers.stream import learn_layout
from bodysense.takes.track import track
from bodysense.tracking.tracker import Tracker
from bodysense_live.protocols.markers.live_markers import LiveMarkers
from bodysense_live.protocols.markers.marker_link import MarkerServer, parsed_address
from bodysense_live.protocols.markers.natnet import NatnetConversation
from bodysense_live.protocols.markers.qtm import QtmConversation
from bodysense_live.protocols.markers.stream_frame import MarkerServerError, StreamFrame, raw_of
from bodysense_live.protocols.markers.vicon import ViconConversation
from bodysense_live.server import scheduler
from bodysense_live.server.scheduler import complete
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.answer import CompletionJob

from ..conftest import Client, Connecting, Serving
from ..server.wearers import until
from .performer import SUBJECT, Captured, captured
from .twins import NatnetTwin, QtmTwin, Twin, ViconTwin

TWINS: dict[str, type[Twin]] = {"natnet": NatnetTwin, "qtm": QtmTwin, "vicon": ViconTwin}
# Servers by TCP share their link, so that tests of it take one of them, and that by UDP.
LINKS = ("qtm", "natnet")
CONVERSATIONS = {"natnet": NatnetConversation, "qtm": QtmConversation, "vicon": ViconConversation}


def settings_for(twin: Twin, name: str, **fields) -> ServerSettings:
    return ServerSettings(markers=MarkerServer(name, "127.0.0.1", twin.port, **fields))  # type: ignore[arg-type]


def wait_for_pose(client: Client) -> float:
    """Wait until a body is tracked, and return the seconds that it took."""
    begun = time.monotonic()
    while (client.pose().hidden < 0.5).sum() <= 5:
        assert time.monotonic() - begun < 20.0, "nothing is tracked"
    return time.monotonic() - begun


def drain(client: Client) -> None:
    """Read the frames that wait; a client with unread frames takes 10 s to close."""
    with pytest.raises(TimeoutError):
        while True:
            client.frame(seconds=0.3)


@pytest.mark.parametrize(("name", "gloves"), [("qtm", False), ("natnet", True)])
def test_a_person_is_tracked(server_of: Serving, connect: Connecting, name: str, gloves: bool) -> None:
    """Every measured joint of the body, and with gloves of the fingers, is that of the performer."""
    capture = captured(gloves=gloves)
    with TWINS[name](capture) as twin:
        client = connect(server_of(settings_for(twin, name)), points=(), watch="markers")
        wait_for_pose(client)
        time.sleep(2.5)  # the layout is learned from two seconds
        drained = time.monotonic() + 0.5
        while time.monotonic() < drained:
            client.frame(SIGNAL, seconds=30)
        welcome = [text for text in client.texts if text["type"] == "welcome"][-1]
        signal = read_signal(client.frame(SIGNAL, seconds=30), len(welcome["signal"]))
        names = [welcome["signal"][k] for k in signal.point]
        joints = [k for k, point in enumerate(names) if "glove" not in point and signal.has[k] & 1]
        frame = round(signal.time * capture.rate)
        truth = np.asarray(forward_kinematics(capture.clip.pose)[0])[capture.index(frame)]
        skeleton = capture.clip.pose.skeleton
        wanted = truth[skeleton.indices([names[k] for k in joints])]
        assert {"left_hip", "right_knee", "left_ankle", "right_elbow"} <= {names[k] for k in joints}
        assert np.linalg.norm(signal.position[joints] - wanted, axis=1).max() < 0.045
        assert gloves == any("glove" in point for point in names)
        if gloves:
            pose = read_pose(client.frame(), len(client.welcome["points"]))
            fingers = [k for k, point in enumerate(client.welcome["points"]) if point.startswith("left_index")]
            assert (pose.hidden[fingers] < 0.5).all()
    drain(client)


@pytest.mark.parametrize("name", TWINS)
def test_frames_are_those_that_were_sent(name: str) -> None:
    """Markers, rigid bodies and hidden markers, in metres and our axes, within the precision of the protocol."""
    capture = captured(gloves=False)
    frames = received(name, capture, hidden=lambda frame: np.arange(len(capture.labels)) % 7 == frame % 7)
    assert len(frames) > 5
    for frame in frames:
        k = round(frame.time * capture.rate)
        raw = raw_of([frame])
        assert raw.axes is not None
        ours = (raw.position[0] * {"m": 1.0, "mm": 0.001}[frame.unit]) @ raw.axes.T
        place = capture.position[capture.index(k)].copy()
        place[np.arange(len(capture.labels)) % 7 == k % 7] = np.nan
        found = {name.rpartition(":")[2]: at for name, at in zip(frame.names, ours, strict=True)}
        np.testing.assert_allclose([found[label] for label in capture.labels], place, atol=1e-6)
        np.testing.assert_allclose(found["Hips"], capture.body_position[capture.index(k), 0], atol=1e-6)
        assert frame.rotation is not None
        turn = frame.rotation[frame.names.index("Prop")]
        assert abs(abs(turn[0]) - 1) < 1e-6
        assert np.isnan(frame.rotation[0]).all()


def received(name: str, capture: Captured, twin_type: type[Twin] | None = None, count: int = 8, **fields):
    """Return frames that a conversation makes of a twin's packets, which arrive in pieces."""
    conversation = CONVERSATIONS[name]()
    kind = socket.SOCK_DGRAM if name == "natnet" else socket.SOCK_STREAM
    frames = []
    with (twin_type or TWINS[name])(capture, **fields) as twin, socket.socket(socket.AF_INET, kind) as client:
        client.settimeout(5)
        client.connect(("127.0.0.1", twin.port))
        for packet in conversation.begin():
            client.send(packet)
        while len(frames) < count:
            data = client.recv(65536 if name == "natnet" else 1000)
            found = conversation.receive(data)
            frames += found.frames
            for packet in found.replies:
                client.send(packet)
    return frames


@pytest.mark.parametrize("version", [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)])
def test_versions_of_natnet(version: tuple[int, int]) -> None:
    twin = type("OtherTwin", (NatnetTwin,), {"version": version})
    (first, *_) = received("natnet", captured(), twin)
    assert f"{SUBJECT}:LASI" in first.names and np.isfinite(first.position).all()


@pytest.mark.parametrize(("version", "fix"), [((2, 10), "update Motive"), ((5, 0), "update bodysense")])
def test_other_versions_of_natnet_are_named(version: tuple[int, int], fix: str) -> None:
    twin = type("OtherTwin", (NatnetTwin,), {"version": version})
    with pytest.raises(MarkerServerError, match=fix):
        received("natnet", captured(), twin)


def test_an_old_qtm_is_named() -> None:
    twin = type("OtherTwin", (QtmTwin,), {"versions": ("1.8",)})
    with pytest.raises(MarkerServerError, match="update it"):
        received("qtm", captured(), twin)


@pytest.mark.parametrize("name", ["qtm", "vicon"])
def test_another_server_is_named(name: str) -> None:
    conversation = CONVERSATIONS[name]()
    with pytest.raises(MarkerServerError, match="port"):
        conversation.receive(b"HTTP/1.1 400 Bad Request\r\n\r\n")


@pytest.mark.parametrize("name", TWINS)
def test_damaged_packets_are_refused(name: str) -> None:
    """A cut or changed packet is refused by MarkerServerError, or read as another frame; nothing else is raised."""
    rng, refused = np.random.default_rng(5), 0
    twin = TWINS[name](captured(gloves=False))
    packets = twin.packets(3)
    twin._socket.close()
    for _ in range(300):
        conversation = CONVERSATIONS[name]()
        try:
            for packet in packets:
                damaged = bytearray(packet)
                for _ in range(int(rng.integers(0, 4))):
                    damaged[int(rng.integers(len(damaged)))] = int(rng.integers(256))
                cut = int(rng.integers(len(damaged))) if rng.random() < 0.2 else len(damaged)
                conversation.receive(bytes(damaged[:cut]))
        except MarkerServerError:
            refused += 1
    assert 10 < refused < 300


@pytest.mark.parametrize("name", LINKS)
def test_a_killed_server_is_back_within_two_seconds(server_of: Serving, connect: Connecting, name: str) -> None:
    """Or, on a loaded machine, within twice the time of the first connection, which also learns a layout."""
    capture = captured(gloves=False)
    with TWINS[name](capture) as twin:
        client = connect(server_of(settings_for(twin, name)), points=(), watch="markers")
        first = wait_for_pose(client)
    time.sleep(1.5)
    drain(client)
    with TWINS[name](capture, twin.port):
        assert wait_for_pose(client) < max(2.0, 2 * first)
    drain(client)


@pytest.mark.parametrize("name", TWINS)
def test_markers_may_change(server_of: Serving, connect: Connecting, name: str, capfd) -> None:
    """A stream whose marker set changes is reported in one line, and the person stays tracked."""
    capture = captured(gloves=False)
    with TWINS[name](capture) as twin:
        client = connect(server_of(settings_for(twin, name)), points=(), watch="markers")
        wait_for_pose(client)
        with twin._lock:
            twin.use = [k for k, label in enumerate(capture.labels) if label not in ("LTHI", "RUPA")]
        if isinstance(twin, ViconTwin):
            twin.announce()
        if isinstance(twin, NatnetTwin):
            twin.has_changed = True
        time.sleep(1.0)
        client.texts.clear()
        for _ in range(20):
            assert (client.pose().hidden < 0.5).sum() > 10
    drain(client)
    printed = capfd.readouterr().out
    assert printed.count("other markers: 2 gone") == 1
    assert "LTHI" in printed


def test_gloves_among_points_without_a_name(server_of: Serving, connect: Connecting) -> None:
    capture = captured(body=False)
    with QtmTwin(capture, labelled=False, bodies=False) as twin:
        client = connect(server_of(settings_for(twin, "qtm", unlabelled=("left", "right"))), points=(), watch="markers")
        until = time.monotonic() + 20
        fingers = [k for k, point in enumerate(client.welcome["points"]) if point.startswith("left_index")]
        while (client.pose().hidden[fingers] >= 0.5).any():
            assert time.monotonic() < until


@pytest.mark.parametrize("name", LINKS)
def test_the_recording_is_what_was_sent(server_of: Serving, connect: Connecting, tmp_path: Path, name: str) -> None:
    capture = captured(gloves=False)
    file = tmp_path / "take.csv"
    with TWINS[name](capture, bodies=False) as twin:
        server = server_of(settings_for(twin, name, record=file))
        client = connect(server, points=(), watch="markers")
        until(lambda: file.is_file() and file.stat().st_size > 70_000)
    drain(client)
    with file.open(newline="") as table:
        header, *rows = csv.reader(table)
    labels = [column.removesuffix(".pos.x").rpartition(":")[2] for column in header[1::3]]
    assert labels == list(capture.labels)
    for row in rows[:-1:20]:
        k = round(float(row[0]) * capture.rate)
        place = np.array(row[1:], dtype=float).reshape(-1, 3)
        np.testing.assert_allclose(place, capture.position[capture.index(k)], atol=1e-4)


def test_live_equals_a_causal_take() -> None:
    """The joints that a session gets, and the body, are those of a causal tracker on the stream's frames."""
    capture = captured(gloves=False)
    frames = received("qtm", capture, count=120, bodies=False)
    layout = learn_layout(raw_of(frames), MarkerFormat(), "stream")
    raw = raw_of(frames)
    columns = layout.columns_in(raw.names)
    whole = layout.observe(columns, raw.position, raw.rotation, raw.time)
    take = track(whole, causal=True)
    tracker = Tracker()
    state = tracker.start()
    for k in range(len(frames)):
        one = layout.observe(columns, raw.position[k : k + 1], None, raw.time[k : k + 1])
        live, state = tracker.step(one, state)
        np.testing.assert_allclose(live.points[0], take.estimate.points[k], atol=1e-6)


def test_a_rigid_body_without_markers_and_hidden_ones(server_of: Serving, connect: Connecting) -> None:
    """Rigid bodies alone are a person if they are named as joints."""
    capture = captured(gloves=False)
    with QtmTwin(capture) as twin:
        with twin._lock:
            twin.use = []
        twin.bodies = ("Hips", "Head")
        client = connect(server_of(settings_for(twin, "qtm")), points=(), watch="markers")
        until = time.monotonic() + 20
        pelvis = client.welcome["points"].index("pelvis")
        while client.pose().hidden[pelvis] >= 0.5:
            assert time.monotonic() < until


@pytest.mark.parametrize(
    "address", ["qtm", "qtm://", "http://host", "qtm://host:99999", "natnet://host/path", "vicon://host:0", ""]
)
def test_wrong_addresses_are_refused(address: str) -> None:
    with pytest.raises(BodysenseError, match="natnet://HOST"):
        parsed_address(address)


def test_usual_ports() -> None:
    assert parsed_address("natnet://10.0.0.2") == ("natnet", "10.0.0.2", 1510)
    assert parsed_address("qtm://lab.local") == ("qtm", "lab.local", 22223)
    assert parsed_address("vicon://lab:8010") == ("vicon", "lab", 8010)


class HandDriven(Twin):
    """A twin that sends a frame when it is asked to, instead of in real time."""

    def _play(self) -> None:
        """Send nothing."""


@pytest.mark.parametrize("name", LINKS)
def test_a_busy_machine_drops_frames_and_does_not_delay_them(
    server_of: Serving, connect: Connecting, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Five frames arrive during each step, and the next step has one of them: none waits for longer in a queue."""
    add, capture = LiveMarkers.add, captured(gloves=False)
    received, late, arrived, enough = [-1], list[int](), threading.Condition(), threading.Event()

    def receive(markers: LiveMarkers, frame: StreamFrame) -> str | None:
        with arrived:
            received.append(round(frame.time * capture.rate))
            arrived.notify()
        return add(markers, frame)

    def send(seconds: float) -> bool:
        """Send a frame, and return whether it arrives in time."""
        twin.frame += 1
        twin._send(twin.frame)
        with arrived:
            return arrived.wait_for(lambda: received[-1] == twin.frame, seconds)

    def step(jobs: Sequence[CompletionJob]) -> list[Any]:
        with stepping:
            late.append(received[-1] - round(jobs[0].frame.time * capture.rate))
            assert len(late) > 40 or all(send(20.0) for _ in range(5))
        if len(late) == 40:
            enough.set()
        return complete(jobs)

    monkeypatch.setattr(LiveMarkers, "add", receive)
    monkeypatch.setattr(scheduler, "complete", step)
    stepping = threading.Lock()
    with type("SteppedTwin", (HandDriven, TWINS[name]), {})(capture) as twin:
        client = connect(server_of(settings_for(twin, name)), points=(), watch="markers")
        while not late:  # until the layout is learned
            with stepping:
                _ = late or send(0.1)
        assert enough.wait(30)
        drain(client)
    assert max(late[2:]) <= 5  # more were sent before the first step


def test_frames_out_of_order_are_not_learned_from() -> None:
    """A late or doubled frame is left out of what the layout is learned from; a clock that was set begins anew."""
    live = LiveMarkers(MarkerFormat())

    def add(*times: float) -> list[float]:
        for time_ in times:
            assert live.add(StreamFrame(time_, ("LTHI", "RUPA"), np.full((2, 3), time_), "mm", "z")) is None
        return [frame.time for frame in live.window()]

    assert add(5.0, 5.01, 5.03, 5.02, 5.03, 5.04) == [5.0, 5.01, 5.03, 5.04]
    assert add(905.0, 905.01) == [905.0, 905.01]
    assert add(1.0, 1.01) == [1.0, 1.01]
