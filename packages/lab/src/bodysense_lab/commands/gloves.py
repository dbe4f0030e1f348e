"""`bodysense train gloves` and `bodysense evaluate gloves-…`: gloves with hidden markers (two-hands)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense_lab.commands.reporting import check_outputs, finish, open_data, progress_over
from bodysense_lab.options import Flat
from bodysense_lab.two_hands.options import (
    GloveLimitsEvaluation,
    GloveOcclusionEvaluation,
    GloveTraining,
    JointEvaluation,
    LayoutEvaluation,
    MarkerEvaluation,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from bodysense_lab.datasets import DataSet
    from bodysense_lab.options import TableOptions


def gloves(run: Flat[GloveTraining]) -> None:
    """Train the networks of a glove (two-hands, 3.2) and write each as an .onnx. Training resumes after a stop.

    It writes a folder: glove_markers.onnx and glove_joints.onnx, each with its checkpoint and log.
    """
    from bodysense_lab.two_hands.train import people_with_fingers, run_gloves

    if not run.leave_one_out:
        run_gloves(run)
        return
    for person in people_with_fingers(run.data):
        run_gloves(replace(run, out=run.out / f"without-{person}", without=(person,)))


def gloves_occlusion(run: Flat[GloveOcclusionEvaluation]) -> None:
    """Two hands, Figs 13 and 14: how many markers of a glove are hidden at once, and for how long.

    A ring of cameras looks at the hands; one hand, two hands, and which of the paper's statements hold.
    """
    from rich.progress import Progress

    from bodysense.devices.simulated.camera_ring import CameraRing
    from bodysense_lab.datasets import Census
    from bodysense_lab.two_hands.occlusion import (
        SYNTHESISED_PIECES,
        count_clips,
        count_synthesised,
        occlusion_report,
    )

    table, ring = run.table, CameraRing(count=run.cameras)
    if run.data is not None:
        chosen = open_data(run.data, table)
        with progress_over([chosen]) as advance:
            counted, census = count_clips(chosen.clips(), ring, table.processes, advance)
        if not counted:
            raise BodysenseError(f"{run.data}: no clip has fingers; give motion with fingers, or leave --data out")
        finish(occlusion_report(counted, ring, chosen, census), table)
        return
    check_outputs(table)
    pieces = 1 if table.quick else SYNTHESISED_PIECES
    with Progress() as progress:
        bar = progress.add_task("synthesised hands", total=pieces)
        counted = count_synthesised(ring, run.seed, table.processes, lambda: progress.update(bar, advance=1), pieces)
    finish(occlusion_report(counted, ring, None, Census()), table)


def gloves_limits(run: Flat[GloveLimitsEvaluation]) -> None:
    """Two hands, section 7: hands in each other, pinches, wrong markers, markers without names, jumps.

    Two hands are watched by a ring of cameras and completed with and without the contact step; wrong samples are
    believed or rejected; markers that have lost their names are named again.
    """
    from rich.progress import Progress

    from bodysense.devices.simulated.camera_ring import CameraRing
    from bodysense_lab.datasets import Census
    from bodysense_lab.two_hands.limits import (
        SYNTHESISED_PIECES,
        SYNTHESISED_SECONDS,
        Findings,
        Networks,
        measure_clips,
        measure_synthesised,
    )
    from bodysense_lab.two_hands.limits_report import SYNTHESISED, limits_report

    table, data, jobs = run.table, run.data, run.table.processes
    ring, networks = CameraRing(count=run.cameras), Networks(run.markers, run.joints)
    check_outputs(table)
    found: dict[str, Findings] = {}
    chosen, census = None, Census()
    if data is not None:
        chosen = open_data(data, table)
        with progress_over([chosen]) as advance:
            found, census = measure_clips(chosen.clips(), networks, ring, jobs, advance)
        if not found:
            raise BodysenseError(f"{data}: no clip has fingers; give motion with fingers, or leave --data out")
    seeds = [(run.seed, piece) for piece in range(1 if table.quick else SYNTHESISED_PIECES)]
    with Progress() as progress:
        bar = progress.add_task("synthesised hands", total=len(seeds))
        found[SYNTHESISED] = measure_synthesised(seeds, networks, ring, jobs, lambda: progress.update(bar, advance=1))
    finish(limits_report(found, ring, chosen, census, len(seeds) * SYNTHESISED_SECONDS), table)


def gloves_table3(run: Flat[MarkerEvaluation]) -> None:
    """Two hands, Table 3: hidden markers filled by the last known position, mean velocity, affine weights, the network.

    One to four markers are hidden for 0.1 to 2 s.
    """
    from bodysense_lab.two_hands.tables import table3

    with _hands(run.data, run.table) as (chosen, synthesised, advance):
        report = table3(chosen, synthesised, run.model, run.table.processes, advance, run.left_out)
    finish(report, run.table)


def gloves_table4(run: Flat[JointEvaluation]) -> None:
    """Two hands, Table 4: finger joints by cyclic coordinate descent, and by the run time with hidden markers."""
    from bodysense_lab.two_hands.tables import table4

    with _hands(run.data, run.table) as (chosen, synthesised, advance):
        report = table4(chosen, synthesised, run.markers, run.joints, run.table.processes, advance, run.left_out)
    finish(report, run.table)


def gloves_layouts(run: Flat[LayoutEvaluation]) -> None:
    """Gloves of other marker sets: finger joints of known hands and of calibrated hands."""
    from rich.progress import Progress

    from bodysense_lab.two_hands.layouts import layout_table, layouts

    check_outputs(run.table)
    count = run.hands or (1 if run.table.quick else 20)
    with Progress() as progress:
        bar = progress.add_task("scoring gloves", total=count * len(layouts()))
        report = layout_table(count, lambda: progress.update(bar, advance=1))
    finish(report, run.table)


@contextmanager
def _hands(data: str | None, table: TableOptions) -> Iterator[tuple[DataSet | None, int, Callable[[], None]]]:
    """The data of a table and how many hands are synthesised, with a progress bar over both."""
    from rich.progress import Progress

    check_outputs(table)
    chosen, synthesised = None if data is None else open_data(data, table), 2 if table.quick else 20
    with Progress() as progress:
        bar = progress.add_task("scoring hands", total=synthesised + (0 if chosen is None else chosen.count()))
        yield chosen, synthesised, lambda: progress.update(bar, advance=1)
