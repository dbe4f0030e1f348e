"""The one family of errors that bodysense raises on purpose."""

# Which extra of bodysense brings a package that is not always installed.
EXTRAS = {
    "av": "video",
    "cv2": "video",
    "cryptography": "serve",
    "distributed": "lab",
    "h11": "serve",
    "lightning": "lab",
    "lightning_fabric": "lab",
    "mediapipe": "video",
    "moderngl": "render",
    "onnx": "lab",
    "onnxscript": "lab",
    "prometheus_client": "serve",
    "scipy": "lab",
    "segno": "serve",
    "starlette": "serve",
    "torch": "lab",
    "uvicorn": "serve",
    "uvloop": "serve",
    "websockets": "serve",
    "zarr": "lab",
    "zeroconf": "serve",
}


class BodysenseError(Exception):
    """Something the user gave cannot be used. The text names the value, what would be valid, and the fix."""


def missing_package(error: ImportError) -> BodysenseError:
    """What to say where a package is not installed; raises the error itself where no extra brings that package."""
    package = (error.name or "").split(".")[0]
    if package not in EXTRAS:
        raise error
    extra = EXTRAS[package]
    return BodysenseError(
        f"this needs the package {package}: pip install 'bodysense[{extra}]', "
        f"or in a clone pip install -c constraints.txt '.[{extra}]'"
    )
