"""Write every table of measured figures in README, docs and model cards from the numbers that commands wrote.

    python scripts/write_figures.py FIGURES

FIGURES is a folder of what the commands of `figures/tables.toml` wrote; each file names the processor. A table whose
file is missing stays unchanged, and the command of the file is printed.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from figures.described import write_descriptions
from figures.rows import write_rows
from figures.tables import ROOT, read_commands, read_measured, read_templates, write_blocks


def main(folder: Path) -> None:
    """Replace the text of every block and the pictures whose figures are in `folder`, then the rows of the papers."""
    blocks, rows = read_templates()
    measured = read_measured(folder)
    missing = {name: command for name, command in read_commands().items() if "." not in name and name not in measured}
    for name, command in missing.items():
        print(f"{name}: {command}")
    write_blocks(blocks, measured)
    write_descriptions(measured)
    write_rows(rows)
    if (drawn := folder / "demo" / "demo.webp").is_file():
        shutil.copyfile(drawn, ROOT / "docs" / "figures" / "demo.webp")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
