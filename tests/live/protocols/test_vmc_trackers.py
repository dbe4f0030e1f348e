"""Devices by VMC: their points, and lost, doubled, reordered, late and malformed packets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder
from scipy.spatial.transform import Rotation

from bodysense.errors import BodysenseError
from bodysense.io.formats.osc import bundled, message_bytes
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.sessions.tracked_devices import POINTS, TrackedDevices, read_device_names

READER = VmcTrackers()
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
HEAD = ("Hmd", "HMD", (0.0, 1.6, 0.0), UPRIGHT)
Row = tuple[str, str, tuple[float, ...], tuple[float, ...]]


def packet(*rows: Row, clock: float | None = None, tail: str = "") -> bytes:
    """Return a bundle as senders build it, by python-osc, in Unity's axes."""
    bundle = OscBundleBuilder(IMMEDIATELY)
    messages = [] if clock is None else [("/VMC/Ext/T", [clock])]
    messages += [(f"/VMC/Ext/{kind}/Pos{tail}", [serial, *place, *turn]) for kind, serial, place, turn in rows]
    for address, values in messages:
        builder = OscMessageBuilder(address)
        for value in values:
            builder.add_arg(value)
        bundle.add_content(builder.build())
    return bundle.build().dgram


def seen(*rows: Row, reader: VmcTrackers = READER) -> Observation:
    state, reason = reader.take(packet(*rows), 0.0, reader.start())
    assert reason is None
    observation = reader.observation(0.0, state)
    assert observation is not None
    return check_observation(observation)


def points(observation: Observation) -> dict[str, np.ndarray]:
    names = (*POINTS, *observation.points[len(POINTS) :])
    return {name: observation.position[0, k] for k, name in enumerate(names) if observation.has_position[0, k]}


def test_devices_are_in_our_world() -> None:
    """Unity's left is −X, ours +X. A headset's −Z is its forward axis, along +Z in both worlds."""
    turn = Rotation.from_euler("y", 30, degrees=True)  # in Unity: to the wearer's right
    left, right = ("Con", "left", (-0.4, 1.0, 0.3), UPRIGHT), ("Con", "right", (0.4, 1.0, 0.3), UPRIGHT)
    found = seen(("Hmd", "HMD", (-0.1, 1.6, 0.2), tuple(turn.as_quat())), left, right)
    np.testing.assert_allclose(points(found)["headset"], [0.1, 1.6, 0.2], atol=1e-6)
    np.testing.assert_allclose(points(found)["left_controller"], [0.4, 1.0, 0.3], atol=1e-6)
    looking = Rotation.from_quat(found.rotation[0, 0][[1, 2, 3, 0]]).apply([0, 0, -1])
    np.testing.assert_allclose(looking, [-np.sin(np.pi / 6), 0, np.cos(np.pi / 6)], atol=1e-6)
    assert found.has_rotation[0].sum() == 3


def test_a_tracker_keeps_the_axes_of_its_mounting() -> None:
    turn = Rotation.from_euler("y", 30, degrees=True)  # in Unity: to the wearer's right
    found = seen(
        HEAD, ("Tra", "waist", (0.0, 1.0, 0.1), tuple(turn.as_quat())), ("Tra", "chest", (0, 1.3, 0), (0,) * 4)
    )
    pelvis, chest = found.points.index("pelvis_tracker"), found.points.index("spine3_tracker")
    ahead = Rotation.from_quat(found.rotation[0, pelvis][[1, 2, 3, 0]]).apply([0, 0, 1])
    np.testing.assert_allclose(ahead, [-np.sin(np.pi / 6), 0, np.cos(np.pi / 6)], atol=1e-6)
    assert found.has_position[0, chest] and not found.has_rotation[0, chest]


@pytest.mark.parametrize(
    ("kind", "serial", "point"),
    [
        ("Hmd", "anything", "headset"),
        ("Con", "OpenVR_LeftHand", "left_controller"),
        ("Con", "RIGHT", "right_controller"),
        ("Tra", "waist", "pelvis"),
        ("Tra", "Human Hips", "pelvis"),
        ("Tra", "chest-1", "spine3"),
        ("Tra", "human://LEFT_FOOT", "left_ankle"),
        ("Tra", "RightKnee", "right_knee"),
        ("Tra", "left elbow", "left_elbow"),
        ("Tra", "LHR-5A3C21FF", "tracker_1"),
        ("Tra", "foot", "tracker_1"),
        ("Con", "LHR-00000000", None),  # without a headset there is no side
    ],
)
def test_serials_name_points(kind: str, serial: str, point: str | None) -> None:
    state, _ = READER.take(packet((kind, serial, (0.0, 1.0, 0.0), UPRIGHT)), 0.0, READER.start())
    observation = READER.observation(0.0, state)
    assert (observation is None) if point is None else (observation is not None and set(points(observation)) == {point})


def test_unassigned_trackers_keep_their_names() -> None:
    state = READER.start()
    for k, serials in enumerate((["A"], ["B", "A"], ["C", "B"])):
        state, _ = READER.take(packet(*(("Tra", one, (0, 1, 0), UPRIGHT) for one in serials)), 0.01 * k, state)
    assert state.devices.unassigned == {"A": "tracker_1", "B": "tracker_2", "C": "tracker_3"}
    for k in range(20):
        state, _ = READER.take(packet(("Tra", f"more {k}", (0, 1, 0), UPRIGHT)), 0.1, state)
    assert len(state.devices.unassigned) == 8


def test_a_table_takes_precedence_over_serials_and_is_checked() -> None:
    table = VmcTrackers(TrackedDevices({"LHR-1": "left_ankle", "left": "right_controller"}))
    there: Row = ("Tra", "LHR-1", (0.1, 0.1, 0.0), UPRIGHT)
    assert set(points(seen(there, ("Con", "left", (0.0, 1.0, 0.0), UPRIGHT), reader=table))) == {
        "left_ankle",
        "right_controller",
    }
    with pytest.raises(BodysenseError, match=r"'tail'.*valid are headset, left_controller"):
        VmcTrackers(TrackedDevices({"LHR-1": "tail"}))


def test_a_table_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "devices.json"
    path.write_text('{"LHR-1": "pelvis"}')
    assert read_device_names(path) == {"LHR-1": "pelvis"}
    for text in ("[]", "no", '{"LHR-1": 2}', "[" * 100_000):
        path.write_text(text)
        with pytest.raises(BodysenseError, match="a table of devices is a JSON object, serial to one of headset"):
            read_device_names(path)
    path.write_text('{"LHR-1": "hip"}')
    with pytest.raises(BodysenseError, match="'hip' \\(for 'LHR-1'\\) is not a device"):
        TrackedDevices(read_device_names(path))
    with pytest.raises(BodysenseError, match="No such file"):
        read_device_names(tmp_path / "gone.json")


@pytest.mark.parametrize("yaw", [0.0, 90.0, 200.0])
def test_controllers_without_a_side_keep_their_hands(yaw: float) -> None:
    """They are assigned by their side of the headset when they appear, whatever its heading; hands may cross later."""
    turn = Rotation.from_euler("y", yaw, degrees=True)

    def place(x: float) -> tuple[float, ...]:
        return tuple(np.array([0.0, 1.0, 0.0]) + turn.apply([x, 0.0, 0.4]))

    head: Row = ("Hmd", "H", (0.0, 1.6, 0.0), tuple(turn.as_quat()))
    state = READER.start()
    for k, (a, b) in enumerate([(0.3, -0.3), (-0.2, 0.2)]):
        rows = (head, ("Con", "A", place(a), UPRIGHT), ("Con", "B", place(b), UPRIGHT))
        state, _ = READER.take(packet(*rows), 0.01 * k, state)
        assert state.devices.hands == {"A": "right_controller", "B": "left_controller"}  # Unity's +X is to the right
    state, _ = READER.take(packet(head, ("Con", "C", place(0.3), UPRIGHT)), 1.0, state)  # A's batteries were changed
    assert state.devices.hands == {"C": "right_controller"}


def test_a_controller_without_a_side_takes_the_free_hand() -> None:
    rows: tuple[Row, ...] = (HEAD, ("Con", "left", (-0.1, 1, 0), UPRIGHT), ("Con", "X", (-0.3, 1, 0), UPRIGHT))
    found = points(seen(*rows))
    np.testing.assert_allclose(found["right_controller"], [0.3, 1, 0], atol=1e-6)


def test_the_rooms_scale_takes_precedence_over_the_avatars() -> None:
    state, _ = READER.take(packet(HEAD, tail="/Local"), 0.0, READER.start())
    taller: Row = ("Hmd", "HMD", (0.0, 1.9, 0.0), UPRIGHT)
    state, _ = READER.take(packet(taller), 0.01, state)
    assert height(READER.observation(0.01, state)) == pytest.approx(1.6)
    state, _ = READER.take(packet(taller), 1.0, state)  # …/Local is no longer sent
    assert height(READER.observation(1.0, state)) == pytest.approx(1.9)


def height(observation: Observation | None) -> float:
    assert observation is not None
    return float(points(observation)["headset"][1])


def test_silence_hides_one_device_and_then_all() -> None:
    state, _ = READER.take(packet(HEAD, ("Con", "left", (0, 1, 0), UPRIGHT)), 0.0, READER.start())
    state, _ = READER.take(packet(HEAD), 0.2, state)
    both, head, none = (READER.observation(now, state) for now in (0.2, 0.3, 0.5))
    assert both is not None and head is not None and none is None
    assert set(points(both)) == {"headset", "left_controller"} and set(points(head)) == {"headset"}
    assert READER.observation(0.0, READER.start()) is None


def test_a_position_is_used_without_a_valid_rotation() -> None:
    found = seen(("Hmd", "H", (0.0, 1.6, 0.0), (0.0, 0.0, 0.0, 0.0)))
    assert set(points(found)) == {"headset"} and not found.has_rotation.any()


def test_a_sender_that_restarts_is_followed() -> None:
    state, reason = READER.take(packet(HEAD, clock=500.0), 0.0, READER.start())
    state, late = READER.take(packet(HEAD, clock=499.5), 0.01, state)
    state, restarted = READER.take(packet(HEAD, clock=0.1), 0.02, state)
    assert reason is None and late is not None and late.startswith("late: sent at 499.5 s") and restarted is None
    assert state.clock == pytest.approx(0.1)


@pytest.mark.parametrize(("loss", "doubled", "latest"), [(0.01, 0, 0), (0.05, 0.1, 0.03), (0.2, 0.3, 0.3)])
def test_a_bad_network_gives_sent_poses_in_order(loss: float, doubled: float, latest: float) -> None:
    """Packets are lost, doubled, and late by up to 0.3 s, so out of order. Every observed pose was sent, and is not
    older than the one before. At the end the newest received pose is observed."""
    random = np.random.default_rng(int(100 * loss))
    arrivals: list[tuple[float, int]] = []
    for k in range(300):
        for _ in range(1 + (random.random() < doubled)):
            if random.random() >= loss:
                arrivals.append((k / 90 + random.uniform(0, latest), k))
    arrivals.sort()
    state, newest, gaps = READER.start(), -1, []
    for now, k in arrivals:
        height = 1.0 + k / 1000
        state, reason = READER.take(packet(("Hmd", "H", (0, height, 0), UPRIGHT), clock=k / 90), now, state)
        assert (reason is not None) == (k < newest)
        gaps.append(k - newest)
        newest = max(newest, k)
        observation = READER.observation(now, state)
        assert observation is not None
        assert points(observation)["headset"][1] == pytest.approx(1.0 + newest / 1000, abs=1e-6)
    assert newest == max(k for _, k in arrivals)
    assert max(gaps) / 90 < READER.devices.longest_silence  # no gap is long enough to hide a device


def test_malformed_packets_have_a_reason_and_change_nothing() -> None:
    state, _ = READER.take(packet(HEAD), 0.0, READER.start())
    nonsense = {
        b"hello": "no address",
        message_bytes("/VMC/Ext/Hmd/Pos", "sff", "HMD", 0.0, 1.0): "is not a serial",
        message_bytes("/VMC/Ext/Hmd/Pos", "ifffffff", 1, *range(7)): "is not a serial",
        message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "HMD", 0, float("nan"), 0, 0, 0, 0, 1): "is not a serial",
        message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "HMD", 0, 1e30, 0, 0, 0, 0, 1): "farther than 1000 m",
        message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", 200 * "x", *range(7)): "is not a serial",
    }
    for packet_, expected in nonsense.items():
        after, reason = READER.take(packet_, 0.1, state)
        assert reason is not None and expected in reason
        assert after.devices.devices.keys() == state.devices.devices.keys() and after.devices.at == 0.0
        assert after.devices.devices["HMD"] is state.devices.devices["HMD"]
    for ignored in (message_bytes("/VMC/Ext/Blend/Val", "sf", "Joy", 1.0), message_bytes("/VMC/Ext/T", "s", "noon")):
        assert READER.take(ignored, 0.1, state)[1] is None


def test_the_number_of_devices_is_limited() -> None:
    state = READER.start()
    for k in range(100):
        state, _ = READER.take(packet(("Tra", f"T{k}", (0.0, 0.0, 0.0), UPRIGHT)), 0.001 * k, state)
        assert len(state.devices.devices) <= 32
    crowd = bundled([message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "HMD", *range(7))] * 129, 65_000)[0]
    assert READER.take(crowd, 0.2, state) == (state, "more than 128 devices in one packet")
    state, reason = READER.take(packet(HEAD), 1.0, state)  # silent devices are replaced
    assert reason is None and "HMD" in state.devices.devices
