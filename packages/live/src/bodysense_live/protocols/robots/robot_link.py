"""The link to a program that drives a robot: publishes bodies, stops without a signal, and resumes slowly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError, missing_package
from bodysense.geometry.products import CONJUGATE, exp, log, multiply, world_rotation
from bodysense_live.protocols.robots.messages import PORT, RobotFormat, gmr_message, sonic_message
from bodysense_live.server.live import Live
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer

STOP_AFTER = 0.5  # s without a tracked point until nothing is published; a controller then holds its last pose
_LOSS = 0.1  # s without a tracked point after which the body comes back slowly
_TURN = 4.0  # rad/s: the fastest turn of a joint while a body resumes; above it robots of human size shake
_SPEED = 1.0  # m/s: the fastest root while a body resumes, a person's stroll


@dataclass(frozen=True)
class RobotSettings:
    """Address and format of a robot's stream."""

    format: RobotFormat = "gmr"
    host: str = "127.0.0.1"  # the address to publish at
    port: int = PORT


@dataclass(frozen=True)
class Followed:
    """A published body, and whether it is still on its way to the tracked one."""

    root_position: np.ndarray  # (3,) m
    rotation: np.ndarray  # (J, 4) wxyz, parent ← joint
    time: float  # s
    resumes: bool


def followed(pose: Pose, time: float, before: Followed | None, paused: bool) -> Followed:
    """Return the body to publish: the tracked one, or after a pause one that comes to it at a bounded speed.

    Root and joints do a common share of their way, so that limbs do not swing on their own.
    """
    root, rotation = np.asarray(pose.root_position), np.asarray(pose.rotation)
    if before is None or not (paused or before.resumes):
        return Followed(root, rotation, time, resumes=False)
    interval = min(time - before.time, 0.1)  # s; a pause itself is no time to move in
    change, way = log(multiply(rotation, before.rotation * CONJUGATE)), root - before.root_position
    turn, distance = float(np.linalg.norm(change, axis=-1).max()), float(np.linalg.norm(way))
    share = min(1.0, _TURN * interval / max(turn, 1e-9), _SPEED * interval / max(distance, 1e-9))
    turned = multiply(exp(share * change), before.rotation)
    return Followed(before.root_position + share * way, turned, time, resumes=share < 1)


class RobotLink:
    """A publisher of bodies by ZeroMQ (`links.Link`). Raises BodysenseError for an address that cannot be used."""

    def __init__(self, settings: RobotSettings, metrics: Metrics) -> None:
        try:
            import zmq
        except ImportError as error:
            raise missing_package(error) from None
        self._settings, self._metrics, self._again = settings, metrics, zmq.Again
        self._context = zmq.Context()
        self._socket: Any = self._context.socket(zmq.XPUB)  # reports whether anyone reads
        self._socket.setsockopt(zmq.SNDHWM, 2)  # a slow reader gets the newest frames
        self._socket.setsockopt(zmq.LINGER, 0)
        self._flags = zmq.NOBLOCK
        self._body: Followed | None = None
        self._tracked: float | None = None  # s, when a point was last tracked
        self._frame = 0
        self._is_read: bool | None = None  # None: not known before the first reader
        try:
            self._socket.bind(f"tcp://{settings.host}:{settings.port}")
        except zmq.ZMQError as error:
            self.close()
            raise BodysenseError(
                f"--robot {settings.format}: {settings.host}:{settings.port}: {error}; give another --robot-port, or "
                "an address of this machine with --robot-host"
            ) from None

    @property
    def address(self) -> str:
        """The address that subscribers connect to."""
        return self._socket.last_endpoint.decode()

    async def open(self, live: Live) -> None:
        """Do nothing: the socket is open."""

    def send_body(self, answer: Answer) -> None:
        """Publish a body, unless nothing has been tracked for `STOP_AFTER` seconds."""
        self._report_readers()
        now, last = answer.moment, self._tracked
        lost = 0.0 if last is None else now - last  # s
        if answer.is_tracked:
            self._tracked = now
        elif last is None or lost > STOP_AFTER:
            return
        self._body = followed(answer.pose, now, self._body, answer.is_tracked and lost > _LOSS)
        pose = Pose(answer.pose.skeleton, self._body.root_position, self._body.rotation)
        points = np.asarray(forward_kinematics(pose)[0])
        turns = world_rotation(pose.skeleton.parents, pose.skeleton.levels, self._body.rotation)
        if self._settings.format == "gmr":
            message = gmr_message(pose, points, turns, now)
        else:
            message = sonic_message(pose, points, turns, self._frame)
        self._frame += 1
        try:
            self._socket.send(message, self._flags)
        except self._again:  # a reader that is slower; the next body follows soon
            self._metrics.dropped("output")

    def _report_readers(self) -> None:
        """Print that a reader has come, or that the last one has gone; bodies are published in any case."""
        is_read = self._is_read
        while True:
            try:
                is_read = self._socket.recv(self._flags)[:1] == b"\x01"  # a first subscription, or none any more
            except self._again:
                break
        if is_read == self._is_read:
            return
        self._is_read = is_read
        if is_read:
            print(f"--robot {self._settings.format}: a program reads the bodies at {self.address}", flush=True)
        else:
            print(
                f"--robot {self._settings.format}: no program reads the bodies any more; they go on at {self.address}, "
                "and are read again when it connects",
                flush=True,
            )

    def close(self) -> None:
        """Stop publishing."""
        self._socket.close()
        self._context.term()
