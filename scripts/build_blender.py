"""Write the Blender extension as a .zip, which Blender installs from disk::

    python scripts/build_blender.py [--out bodysense-blender.zip]

Its files are `extras/blender` and the licence.
"""

from __future__ import annotations

import argparse
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "extras" / "blender"


def build(out: Path) -> list[str]:
    """Write the extension; return the names of its files."""
    files = [*sorted(FOLDER.glob("*.py")), FOLDER / "blender_manifest.toml", ROOT / "LICENSE"]
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(file, file.name)
    return [file.name for file in files]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the Blender extension as a .zip.")
    parser.add_argument("--out", type=Path, default=Path("bodysense-blender.zip"), help="the .zip")
    out = parser.parse_args().out
    print(f"wrote {out}: {len(build(out))} files")
