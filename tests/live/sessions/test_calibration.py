"""Calibration of strapped trackers, by VMC and by the command."""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.formats.osc import bundled, message_bytes
from bodysense.io.formats.unity import unity_position, unity_rotation
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.server.messages import Calibrate, Recentre
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.worn_trackers import read_trackers

from ..conftest import Serving, free_port
from .test_worn_trackers import STRAPPED

SKELETON = default_skeleton()


def devices(anonymous: bool) -> list[bytes]:
    """Return VMC packets with headset and trackers of a standing wearer with the default body."""
    position, rotation = forward_kinematics(standing_pose(SKELETON))
    floor = np.asarray(position)[:, 1].min()
    head = np.asarray(position)[SKELETON.index("head")] - [0, floor, 0] + [0.0, 0.07, 0.08]
    rows = [message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "HMD", *unity_position(head).tolist(), 0.0, 0.0, 0.0, 1.0)]
    for k, (joint, (place, turn)) in enumerate(STRAPPED.items()):
        j = SKELETON.index(joint)
        carrier = RigidTransform(np.asarray(position)[j] - [0, floor, 0], np.asarray(rotation)[j])
        tracker_pose = carrier @ RigidTransform(np.array(place), quaternion_exp(np.array(turn)))
        values = *unity_position(tracker_pose.translation).tolist(), *unity_rotation(tracker_pose.rotation).tolist()
        serial = f"LHR-{k}" if anonymous else joint.replace("ankle", "foot")
        rows.append(message_bytes("/VMC/Ext/Tra/Pos", "sfffffff", serial, *values))
    return rows


@pytest.mark.slow
def test_calibration_assigns_unassigned_trackers_and_saves_the_wearer(server_of: Serving, tmp_path: Path) -> None:
    """Trackers are assigned by their positions while the wearer stands."""
    port, kept = free_port(), tmp_path / "me.json"
    server_of(ServerSettings(vmc_in=port, save_person=kept))
    (packet,) = bundled(devices(anonymous=True))
    until, requests = time.monotonic() + 20, False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while not kept.is_file() and time.monotonic() < until:
            sender.sendto(packet, ("127.0.0.1", port))
            if not requests:
                sender.sendto(message_bytes("/VMC/Ext/Set/Calib/Exec", "i", 0), ("127.0.0.1", port))
                requests = True
            time.sleep(0.02)
    person = Person.load(kept)
    assert set(person.mounts) == set(STRAPPED)
    assert read_trackers(kept) == {f"LHR-{k}": joint for k, joint in enumerate(STRAPPED)}
    for joint, (place, _) in STRAPPED.items():
        off = np.linalg.norm(person.mounts[joint].translation - place)
        assert off < 0.04  # mostly the error of the height, which is inferred from the head


def test_the_calibrate_command(server_of: Serving, capsys: pytest.CaptureFixture[str]) -> None:
    from bodysense_live.commands.calibrate import calibrate

    port, over = free_port(), threading.Event()
    server = server_of(ServerSettings(vmc_in=port))
    (packet,) = bundled(devices(anonymous=False))

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not over.wait(0.02):
                sender.sendto(packet, ("127.0.0.1", port))

    wearer = threading.Thread(target=send)
    wearer.start()
    try:
        calibrate(f"{server.http}/", wait=0.01)
    finally:
        over.set()
        wearer.join()
    assert "m tall" in capsys.readouterr().out


def test_commands_in_packets() -> None:
    reader = VmcTrackers()
    requests = [message_bytes("/VMC/Ext/Set/Calib/Exec", "i", 0), message_bytes("/bodysense/recentre", "")]
    assert [reader.commands(one) for one in requests] == [[Calibrate()], [Recentre()]]
    assert reader.commands(b"Calib") == [] and reader.commands(devices(False)[0]) == []
