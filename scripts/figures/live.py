"""Table of docs/serve.md: number of wearers that a server sustains."""

from __future__ import annotations

from .blocks import Block, Numbers, markdown

RUNS = ((1, 8), (2, 8), (2, 16), (2, 24), (2, 40))  # processes and sessions
HEADER = ("sessions", "Hz", "processes", "in the server p50, p99, ms", "round trip p50, p99, ms", "answered", "MB each")


def live(*runs: Numbers | None) -> str:
    """Return the latency of runs."""
    found = [row for row in runs if row is not None]
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
        for row in found
    ]
    parts = [markdown(HEADER, rows), "Two cores that server and clients share."]
    most = [row for row in found if "most_sessions" in row]
    if most:
        parts.append(
            f"A core bears {most[-1]['most_sessions']:.0f} wearers at {most[-1]['rate_hz']:.0f} Hz: one process answers"
            " 99 % of their frames (`bench live --most`)."
        )
    return "\n\n".join(parts)


_FILES = tuple(f"live-{workers}x{sessions}" for workers, sessions in RUNS)
BLOCKS = (Block("docs/serve.md", "live", live, _FILES),)
