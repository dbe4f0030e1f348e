"""A live server in its own process, for benchmarks."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from bodysense.errors import BodysenseError


@contextmanager
def running_server(*options: str, **environment: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run `bodysense serve` with options while the block runs; yields its address and process.

    Raises BodysenseError if the server does not start.
    """
    command = (sys.executable, "-m", "bodysense", "serve", "--port", "0", *options)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | environment) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            address = re.search(r"http://\S+", line)
            if address is None:
                raise BodysenseError(f"the server did not start: {line.strip() or 'see its output above'}")
            yield address.group(), process
        finally:
            process.terminate()
