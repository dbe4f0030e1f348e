"""`bodysense evaluate unoc-table1 …`: UNOC's tables, next to the published figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense_lab.commands.reporting import check_outputs, finish, open_data, progress_over, tracker_settings
from bodysense_lab.options import Data, Split, Stride, Table, TableOptions, check_positive

if TYPE_CHECKING:
    from bodysense.io.clip import Clip
    from bodysense_lab.unoc.tables import NetworkTable
    from bodysense_lab.unoc.variant_scores import Shipped

Sets = Annotated[tuple[str, ...], tyro.conf.arg(help="folders of motion or prepared stores; NAME=FOLDER names one")]
Predictor = Annotated[
    Path | None,
    tyro.conf.arg(help="predictor written by `bodysense train body-gru`; the packaged one if omitted"),
]
HalfLife = Annotated[
    float | None, tyro.conf.arg(help="half-life of the tracker's smoother in seconds; its own if omitted")
]
Networks = Annotated[Path, tyro.conf.arg(help="folder that `bodysense train unoc-tables` wrote")]


def unoc_table1(data: Sets, table: Table = TableOptions(split="all")) -> None:
    """UNOC, Table 1: share and duration of occlusion, and share of self-contact; a column a data set, or a category."""
    from bodysense_lab.datasets import named_data
    from bodysense_lab.unoc.occlusion import count_clips, occlusion_report

    check_outputs(table)
    sets = [named_data(one, table.split, table.quick) for one in data]
    with progress_over(sets) as advance:
        counted = [(one, *count_clips(one.clips(), table.processes, advance)) for one in sets]
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
        networks: folder that `bodysense train unoc-tables` wrote; if omitted, only the predictor and the baselines are
            scored. Scores are kept in it, or in --out.
    """
    from bodysense_lab.unoc.tables import TABLE_2
    from bodysense_lab.unoc.variant_scores import Shipped

    _network_table(TABLE_2, data, networks, stride, table, Shipped(model))


def unoc_table3(data: Data, networks: Networks, stride: Stride = 1, table: Table = TableOptions()) -> None:
    """UNOC, Table 3: other forms of the network."""
    from bodysense_lab.unoc.tables import TABLE_3

    _network_table(TABLE_3, data, networks, stride, table, None)


def unoc_table4(data: Data, networks: Networks, stride: Stride = 1, table: Table = TableOptions()) -> None:
    """UNOC, Table 4: without predicting the occlusion, without the losses of bones."""
    from bodysense_lab.unoc.tables import TABLE_4

    _network_table(TABLE_4, data, networks, stride, table, None)


def unoc_table5(
    data: Sets,
    networks: tuple[str, ...],
    finger_networks: tuple[str, ...] = (),
    stride: Stride = 1,
    table: Table = TableOptions(),
) -> None:
    """UNOC, Table 5: networks trained on one data set and tested on another; and finger synthesis.

    Scores are kept in the folder --out.

    Args:
        networks: NAME=FOLDER for each training set, written by `bodysense train unoc-tables --networks gru`.
        finger_networks: NAME=FILE for each training set, written by `bodysense train fingers --form paper`.
    """
    from bodysense.papers.point_model import load_point_model
    from bodysense_lab.datasets import named_data
    from bodysense_lab.unoc.cross_table import cross_report, synthesis_errors
    from bodysense_lab.unoc.variant_scores import networks_in, score_pairs

    check_positive(stride=stride)
    check_outputs(table)
    sets = [named_data(one, table.split, table.quick) for one in data]
    folders = _named(networks, "--networks")
    trained = {name: networks_in(folder, ["gru"])["gru"] for name, folder in folders.items()}
    files = _named(finger_networks, "--finger-networks")
    hands = {name: load_point_model("fingers", file) for name, file in files.items()}
    with progress_over(sets) as advance:
        scores, last_known = score_pairs(sets, trained, table.out, stride, table.processes, advance)
    fingers = synthesis_errors(sets, hands) if hands else None
    finish(cross_report(list(trained), sets, scores, last_known, fingers), table)


def unoc_table6(data: Data, model: Path | None = None, table: Table = TableOptions()) -> None:
    """UNOC, Table 6: the upper body from a headset and two controllers, by a network and by inverse kinematics.

    It runs in one process.

    Args:
        model: network written by `bodysense train upper-body`; the packaged one if omitted.
    """
    from bodysense_lab.datasets import Census, census_of
    from bodysense_lab.unoc.upper_body_table import (
        LearnedUpperBody,
        evaluate_upper_body,
        load_upper_body,
        upper_body_report,
    )

    chosen, network = open_data(data, table), load_upper_body(model)
    census = Census()

    def count(clip: Clip) -> None:
        nonlocal census
        census += census_of(clip)
        advance(clip)

    with progress_over([chosen]) as advance:
        scored = evaluate_upper_body(chosen.clips(), lambda skeleton: LearnedUpperBody(skeleton, network), count)
    finish(upper_body_report(scored, census, chosen), table)


def unoc_smoothness(
    data: Data,
    networks: Networks,
    model: Predictor = None,
    half_life: HalfLife = None,
    table: Table = TableOptions(),
) -> None:
    """UNOC, section 4.2: how often joints accelerate strongly, before and after inverse kinematics and smoothing."""
    from bodysense_lab.unoc.smoothness import NETWORKS, measure_smoothness, smoothness_report
    from bodysense_lab.unoc.variant_scores import networks_in

    chosen, files = open_data(data, table), networks_in(networks, NETWORKS)
    settings = tracker_settings(half_life)
    with progress_over([chosen]) as advance:
        sums, census = measure_smoothness(chosen, files, model, settings, table.processes, advance)
    finish(smoothness_report(sums, census, chosen), table)


def reliability(data: Data, model: Predictor = None, table: Table = TableOptions()) -> None:
    """Expected against true errors of hidden joints, in ten bins of equal count."""
    from bodysense_lab.unoc.reliability import measure_reliability, reliability_report

    chosen = open_data(data, table)
    with progress_over([chosen]) as advance:
        pairs, census = measure_reliability(chosen, model, table.processes, advance)
    finish(reliability_report(pairs, census, chosen), table)


def transitions(data: Data, model: Predictor = None, half_life: HalfLife = None, table: Table = TableOptions()) -> None:
    """How jerky motion is in the second in which a joint is lost or seen again, before and after smoothing."""
    from bodysense_lab.unoc.transitions import measure_transitions, transitions_report

    chosen, settings = open_data(data, table), tracker_settings(half_life)
    with progress_over([chosen]) as advance:
        found, census = measure_transitions(chosen, model, settings, table.processes, advance)
    finish(transitions_report(found, census, chosen), table)


def finger_synthesis(data: Data, split: Split = "test", model: Path | None = None, json: Path | None = None) -> None:
    """Score finger synthesis (UNOC, Table 5, right) against the mean hand and the hand of the nearest body.

    Clips with fingers are scored; both baselines know the clips of the train split.

    Args:
        split: people or actions to score.
        model: network written by `bodysense train fingers`; the packaged one if omitted.
        json: file for the numbers, as one flat object.
    """
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.papers.point_model import load_point_model
    from bodysense_lab.datasets import named_data
    from bodysense_lab.unoc.finger_scores import evaluate_finger_synthesis, examples_of

    if json is not None:
        check_place(json)
    scored, known = named_data(data, split), named_data(data, "train")
    network = load_point_model("fingers", model)
    with Progress() as progress:
        bar = progress.add_task("reading the train split", total=None)
        examples = examples_of(known.clips())
        table = evaluate_finger_synthesis(
            scored.clips(),
            examples,
            network,
            lambda clip: progress.update(bar, advance=1, description=f"scored {clip.name}"),
        )
    shown = Table(title=f"{scored.name}, {split}: {table.clips} clips with fingers, {table.seconds / 60:.1f} minutes")
    shown.caption = "Finger joints and fingertips from their wrist, cm."
    shown.add_column("method")
    for heading in ("RMSJPE", "MPJPE"):
        shown.add_column(heading, justify="right")
    for method, tally in table.tallies.items():
        shown.add_row(method.replace("_", " "), f"{tally.rmsjpe:.2f}", f"{tally.mpjpe:.2f}")
    Console().print(shown)
    write_numbers(json, table.numbers())


def _named(pairs: tuple[str, ...], option: str) -> dict[str, Path]:
    """NAME=PATH, by name."""
    from bodysense_lab.datasets import set_name

    result = {}
    for pair in pairs:
        name, equals, path = pair.partition("=")
        if not (name and equals and path):
            raise BodysenseError(f"{option} {pair!r}: write NAME=PATH, the name of the data set that it was trained on")
        result[set_name(name)] = Path(path)
    return result


def _network_table(
    rows: NetworkTable, data: str, networks: Path | None, stride: int, table: TableOptions, shipped: Shipped | None
) -> None:
    """Score the methods without kept scores, and report."""
    from bodysense_lab.unoc.tables import OWN_NAMES, network_report
    from bodysense_lab.unoc.variant_scores import Work, networks_in, score

    check_positive(stride=stride)
    chosen = open_data(data, table)
    if networks is None:
        rows = rows.only(OWN_NAMES)
    files = {} if networks is None else networks_in(networks, [n for n in rows.methods if n not in OWN_NAMES])
    work = Work(files, shipped, stride)
    with progress_over([chosen]) as advance:
        scores = score(chosen, networks or table.out, work, table.processes, advance)
    finish(network_report(rows, scores, chosen), table)
