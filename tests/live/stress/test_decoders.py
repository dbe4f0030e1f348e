"""Packets of the server, read by independent decoders."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from bodysense.errors import BodysenseError

from . import decoders
from .decoders import decode


def test_python_osc_and_a_reader_of_solarxr_read_every_packet() -> None:
    *_, found = decode(200, np.random.default_rng(1), None)
    assert found.osc + found.solarxr == 200 and found.solarxr > 10 and found.osc_messages > 1000


@pytest.mark.slow
def test_wireshark_reads_every_packet() -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("no tshark on this machine: apt-get install tshark")
    *_, found = decode(12_000, np.random.default_rng(1), tshark)
    assert found.osc == found.wireshark > 9_000


def test_a_packet_that_is_decoded_differently_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoders, "_python_osc", lambda data: [])
    with pytest.raises(BodysenseError, match="python-osc reads it differently"):
        list(decode(5, np.random.default_rng(1), None))
