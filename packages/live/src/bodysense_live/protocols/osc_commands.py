"""Commands in OSC packets: calibrate and recentre."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from bodysense.io.formats.osc import read_packet
from bodysense_live.server.messages import Calibrate, Recentre

COMMANDS: Mapping[str, Calibrate | Recentre] = MappingProxyType(
    {
        "/bodysense/calibrate": Calibrate(),
        "/bodysense/calibrate/arms": Calibrate(arms_out=True),
        "/bodysense/recentre": Recentre(),
    }
)


def commands_of(packet: bytes, commands: Mapping[str, Calibrate | Recentre] = COMMANDS) -> list[Calibrate | Recentre]:
    """Return the commands in a packet, by their addresses. A packet without one is not decoded."""
    if not any(address.encode() in packet for address in commands):
        return []
    messages = read_packet(packet)
    return [] if isinstance(messages, str) else [commands[one.address] for one in messages if one.address in commands]
