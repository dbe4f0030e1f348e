"""`bodysense bench import`: the time until the library is imported."""

from __future__ import annotations

import sys

import numpy as np

from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json


def import_time(runs: int = 9, json: Json = None) -> None:
    """Time `import bodysense`, alone and with the tracker, in new processes. PyTorch must not be imported.

    numpy_seconds is `import numpy` alone, which is part of the time with the tracker.

    Args:
        runs: number of processes; the median is printed.
    """
    import subprocess

    numpy = "import time; begun = time.perf_counter(); import numpy; print(time.perf_counter() - begun)"
    code = (
        "import time; begun = time.perf_counter(); import bodysense; alone = time.perf_counter() - begun; "
        "bodysense.Tracker; import sys; print(alone, time.perf_counter() - begun, int('torch' in sys.modules))"
    )
    rows = [
        [
            float(word)
            for word in subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout.split()
        ]
        for _ in range(runs)
    ]
    bare = [float(subprocess.run([sys.executable, "-c", numpy], capture_output=True, check=True).stdout) for _ in rows]
    alone, seconds = (float(np.median([row[k] for row in rows])) for k in (0, 1))
    numbers = {
        "package_seconds": alone,
        "seconds": seconds,
        "numpy_seconds": float(np.median(bare)),
        "torch_imported": max(row[2] for row in rows),
    }
    report("import", numbers, json)
