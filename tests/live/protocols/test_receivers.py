"""Our VMC packets, replayed into small models of how three receivers use them.

From the code of EVMC4U (Unity), VRM4U (Unreal) and Godot XR VMC Tracker. A pose is late if a receiver still shows
the one before after all packets of a frame, and torn if bones of two frames are shown together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.io.formats.osc import DATAGRAM, Argument, Message, bundled, message_bytes, read_packet
from bodysense_live.protocols.vmc import vmc_packets

Bones = dict[str, tuple[Argument, ...]]
FRAMES = 20


@dataclass
class Receiver:
    """A receiver: the bones received so far, and those that an avatar displays."""

    came: Bones = field(default_factory=dict)
    drawn: list[Bones] = field(default_factory=list)  # drawn bodies, one per datagram if the receiver draws then

    def take(self, packet: bytes) -> None:
        """Read a datagram."""
        messages = read_packet(packet)
        assert not isinstance(messages, str)
        for message in messages:
            if message.address == "/VMC/Ext/Bone/Pos":
                self.came[str(message.arguments[0])] = message.arguments[1:]
            self.after(message)
        self.after_datagram()

    def after(self, message: Message) -> None:
        """Handle a message."""

    def after_datagram(self) -> None:
        """Handle the end of a datagram."""


class Unity(Receiver):
    """EVMC4U: bones apply at once; the avatar may be drawn between any two datagrams."""

    def after_datagram(self) -> None:
        self.drawn.append(dict(self.came))


class Unreal(Receiver):
    """VRM4U: the bones present when OK arrives (later versions: T, Blend/Apply) are drawn."""

    latches = ("/VMC/Ext/OK",)

    def after(self, message: Message) -> None:
        if message.address in self.latches:
            self.drawn.append(dict(self.came))


class UnrealByTime(Unreal):
    latches = ("/VMC/Ext/T",)


class UnrealByAny(Unreal):
    latches = ("/VMC/Ext/OK", "/VMC/Ext/T", "/VMC/Ext/Blend/Apply")


class Godot(Unity):
    """Godot XR VMC Tracker: the whole body is computed anew after each datagram with a bone in it."""


RECEIVERS: tuple[Callable[[], Receiver], ...] = (Unity, Unreal, UnrealByTime, UnrealByAny, Godot)


def poses() -> Iterator[Pose]:
    """Yield bodies in which every joint has a new rotation in every frame."""
    skeleton = default_skeleton()
    for k in range(FRAMES):
        half = 0.01 * (k + 1)
        rotation = np.tile([np.cos(half), np.sin(half), 0.0, 0.0], (len(skeleton.joints), 1))
        yield Pose(skeleton, np.array([0.0, 1.0, 0.1 * k]), rotation)


def faults(receiver: Receiver, frames: Sequence[Sequence[bytes]]) -> tuple[int, int]:
    """Return the numbers of late frames and of torn bodies."""
    bodies: list[Bones] = []
    late = 0
    for packets in frames:
        whole = Receiver()
        for packet in packets:
            whole.take(packet)
            receiver.take(packet)
        bodies.append(whole.came)
        late += not receiver.drawn or receiver.drawn[-1] != whole.came
    return late, sum(body not in bodies for body in receiver.drawn)


@pytest.mark.parametrize("receiver", RECEIVERS)
def test_no_pose_is_late_or_torn(receiver: Callable[[], Receiver]) -> None:
    assert faults(receiver(), [vmc_packets(pose, k / 72) for k, pose in enumerate(poses())]) == (0, 0)


def split(packet: bytes, first: tuple[str, ...]) -> list[bytes]:
    """Split the packet of a frame into several datagrams, with the messages of `first` first."""
    messages = read_packet(packet)
    assert not isinstance(messages, str)
    rows = sorted(messages, key=lambda message: message.address not in first)
    tags = {int: "i", float: "f", str: "s"}
    return bundled(
        [message_bytes(row.address, "".join(tags[type(x)] for x in row.arguments), *row.arguments) for row in rows],
        DATAGRAM,
    )


def test_the_models_detect_wrong_order_and_split_packets() -> None:
    """OK and T ahead of the bones, in datagrams of 1400 bytes: Unreal is a frame late, Unity and Godot are torn."""
    frames = [
        split(packets[0], ("/VMC/Ext/OK", "/VMC/Ext/T")) for packets in map(lambda p: vmc_packets(p, 0.0), poses())
    ]
    assert len(frames[0]) > 1
    assert faults(Unreal(), frames) == (FRAMES, 1)  # the first OK arrives before any bone
    for drawn in (Unity(), Godot()):
        late, torn = faults(drawn, frames)
        assert late == 0 and torn > FRAMES
