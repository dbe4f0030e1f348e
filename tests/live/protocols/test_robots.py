"""Bodies for robots: messages decoded by a twin of each reader, a stop without a signal, and a slow return."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bodysense as bs
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.products import world_rotation
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.formats.protocol import PoseFrame, SignalFrame
from bodysense_live.protocols.robots.messages import gmr_message, sonic_message
from bodysense_live.protocols.robots.robot_link import STOP_AFTER, RobotLink, RobotSettings, followed
from bodysense_live.protocols.webxr import Placement
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer

zmq = pytest.importorskip("zmq")
SKELETON = default_skeleton()
SHOWN = SKELETON.indices((*BODY, "left_middle1", "right_middle1"))


@cache
def performed() -> Pose:
    """Poses of the demo, 30 Hz."""
    return bs.demo.packaged_performance().pose[::25]


def turns_of(pose: Pose) -> np.ndarray:
    return world_rotation(pose.skeleton.parents, pose.skeleton.levels, np.asarray(pose.rotation))


def decoded(message: bytes) -> tuple[int, dict[str, np.ndarray]]:
    """Read a packed message as SONIC's receiver does."""
    assert message.startswith(b"pose")
    header = json.loads(message[4 : 4 + 1280].rstrip(b"\0"))
    assert header["endian"] == "le"
    fields, place = {}, 4 + 1280
    for field in header["fields"]:
        kind = np.dtype({"f32": "<f4", "i32": "<i4"}[field["dtype"]])
        size = int(np.prod(field["shape"])) * kind.itemsize
        fields[field["name"]] = np.frombuffer(message[place : place + size], kind).reshape(field["shape"])
        place += size
    assert place == len(message)
    return header["v"], fields


def test_the_dictionary_for_gmr_has_global_poses_with_z_up() -> None:
    """Against SciPy: a body that faces +Z in our world faces +X, stands along +Z, and has its left hand at +Y."""
    pose = rest_pose(SKELETON)
    read = json.loads(gmr_message(pose, np.asarray(forward_kinematics(pose)[0]), turns_of(pose), 2.5))
    joints = {name: np.array(place) for name, (place, _) in read["joints"].items()}
    assert read["time"] == 2.5 and tuple(joints) == BODY
    assert (
        joints["head"][2] > 1.4 and joints["left_wrist"][1] > 0.6 and joints["left_foot"][0] > joints["left_ankle"][0]
    )
    for k in range(len(performed().rotation)):
        pose = performed()[k]
        points, turns = np.asarray(forward_kinematics(pose)[0]), turns_of(pose)
        read = json.loads(gmr_message(pose, points, turns, 0.0))["joints"]
        axes = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # of robots ← ours
        for index, name in enumerate(BODY):
            np.testing.assert_allclose(read[name][0], axes.apply(points[index]), atol=2e-6)
            expected = axes * Rotation.from_quat(turns[index], scalar_first=True)
            given = Rotation.from_quat(read[name][1], scalar_first=True)
            assert (given * expected.inv()).magnitude() < 1e-5


def test_sonic_rebuilds_the_body_from_its_message() -> None:
    """The reader's kinematics of SMPL, in SciPy, places each joint where the message has it."""
    for k in range(len(performed().rotation)):
        pose = performed()[k]
        points = np.asarray(forward_kinematics(pose)[0])
        version, fields = decoded(sonic_message(pose, points, turns_of(pose), 7))
        assert version == 3 and fields["frame_index"].tolist() == [7]
        assert fields["joint_pos"].shape == fields["joint_vel"].shape == (1, 29) and not fields["joint_pos"].any()
        root = Rotation.from_quat(fields["body_quat"][0], scalar_first=True)
        world = root.apply(fields["smpl_joints"][0]) + points[0, [2, 0, 1]]
        np.testing.assert_allclose(world, points[SHOWN][:, [2, 0, 1]], atol=1e-5)
        offsets = np.array(pose.skeleton.rest_offset)
        local = Rotation.from_rotvec(fields["smpl_pose"][0])
        turned, place = [Rotation.identity()], [np.zeros(3)]
        for index in range(1, len(BODY)):  # parents come first
            parent = SKELETON.parents[index]
            turned.append(turned[parent] * local[index - 1])
            place.append(place[parent] + turned[parent].apply(offsets[index]))
        np.testing.assert_allclose(fields["smpl_joints"][0, : len(BODY)], np.array(place)[:, [2, 0, 1]], atol=1e-5)


def test_a_body_that_faces_forward_has_the_identity() -> None:
    pose = rest_pose(SKELETON)
    _, fields = decoded(sonic_message(pose, np.asarray(forward_kinematics(pose)[0]), turns_of(pose), 0))
    np.testing.assert_allclose(fields["body_quat"], [[1, 0, 0, 0]], atol=1e-6)
    assert not fields["smpl_pose"].any()


def answer(pose: Pose, moment: float, tracked: bool = True) -> Answer:
    has = np.full(1, 3 if tracked else 0, np.uint8)
    signal = SignalFrame(0, moment, np.zeros(1, np.uint8), has, np.zeros((1, 3)), np.zeros((1, 4)))
    root, rotation = np.asarray(pose.root_position), np.asarray(pose.rotation)
    points = len(pose.skeleton.points)
    frame = PoseFrame(0, moment, root, rotation, np.zeros(points), np.zeros(points), np.zeros(4))
    return Answer(signal, frame, pose, moment, moment, None, Placement())


@contextmanager
def subscribed(form: Any = "gmr") -> Iterator[tuple[RobotLink, Any]]:
    link = RobotLink(RobotSettings(form, port=0), Metrics())
    context = zmq.Context()
    reader = context.socket(zmq.SUB)
    reader.connect(link.address)
    reader.setsockopt(zmq.SUBSCRIBE, b"")
    reader.setsockopt(zmq.RCVTIMEO, 2000)
    try:
        for k in range(200):  # until the subscription has arrived
            link.send_body(answer(performed()[0], 0.001 * k))
            if reader.poll(20):
                break
        while reader.poll(50):
            reader.recv()
        yield link, reader
    finally:
        reader.close()
        context.term()
        link.close()


def test_a_subscriber_gets_bodies_and_nothing_after_half_a_second_without_a_signal() -> None:
    with subscribed() as (link, reader):
        link.send_body(answer(performed()[0], 10.0))
        assert json.loads(reader.recv())["time"] == 10.0
        link.send_body(answer(performed()[0], 10.0 + 0.9 * STOP_AFTER, tracked=False))
        assert json.loads(reader.recv())["time"] == pytest.approx(10.0 + 0.9 * STOP_AFTER)
        for moment in (10.6, 11.0, 15.0):
            link.send_body(answer(performed()[0], moment, tracked=False))
        assert not reader.poll(200)
        link.send_body(answer(performed()[0], 16.0))
        assert json.loads(reader.recv())["time"] == 16.0


def test_a_reader_that_goes_is_reported_and_reads_on_when_it_is_back(capsys: pytest.CaptureFixture[str]) -> None:
    with subscribed() as (link, reader):

        def until(said: str) -> str:
            for k in range(500):
                link.send_body(answer(performed()[0], 20.0 + 0.01 * k))
                lines.append(capsys.readouterr().out)
                if said in "".join(lines):
                    return "".join(lines)
                time.sleep(0.01)
            raise AssertionError("".join(lines))

        lines: list[str] = []
        assert until("a program reads the bodies").count("\n") == 1
        reader.close()
        lines.clear()
        assert until("no program reads the bodies any more").count("\n") == 1
        again = zmq.Context.instance().socket(zmq.SUB)
        again.connect(link.address)
        again.setsockopt(zmq.SUBSCRIBE, b"")
        lines.clear()
        assert until("a program reads the bodies at").count("\n") == 1
        link.send_body(answer(performed()[0], 30.0))
        assert again.poll(2000)
        again.close()


def test_a_body_returns_slowly_after_a_loss_and_arrives() -> None:
    """No joint turns faster than 4 rad/s, the root moves at a stroll, and within 3 s the body is the tracked one."""
    skeleton, rate = default_skeleton(), 60
    start, target = rest_pose(skeleton), rest_pose(skeleton)
    target.rotation[skeleton.index("left_shoulder")] = quaternion_exp(np.array([0, 0, -2.5]))
    target.rotation[0] = quaternion_multiply(quaternion_exp(np.array([0, 2.0, 0])), target.rotation[0])
    moved = replace(target, root_position=target.root_position + np.array([1.5, 0.0, 0.0]))
    body = followed(start, 0.0, None, paused=False)
    for k in range(3 * rate):
        before, body = body, followed(moved, 1.0 + k / rate, body, paused=k == 0)
        interval = min(body.time - before.time, 0.1)
        now, then = (Rotation.from_quat(one.rotation, scalar_first=True) for one in (body, before))
        turn = now * then.inv()
        assert turn.magnitude().max() <= 4 * interval + 1e-6
        assert np.linalg.norm(body.root_position - before.root_position) <= 1.0 * interval + 1e-9
    assert not body.resumes
    np.testing.assert_allclose(body.rotation, moved.rotation, atol=1e-9)
    after = followed(start, 9.0, body, paused=False)  # tracked without a loss: at once
    np.testing.assert_array_equal(after.rotation, start.rotation)


def test_an_address_in_use_names_the_option() -> None:
    with subscribed() as (link, _), pytest.raises(BodysenseError, match="give another --robot-port"):
        RobotLink(RobotSettings("sonic", port=int(link.address.rpartition(":")[2])), Metrics())
