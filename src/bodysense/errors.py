"""The one family of errors that bodysense raises on purpose."""

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
}


class BodysenseError(Exception):
    """Something the user gave cannot be used. The text names the value, what would be valid, and the fix."""


def missing_package(error: ImportError) -> BodysenseError:
    """Return the error for a package that is not installed; raise `error` itself if no part of ours installs it."""
    package = (error.name or "").split(".")[0]
    if package not in SOURCES:
        raise error
    return BodysenseError(f"this needs the package {package}; {how_to_install(SOURCES[package])}")


def how_to_install(source: str) -> str:
    """Return how to install a part of the repository from a clone of it."""
    quoted = f"'{source}'" if "[" in source else source
    return f"in a clone of the repository: pip install -c constraints.txt -e {quoted}"
