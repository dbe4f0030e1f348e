"""Errors that bodysense raises for invalid input, and install lines of missing packages."""

from __future__ import annotations

from reprlib import repr as brief

# Part of the repository to install, from a clone of it, for each optional package.
SOURCES = {
    "av": ".[video]",
    "cv2": ".[video]",
    "bodysense_conform": "packages/conform",
    "bodysense_lab": "packages/lab",
    "bodysense_live": "packages/live",
    "cryptography": "packages/live",
    "distributed": "packages/lab",
    "flatbuffers": "packages/live",
    "h11": "packages/live",
    "lightning": "packages/lab",
    "lightning_fabric": "packages/lab",
    "matplotlib": "packages/lab",
    "mcap": ".[mcap]",
    "mediapipe": ".[video]",
    "moderngl": "packages/lab[render]",
    "onnx": "packages/lab",
    "onnxruntime": ".[networks]",
    "onnxscript": "packages/lab",
    "prometheus_client": "packages/live",
    "redis": "packages/live[shared]",
    "scipy": "packages/lab",
    "segno": "packages/live",
    "starlette": "packages/live",
    "torch": "packages/lab",
    "uvicorn": "packages/live",
    "uvloop": "packages/live",
    "websockets": "packages/live",
    "zarr": "packages/lab",
    "zeroconf": "packages/live",
    "zmq": "packages/live[robots]",
}


class BodysenseError(Exception):
    """Error for input that cannot be used. The message names the value, valid values, and the fix."""


def missing_package(error: ImportError) -> BodysenseError:
    """Return the error for a missing package with its install line; raise `error` itself for an unknown package."""
    package = (error.name or "").split(".")[0]
    if package not in SOURCES:
        raise error
    return BodysenseError(f"this needs the package {package}; {how_to_install(SOURCES[package])}")


def how_to_install(source: str) -> str:
    """Return the install line of a part of the repository, for a clone of it."""
    quoted = f"'{source}'" if "[" in source else source
    return f"in a clone of the repository: pip install -c constraints.txt -e {quoted}"


def expect(value: object, kind: type | tuple[type, ...], where: str, fix: str) -> None:
    """Raise BodysenseError unless a value is of a class: `where` names the call, `fix` the call that is right."""
    if not isinstance(value, kind):
        raise BodysenseError(f"{where}: {brief(value)} is of type {type(value).__name__}; give {fix}")
