"""Wireshark's OSC dissector, an independent reader, finds in our packets what we wrote."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.io.clip import Clip
from bodysense.io.osc import Message, bundled, message_bytes, read_packet
from bodysense_lab.serving.decoders import capture
from bodysense_live import vmc, vrchat
from bodysense_live.marker_stream import ADDRESS
from bodysense_live.vmc import vmc_packets
from bodysense_live.vrchat import vrchat_packets


def dissected(tshark: str, folder: Path, packets: list[bytes], port: int) -> list[dict[str, list[str]]]:
    """The OSC fields of each packet, in order."""
    path = folder / "sent.pcap"
    path.write_bytes(capture([(packet, port) for packet in packets]))
    fields = (
        "osc.message.header.path",
        "osc.message.string",
        "osc.message.float",
        "osc.message.double",
        "_ws.malformed",
    )
    wanted = [word for field in fields for word in ("-e", field)]
    command = [tshark, "-n", "-r", str(path), "--enable-heuristic", "osc_udp", "-T", "json", *wanted]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    layers = [packet["_source"]["layers"] for packet in json.loads(ran.stdout)]
    return [{field: layer.get(field, []) for field in fields} for layer in layers]


@pytest.mark.slow
def test_wireshark_reads_what_we_send(waving_clip: Clip, tmp_path: Path) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("no tshark on this machine: apt-get install tshark")
    pose = waving_clip.pose[40]
    markers = bundled([message_bytes(ADDRESS, "dsfff", 12.25, "left_glove_palm", 0.1, 1.2, -0.3)])
    for packets, port in ((vmc_packets(pose, 3.5), vmc.PORT), (vrchat_packets(pose), vrchat.PORT), (markers, 9123)):
        found = dissected(tshark, tmp_path, packets, port)
        assert len(found) == len(packets)
        for packet, fields in zip(packets, found, strict=True):
            ours: Any = read_packet(packet)
            assert not fields["_ws.malformed"]
            assert fields["osc.message.header.path"] == [message.address for message in ours]
            assert fields["osc.message.string"] == [x for x in arguments(ours) if isinstance(x, str)]
            numbers = np.array(fields["osc.message.double"] + fields["osc.message.float"], dtype=float)
            wanted = np.array([x for x in arguments(ours) if isinstance(x, float)])
            np.testing.assert_allclose(numbers, wanted, rtol=1e-5)  # it prints six digits


def arguments(messages: tuple[Message, ...]) -> list[Any]:
    return [argument for message in messages for argument in message.arguments]
