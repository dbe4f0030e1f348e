"""`bodysense page`: the page as a folder of static files, a product alone."""

from __future__ import annotations

from pathlib import Path

LANDMARKERS = Path("~/.cache/bodysense/landmarkers")


def page(out: Path, webcam: Path | None = None) -> None:
    """Write the page as a folder for any static host; all of it runs in the browser (docs/page.md).

    Args:
        out: folder for its files; made where it is missing.
        webcam: folder with MediaPipe's files for the webcam (docs/page.md); where `scripts/build_landmarkers.py` puts
            them, if omitted.
    """
    from bodysense.errors import BodysenseError
    from bodysense_live.page_files import WEBCAM, WHEN_USED, write_page

    source = LANDMARKERS.expanduser() if webcam is None else webcam
    missing = [name for name in WEBCAM if not (source / name).is_file()]
    if webcam is not None and missing:
        raise BodysenseError(f"--webcam {webcam}: no {missing[0]} in it; write it with scripts/build_landmarkers.py")
    written = write_page(out, source)
    megabytes = sum(size for name, size in written if name not in WHEN_USED) / 1e6
    print(f"{out}: {len(written)} files; a visit downloads {megabytes:.1f} MB")
    if missing:
        print(f"without the webcam: {missing[0]} is not in {source}; scripts/build_landmarkers.py puts it there")
    print(f"see it: python -m http.server --directory {out} 8000, then http://localhost:8000")
