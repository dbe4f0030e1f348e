"""`bodysense data info` of the laboratory, also for prepared stores and with statistics of occlusion."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from bodysense.cli.data import print_info, print_skipped
from bodysense.cli.found_files import FoundFile, Split, files_in, readable_clips
from bodysense.cli.options import Reading
from bodysense.devices.simulated.headset_camera import HeadsetCamera
from bodysense.io.datasets.layouts import Layout
from bodysense.io.reading_options import AS_FOUND, ReadingOptions


def info(
    place: Annotated[Path, tyro.conf.Positional],
    occlusion: bool = False,
    split: Split = "all",
    layout: Layout | None = None,
    camera: HeadsetCamera = HeadsetCamera(),
    picture: Path | None = None,
    json: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Describe a motion file, a folder of them or a prepared store, and how each file was read.

    Files are listed with rig, unit, upward axis, floor, frame rate, missing joints and certainty. Unreadable files are
    skipped, counted and listed with the reason.

    Args:
        place: a motion file (.bvh, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma), markers (.c3d, .trc, .tsv, .csv), a
            recording, a folder of them, also .bvh in .zip, or a store written by `bodysense data prepare`.
        occlusion: simulate the headset's cameras and print the statistics of UNOC, Table 1, and the published ones.
        split: people to include.
        layout: published data set that the folder is; recognised by its files if omitted.
        camera: cameras of the headset, for --occlusion.
        picture: PNG file with bodies of a few frames of the first readable file.
        json: JSON file for the numbers, as one flat object.
        reading: properties that the files do not contain.
    """
    from rich.progress import track

    from bodysense.cli.show import wide_console, write_numbers
    from bodysense.files import check_picture

    if picture is not None:
        check_picture(picture)
    total, every = _clips_of(place, split, layout, reading)
    if not occlusion:
        print_info(place, split, total, every, picture, json)
        return
    from bodysense_lab.commands.reporting import print_report
    from bodysense_lab.data.datasets import gather_results
    from bodysense_lab.papers.unoc.score.occlusion import columns_of, count_clip, occlusion_table

    found = list[FoundFile]()
    clips = readable_clips(track(every, "looking", total), found)
    counted, _ = gather_results(partial(count_clip, camera=camera), clips, 1, lambda clip: None)
    report = occlusion_table(columns_of(counted))
    print_report(report, wide_console())
    write_numbers(json, report.numbers | {"skipped": print_skipped(place, total, found)})


def _clips_of(
    place: Path, split: Split, layout: Layout | None, reading: ReadingOptions
) -> tuple[int, Iterable[FoundFile]]:
    """Return the number of clips of a file, folder or store, and an iterable of them."""
    from bodysense.io.datasets.reasons import lines_by_kind
    from bodysense_lab.data.bodies import body_lines
    from bodysense_lab.data.clips import count_clips, open_clips
    from bodysense_lab.data.store import is_store, read_store

    if not is_store(place):
        return files_in(place, split, layout, reading)
    table = read_store(place).table
    lines = lines_by_kind((row.source, row.reason) for row in table.skipped)
    clips = open_clips(place, split, layout=layout, options=reading)
    print(f"{place}: prepared at {table.rate:g} Hz", *body_lines(table.bodies), *lines, sep="\n")
    found = (FoundFile(clip.name, clip, kind="store", rate=clip.frame_rate) for clip in clips)
    return count_clips(place, split), found
