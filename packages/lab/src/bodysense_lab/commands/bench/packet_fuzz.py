"""`bodysense bench packet-fuzz`: hostile packets for every reader of packets."""

from __future__ import annotations

import time

from bodysense.ranges import Count, Seed
from bodysense_lab.core.options import Json


def packet_fuzz(packets: Count = 1_000_000, seed: Seed = 1, json: Json = None) -> None:
    """Read hostile packets of every UDP and socket protocol (VMC, VMT, VRChat, SlimeVR, SolarXR); fails on errors.

    Args:
        packets: number of packets.
        seed: random seed of the packets.
    """
    import numpy as np

    from bodysense.cli.show import write_numbers
    from bodysense_lab.serving.hostile_packets import fuzz_packets

    begun = time.perf_counter()
    found = fuzz_packets(packets, np.random.default_rng(seed))
    seconds = time.perf_counter() - begun
    parts = ", ".join(f"{name} {count}" for name, count in found.items())
    print(f"{packets} packets in {seconds:.0f} s, no failure: {parts}")
    numbers: dict[str, float] = {"packets": packets, "seed": seed, "seconds": round(seconds, 1)}
    write_numbers(json, numbers | found)
