"""The program `bodysense-serve`: `bodysense serve` in one file, without Python."""

from __future__ import annotations

import multiprocessing
import sys

from bodysense.cli import main

if __name__ == "__main__":
    multiprocessing.freeze_support()
    sys.exit(main(["serve", *sys.argv[1:]]))
