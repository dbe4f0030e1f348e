"""The page's film, recorded from the real page: `python scripts/page_film.py [--out docs/figures/film.webp]`.

Needs node, `npm ci` in web/, Debian's Chromium and the built page.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

from bodysense.files import written_beside
from bodysense_live.server.page_files import write_page

ROOT = Path(__file__).parents[1]
OUTPUT = ROOT / "docs" / "figures" / "film.webp"
SECONDS, RATE = 12, 15  # s of the performance (walking, turning, waving, sitting down); Hz
SIZE = (840, 480)  # pixels
LARGEST = 1_500_000  # bytes
QUALITIES = (75, 60, 45, 30)  # of WebP, best first


def main() -> None:
    """Record the pictures and write the film."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUTPUT, help="file to write")
    parser.add_argument("--pictures", type=Path, help="folder to keep the pictures in; a temporary one if omitted")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        pictures = arguments.pictures or Path(folder) / "pictures"
        pictures.mkdir(parents=True, exist_ok=True)
        write_page(Path(folder) / "site")
        recorder = ["node", "scripts/record_page.mjs", str(Path(folder) / "site"), str(pictures)]
        subprocess.run([*recorder, str(SECONDS), str(RATE)], cwd=ROOT, check=True)
        frames = [Image.open(path).convert("RGB").resize(SIZE, 1) for path in sorted(pictures.glob("*.png"))]
    encode(frames, arguments.out)


def encode(frames: list[Image.Image], out: Path) -> None:
    """Write a film with the best quality that is small enough."""
    for quality in QUALITIES:
        with written_beside(out) as beside:
            options = {"save_all": True, "append_images": frames[1:], "loop": 0, "duration": round(1000 / RATE)}
            frames[0].save(beside, "WEBP", quality=quality, method=4, **options)
        size = out.stat().st_size
        if size <= LARGEST:
            print(f"{out}: {len(frames)} pictures, {size / 1e6:.2f} MB, quality {quality}")
            return
    raise SystemExit(f"{out}: more than {LARGEST} bytes at quality {QUALITIES[-1]}; shorten the film")


if __name__ == "__main__":
    main()
