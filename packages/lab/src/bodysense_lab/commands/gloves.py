"""`bodysense train gloves` and `evaluate gloves-…`: gloves with hidden markers (two-hands)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import tyro

from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Seed
from bodysense_lab.commands.reporting import check_outputs, finish, open_data, progress_bar
from bodysense_lab.core.options import Flat, Table, TableOptions
from bodysense_lab.papers.two_hands.options import GloveTraining

if TYPE_CHECKING:
    from collections.abc import Callable

    from bodysense_lab.core.table import Report
    from bodysense_lab.data.datasets import Census, DataSet
    from bodysense_lab.papers.two_hands.score.hand_pairs import Figures, Piece, Work
    from bodysense_lab.papers.two_hands.score.scores import GloveTable, HandTask
    from bodysense_lab.papers.two_hands.trials import HandErrors

F = TypeVar("F", bound="Figures")
Hands = Annotated[
    str | None,
    tyro.conf.arg(
        help="folder of motion with fingers or prepared store; NAME=FOLDER names it; synthesised hands alone if omitted"
    ),
]
Cameras = Annotated[int, tyro.conf.arg(help="cameras in the ring; two must see a marker")]
MotionSeed = Annotated[Seed, tyro.conf.arg(help="random seed of the synthesised motion")]
Network = Annotated[
    Path | None, tyro.conf.arg(help="network written by `bodysense train gloves`; the packaged one if omitted")
]
LeftOut = Annotated[
    Path | None,
    tyro.conf.arg(
        help="folder that `bodysense train gloves --leave-one-out` wrote, to score people by networks that "
        "never saw them"
    ),
]


def gloves(run: Flat[GloveTraining]) -> None:
    """Train the networks of a glove (two-hands, 3.2) and write each as an .onnx. Training resumes after a stop.

    It writes a folder: glove_markers.onnx and glove_joints.onnx, each with its checkpoint and log.
    """
    from bodysense_lab.papers.two_hands.train import people_with_fingers, run_gloves

    if not run.leave_one_out:
        run_gloves(run)
        return
    for person in people_with_fingers(run.data):
        run_gloves(replace(run, out=run.out / f"without-{person}", without=(person,)))


def gloves_occlusion(
    data: Hands = None, cameras: Cameras = 12, seed: MotionSeed = 1, table: Table = TableOptions()
) -> None:
    """Two hands, Figs 13 and 14: number of markers of a glove that are hidden at a time, and for how long.

    A ring of cameras tracks one hand and two hands; the paper's statements are checked. With --data only recorded hands
    are counted.
    """
    from bodysense.devices.simulated.camera_ring import CameraRing
    from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED
    from bodysense_lab.papers.two_hands.score.occlusion import SYNTHESISED_PIECES, count_pair, occlusion_report

    ring = CameraRing(count=cameras)
    seeds = _seeds(seed, SYNTHESISED_PIECES, table) if data is None else []
    chosen, found, census = _pairs(partial(count_pair, cameras=ring), data, seeds, table)
    counted = found if data is not None else {"main": found[SYNTHESISED]}
    finish(occlusion_report(counted, ring, chosen, census), table)


def gloves_limits(
    data: Hands = None,
    cameras: Cameras = 12,
    seed: MotionSeed = 1,
    markers: Network = None,
    joints: Network = None,
    table: Table = TableOptions(),
) -> None:
    """Two hands, section 7: overlapping hands, pinches, wrong markers, markers without labels, jumps.

    Two hands are tracked by a ring of cameras and completed. Wrong samples are accepted or
    rejected. Markers without labels are labelled again.
    """
    from bodysense.devices.gloves.hands import load_glove_models
    from bodysense.devices.simulated.camera_ring import CameraRing
    from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED_SECONDS
    from bodysense_lab.papers.two_hands.score.limits import SYNTHESISED_PIECES, measure_limits
    from bodysense_lab.papers.two_hands.score.limits_report import limits_report

    ring = CameraRing(count=cameras)
    load_glove_models(markers, joints)  # refuses other files before the work
    work = partial(measure_limits, cameras=ring, markers=markers, joints=joints)
    seeds = _seeds(seed, SYNTHESISED_PIECES, table)
    chosen, found, census = _pairs(work, data, seeds, table)
    finish(limits_report(found, ring, chosen, census, len(seeds) * SYNTHESISED_SECONDS), table)


def gloves_table3(
    data: Hands = None, model: Network = None, left_out: LeftOut = None, table: Table = TableOptions()
) -> None:
    """Two hands, Table 3: hidden markers by last known position, mean velocity, affine weights, and the network.

    One to four markers are hidden for 0.1 to 2 s.
    """
    from bodysense.devices.gloves.networks import load_marker_network
    from bodysense_lab.papers.two_hands.score.scores import measure_markers
    from bodysense_lab.papers.two_hands.score.tables import marker_report

    load_marker_network(model)  # refuses other files before the work
    _score_hands(partial(measure_markers, model=model, left_out=left_out), marker_report, data, table)


def gloves_table4(
    data: Hands = None,
    markers: Network = None,
    joints: Network = None,
    left_out: LeftOut = None,
    table: Table = TableOptions(),
) -> None:
    """Two hands, Table 4: finger joints by cyclic coordinate descent, and by the glove device with hidden markers."""
    from bodysense.devices.gloves.hands import load_glove_models
    from bodysense_lab.papers.two_hands.score.scores import measure_fingers
    from bodysense_lab.papers.two_hands.score.tables import finger_report

    load_glove_models(markers, joints)  # refuses other files before the work
    work = partial(measure_fingers, markers=markers, joints=joints, left_out=left_out)
    _score_hands(work, finger_report, data, table)


def gloves_fusion(
    data: Hands = None,
    markers: Network = None,
    joints: Network = None,
    left_out: LeftOut = None,
    table: Table = TableOptions(),
) -> None:
    """Two hands, section 2.2: fingers with hidden markers, from markers, from inertial sensors, and from both.

    The hands are unseen: left out of training (--left-out) or drawn from the hand shape space.
    """
    from bodysense.devices.gloves.hands import load_glove_models
    from bodysense_lab.papers.two_hands.score.fusion import fusion_report, measure_fusion

    load_glove_models(markers, joints)  # refuses other files before the work
    work = partial(measure_fusion, markers=markers, joints=joints, left_out=left_out)
    _score_hands(work, fusion_report, data, table, by_person=True)


def gloves_settings(data: Hands = None, table: Table = TableOptions(split="val")) -> None:
    """Select settings of gloves on hands that are in no table: decay of offsets, and use of inertial sensors.

    Hands are drawn with their own seed and have motions of the validation split.
    """
    from bodysense_lab.papers.two_hands.score.choice import measure_settings, settings_report

    _score_hands(measure_settings, settings_report, data, table, by_person=True)


def gloves_layouts(hands: Count | None = None, table: Table = TableOptions()) -> None:
    """Gloves of other marker sets: finger joints of known hands and of calibrated hands.

    Args:
        hands: number of drawn hands; 20 if omitted, 1 with --quick.
    """
    from bodysense_lab.papers.two_hands.score.layouts import layout_table, layouts

    check_outputs(table)
    count = hands or (1 if table.quick else 20)
    with progress_bar("scoring gloves", count * len(layouts())) as advance:
        report = layout_table(count, advance)
    finish(report, table)


def _seeds(seed: Seed, pieces: int, table: TableOptions) -> list[Piece]:
    """Return the pieces of synthesised motion for a table; a single one with --quick."""
    return [(seed, piece) for piece in range(1 if table.quick else pieces)]


def _pairs(
    work: Work[F], data: str | None, seeds: list[Piece], table: TableOptions
) -> tuple[DataSet | None, dict[str, F], Census]:
    """Return the data set, figures by group (also of synthesised motion), and the amount of recorded motion.

    Raises BodysenseError if no clip of the data has fingers.
    """
    from bodysense_lab.data.datasets import Census
    from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED, over_clips, over_seeds

    check_outputs(table)
    chosen, found, census = None, dict[str, F](), Census()
    if data is not None:
        chosen = open_data(data, table)
        with progress_bar("scored", chosen.count()) as advance:
            found, census = over_clips(work, chosen.clips(), table.processes, advance)
        if not found:
            raise BodysenseError(f"{data}: no clip has fingers; give motion with fingers, or leave --data out")
    if seeds:
        with progress_bar("synthesised hands", len(seeds)) as advance:
            found[SYNTHESISED] = over_seeds(work, seeds, table.processes, advance)
    return chosen, found, census


def _score_hands(
    work: Callable[[HandTask], HandErrors],
    report: Callable[[GloveTable], Report],
    data: str | None,
    table: TableOptions,
    by_person: bool = False,
) -> None:
    """Score recorded and synthesised hands, and report them.

    With `by_person`, `work` receives all motions of a person at once, and hands are synthesised only without data.
    """
    from bodysense_lab.papers.two_hands.score.scores import measure

    check_outputs(table)
    chosen = None if data is None else open_data(data, table)
    synthesised = 0 if by_person and chosen is not None else 2 if table.quick else 20
    with progress_bar("scoring hands", synthesised + (0 if chosen is None else chosen.count())) as advance:
        measured = measure(work, chosen, synthesised, table.processes, advance, by_person)
    finish(report(measured), table)
