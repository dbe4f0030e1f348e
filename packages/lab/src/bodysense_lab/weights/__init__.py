"""The networks that only the laboratory uses, one self-describing .onnx file each."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def packaged(name: str) -> Path:
    """Return the path of a packaged network."""
    return Path(str(files("bodysense_lab.weights").joinpath(name)))
