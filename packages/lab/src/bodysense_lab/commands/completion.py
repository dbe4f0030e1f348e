"""`bodysense train completion`, `completion-fingers` and `bodysense evaluate completion`, `fingers`, `holes`."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense_lab.commands.reporting import check_places, finish, open_data, progress_over, show
from bodysense_lab.completion.options import (
    AmassEvaluation,
    CompletionEvaluation,
    CompletionTraining,
    FingerTraining,
    HoleEvaluation,
    JoiningTraining,
    SightEvaluation,
    UntrackedFingerEvaluation,
)
from bodysense_lab.options import Flat


def completion(run: Flat[CompletionTraining]) -> None:
    """Train the completion network, make its expected errors true, and write both networks as one .safetensors file.

    Training resumes from the checkpoints in the folder of the run. The 6200 steps take an hour and a half of one core.
    """
    from bodysense_lab.completion.publish import publish, rounded
    from bodysense_lab.completion.task import CompletionTask
    from bodysense_lab.completion.train import fingers_of_completion, train_completion
    from bodysense_lab.fit import announced

    check_place(run.out)
    fabric = announced(run, CompletionTask)
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
    from bodysense_lab.fit import announced

    check_place(run.out)
    fabric = announced(run, FingerTask)
    train_fingers(run, fabric)
    fabric.print(f"wrote {run.out}")


def completion_joining(run: Flat[JoiningTraining]) -> None:
    """Train the network that joins the two answers of a take, and write it as one .safetensors file.

    The takes are completed first, in both directions, by the packaged networks. Training resumes from its checkpoint in
    the folder of the run, which also keeps the takes.
    """
    from bodysense_lab.completion.joining_task import JoiningTask, train_joining, write_joining
    from bodysense_lab.fit import announced

    check_place(run.out)
    fabric = announced(run, JoiningTask)
    network = train_joining(run, fabric)
    if not fabric.is_global_zero:
        return
    card = {"training_data": run.data_note or str(run.data.name), "licence": run.licence}
    write_joining(network, run.out, card | {"seed": run.schedule.seed, "steps": run.schedule.steps})
    print(f"wrote {run.out}")


def completion_table(run: Flat[CompletionEvaluation]) -> None:
    """Score the tracker on any sensors and proportions: errors, motion, feet, confidence, lattice of sensors."""
    from rich.progress import Progress

    from bodysense.cli.show import wide_console, write_numbers
    from bodysense_lab.commands.reporting import print_report
    from bodysense_lab.completion.baselines import cached_mean_body
    from bodysense_lab.completion.kept import KeptClips
    from bodysense_lab.completion.reliability import draw_reliability
    from bodysense_lab.completion.scoring import evaluate_completion, work_of
    from bodysense_lab.completion.tables import CompletionSettings, completion_reports
    from bodysense_lab.completion.tracking import TakenBy, TrackedBy, step_times
    from bodysense_lab.completion.worst import draw_worst
    from bodysense_lab.datasets import Census, census_of, named_data, open_clips
    from bodysense_lab.spread import spread
    from bodysense_lab.table import write_csv

    check_places(*run.outputs)
    track = TrackedBy(run.model)
    takes = TakenBy(run.model, run.backward_model, run.joining_model) if run.takes else None
    _ = track.network, takes and takes.networks  # refuses files of other things before any work
    chosen, census = named_data(run.data, run.split), Census()
    settings = CompletionSettings(run.split, run.sets, run.bodies, 200 if run.lattice else 0, run.takes)
    network = "packaged" if run.model is None else str(run.model.resolve())
    kept = None if run.keep is None else KeptClips.open(run.keep, settings, network)
    total = chosen.count()
    count = min(total, run.limit or total)
    with Progress() as progress:
        bar = progress.add_task("reading", total=count)
        clips = []
        for clip in open_clips(chosen.path, run.split, at_most=run.limit):
            census += census_of(clip)
            clips.append(clip)
            progress.advance(bar)
        mean_body = None
        if "headset_camera" in settings.sets:
            bar = progress.add_task("averaging bodies", total=None)
            mean_body = cached_mean_body(chosen.path, lambda clip: progress.advance(bar))
            progress.update(bar, total=1, completed=1)
        bar = progress.add_task("scoring", total=work_of(len(clips), settings))

        def advance(done: int, what: str) -> None:
            progress.update(bar, advance=done, description=f"scored {what}")

        table = evaluate_completion(
            clips,
            settings,
            track=track,
            takes=takes,
            times=partial(step_times, network=track.network),
            spread=partial(spread, jobs=run.jobs or os.cpu_count() or 1, scheduler=run.scheduler),
            mean_body=mean_body,
            kept=kept,
            advance=advance,
        )
    console = wide_console()
    reports = completion_reports(table, census, chosen, total)
    for report in reports:
        print_report(report, console)
    write_numbers(run.json, reports[0].numbers, timed=kept is None or not kept.resumed)
    if run.csv is not None:
        write_csv(run.csv, reports[1])
    if run.picture is not None:
        draw_reliability(run.picture, table)
    if run.sheet is not None:
        draw_worst(run.sheet, table.worst, clips, settings, track, run.worst, run.worst_by)
    for path in run.outputs:
        console.print(f"wrote {path}", highlight=False)


def amass_p1(run: Flat[AmassEvaluation]) -> None:
    """Score three points on AMASS by AvatarPoser's protocol 1, next to published figures."""
    from rich.progress import track as progress_of

    from bodysense.cli.show import wide_console, write_numbers
    from bodysense_lab.amass_p1 import listed_sources, mpjpe_interval, report_of, score_source
    from bodysense_lab.commands.reporting import print_report
    from bodysense_lab.completion.tables import sample_remark
    from bodysense_lab.completion.tracking import TrackedBy
    from bodysense_lab.datasets import spread_evenly
    from bodysense_lab.spread import spread

    check_places(run.json)
    listed, missing = listed_sources(run.amass, run.split_lists)
    test = [source for source in listed if source.split == "test"]
    chosen = spread_evenly(test, run.limit)
    work = partial(score_source, model=run.smpl_model, track=TrackedBy(run.model))
    scores = [one for _, one in progress_of(spread(work, chosen, run.jobs), "scoring", len(chosen))]
    remarks = [f"{len(chosen)} of {len(test)} test clips in {run.amass}."]
    if len(chosen) < len(test):
        people = [source.person for source in chosen]
        remarks.append(sample_remark(len(chosen), len(test), "MPJPE", mpjpe_interval(people, scores)))
    if missing:
        remarks.append(f"{missing} of the files in the lists are not there.")
    if run.smpl_model is None:
        remarks.append("The default body instead of the published one: compare with --smpl-model male/model.npz only.")
    report = report_of(scores, remarks, "packaged" if run.model is None else run.model.name)
    print_report(report, wide_console())
    write_numbers(run.json, report.numbers | {"clips_in_split": float(len(test))})


def sight(run: Flat[SightEvaluation]) -> None:
    """Score scripted wearers who stand, sit, raise their arms or take rare poses, and heads of real headsets."""
    from rich.console import Console

    from bodysense_lab.completion.tracking import TrackedBy
    from bodysense_lab.completion.wearer_scores import score_wearers, sight_report

    check_places(run.json)
    with Console().status("tracking …"):
        scores = score_wearers(TrackedBy(run.model).network, run.headset)
    show(sight_report(scores), run.json)


def untracked_fingers(run: Flat[UntrackedFingerEvaluation]) -> None:
    """Score fingers that are not tracked, each network on the person without whom it was trained."""
    from bodysense_lab.completion.corpus import read_corpus
    from bodysense_lab.completion.finger_scores import finger_report, load_finger_network, score_fingers

    check_places(run.json)
    loaded = {path.name: load_finger_network(path) for path in run.networks}
    scored, learned = (read_corpus(run.data, part) for part in (run.split, "train"))
    for name, (_, task) in loaded.items():
        if not task.left_out or not len(scored.finger_clips(task.left_out)[0]):
            raise BodysenseError(
                f"{name}: left out {task.left_out or 'no one'!r}, "
                f"who has no fingers in the {run.split} split of {run.data}; "
                "give networks trained with --leave-out NAME of someone who has"
            )
    show(finger_report(score_fingers(loaded, scored, learned), f"{run.data.name}, {run.split}"), run.json)


def holes(run: Flat[HoleEvaluation]) -> None:
    """Score filled holes of 0.1 to 10 s, of limbs, upper body or fingers, against interpolation and live tracking."""
    from bodysense_lab.datasets import open_clips
    from bodysense_lab.holes import PARTS, report_of, score_holes

    source = open_data(run.data, run.table)
    total = source.count()
    count = min(total, 6 if run.table.quick else run.clips or total)
    with progress_over([source], count) as advance:
        clips = open_clips(source.path, source.split, at_most=count)
        gaps = score_holes(clips, parts=run.parts or tuple(PARTS), advance=advance)
    report = report_of(gaps, source.name)
    numbers = report.numbers | {"clips": float(count), "clips_in_split": float(total)}
    finish(replace(report, numbers=numbers), run.table)
