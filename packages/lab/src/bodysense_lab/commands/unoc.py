"""`bodysense evaluate unoc-table1 …`: UNOC's tables, next to the published figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense_lab.commands.reporting import check_outputs, finish, open_data, progress_over, tracker_settings
from bodysense_lab.options import Flat
from bodysense_lab.unoc.options import (
    CrossEvaluation,
    FingerSynthesisEvaluation,
    OcclusionEvaluation,
    PredictorEvaluation,
    ReliabilityEvaluation,
    SmoothnessEvaluation,
    TransitionEvaluation,
    UpperBodyEvaluation,
    VariantEvaluation,
)

if TYPE_CHECKING:
    from bodysense.io.clip import Clip
    from bodysense_lab.unoc.tables import NetworkTable
    from bodysense_lab.unoc.variant_scores import Shipped


def unoc_table1(run: Flat[OcclusionEvaluation]) -> None:
    """UNOC, Table 1: share and duration of occlusion, and share of self-contact."""
    from bodysense_lab.datasets import named_data
    from bodysense_lab.unoc.occlusion import count_clips, occlusion_report

    check_outputs(run.table)
    sets = [named_data(one, run.table.split, run.table.quick) for one in run.data]
    with progress_over(sets) as advance:
        counted = [(one, *count_clips(one.clips(), run.table.processes, advance)) for one in sets]
    finish(occlusion_report(counted), run.table)


def unoc_table2(run: Flat[PredictorEvaluation]) -> None:
    """UNOC, Table 2: GRU, RNN, LSTM, TCN, last known position, and the packaged predictor.

    Scores are kept in the folder --networks, or in --out where that is omitted.
    """
    from bodysense_lab.unoc.tables import TABLE_2
    from bodysense_lab.unoc.variant_scores import Shipped

    _network_table(TABLE_2, run, Shipped(run.model))


def unoc_table3(run: Flat[VariantEvaluation]) -> None:
    """UNOC, Table 3: other forms of the network."""
    from bodysense_lab.unoc.tables import TABLE_3

    _network_table(TABLE_3, run, None)


def unoc_table4(run: Flat[VariantEvaluation]) -> None:
    """UNOC, Table 4: without predicting the occlusion, without the losses of bones."""
    from bodysense_lab.unoc.tables import TABLE_4

    _network_table(TABLE_4, run, None)


def unoc_table5(run: Flat[CrossEvaluation]) -> None:
    """UNOC, Table 5: networks trained on one data set and tested on another; and finger synthesis.

    Scores are kept in the folder --out.
    """
    from bodysense.papers.point_model import load_point_model
    from bodysense_lab.datasets import named_data
    from bodysense_lab.unoc.cross_table import cross_report, synthesis_errors
    from bodysense_lab.unoc.variant_scores import networks_in, score_pairs

    table = run.table
    check_outputs(table)
    sets = [named_data(one, table.split, table.quick) for one in run.data]
    folders = _named(run.networks, "--networks")
    trained = {name: networks_in(folder, ["gru"])["gru"] for name, folder in folders.items()}
    files = _named(run.finger_networks, "--finger-networks")
    hands = {name: load_point_model("fingers", file) for name, file in files.items()}
    with progress_over(sets) as advance:
        scores, last_known = score_pairs(sets, trained, table.out, run.stride, table.processes, advance)
    fingers = synthesis_errors(sets, hands) if hands else None
    finish(cross_report(list(trained), sets, scores, last_known, fingers), table)


def unoc_table6(run: Flat[UpperBodyEvaluation]) -> None:
    """UNOC, Table 6: the upper body from a headset and two controllers, by a network and by inverse kinematics.

    One process does it.
    """
    from bodysense_lab.datasets import Census, census_of
    from bodysense_lab.unoc.upper_body_table import (
        LearnedUpperBody,
        evaluate_upper_body,
        load_upper_body,
        upper_body_report,
    )

    chosen, network = (
        open_data(run.data, run.table),
        load_upper_body(run.model),
    )
    census = Census()

    def count(clip: Clip) -> None:
        nonlocal census
        census += census_of(clip)
        advance(clip)

    with progress_over([chosen]) as advance:
        table = evaluate_upper_body(chosen.clips(), lambda skeleton: LearnedUpperBody(skeleton, network), count)
    finish(upper_body_report(table, census, chosen), run.table)


def unoc_smoothness(run: Flat[SmoothnessEvaluation]) -> None:
    """UNOC, section 4.2: how often joints accelerate strongly, before and after inverse kinematics and smoothing."""
    from bodysense_lab.unoc.smoothness import NETWORKS, measure_smoothness, smoothness_report
    from bodysense_lab.unoc.variant_scores import networks_in

    chosen, files = open_data(run.data, run.table), networks_in(run.networks, NETWORKS)
    settings = tracker_settings(run.half_life)
    with progress_over([chosen]) as advance:
        sums, census = measure_smoothness(chosen, files, run.model, settings, run.table.processes, advance)
    finish(smoothness_report(sums, census, chosen), run.table)


def reliability(run: Flat[ReliabilityEvaluation]) -> None:
    """Expected against true errors of hidden joints, in ten bins of equal count."""
    from bodysense_lab.unoc.reliability import measure_reliability, reliability_report

    chosen = open_data(run.data, run.table)
    with progress_over([chosen]) as advance:
        pairs, census = measure_reliability(chosen, run.model, run.table.processes, advance)
    finish(reliability_report(pairs, census, chosen), run.table)


def transitions(run: Flat[TransitionEvaluation]) -> None:
    """How jerky motion is in the second in which a joint is lost or seen again, before and after smoothing."""
    from bodysense_lab.unoc.transitions import measure_transitions, transitions_report

    chosen, settings = open_data(run.data, run.table), tracker_settings(run.half_life)
    with progress_over([chosen]) as advance:
        found, census = measure_transitions(chosen, run.model, settings, run.table.processes, advance)
    finish(transitions_report(found, census, chosen), run.table)


def finger_synthesis(run: Flat[FingerSynthesisEvaluation]) -> None:
    """Score finger synthesis (UNOC, Table 5, right) against the mean hand and the hand of the nearest body."""
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.papers.point_model import load_point_model
    from bodysense_lab.datasets import named_data
    from bodysense_lab.unoc.finger_scores import evaluate_finger_synthesis, examples_of

    if run.json is not None:
        check_place(run.json)
    scored, known = named_data(run.data, run.split), named_data(run.data, "train")
    network = load_point_model("fingers", run.model)
    with Progress() as progress:
        bar = progress.add_task("reading the train split", total=None)
        examples = examples_of(known.clips())
        table = evaluate_finger_synthesis(
            scored.clips(),
            examples,
            network,
            lambda clip: progress.update(bar, advance=1, description=f"scored {clip.name}"),
        )
    shown = Table(
        title=f"{scored.name}, {run.split}: {table.clips} clips with fingers, {table.seconds / 60:.1f} minutes"
    )
    shown.caption = "Finger joints and fingertips from their wrist, cm."
    shown.add_column("method")
    for heading in ("RMSJPE", "MPJPE"):
        shown.add_column(heading, justify="right")
    for method, tally in table.tallies.items():
        shown.add_row(method.replace("_", " "), f"{tally.rmsjpe:.2f}", f"{tally.mpjpe:.2f}")
    Console().print(shown)
    write_numbers(run.json, table.numbers())


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


def _network_table(table: NetworkTable, run: PredictorEvaluation | VariantEvaluation, shipped: Shipped | None) -> None:
    """Score what is not scored yet, and report."""
    from bodysense_lab.unoc.tables import OWN_NAMES, network_report
    from bodysense_lab.unoc.variant_scores import Work, networks_in, score

    chosen, networks = open_data(run.data, run.table), run.networks
    if networks is None:
        table = table.only(OWN_NAMES)
    files = {} if networks is None else networks_in(networks, [n for n in table.methods if n not in OWN_NAMES])
    work = Work(files, shipped, run.stride)
    with progress_over([chosen]) as advance:
        scores = score(chosen, networks or run.table.out, work, run.table.processes, advance)
    finish(network_report(table, scores, chosen), run.table)
