"""`bodysense evaluate gloves-…`: gloves with hidden markers (two-hands)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense.lab.commands.reporting import Common, checked, finish, progress_over
from bodysense.lab.options import Flat

if TYPE_CHECKING:
    from collections.abc import Callable

    from bodysense.lab.datasets import DataSet


def gloves_occlusion(
    data: str | None = None, cameras: int = 12, seed: int = 1, common: Flat[Common] = Common()
) -> None:
    """Two hands, Figs 13 and 14: how many markers of a glove are hidden at once, and for how long.

    A ring of cameras looks at the hands; one hand, two hands, and what of the paper's statements holds.

    Args:
        data: A folder of motion files with fingers or a prepared store; NAME=FOLDER names it. Synthesised motion of two
            hands by default.
        cameras: In the ring; two must see a marker.
        seed: random seed of the synthesised motion.
        common: Common options.
    """
    from rich.progress import Progress

    from bodysense.devices.simulated.camera_ring import CameraRing
    from bodysense.lab.datasets import Census, named_data
    from bodysense.lab.two_hands.occlusion import (
        SYNTHESISED_PIECES,
        count_clips,
        count_synthesised,
        occlusion_report,
    )

    jobs, ring = checked(common), CameraRing(count=cameras)
    if data is not None:
        chosen = named_data(data, common.split, common.quick)
        with progress_over([chosen]) as advance:
            counted, census = count_clips(chosen.clips(), ring, jobs, advance)
        if not counted:
            raise BodysenseError(f"{data}: no clip has fingers; give motion with fingers, or leave --data out")
        finish(occlusion_report(counted, ring, chosen, census), common)
        return
    pieces = 1 if common.quick else SYNTHESISED_PIECES
    with Progress() as progress:
        bar = progress.add_task("synthesised hands", total=pieces)
        counted = count_synthesised(ring, seed, jobs, lambda: progress.update(bar, advance=1), pieces)
    finish(occlusion_report(counted, ring, None, Census()), common)


def gloves_table3(
    data: str | None = None, model: Path | None = None, left_out: Path | None = None, common: Flat[Common] = Common()
) -> None:
    """Two hands, Table 3: hidden markers filled by the last known position, mean velocity, affine weights, the network.

    One to four markers are hidden for 0.1 to 2 s. Synthesised hands are scored beside the recorded ones.

    Args:
        data: A folder of motion files with fingers or a prepared store; NAME=FOLDER names it. Synthesised hands alone
            by default.
        model: A network written by `bodysense train gloves`; the packaged one if omitted.
        left_out: A folder written by `bodysense train gloves --leave-one-out`: each person's clips are scored by the
            network that was trained without them, too.
        common: Common options.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.two_hands.tables import table3

    jobs, chosen = checked(common), None if data is None else named_data(data, common.split, common.quick)
    synthesised = _synthesised(common)
    with _progress(chosen, synthesised) as advance:
        report = table3(chosen, synthesised, model, jobs, advance, left_out)
    finish(report, common)


def gloves_table4(
    data: str | None = None,
    markers: Path | None = None,
    joints: Path | None = None,
    left_out: Path | None = None,
    common: Flat[Common] = Common(),
) -> None:
    """Two hands, Table 4: the joints of fingers by cyclic coordinate descent, and by the run time with hidden markers.

    Args:
        data: A folder of motion files with fingers or a prepared store; NAME=FOLDER names it. Synthesised hands alone
            by default.
        markers: A network for hidden markers, written by `bodysense train gloves`; the packaged one if omitted.
        joints: One for angles, likewise.
        left_out: As for Table 3.
        common: Common options.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.two_hands.tables import table4

    jobs, chosen = checked(common), None if data is None else named_data(data, common.split, common.quick)
    synthesised = _synthesised(common)
    with _progress(chosen, synthesised) as advance:
        report = table4(chosen, synthesised, markers, joints, jobs, advance, left_out)
    finish(report, common)


def gloves_layouts(hands: int | None = None, common: Flat[Common] = Common()) -> None:
    """Gloves of other marker sets than ours: joints of fingers, of hands that were told and that were calibrated.

    Args:
        hands: how many are drawn; 20 if omitted, 1 with --quick.
        common: Common options.
    """
    from rich.progress import Progress

    from bodysense.lab.two_hands.layouts import layout_table, layouts

    checked(common)
    if hands is not None and hands < 1:
        raise BodysenseError(f"--hands {hands}: give at least 1")
    count = hands or (1 if common.quick else 20)
    with Progress() as progress:
        bar = progress.add_task("scoring gloves", total=count * len(layouts()))
        report = layout_table(count, lambda: progress.update(bar, advance=1))
    finish(report, common)


def _synthesised(common: Common) -> int:
    """How many hands are synthesised."""
    return 2 if common.quick else 20


@contextmanager
def _progress(data: DataSet | None, synthesised: int) -> Iterator[Callable[[], None]]:
    """A progress bar over the clips of a table, and its synthesised hands."""
    from rich.progress import Progress

    with Progress() as progress:
        bar = progress.add_task("scoring hands", total=synthesised + (0 if data is None else data.count()))
        yield lambda: progress.update(bar, advance=1)
