"""`bodysense bench bvh`: reading a large BVH file."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json


def bvh(megabytes: int = 60, json: Json = None) -> None:
    """Time reading a large BVH file, compared with parsing its numbers by NumPy.

    Args:
        megabytes: size of the file, which is written to a temporary folder.
    """
    from dataclasses import replace
    from tempfile import TemporaryDirectory

    from bodysense.demo import packaged_performance
    from bodysense.io.formats.bvh import read_bvh, write_bvh

    clip = packaged_performance()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "large.bvh"
        write_bvh(path, clip)
        copies = max(1, round(megabytes * 1e6 / path.stat().st_size))
        write_bvh(path, replace(clip, pose=clip.pose[np.tile(np.arange(len(clip)), copies)]))
        size = path.stat().st_size / 1e6
        begun = time.perf_counter()
        read_bvh(path)
        read = time.perf_counter() - begun
        text = path.read_bytes()
        numbers = text[text.index(b"Frame Time") :].split(b"\n", 1)[1]
        begun = time.perf_counter()
        np.fromstring(numbers.decode("ascii"), sep=" ")
        bare = time.perf_counter() - begun
    report("bvh", {"mb_per_second": size / read, "bare_parse_mb_per_second": size / bare, "ratio": read / bare}, json)
