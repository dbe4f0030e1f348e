"""`bodysense evaluate unoc-table1 …`: UNOC's tables, next to the published figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.ranges import Count
from bodysense_lab.commands.reporting import (
    check_places,
    finish,
    open_data,
    open_sets,
    progress_bar,
    show,
)
from bodysense_lab.core.options import Data, Json, Output, Split, Stride, Table, TableOptions, check_ending

if TYPE_CHECKING:
    from bodysense.io.clip import Clip
    from bodysense_lab.core.score_table import ScoreTable
    from bodysense_lab.core.table import Report
    from bodysense_lab.data.datasets import Census, DataSet
    from bodysense_lab.papers.unoc.score.variant_scores import Shipped

Sets = Annotated[tuple[str, ...], tyro.conf.arg(help="folders of motion or prepared stores; NAME=FOLDER names one")]
Predictor = Annotated[
    Path | None,
    tyro.conf.arg(help="predictor written by `bodysense train body-gru`; the packaged one if omitted"),
]
Motion = Annotated[Path, tyro.conf.Positional]
Networks = Annotated[Path, tyro.conf.arg(help="folder that `bodysense train unoc-tables` wrote")]


def unoc_table1(data: Sets, table: Table = TableOptions(split="all")) -> None:
    """UNOC, Table 1: share and duration of occlusion, and share of self-contact, by data set or category."""
    from bodysense_lab.data.datasets import gather_results
    from bodysense_lab.papers.unoc.score.occlusion import count_clip, occlusion_report

    sets = open_sets(data, table)
    with progress_bar("scored", sum(one.count() for one in sets)) as advance:
        counted = [(one, *gather_results(count_clip, one.clips(), table.processes, advance)) for one in sets]
    finish(occlusion_report(counted), table)


def unoc_table2(
    data: Data,
    networks: Path | None = None,
    model: Predictor = None,
    stride: Stride = 1,
    table: Table = TableOptions(),
) -> None:
    """UNOC, Table 2: GRU, RNN, LSTM, TCN, last known position, constant velocity, and the packaged predictor.

    Args:
        networks: folder that `bodysense train unoc-tables` wrote; only the predictor and the baselines are scored if
            omitted. Scores are saved in it, or in --out.
    """
    from bodysense_lab.papers.unoc.score.tables import TABLE_2
    from bodysense_lab.papers.unoc.score.variant_scores import Shipped

    _network_table(TABLE_2, data, networks, stride, table, Shipped(model))


def unoc_table3(data: Data, networks: Networks, stride: Stride = 1, table: Table = TableOptions()) -> None:
    """UNOC, Table 3: other forms of the network."""
    from bodysense_lab.papers.unoc.score.tables import TABLE_3

    _network_table(TABLE_3, data, networks, stride, table, None)


def unoc_table4(data: Data, networks: Networks, stride: Stride = 1, table: Table = TableOptions()) -> None:
    """UNOC, Table 4: without prediction of occlusion, and without losses on bones."""
    from bodysense_lab.papers.unoc.score.tables import TABLE_4

    _network_table(TABLE_4, data, networks, stride, table, None)


def unoc_table5(
    data: Sets,
    networks: tuple[str, ...],
    finger_networks: tuple[str, ...] = (),
    stride: Stride = 1,
    table: Table = TableOptions(),
) -> None:
    """UNOC, Table 5: networks trained on one data set and tested on another; and finger synthesis.

    Scores are saved in the folder --out.

    Args:
        networks: NAME=FOLDER for each training set, written by `bodysense train unoc-tables --networks gru`.
        finger_networks: NAME=FILE for each training set, written by `bodysense train fingers --form paper`.
    """
    from bodysense_lab.papers.unoc.point_model import load_point_model
    from bodysense_lab.papers.unoc.score.cross_table import cross_report, synthesis_errors
    from bodysense_lab.papers.unoc.score.variant_scores import networks_in, score_pairs

    sets = open_sets(data, table)
    folders = _named(networks, "--networks")
    files = _named(finger_networks, "--finger-networks")
    hands = {name: load_point_model("fingers", file) for name, file in files.items()}
    trained = {name: networks_in(folder, ["gru"])["gru"] for name, folder in folders.items()}
    with progress_bar("scored", sum(one.count() for one in sets)) as advance:
        scores, last_known = score_pairs(sets, trained, table.out, stride, table.processes, advance)
    fingers = synthesis_errors(sets, hands) if hands else None
    finish(cross_report(list(trained), sets, scores, last_known, fingers), table)


def unoc_table6(data: Data, model: Path | None = None, table: Table = TableOptions()) -> None:
    """UNOC, Table 6: the upper body from a headset and two controllers, by a network and by inverse kinematics.

    It runs in one process.

    Args:
        model: network written by `bodysense train upper-body`; the packaged one if omitted.
    """
    from bodysense_lab.papers.unoc.learned_upper_body import LearnedUpperBody, load_upper_body
    from bodysense_lab.papers.unoc.score.upper_body_table import MakeEstimator, upper_body_errors, upper_body_report
    from bodysense_lab.papers.unoc.upper_body_ik import UpperBodyIk

    network = load_upper_body(model)
    methods: dict[str, MakeEstimator] = {
        "network": lambda skeleton: LearnedUpperBody(skeleton, network),
        "ik": UpperBodyIk,
    }
    _score(data, replace(table, jobs=1), partial(upper_body_errors, methods=methods), upper_body_report)


def unoc_smoothness(
    data: Data,
    networks: Networks,
    model: Predictor = None,
    table: Table = TableOptions(),
) -> None:
    """UNOC, section 4.2: share of strong accelerations, before and after inverse kinematics and smoothing."""
    from bodysense_lab.papers.unoc.ik_tracker import IkTrackerSettings
    from bodysense_lab.papers.unoc.score.smoothness import NETWORKS, smoothness_of_clip, smoothness_report
    from bodysense_lab.papers.unoc.score.variant_scores import networks_in

    files = networks_in(networks, NETWORKS)
    work = partial(smoothness_of_clip, networks=files, model=model, settings=IkTrackerSettings())
    _score(data, table, work, smoothness_report)


def transitions(data: Data, model: Predictor = None, table: Table = TableOptions()) -> None:
    """Measure jerk in the second in which a joint is lost or seen again, before and after smoothing."""
    from bodysense_lab.papers.unoc.ik_tracker import IkTrackerSettings
    from bodysense_lab.papers.unoc.score.transitions import transitions_of_clip, transitions_report

    work = partial(transitions_of_clip, model=model, settings=IkTrackerSettings())
    _score(data, table, work, transitions_report)


def finger_synthesis(data: Data, split: Split = "test", model: Path | None = None, json: Json = None) -> None:
    """Score finger synthesis (UNOC, Table 5, right) against the mean hand and the hand of the nearest body.

    Only clips with fingers are scored. Both baselines use the clips of the train split.

    Args:
        split: people or actions to score.
        model: network written by `bodysense train fingers`; the packaged one if omitted.
    """
    from bodysense_lab.core.scoring import group_of
    from bodysense_lab.data.datasets import gather_results, open_data_set
    from bodysense_lab.papers.unoc.point_model import load_point_model
    from bodysense_lab.papers.unoc.score.finger_scores import examples_of, finger_errors, finger_report

    check_places(json)
    scored, known, network = (
        open_data_set(data, split),
        open_data_set(data, "train"),
        load_point_model("fingers", model),
    )
    clips = (clip for clip in scored.clips() if clip.has_fingers and group_of(clip) == "main")
    with progress_bar("scored", scored.count()) as advance:
        work = partial(finger_errors, examples=examples_of(known.clips()), model=network)
        found, census = gather_results(work, clips, 1, advance)
    show(finger_report(found, census, scored), json)


def unoc_figure5(
    motion: Motion, out: Output, model: Predictor = None, moments: Count = 5, reading: Reading = AS_FOUND
) -> None:
    """UNOC, Fig. 5: draw truth, last known positions, network and inverse kinematics side by side.

    A simulated headset sees the motion; what it does not see is red. Each row is the frame of an equal part of the
    motion in which most is hidden.

    Args:
        motion: motion: .bvh, AMASS or SMPL .npz, .glb.
        out: picture, .png or .webp.
        moments: number of rows.
        reading: properties that the file does not contain.
    """
    from bodysense.pictures.comparison import write_picture
    from bodysense_lab.papers.unoc.figures import completions, draw_figure_5, most_hidden

    found = completions(_drawn(motion, out, reading), model)
    write_picture(out, draw_figure_5(found, most_hidden(found.seen, moments)))
    for name, error in found.errors().items():
        print(f"{name}: {error:.2f} cm (RMSJPE of hidden joints of the body)")
    print(f"wrote {out}")


def unoc_figure7(
    motion: Motion, out: Output, model: Path | None = None, moments: Count = 4, reading: Reading = AS_FOUND
) -> None:
    """UNOC, Fig. 7: draw bodies, a hand of each, and below it the fingers that a network predicts from the body.

    Each example is the hand that is bent most in an equal part of the motion.

    Args:
        motion: motion with fingers: .bvh, .glb.
        out: picture, .png or .webp.
        model: network written by `bodysense train fingers`; the packaged one if omitted.
        moments: number of examples.
        reading: properties that the file does not contain.
    """
    from bodysense.pictures.comparison import write_picture
    from bodysense_lab.papers.unoc.figures import draw_figure_7, finger_error, most_bent, predicted_fingers
    from bodysense_lab.papers.unoc.point_model import load_point_model

    clip = _drawn(motion, out, reading)
    if not clip.has_fingers:
        raise BodysenseError(
            f"{motion}: no fingers; the figure compares them with predicted ones: give motion with fingers"
        )
    truth, predicted = predicted_fingers(clip, load_point_model("fingers", model))
    write_picture(out, draw_figure_7(truth.pose, predicted.pose, most_bent(truth, moments)))
    print(f"fingers: {finger_error(truth, predicted):.2f} cm (MPJPE from the wrist)")
    print(f"wrote {out}")


def _drawn(motion: Path, out: Path, reading: ReadingOptions) -> Clip:
    """Return the motion of a figure. Raises BodysenseError for a picture that cannot be written."""
    from bodysense.cli.recordings import load_clip
    from bodysense.files import check_place

    check_place(out)
    check_ending(out, ".png", ".webp", what="a picture")
    return load_clip(motion, reading)


def _score(
    data: str,
    table: TableOptions,
    work: Callable[[Clip], Mapping[Any, Any]],
    report: Callable[[dict[Any, Any], Census, DataSet], Report],
) -> None:
    """Gather the results of all clips of a data set, and report them."""
    from bodysense_lab.data.datasets import gather_results

    chosen = open_data(data, table)
    with progress_bar("scored", chosen.count()) as advance:
        found, census = gather_results(work, chosen.clips(), table.processes, advance)
    finish(report(found, census, chosen), table, chosen)


def _named(pairs: tuple[str, ...], option: str) -> dict[str, Path]:
    """Parse NAME=PATH options; returns paths by name."""
    from bodysense_lab.data.datasets import catalogue_name

    result = {}
    for pair in pairs:
        name, equals, path = pair.partition("=")
        if not (name and equals and path):
            raise BodysenseError(f"{option} {pair!r}: write NAME=PATH with the name of the training data set")
        result[catalogue_name(name)] = Path(path)
    return result


def _network_table(
    rows: ScoreTable, data: str, networks: Path | None, stride: int, table: TableOptions, shipped: Shipped | None
) -> None:
    """Score the methods that have no saved scores, and report."""
    from bodysense_lab.papers.unoc.score.tables import OWN_NAMES, network_report
    from bodysense_lab.papers.unoc.score.variant_scores import Work, networks_in, score

    chosen = open_data(data, table)
    files = {} if networks is None else networks_in(networks, [n for n in rows.methods if n not in OWN_NAMES])
    work = Work(files, shipped, stride)
    with progress_bar("scored", chosen.count()) as advance:
        scores = score(chosen, networks or table.out, work, table.processes, advance)
    finish(network_report(rows, scores, chosen), table, chosen)
