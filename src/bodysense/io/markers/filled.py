"""Marker files with filled gaps: a copy of the file in which only filled cells change."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text, written_beside
from bodysense.io.markers.formats.c3d import filled_c3d
from bodysense.io.markers.formats.text import MISSING, OTHER_ENCODING
from bodysense.io.markers.raw_markers import Cells, RawMarkers

_SAMPLE = 50  # cells of a marker from which the number of digits is inferred
_USUAL_DIGITS = 5  # decimals in a file without any number
_NUMBER = re.compile(r"[-+]?\d*(?P<point>[.,]?)(?P<digits>\d*)(?P<exponent>[eE].*)?")


def check_fillable(path: Path, out: Path, raw: RawMarkers) -> None:
    """Raise BodysenseError if a marker file cannot be copied to `out`."""
    if out.suffix.lower() != path.suffix.lower():
        raise BodysenseError(
            f"{out}: markers with filled gaps are the same kind of file as {path.name}; give a name that ends in "
            f"{path.suffix.lower()}, or for the body's motion in .bvh"
        )
    if path.suffix.lower() != ".c3d" and raw.cells is None:
        raise BodysenseError(f"{path}: its points are rigid bodies or segments; gaps are filled of markers alone")


def fillable(raw: RawMarkers) -> np.ndarray:
    """Return (M,) bool: the points of a file that are markers with writable cells."""
    if raw.cells is None:
        return np.ones(len(raw.names), dtype=bool)
    return np.asarray((raw.cells.columns >= 0).all(axis=1))


def write_filled(path: Path, out: Path, raw: RawMarkers, position: np.ndarray, filled: np.ndarray) -> None:
    """Write a copy of a marker file with filled gaps.

    Args:
        path: the file that was read.
        out: the output; it appears whole or not at all.
        raw: the content of `path`.
        position: (T, M, 3) of all its points in the file's unit and axes.
        filled: (T, M) bool: which of them are written.
    """
    check_fillable(path, out, raw)
    if raw.cells is None:
        data = filled_c3d(path, position, filled)
    else:
        data = _filled_text(path, raw.cells, position, filled)
    with written_beside(out) as beside:
        beside.write_bytes(data)


def _filled_text(path: Path, cells: Cells, position: np.ndarray, filled: np.ndarray) -> bytes:
    """Return the bytes of a text file with other numbers."""
    mark = b"\xef\xbb\xbf" if path.read_bytes()[:3] == b"\xef\xbb\xbf" else b""
    text = read_text(path, OTHER_ENCODING)
    encoding = "utf-8" if mark + text.encode() == path.read_bytes() else OTHER_ENCODING
    lines = text.splitlines(keepends=True)
    if [line.rstrip("\r\n") for line in lines] != [line.rstrip("\r\n") for line in text.splitlines()]:
        raise BodysenseError(f"{path}: its lines end in an odd way; export it again")
    split = [_split(lines[number - 1], cells.delimiter) for number in cells.lines]
    for marker in np.flatnonzero(filled.any(axis=0)).tolist():
        columns, flag = cells.columns[marker].tolist(), cells.valid.get(marker)
        known = [row for row, was_filled in zip(split, filled[:, marker].tolist(), strict=True) if not was_filled]
        digits, point = _form(known, columns)
        for t in np.flatnonzero(filled[:, marker]).tolist():
            row = split[t]
            row += [""] * (max(*columns, flag or 0) + 1 - len(row))
            for column, value in zip(columns, position[t, marker].tolist(), strict=True):
                row[column] = _replaced(row[column], f"{value:.{digits}f}".replace(".", point), cells.delimiter)
            if flag is not None:
                row[flag] = _replaced(row[flag], "1", cells.delimiter)
    for t in np.flatnonzero(filled.any(axis=1)).tolist():
        line = lines[cells.lines[t] - 1]
        lines[cells.lines[t] - 1] = cells.delimiter.join(split[t]) + line[len(line.rstrip("\r\n")) :]
    return mark + "".join(lines).encode(encoding)


def _split(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line with their blanks and quotes; delimiters within quotes are text."""
    line = line.rstrip("\r\n")
    if '"' not in line:
        return line.split(delimiter)
    unquoted = re.sub(r'"[^"]*"', lambda match: match[0].replace(delimiter, "\0"), line)
    return [part.replace("\0", delimiter) for part in unquoted.split(delimiter)]


def _replaced(cell: str, number: str, delimiter: str) -> str:
    """Return a cell with a new number, in quotes if it holds the delimiter; blanks and quotes around it stay."""
    content, has_quotes = cell.strip().strip('"').strip(), '"' in cell
    if content and (has_quotes or delimiter not in number):
        return cell.replace(content, number, 1)
    return f'"{number}"' if has_quotes or delimiter in number else number


def _form(rows: list[list[str]], columns: list[int]) -> tuple[int, str]:
    """Return the usual number of decimals of a marker, and the decimal point."""
    found: Counter[tuple[int, str]] = Counter()
    for row in rows:
        for column in columns:
            text = row[column].strip().strip('"') if column < len(row) else ""
            match = _NUMBER.fullmatch(text) if text.lower() not in MISSING else None
            if match is not None and float(text.replace(",", ".") or 0) != 0:
                digits = _USUAL_DIGITS if match["exponent"] else len(match["digits"])
                found[digits, match["point"] or "."] += 1
        if found.total() >= _SAMPLE:
            break
    return found.most_common(1)[0][0] if found else (_USUAL_DIGITS, ".")
