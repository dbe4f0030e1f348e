"""Networks that only the laboratory uses, each an .onnx file with its description as metadata."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def packaged(name: str) -> Path:
    """Return the path of a packaged network."""
    return Path(str(files("bodysense_lab.weights").joinpath(name)))
