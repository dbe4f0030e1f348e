"""The files of the page: those built from web/, and those of the library, each stored once.

A folder with these files can be served by any static host. `bodysense serve` serves the same files.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Iterator
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from bodysense.devices.video.landmarker_files import HAND_LANDMARKER, OFFICIAL, POSE_LANDMARKER
from bodysense.errors import BodysenseError
from bodysense.files import written_beside

ABOUT = "page.json"  # whether the page has a server, and the names of its files
# Files of the library by the names that the page requests. Those that end in .gz are packed.
LIBRARY_FILES = {
    "completion.safetensors.gz": ("bodysense.weights", "completion.safetensors"),
    "default_body.json.gz": ("bodysense.body", "default_body.json"),
    "avatar.vrm.gz": ("bodysense.body", "avatar.vrm.gz"),
    "performance.npz": ("bodysense.demo", "performance.npz"),
}
_VISION = "https://cdn.jsdelivr.net/npm/@mediapipe/tasks-vision@1.1.0/wasm"  # the version of web/package-lock.json
# Optional: MediaPipe's files for the webcam, with address and SHA-256.
WEBCAM = {
    POSE_LANDMARKER: OFFICIAL[POSE_LANDMARKER],
    HAND_LANDMARKER: OFFICIAL[HAND_LANDMARKER],
    "vision_wasm_module_internal.js": (
        f"{_VISION}/vision_wasm_module_internal.js",
        "70eff3956521b7de058d7173a4935c95e4a223c26ea624b9f5a936d3a043dcb0",
    ),
    "vision_wasm_module_internal.wasm": (
        f"{_VISION}/vision_wasm_module_internal.wasm",
        "ee03b14a878e6c3c053a1bfa62e166dc45244be54dc0bbe61c578f710b771f6a",
    ),
}
DRACO = ("DRACOLoader.js", "draco_decoder.wasm", "draco_wasm_wrapper.js")  # decoder of compressed glTF files
WHEN_USED = frozenset({*WEBCAM, *DRACO, "webcam.js", "camera_worker.js"})  # downloaded, and cached, only when used


def built() -> Path:
    """Return the folder of the built page. Raises BodysenseError if this copy was installed without it."""
    folder = Path(str(files("bodysense_live").joinpath("page")))
    if not (folder / "index.html").is_file():
        raise BodysenseError("this copy of bodysense has no page; build it with `npm ci && npm run build` in web/")
    return folder


@lru_cache(maxsize=len(LIBRARY_FILES))
def library_file(name: str) -> bytes:
    """Return the bytes of one of `LIBRARY_FILES`."""
    package, file = LIBRARY_FILES[name]
    content = files(package).joinpath(file).read_bytes()
    if name != f"{file}.gz":
        return content
    # Weights hardly repeat, so that looking for fewer repeats makes them 1 % smaller.
    packer = zlib.compressobj(9, zlib.DEFLATED, 31, 9, zlib.Z_FILTERED)  # 31: gzip's header, without a time
    return packer.compress(content) + packer.flush()


def library_routes() -> list[Any]:
    """Return Starlette's routes of `LIBRARY_FILES`."""
    from starlette.responses import Response
    from starlette.routing import Route

    def answer(request: Any) -> Response:  # runs in a thread, because compression takes a second
        return Response(library_file(request.url.path.rpartition("/")[2]), media_type="application/octet-stream")

    return [Route(f"/{name}", answer) for name in LIBRARY_FILES]


def page_files(webcam: Path | None = None) -> Iterator[tuple[str, bytes]]:
    """Yield names and bytes of all files of a page without a server, `page.json` last.

    Args:
        webcam: folder with the files of `WEBCAM`; without all of them the page has no webcam.
    """
    folder, digest, names = built(), hashlib.sha256(), []
    own = [(path.name, path.read_bytes()) for path in sorted(folder.iterdir()) if path.name != ABOUT]
    library = [(name, library_file(name)) for name in LIBRARY_FILES]
    has_webcam = webcam is not None and all((webcam / name).is_file() for name in WEBCAM)
    vision = [(name, (webcam / name).read_bytes()) for name in WEBCAM] if webcam is not None and has_webcam else []
    for name, content in (*own, *library, *vision):
        names.append(name)
        digest.update(name.encode() + content)
        yield name, content
    needed = [name for name in names if name not in WHEN_USED]
    about = {"server": False, "webcam": has_webcam, "version": digest.hexdigest()[:16], "files": needed}
    yield ABOUT, (json.dumps(about, indent=1) + "\n").encode()


def write_page(out: Path, webcam: Path | None = None) -> list[tuple[str, int]]:
    """Write all files into a folder. Return their names and sizes. Other files in the folder are unchanged."""
    check_out(out)
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, content in page_files(webcam):
        with written_beside(out / name) as beside:
            beside.write_bytes(content)
        written.append((name, len(content)))
    return written


def check_out(out: Path) -> None:
    """Raise BodysenseError if a path is a file, or a folder with another page."""
    if out.exists() and not out.is_dir():
        raise BodysenseError(f"--out {out}: it is a file; give a folder")
    if (out / "index.html").exists() and not (out / ABOUT).exists():
        raise BodysenseError(f"--out {out}: its index.html is another page's; give another folder, such as {out}/body")
