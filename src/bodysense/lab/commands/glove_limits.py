"""`bodysense evaluate gloves-limits`: what the paper's gloves cannot do, with and without what is done about it."""

from __future__ import annotations

from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.lab.commands.reporting import Common, checked, finish, progress_over
from bodysense.lab.options import Flat


def gloves_limits(
    data: str | None = None,
    cameras: int = 12,
    seed: int = 1,
    markers: Path | None = None,
    joints: Path | None = None,
    variants: Path | None = None,
    common: Flat[Common] = Common(),
) -> None:
    """Two hands, section 7: hands in each other, pinches, wrong markers, markers without names, jumps.

    Two hands are watched by a ring of cameras and completed with and without the contact step; wrong samples are
    believed or rejected; markers that have lost their names are named again.

    Args:
        data: A folder of motion files with fingers or a prepared store; NAME=FOLDER names it. Synthesised motion of two
            hands is scored in any case.
        cameras: In the ring; two must see a marker.
        seed: random seed of the synthesised motion.
        markers: A network for hidden markers, written by `bodysense train gloves`; the packaged one if omitted.
        joints: One for angles, likewise.
        variants: A folder with networks that `bodysense train gloves --network two-hands` and `--network recurrent`
            wrote, to compare with the one for hidden markers.
        common: Common options.
    """
    from rich.console import Console
    from rich.progress import Progress

    from bodysense.devices.simulated.camera_ring import CameraRing
    from bodysense.lab.datasets import Census, named_data
    from bodysense.lab.scoring import group_of
    from bodysense.lab.two_hands.limits import (
        SYNTHESISED_PIECES,
        SYNTHESISED_SECONDS,
        Findings,
        Networks,
        compare_variants,
        measure_clips,
        measure_synthesised,
        pair_of_clip,
        synthesised_pair,
    )
    from bodysense.lab.two_hands.limits_report import SYNTHESISED, limits_report

    jobs, ring, networks = checked(common), CameraRing(count=cameras), Networks(markers, joints)
    found: dict[str, Findings] = {}
    chosen, census = None, Census()
    if data is not None:
        chosen = named_data(data, common.split, common.quick)
        with progress_over([chosen]) as advance:
            found, census = measure_clips(chosen.clips(), networks, ring, jobs, advance)
        if not found:
            raise BodysenseError(f"{data}: no clip has fingers; give motion with fingers, or leave --data out")
    seeds = [(seed, piece) for piece in range(1 if common.quick else SYNTHESISED_PIECES)]
    with Progress() as progress:
        bar = progress.add_task("synthesised hands", total=len(seeds))
        found[SYNTHESISED] = measure_synthesised(seeds, networks, ring, jobs, lambda: progress.update(bar, advance=1))
    if variants is not None:
        Console().print("comparing networks for hidden markers")
        compare_variants(found[SYNTHESISED], map(synthesised_pair, seeds), variants, networks, ring)
        if chosen is not None and "main" in found:
            main = (pair_of_clip(clip) for clip in chosen.clips() if clip.has_fingers and group_of(clip) == "main")
            compare_variants(found["main"], main, variants, networks, ring)
    finish(limits_report(found, ring, chosen, census, len(seeds) * SYNTHESISED_SECONDS), common)
