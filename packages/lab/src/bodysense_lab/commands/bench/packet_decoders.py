"""`bodysense bench packet-decoders`: packets of the server read by independent decoders."""

from __future__ import annotations

import time
from dataclasses import asdict

from bodysense.ranges import Count, Seed
from bodysense_lab.core.options import Json


def packet_decoders(packets: Count = 1_000_000, seed: Seed = 1, json: Json = None) -> None:
    """Decode the server's packets (VMC, VRChat, VMT, SolarXR) with independent decoders; fails if values differ.

    Decoders are python-osc, Wireshark's tshark if installed, and a reader of SolarXR's public schema.

    Args:
        packets: number of packets.
        seed: random seed of the bodies.
    """
    import shutil

    import numpy as np
    from rich.progress import Progress

    from bodysense.cli.show import write_numbers
    from bodysense_lab.serving.decoders import Decoded, decode

    begun, found = time.perf_counter(), Decoded()
    with Progress() as progress:
        bar = progress.add_task("decoding", total=packets)
        for found in decode(packets, np.random.default_rng(seed), shutil.which("tshark")):
            progress.update(bar, completed=found.osc + found.solarxr)
    seconds = time.perf_counter() - begun
    wireshark = f"Wireshark {found.wireshark} of these" if found.wireshark else "tshark is not installed"
    print(
        f"{packets} packets in {seconds:.0f} s, all decoded correctly: python-osc {found.osc} with "
        f"{found.osc_messages} messages, {wireshark}, a reader of SolarXR {found.solarxr}"
    )
    write_numbers(json, {"packets": packets, "seed": seed, "seconds": round(seconds, 1)} | asdict(found))
