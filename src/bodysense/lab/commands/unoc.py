"""`bodysense evaluate unoc-table1 …`: UNOC's tables, ours beside the published figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.lab.commands.reporting import Common, checked, finish, progress_over, tracker_settings
from bodysense.lab.options import Flat

if TYPE_CHECKING:
    from bodysense.io.clip import Clip
    from bodysense.lab.unoc.tables import NetworkTable
    from bodysense.lab.unoc.variant_scores import Shipped


def unoc_table1(data: tuple[str, ...], common: Flat[Common] = Common(split="all")) -> None:
    """UNOC, Table 1: how much a headset does not see, for how long, and how often the body touches itself.

    Args:
        data: Folders of motion files or prepared stores; NAME=FOLDER names one. Of one, a column a category; of
            several, a column each.
        common: Common options.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.occlusion_table import count_clips, occlusion_report

    jobs = checked(common)
    sets = [named_data(one, common.split, common.quick) for one in data]
    with progress_over(sets) as advance:
        counted = [(one, *count_clips(one.clips(), jobs, advance)) for one in sets]
    finish(occlusion_report(counted), common)


def unoc_table2(
    data: str,
    networks: Path | None = None,
    model: Path | None = None,
    stride: int = 1,
    common: Flat[Common] = Common(),
) -> None:
    """UNOC, Table 2: GRU, RNN, LSTM, TCN, last known position, and the shipped predictor.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        networks: The folder into which `bodysense train unoc-tables` wrote the networks; scores are kept in it. Without
            it the shipped predictor alone is scored beside the last known position, and its scores kept in --out.
        model: The shipped predictor, a network written by `bodysense train body-gru`; the packaged one if omitted.
        stride: Score every n-th frame.
        common: Common options.
    """
    from bodysense.lab.unoc.tables import TABLE_2
    from bodysense.lab.unoc.variant_scores import Shipped

    _network_table(TABLE_2, data, networks, Shipped(model), stride, common)


def unoc_table3(data: str, networks: Path, stride: int = 1, common: Flat[Common] = Common()) -> None:
    """UNOC, Table 3: other forms of the network.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        networks: The folder into which `bodysense train unoc-tables` wrote the networks; scores are kept in it.
        stride: Score every n-th frame.
        common: Common options.
    """
    from bodysense.lab.unoc.tables import TABLE_3

    _network_table(TABLE_3, data, networks, None, stride, common)


def unoc_table4(data: str, networks: Path, stride: int = 1, common: Flat[Common] = Common()) -> None:
    """UNOC, Table 4: without predicting the occlusion, without the losses of bones.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        networks: The folder into which `bodysense train unoc-tables` wrote the networks; scores are kept in it.
        stride: Score every n-th frame.
        common: Common options.
    """
    from bodysense.lab.unoc.tables import TABLE_4

    _network_table(TABLE_4, data, networks, None, stride, common)


def unoc_table5(
    data: tuple[str, ...],
    networks: tuple[str, ...],
    finger_networks: tuple[str, ...] = (),
    stride: int = 1,
    common: Flat[Common] = Common(),
) -> None:
    """UNOC, Table 5: networks trained on one data set and tested on another; and finger synthesis.

    Args:
        data: Test sets, as NAME=FOLDER; a folder of motion files or a prepared store.
        networks: NAME=FOLDER for each training set: what `bodysense train unoc-tables --networks gru` wrote of it.
        finger_networks: NAME=FILE for each training set: what `bodysense train fingers --form paper` wrote of it.
        stride: Score every n-th frame.
        common: Common options; scores are kept in its --out.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.cross_table import cross_report, synthesis_errors
    from bodysense.lab.unoc.point_model import load_point_model
    from bodysense.lab.unoc.variant_scores import networks_in, score_pairs

    jobs = checked(common, stride)
    sets = [named_data(one, common.split, common.quick) for one in data]
    trained = {name: networks_in(folder, ["gru"])["gru"] for name, folder in _named(networks, "--networks").items()}
    hands = {n: load_point_model("fingers", f) for n, f in _named(finger_networks, "--finger-networks").items()}
    with progress_over(sets) as advance:
        scores, last_known = score_pairs(sets, trained, common.out, stride, jobs, advance)
    fingers = synthesis_errors(sets, hands) if hands else None
    finish(cross_report(list(trained), sets, scores, last_known, fingers), common)


def unoc_table6(data: str, model: Path | None = None, common: Flat[Common] = Common()) -> None:
    """UNOC, Table 6: the upper body from a headset and two controllers, by a network and by inverse kinematics.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        model: A network written by `bodysense train upper-body`; the packaged one if omitted.
        common: Common options; one process does it.
    """
    from bodysense.lab.datasets import Census, census_of, named_data
    from bodysense.lab.unoc.learned_upper_body import LearnedUpperBody
    from bodysense.lab.unoc.point_model import load_point_model
    from bodysense.lab.unoc.upper_body_table import evaluate_upper_body, upper_body_report

    checked(common)
    chosen, network = named_data(data, common.split, common.quick), load_point_model("upper-body", model)
    census = Census()

    def count(clip: Clip) -> None:
        nonlocal census
        census += census_of(clip)
        advance(clip)

    with progress_over([chosen]) as advance:
        table = evaluate_upper_body(chosen.clips(), lambda skeleton: LearnedUpperBody(skeleton, network), count)
    finish(upper_body_report(table, census, chosen), common)


def unoc_smoothness(
    data: str,
    networks: Path,
    model: Path | None = None,
    half_life: float | None = None,
    common: Flat[Common] = Common(),
) -> None:
    """UNOC, section 4.2: how often joints accelerate strongly, before and after inverse kinematics and smoothing.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        networks: The folder into which `bodysense train unoc-tables` wrote the networks.
        model: The shipped predictor, a network written by `bodysense train body-gru`; the packaged one if omitted.
        half_life: half-life of the tracker's smoother in seconds; its own if omitted.
        common: Common options.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.smoothness import NETWORKS, measure_smoothness, smoothness_report
    from bodysense.lab.unoc.variant_scores import networks_in

    jobs, chosen = checked(common), named_data(data, common.split, common.quick)
    files, settings = networks_in(networks, NETWORKS), tracker_settings(half_life)
    with progress_over([chosen]) as advance:
        sums, census = measure_smoothness(chosen, files, model, settings, jobs, advance)
    finish(smoothness_report(sums, census, chosen), common)


def reliability(data: str, model: Path | None = None, common: Flat[Common] = Common()) -> None:
    """The error that the predictor expects of hidden joints beside the true one, in ten bins of equal count.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        model: A network written by `bodysense train body-gru`; the packaged one if omitted.
        common: Common options.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.reliability import measure_reliability, reliability_report

    jobs, chosen = checked(common), named_data(data, common.split, common.quick)
    with progress_over([chosen]) as advance:
        pairs, census = measure_reliability(chosen, model, jobs, advance)
    finish(reliability_report(pairs, census, chosen), common)


def transitions(
    data: str, model: Path | None = None, half_life: float | None = None, common: Flat[Common] = Common()
) -> None:
    """How jerky the second is in which a joint is lost, or seen again: before and after smoothing, and what it costs.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        model: A network written by `bodysense train body-gru`; the packaged one if omitted.
        half_life: half-life of the tracker's smoother in seconds; its own if omitted.
        common: Common options.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.transitions import measure_transitions, transitions_report

    jobs, chosen = checked(common), named_data(data, common.split, common.quick)
    with progress_over([chosen]) as advance:
        found, census = measure_transitions(chosen, model, tracker_settings(half_life), jobs, advance)
    finish(transitions_report(found, census, chosen), common)


def finger_synthesis(
    data: str,
    split: Literal["train", "val", "test", "all"] = "test",
    model: Path | None = None,
    json: Path | None = None,
) -> None:
    """Score finger synthesis (UNOC, Table 5, right) beside the mean hand and the hand of the nearest body.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it. Its clips with fingers are scored, and
            both baselines know those of its train split.
        split: people or actions to score.
        model: A network written by `bodysense train fingers`; the packaged one if omitted.
        json: Write the numbers here, as one flat object.
    """
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.finger_scores import evaluate_finger_synthesis, examples_of
    from bodysense.lab.unoc.point_model import load_point_model

    if json is not None:
        check_place(json)
    scored, known, network = named_data(data, split), named_data(data, "train"), load_point_model("fingers", model)
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
    from bodysense.lab.datasets import set_name

    result = {}
    for pair in pairs:
        name, equals, path = pair.partition("=")
        if not (name and equals and path):
            raise BodysenseError(f"{option} {pair!r}: write NAME=PATH, the name of the data set that it was trained on")
        result[set_name(name)] = Path(path)
    return result


def _network_table(
    table: NetworkTable, data: str, networks: Path | None, shipped: Shipped | None, stride: int, common: Common
) -> None:
    """Score what is not scored yet, and report."""
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.tables import OWN_NAMES, network_report
    from bodysense.lab.unoc.variant_scores import Work, networks_in, score

    jobs = checked(common, stride)
    chosen = named_data(data, common.split, common.quick)
    if networks is None:
        table = table.only(OWN_NAMES)
    files = {} if networks is None else networks_in(networks, [n for n in table.methods if n not in OWN_NAMES])
    with progress_over([chosen]) as advance:
        scores = score(chosen, networks or common.out, Work(files, shipped, stride), jobs, advance)
    finish(network_report(table, scores, chosen), common)
