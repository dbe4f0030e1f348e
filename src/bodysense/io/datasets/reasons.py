"""Reasons for which files were skipped, counted by kind."""

from __future__ import annotations

import re
from collections.abc import Iterable


def lines_by_kind(skipped: Iterable[tuple[str, str]]) -> list[str]:
    """Return a line for each kind of reason, the most frequent first, from (file, reason) pairs.

    A kind that one file has is given with its whole reason; of several, the first file stands for all. Reasons are of
    one kind if they agree but for names in quotation marks, numbers, and the file's own name before the first colon.
    """
    kinds: dict[str, list[tuple[str, str]]] = {}
    for file, reason in skipped:
        text = reason.partition(f"{file}: ")[2] or reason
        kinds.setdefault(re.sub(r"'[^']*'|[\d.]+", "…", text), []).append((file, text))
    ordered = sorted(kinds.values(), key=len, reverse=True)
    return [
        f"skipped {files[0][0]}: {files[0][1]}"
        if len(files) == 1
        else f"skipped {len(files)} files such as {files[0][0]}: {files[0][1]}"
        for files in ordered
    ]
