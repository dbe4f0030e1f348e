"""`bodysense check` and `bodysense repair`: find the defects of a finished take, and repair them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from bodysense.cli.options import Output, Reading
from bodysense.cli.overwriting import check_apart
from bodysense.cli.show import wide_console
from bodysense.cli.summary import write_summary
from bodysense.files import check_picture, check_place
from bodysense.io.reading_options import AS_FOUND
from bodysense.quality.defects import UNITS, Defect, Kind, find_defects

if TYPE_CHECKING:
    from bodysense.io.clip import Clip

_LISTED = 40  # largest number of defects in the table
MotionFile = Annotated[Path, tyro.conf.Positional]
Kinds = tuple[Kind, ...]


def check(
    file: MotionFile,
    only: Kinds = (),
    picture: Path | None = None,
    json: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Find the defects of a finished take: which joint, in which frames, how large.

    Args:
        file: motion: .bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma.
        only: kinds of defects to look for; all if omitted.
        picture: PNG file for a timeline of the defects.
        json: JSON file for the defects.
        reading: facts that the file omits.
    """
    from bodysense.takes.repair import checked_motion

    _check_outputs(picture, json)
    opened = checked_motion(file, reading)
    for line in opened.remarks:
        print(line)
    defects = find_defects(opened.clip.pose, opened.clip.frame_rate, only)
    _print(defects, opened.clip)
    _draw(picture, defects, len(opened.clip))
    write_summary(json, [], _values(defects, opened.clip))


def repair(
    file: MotionFile,
    out: Output,
    only: Kinds = (),
    dry_run: bool = False,
    rig: str | None = None,
    picture: Path | None = None,
    json: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Repair the defects of a finished take; frames without defects are unchanged.

    Args:
        file: motion: .bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma.
        out: repaired motion: .bvh, .fbx, .glb, .vrma or .mcap; in the file's own rig if its ending is that of FILE.
        only: kinds of defects to repair; all if omitted.
        dry_run: print what would be repaired and write nothing.
        rig: target rig, as of `bodysense track`.
        picture: PNG file for a timeline of the defects.
        json: JSON file for the defects that were found and those that remain.
        reading: facts that the file omits.
    """
    from bodysense.io.motion_files import check_ending
    from bodysense.takes.repair import checked_motion
    from bodysense.takes.repair import repair as repaired

    check_ending(out)
    check_apart([out], file)
    _check_outputs(picture, json)
    opened = checked_motion(file, reading)
    for line in opened.remarks:
        print(line)
    if dry_run:
        defects: Sequence[Defect] = find_defects(opened.clip.pose, opened.clip.frame_rate, only)
        _print(defects, opened.clip)
        _draw(picture, defects, len(opened.clip))
        return
    done = repaired(opened, only=only, reading=reading)
    _print(done.defects, opened.clip)
    _draw(picture, done.defects, len(opened.clip))
    done.save(out, rig)
    print(f"wrote {out}: {len(done.defects)} defects found, {len(done.remaining)} after the repair")
    values = _values(done.defects, opened.clip) | {"remaining": [_row(defect) for defect in done.remaining]}
    write_summary(json, [out], values)


def _check_outputs(picture: Path | None, json: Path | None) -> None:
    """Raise BodysenseError, before any work, for outputs that cannot be written."""
    if picture is not None:
        check_picture(picture)
    if json is not None:
        check_place(json)


def _draw(picture: Path | None, defects: Sequence[Defect], frames: int) -> None:
    """Draw a timeline of the defects, if a path is given."""
    if picture is None:
        return
    from bodysense.pictures.timeline import draw_timeline

    draw_timeline(picture, defects, frames)
    print(f"wrote {picture}")


def _print(defects: Sequence[Defect], clip: Clip) -> None:
    """Print a table of defects."""
    if not defects:
        print(f"no defects in {len(clip)} frames")
        return
    from rich.table import Table

    table = Table(title=f"{len(defects)} defects in {len(clip)} frames")
    for column in ("defect", "joint", "frames", "seconds", "size"):
        table.add_column(column, justify="left" if column in ("defect", "joint") else "right")
    for defect in defects[:_LISTED]:
        span = f"{defect.first}-{defect.last}"
        begin = f"{defect.first / clip.frame_rate:.2f}"
        table.add_row(defect.kind, defect.joint, span, begin, f"{defect.size:.3g} {UNITS[defect.kind]}")
    wide_console().print(table)
    if len(defects) > _LISTED:
        print(f"and {len(defects) - _LISTED} more (--json has all)")


def _row(defect: Defect) -> dict[str, Any]:
    return {
        **{"kind": defect.kind, "joint": defect.joint, "first": defect.first, "last": defect.last},
        **{"size": round(defect.size, 3), "unit": UNITS[defect.kind]},
    }


def _values(defects: Sequence[Defect], clip: Clip) -> dict[str, Any]:
    """Return the values of the JSON object."""
    return {
        "frames": len(clip),
        "frame_rate": round(clip.frame_rate, 6),
        "defects": [_row(defect) for defect in defects],
    }
