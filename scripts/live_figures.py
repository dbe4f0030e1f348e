"""Write the table of docs/serve.md from the numbers that the commands wrote.

    bodysense bench live --workers 2 --sessions N --json FIGURES/live-N.json        (for N of 8, 16, …)
    bodysense bench live --sessions 8 --most --json FIGURES/live-most.json
    bodysense bench live-soak --json FIGURES/live-soak.json
    bodysense bench live-fuzz --json FIGURES/live-fuzz.json
    python scripts/live_figures.py FIGURES

If a file is missing, its line is left out.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from readme_figures import markdown, put

from bodysense.cli.show import processor

PAGE = Path(__file__).parents[1] / "docs" / "serve.md"
HEADER = ("sessions", "Hz", "processes", "in the server p50, p99, ms", "round trip p50, p99, ms", "answered", "MB each")


def main(folder: Path) -> None:
    """Replace the text between the markers of `live`."""
    read = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("live-*.json")}
    runs = [numbers for numbers in read.values() if "p99_ms" in numbers]
    runs.sort(key=lambda row: (row["rate_hz"], row["workers"], row["sessions"]))
    rows = [
        [
            f"{row['sessions']:.0f}",
            f"{row['rate_hz']:.0f}",
            f"{row['workers']:.0f}",
            f"{row['p50_ms']:.1f}, {row['p99_ms']:.1f}",
            f"{row['round_trip_p50_ms']:.1f}, {row['round_trip_p99_ms']:.1f}",
            f"{row['answered']:.1%}",
            f"{row['rss_per_session_mb']:.1f}",
        ]
        for row in runs
    ]
    said = [markdown(HEADER, rows), f"{processor()}, two cores that server and clients share."]
    most = [row for row in runs if "most_sessions" in row]
    if most:
        said.append(
            f"A core bears {most[-1]['most_sessions']:.0f} wearers at {most[-1]['rate_hz']:.0f} Hz: one process answers"
            " 99 % of their frames (`bench live --most`)."
        )
    if "live-soak" in read:
        soak = read["live-soak"]
        said.append(
            f"`bench live-soak`: {soak['seconds'] / 60:.0f} minutes of {soak['sessions']:.0f} wearers at "
            f"{soak['rate']:.0f} Hz, {soak['loss']:.0%} of the frames lost: {soak['answered']:,} of {soak['sent']:,} "
            f"answered, {soak['breaks']} broken connections, {soak['not_finite']} poses that are no numbers, longest "
            f"silence {soak['longest_silence_s']:.1f} s, {soak['rss_mb_warm']:.0f} MB at the beginning and "
            f"{soak['rss_mb_last']:.0f} MB at the end."
        )
    if "live-fuzz" in read:
        fuzz = read["live-fuzz"]
        said.append(
            f"`bench live-fuzz`: {fuzz['frames']:,} messages of {fuzz['connections']:,} clients, {fuzz['refused']:,} "
            "refused, no failure."
        )
    PAGE.write_text(put(PAGE.read_text(encoding="utf-8"), "live", "\n\n".join(said)), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
