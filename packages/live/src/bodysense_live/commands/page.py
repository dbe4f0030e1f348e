"""`bodysense page`: the page as a folder of static files."""

from __future__ import annotations

from pathlib import Path

from bodysense.cli.options import Output


def page(out: Output, webcam: bool = False, landmarkers: Path | None = None) -> None:
    """Write the page as a folder for any static host; it runs in the browser alone (docs/page.md).

    Args:
        out: folder for its files; created if missing.
        webcam: include the webcam: MediaPipe's files (31 MB), from the cache or downloaded once.
        landmarkers: folder with these files, in place of the cache.
    """
    from bodysense.devices.video.landmarker_files import find_files
    from bodysense.errors import BodysenseError
    from bodysense_live.server.page_files import WEBCAM, WHEN_USED, check_out, write_page

    check_out(out)
    if landmarkers is not None and not webcam:
        raise BodysenseError(f"--landmarkers {landmarkers}: is for the webcam; give --webcam, too")
    written = write_page(out, find_files(landmarkers, WEBCAM) if webcam else None)
    megabytes = sum(size for name, size in written if name not in WHEN_USED) / 1e6
    print(f"{out}: {len(written)} files; a visit downloads {megabytes:.1f} MB")
    if not webcam:
        print("without the webcam; --webcam adds it")
    print(f"see it: python -m http.server --directory {out} 8000, then http://localhost:8000")
