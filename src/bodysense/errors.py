"""Errors that bodysense raises for invalid input, and install lines of missing packages."""

from __future__ import annotations

import difflib
from collections.abc import Collection
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


_FEW = 15  # names that a message lists; of more, only the nearest are of use


def unknown_name(name: str, names: Collection[str]) -> str:
    """Return the end of a message about an unknown name: the nearest valid names, and all of them if they are few.

    Capitals, blanks and punctuation do not count.
    """
    asked, listed = did_you_mean(name, names), f"valid are {', '.join(names)}"
    if not asked:
        return listed
    return f"{asked} V{listed[1:]}" if len(names) <= _FEW else asked


def did_you_mean(name: str, names: Collection[str]) -> str:
    """Return a question with the nearest valid names, or an empty text."""
    plain = {_plain(valid): valid for valid in reversed(tuple(names))}
    asked = _plain(name)
    near = [plain[one] for one in ([asked] if asked in plain else difflib.get_close_matches(asked, plain, 2, 0.8))]
    return f"did you mean {' or '.join(near)}?" if near else ""


def _plain(name: str) -> str:
    """Return a name's letters and digits in lower case, without a character's prefix such as 'mixamorig:'."""
    return "".join(letter for letter in name.rpartition(":")[2].lower() if letter.isalnum())


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
