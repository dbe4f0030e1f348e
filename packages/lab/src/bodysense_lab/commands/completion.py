"""`bodysense train completion`, `completion-fingers` and `bodysense evaluate completion`, `fingers`, `holes`."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.ranges import Count, Processes
from bodysense_lab.commands.reporting import (
    check_places,
    finish,
    open_data,
    print_report,
    progress_bar,
    show,
    with_progress_bar,
)
from bodysense_lab.completion.options import (
    BODIES,
    TABLE_SETS,
    Body,
    CompletionTraining,
    Fault,
    FingerTraining,
    JoiningTraining,
)
from bodysense_lab.options import Data, Flat, Json, Split, Table, TableOptions, check_ending

Network = Annotated[Path | None, tyro.conf.arg(help="completion network of your own; the packaged one if omitted")]


def completion(run: Flat[CompletionTraining]) -> None:
    """Train the completion network, make its expected errors true, and write both networks as one .safetensors file.

    Training resumes from the checkpoints in the folder of the run. The 6200 steps take an hour and a half of one core.
    """
    from bodysense_lab.completion.publish import publish, rounded
    from bodysense_lab.completion.task import CompletionTask
    from bodysense_lab.completion.train import fingers_of_completion, train_completion
    from bodysense_lab.fit import announce_run

    check_place(run.out)
    fabric = announce_run(run, CompletionTask)
    body = train_completion(run, fabric)
    fingers = fingers_of_completion(run, fabric)
    if not fabric.is_global_zero:
        return
    card = {"training_data": run.data_note or str(run.data.name), "licence": run.licence}
    card |= {"backward": run.backward, "seed": run.schedule.seed, "steps": run.schedule.steps}
    body = rounded(body.eval(), run.data, run.limit, run.backward)
    publish(body, fingers.eval(), run.data, run.out, card, run.limit, run.backward)
    print(f"wrote {run.out}")


def completion_fingers(run: Flat[FingerTraining]) -> None:
    """Train the finger network of the completion network alone, so that it can be scored on people it does not know.

    Training resumes from its checkpoint, the .ckpt that is written.
    """
    from bodysense_lab.completion.task import FingerTask
    from bodysense_lab.completion.train import train_fingers
    from bodysense_lab.fit import announce_run

    check_place(run.out)
    fabric = announce_run(run, FingerTask)
    train_fingers(run, fabric)
    fabric.print(f"wrote {run.out}")


def completion_joining(run: Flat[JoiningTraining]) -> None:
    """Train the network that joins the two answers of a take, and write it as one .safetensors file.

    The takes are completed first, in both directions, by the packaged networks. Training resumes from its checkpoint in
    the folder of the run, which also keeps the takes.
    """
    from bodysense_lab.completion.joining_task import JoiningTask, train_joining, write_joining
    from bodysense_lab.fit import announce_run

    check_place(run.out)
    fabric = announce_run(run, JoiningTask)
    network = train_joining(run, fabric)
    if not fabric.is_global_zero:
        return
    card = {"training_data": run.data_note or str(run.data.name), "licence": run.licence}
    write_joining(network, run.out, card | {"seed": run.schedule.seed, "steps": run.schedule.steps})
    print(f"wrote {run.out}")


def completion_table(
    data: Data,
    split: Split = "test",
    sets: tuple[str, ...] = TABLE_SETS,
    bodies: tuple[Body, ...] = BODIES,
    limit: Count | None = None,
    model: Network = None,
    backward_model: Path | None = None,
    joining_model: Path | None = None,
    lattice: bool = False,
    takes: bool = False,
    keep: Path | None = None,
    jobs: Processes | None = None,
    scheduler: str | None = None,
    json: Json = None,
    csv: Path | None = None,
    picture: Path | None = None,
    worst: Count = 12,
    worst_by: Fault = "error",
    sheet: Path | None = None,
) -> None:
    """Score the tracker on any sensors and proportions: errors, motion, feet, confidence, lattice of sensors.

    Args:
        split: people, and unseen bodies, to score.
        sets: sensor sets.
        bodies: proportions: the recording's, or an unseen body's of which all, the height or nothing is known.
        limit: number of clips, spread evenly, for a sample with its intervals; all if omitted.
        backward_model: completion network of your own for time that runs backward, in takes; MODEL if omitted.
        joining_model: joining network of your own, in takes; the packaged one if omitted.
        lattice: score 200 random edges of the lattice of sensor sets as well, which takes as long as half of all clips.
        takes: score takes as well, completed with past and future, which takes three times as long.
        keep: folder that keeps the results of every clip; clips that are in it are not scored again.
        jobs: processes; all processors if omitted. Steps are timed afterwards, alone.
        scheduler: address of a Dask scheduler to run on instead of this machine, like tcp://host:8786.
        csv: file for the table of all measures.
        picture: file for the reliability diagram (PNG).
        worst: number of frames on the sheet, at most one of a clip.
        worst_by: frames on the sheet: those with the largest mean error, or the largest leap of a joint within a frame.
        sheet: file for a sheet of the worst frames, truth next to result (PNG).
    """
    from bodysense.cli.show import wide_console, write_numbers
    from bodysense_lab.clips import open_clips
    from bodysense_lab.completion.baselines import cached_mean_body
    from bodysense_lab.completion.kept import KeptClips
    from bodysense_lab.completion.reliability import draw_reliability
    from bodysense_lab.completion.scoring import evaluate_completion, work_of
    from bodysense_lab.completion.tables import CompletionSettings, completion_reports
    from bodysense_lab.completion.tracking import TakenBy, TrackedBy, step_times
    from bodysense_lab.completion.worst import draw_worst
    from bodysense_lab.datasets import Census, census_of, open_data_set
    from bodysense_lab.parallel import parallel_map
    from bodysense_lab.table import write_csv

    _check_choice(sets, bodies, takes, backward_model, joining_model)
    for path in filter(None, (picture, sheet)):
        check_ending(path, ".png", what="a picture")
    check_places(json, csv, picture, sheet)
    track = TrackedBy(model)
    both_ways = TakenBy(model, backward_model, joining_model) if takes else None
    _ = track.network, both_ways and both_ways.networks  # refuses files of other things before any work
    chosen = open_data_set(data, split)
    settings = CompletionSettings(split, sets, bodies, 200 if lattice else 0, takes)
    network = "packaged" if model is None else str(model.resolve())
    kept = None if keep is None else KeptClips.open(keep, settings, network)
    total = chosen.count()
    clips = list(with_progress_bar(open_clips(chosen.path, split, at_most=limit), "read", min(total, limit or total)))
    census = sum(map(census_of, clips), start=Census())
    mean_body = None
    if "headset_camera" in sets:
        with progress_bar("averaging bodies") as advance:
            mean_body = cached_mean_body(chosen.path, advance)
    with progress_bar("scored", work_of(len(clips), settings)) as advance:
        table = evaluate_completion(
            clips,
            settings,
            track=track,
            takes=both_ways,
            times=partial(step_times, network=track.network),
            parallel_map=partial(parallel_map, jobs=jobs or os.cpu_count() or 1, scheduler=scheduler),
            mean_body=mean_body,
            kept=kept,
            advance=lambda done, what: advance(what, done),
        )
    console = wide_console()
    reports = completion_reports(table, census, chosen, total)
    for report in reports:
        print_report(report, console)
    write_numbers(json, reports[0].numbers, timed=kept is None or not kept.resumed)
    if csv is not None:
        write_csv(csv, reports[1])
    if picture is not None:
        draw_reliability(picture, table)
    if sheet is not None:
        draw_worst(sheet, table.worst, clips, settings, track, worst, worst_by)
    for path in filter(None, (json, csv, picture, sheet)):
        console.print(f"wrote {path}", highlight=False)


def _check_choice(
    sets: tuple[str, ...], bodies: tuple[Body, ...], takes: bool, backward: Path | None, joining: Path | None
) -> None:
    """Raise BodysenseError if there is nothing to score, or a network for takes that are not asked for."""
    unknown = [name for name in sets if name not in SENSOR_SETS]
    if unknown:
        raise BodysenseError(f"--sets {unknown[0]}: unknown; valid are {', '.join(SENSOR_SETS)}")
    if backward is not None and not takes:
        raise BodysenseError("--backward-model: only takes are tracked backward in time; give --takes as well")
    if joining is not None and not takes:
        raise BodysenseError("--joining-model: only takes have two answers to join; give --takes as well")
    if not bodies:
        raise BodysenseError(f"--bodies: give at least one of {', '.join(BODIES)}")


def amass_p1(
    amass: Path,
    split_lists: Path,
    smpl_model: Path | None = None,
    model: Path | None = None,
    limit: Count | None = None,
    jobs: Processes = 1,
    json: Json = None,
) -> None:
    """Score three points on AMASS by AvatarPoser's protocol 1, next to published figures.

    Args:
        amass: folder of AMASS, with CMU, BMLrub (BioMotionLab_NTroje) and HDM05 (MPI_HDM05).
        split_lists: folder data_split of a clone of github.com/eth-siplab/AvatarPoser.
        smpl_model: SMPL-H model whose mean body everybody has, as published: male/model.npz; the default body if
            omitted.
        model: completion network of your own; the packaged one, which did not learn from these lists, if omitted.
        limit: number of clips, spread evenly; all if omitted.
        jobs: processes.
    """
    from bodysense_lab.amass_p1 import listed_sources, mpjpe_interval, protocol_report, score_source
    from bodysense_lab.clips import spread_evenly
    from bodysense_lab.completion.tables import sample_remark
    from bodysense_lab.completion.tracking import TrackedBy
    from bodysense_lab.parallel import parallel_map

    check_places(json)
    listed, missing = listed_sources(amass, split_lists)
    test = [source for source in listed if source.split == "test"]
    chosen = spread_evenly(test, limit)
    work = partial(score_source, model=smpl_model, track=TrackedBy(model))
    scores = [one for _, one in with_progress_bar(parallel_map(work, chosen, jobs), "scored", len(chosen))]
    remarks = [f"{len(chosen)} of {len(test)} test clips in {amass}."]
    if len(chosen) < len(test):
        people = [source.person for source in chosen]
        remarks.append(sample_remark(len(chosen), len(test), "MPJPE", mpjpe_interval(people, scores)))
    if missing:
        remarks.append(f"{missing} of the files in the lists are not there.")
    if smpl_model is None:
        remarks.append("The default body instead of the published one: compare with --smpl-model male/model.npz only.")
    report = protocol_report(scores, remarks, "packaged" if model is None else model.name)
    show(replace(report, numbers=report.numbers | {"clips_in_split": float(len(test))}), json)


def sight(headset: Path | None = None, model: Network = None, json: Json = None) -> None:
    """Score scripted wearers who stand, sit, raise their arms or take rare poses, and heads of real headsets.

    Args:
        headset: folder of recorded headsets (headset_takes.npz); these rows are left out if omitted.
    """
    from rich.console import Console

    from bodysense_lab.completion.tracking import TrackedBy
    from bodysense_lab.completion.wearer_scores import score_wearers, sight_report

    check_places(json)
    with Console().status("tracking …"):
        scores = score_wearers(TrackedBy(model).network, headset)
    show(sight_report(scores), json)


def untracked_fingers(
    data: Path,
    networks: tuple[Path, ...],
    split: Literal["train", "val", "test"] = "test",
    json: Json = None,
) -> None:
    """Score fingers that are not tracked, each network on the person without whom it was trained.

    Args:
        data: folder of motion with splits; its train split makes the mean hand of the baseline.
        networks: checkpoints of `bodysense train completion-fingers --leave-out NAME`.
        split: which clips of these people.
    """
    from bodysense_lab.completion.corpus import read_corpus
    from bodysense_lab.completion.finger_scores import finger_report, load_finger_network, score_fingers

    check_places(json)
    loaded = {path.name: load_finger_network(path) for path in networks}
    scored, learned = (read_corpus(data, part) for part in (split, "train"))
    for name, (_, task) in loaded.items():
        if not task.left_out or not len(scored.finger_clips(task.left_out)[0]):
            raise BodysenseError(
                f"{name}: left out {task.left_out or 'no one'!r}, who has no fingers in the {split} split of {data}; "
                "give networks trained with --leave-out NAME of someone who has"
            )
    show(finger_report(score_fingers(loaded, scored, learned), f"{data.name}, {split}"), json)


def holes(
    data: Data,
    clips: Count | None = None,
    parts: tuple[Literal["arm", "leg", "legs", "upper_body", "fingers"], ...] = (),
    table: Table = TableOptions(),
) -> None:
    """Score filled holes of 0.1 to 10 s, of limbs, upper body or fingers, against interpolation and live tracking.

    Args:
        clips: number of clips, spread evenly; all if omitted.
        parts: parts of the body to remove; all if omitted.
    """
    from bodysense_lab.clips import open_clips
    from bodysense_lab.holes import PARTS, protocol_report, score_holes

    source = open_data(data, table)
    total = source.count()
    count = min(total, 6 if table.quick else clips or total)
    with progress_bar("scored", count) as advance:
        chosen = open_clips(source.path, source.split, at_most=count)
        gaps = score_holes(chosen, parts=parts or tuple(PARTS), advance=advance)
    report = protocol_report(gaps, source.name)
    numbers = report.numbers | {"clips": float(count), "clips_in_split": float(total)}
    finish(replace(report, numbers=numbers), table)
