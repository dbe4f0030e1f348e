"""`bodysense train completion`, `completion-fingers`; `evaluate completion`, `fingers`, `holes`, `repair` …"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

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
from bodysense_lab.completion.training.options import (
    CompletionTraining,
    EvaluationFiles,
    EvaluationNetworks,
    EvaluationScope,
    EvaluationWork,
    FingerTraining,
    JoiningTraining,
    KindsScope,
)
from bodysense_lab.core.options import Data, Flat, Json, Table, TableOptions

_PAIRS = 4  # pairs that a process scores at a time
SceneSetName = Literal[
    "head",
    "three_point",
    "hands_in_view",
    "lost_hands",
    "headset_camera",
    "six_point",
    "head_unknown",
    "three_point_unknown",
]
Network = Annotated[Path | None, tyro.conf.arg(help="completion network of your own; the packaged one if omitted")]


def completion(run: Flat[CompletionTraining]) -> None:
    """Train the completion network, make its expected errors true, and write both networks as one .safetensors file.

    Training resumes from the checkpoints in the folder of the run. The 6200 steps take an hour and a half of one core.
    """
    from bodysense_lab.completion.data.corpus_cache import read_corpus
    from bodysense_lab.completion.networks.publish import publish, round_network
    from bodysense_lab.completion.train import completion_finger_network, train_completion
    from bodysense_lab.completion.training.task import CompletionTask
    from bodysense_lab.core.fit import announce_run

    check_place(run.out)
    fabric = announce_run(run, CompletionTask)
    corpora = partial(read_corpus, run.data, limit=run.limit)
    body = train_completion(run, fabric, corpora)
    fingers = completion_finger_network(run, fabric, corpora)
    if not fabric.is_global_zero:
        return
    card = {"training_data": run.data_note or str(run.data.name), "licence": run.licence}
    card |= {
        "reads_unplaced_head": True,
        "backward": run.backward,
        "seed": run.schedule.seed,
        "steps": run.schedule.steps,
    }
    body = round_network(body.eval(), run.data, run.limit, run.backward)
    publish(body, fingers.eval(), run.data, run.out, card, run.limit, run.backward)
    print(f"wrote {run.out}")


def completion_fingers(run: Flat[FingerTraining]) -> None:
    """Train the finger network of the completion network alone, so that it can be scored on people it does not know.

    Training resumes from its checkpoint, the .ckpt that is written.
    """
    from bodysense_lab.completion.data.corpus_cache import read_corpus
    from bodysense_lab.completion.train import train_fingers
    from bodysense_lab.completion.training.task import FingerTask
    from bodysense_lab.core.fit import announce_run

    check_place(run.out)
    fabric = announce_run(run, FingerTask)
    train_fingers(run, fabric, partial(read_corpus, run.data, limit=run.limit))
    fabric.print(f"wrote {run.out}")


def completion_joining(run: Flat[JoiningTraining]) -> None:
    """Train the network that joins the two answers of a take, and write it as one .safetensors file.

    The takes are completed first, in both directions, by the packaged networks. Training resumes from its checkpoint in
    the folder of the run, which also keeps the takes.
    """
    from bodysense_lab.completion.training.joining_task import JoiningTask, train_joining, write_joining
    from bodysense_lab.core.fit import announce_run

    check_place(run.out)
    fabric = announce_run(run, JoiningTask)
    network = train_joining(run, fabric)
    if not fabric.is_global_zero:
        return
    card = {"training_data": run.data_note or str(run.data.name), "licence": run.licence}
    write_joining(network, run.out, card | {"seed": run.schedule.seed, "steps": run.schedule.steps})
    print(f"wrote {run.out}")


def completion_table(
    scope: Flat[EvaluationScope],
    networks: Flat[EvaluationNetworks],
    work: Flat[EvaluationWork],
    files: Flat[EvaluationFiles],
) -> None:
    """Score the tracker on any sensors and proportions: errors, motion, feet, confidence."""
    from bodysense.cli.show import wide_console, write_numbers
    from bodysense.parallel import parallel_map
    from bodysense_lab.completion.score.baselines import cached_mean_body, count_of_split
    from bodysense_lab.completion.score.clip_results import ClipResults
    from bodysense_lab.completion.score.scoring import evaluate_completion, work_of
    from bodysense_lab.completion.score.tables import CompletionSettings, completion_reports
    from bodysense_lab.completion.score.tracking import PeopleTracker, TakeTracker, step_times
    from bodysense_lab.completion.score.worst import draw_worst
    from bodysense_lab.core.table import write_csv
    from bodysense_lab.data.clips import open_clips
    from bodysense_lab.data.datasets import Census, census_of, open_data_set

    if networks.backward_model is not None and not scope.takes:
        raise BodysenseError("--backward-model: only takes are tracked backward in time; give --takes as well")
    if networks.joining_model is not None and not scope.takes:
        raise BodysenseError("--joining-model: only takes have two answers to join; give --takes as well")
    check_places(files.json, files.csv, files.sheet)
    track = PeopleTracker(networks.model)
    take_tracker = None
    if scope.takes:
        take_tracker = TakeTracker(networks.model, networks.backward_model, networks.joining_model)
    _ = track.network, take_tracker and take_tracker.networks  # refuse other files before any work
    data = open_data_set(scope.data, scope.split)
    settings = CompletionSettings(scope.split, scope.sets, scope.bodies, scope.takes)
    network = "packaged" if networks.model is None else str(networks.model.resolve())
    results = None if work.keep is None else ClipResults.open(work.keep, settings, network)
    total = data.count()
    clips = list(
        with_progress_bar(
            open_clips(data.path, scope.split, at_most=scope.limit), "read", min(total, scope.limit or total)
        )
    )
    census = sum(map(census_of, clips), start=Census())
    mean_body = None
    if "headset_camera" in scope.sets and scope.mean_body:
        with progress_bar("averaging bodies", count_of_split(data.path, "train")) as advance:
            mean_body = cached_mean_body(data.path, advance)
    with progress_bar("scored", work_of(len(clips), settings)) as advance:
        table = evaluate_completion(
            clips,
            settings,
            track=track,
            takes=take_tracker,
            times=partial(step_times, network=track.network),
            parallel_map=partial(parallel_map, jobs=work.jobs or os.cpu_count() or 1, scheduler=work.scheduler),
            mean_body=mean_body,
            results=results,
            advance=lambda done, what: advance(what, done),
        )
    console = wide_console()
    reports = completion_reports(table, census, data, total)
    for report in reports:
        print_report(report, console)
    write_numbers(files.json, reports[0].numbers, timed=results is None or not results.resumed)
    if files.csv is not None:
        write_csv(files.csv, reports[1])
    if files.sheet is not None:
        draw_worst(files.sheet, table.worst, clips, settings, track, files.worst, files.worst_by)
    for path in filter(None, (files.json, files.csv, files.sheet)):
        console.print(f"wrote {path}", highlight=False)


def kinds(scope: Flat[KindsScope]) -> None:
    """Score kinds of signals: named and random sets, each without its head, its rotations or its positions.

    Random pairs of a set and the same set with one more sensor show whether a sensor ever makes the body worse.
    """
    from bodysense.parallel import parallel_map
    from bodysense_lab.completion.kinds.kind_scores import kind_jobs, kind_report, score_all
    from bodysense_lab.completion.kinds.lattice import random_edges
    from bodysense_lab.completion.kinds.lattice_scores import FRAMES, choose_scenes, score_lattice
    from bodysense_lab.completion.score.scenes import scene_of
    from bodysense_lab.completion.score.tracking import PeopleTracker
    from bodysense_lab.core.scoring import RATE
    from bodysense_lab.data.clips import open_clips
    from bodysense_lab.data.datasets import open_data_set

    check_places(scope.json)
    track = PeopleTracker(scope.model)
    _ = track.network  # refuse other files before any work
    data = open_data_set(scope.data, scope.split)
    long = [clip for clip in open_clips(data.path, scope.split) if clip.seconds >= FRAMES / RATE]
    chosen = choose_scenes([scene_of(clip, "stranger", scope.split) for clip in long], scope.clips)
    jobs, edges = kind_jobs(scope.members), random_edges(scope.pairs)
    share = partial(parallel_map, jobs=scope.jobs or os.cpu_count() or 1)
    with progress_bar("scored", len(jobs) + len(edges)) as advance:
        scores = score_all(jobs, chosen, track, share, advance)
        groups = [edges[first : first + _PAIRS] for first in range(0, len(edges), _PAIRS)]
        pairs = []
        for group, found in share(partial(score_lattice, scenes=chosen, track=track), groups):
            pairs.extend(found)
            advance("pairs", len(group))
    show(kind_report(scores, pairs, f"{data.name}, {scope.split}", len(chosen)), scope.json)


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
    from bodysense.parallel import parallel_map
    from bodysense_lab.completion.score.amass_p1 import listed_sources, mpjpe_interval, protocol_report, score_source
    from bodysense_lab.completion.score.tables import sample_remark
    from bodysense_lab.completion.score.tracking import PeopleTracker
    from bodysense_lab.data.clips import spread_evenly

    check_places(json)
    listed, missing = listed_sources(amass, split_lists)
    test = [source for source in listed if source.split == "test"]
    chosen = spread_evenly(test, limit)
    work = partial(score_source, model=smpl_model, track=PeopleTracker(model))
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


def scenes(
    split: Literal["val", "test"] = "test",
    scenes: Count = 4,
    sets: tuple[SceneSetName, ...] = (),
    kinds: tuple[str, ...] = (),
    headset: Path | None = None,
    model: Network = None,
    sheet: Path | None = None,
    jobs: Processes | None = None,
    json: Json = None,
) -> None:
    """Score scripted people at home, who step, turn, bow, kneel, sit and reach, by sets of sensors.

    Args:
        split: seeds of the scenes; networks are compared on `val`.
        scenes: scenes of each kind.
        sets: sets of sensors; all if omitted.
        kinds: kinds of scenes; all if omitted.
        headset: folder of recorded headsets (headset_takes.npz); left out if omitted.
        sheet: picture (PNG) of a scene of each kind, tracked by three points: the truth over the result.
        jobs: processes; one for each core if omitted.
    """
    from bodysense.cli.show import wide_console, write_numbers
    from bodysense.parallel import parallel_map
    from bodysense_lab.completion.score.scripted.scene_scoring import SETS, SceneWork, scene_jobs, score_headsets
    from bodysense_lab.completion.score.scripted.scene_strips import draw_strips
    from bodysense_lab.completion.score.scripted.scene_tables import merge_scores, scene_numbers, scene_reports
    from bodysense_lab.completion.score.tracking import PeopleTracker
    from bodysense_lab.synthesis.scenes import KINDS

    check_places(json, sheet)
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise BodysenseError(f"--kinds {unknown[0]}: no scene of this kind; give some of {', '.join(KINDS)}")
    track = PeopleTracker(model)
    _ = track.network  # refuse other files before any work
    headsets = {} if headset is None else dict(score_headsets(headset, track))  # first: it refuses other folders
    chosen = kinds or tuple(KINDS)
    todo = scene_jobs(split, chosen, scenes)
    done = parallel_map(SceneWork(track, sets or tuple(SETS)), todo, jobs or os.cpu_count() or 1)
    scored = merge_scores(with_progress_bar(done, "scored", len(todo)))
    console = wide_console()
    for report in scene_reports(scored, headsets, f"{split}, {scenes} of each kind"):
        print_report(report, console)
    write_numbers(json, scene_numbers(scored, headsets))
    if sheet is not None:
        draw_strips(sheet, scene_jobs(split, chosen, 1), "three_point", track)
        console.print(f"wrote {sheet}", highlight=False)


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
    from bodysense_lab.completion.data.corpus_cache import read_corpus
    from bodysense_lab.completion.score.finger_scores import finger_report, load_finger_network, score_fingers

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
    from bodysense_lab.completion.score.holes import PARTS, holes_report, score_holes
    from bodysense_lab.data.clips import open_clips

    source = open_data(data, table)
    total = source.count()
    count = min(total, 6 if table.quick else clips or total)
    with progress_bar("scored", count) as advance:
        chosen = open_clips(source.path, source.split, at_most=count)
        gaps = score_holes(chosen, parts=parts or tuple(PARTS), advance=advance)
    report = holes_report(gaps, source.name)
    numbers = report.numbers | {"clips": float(count), "clips_in_split": float(total)}
    finish(replace(report, numbers=numbers), table)


def repair_table(
    data: Data,
    clips: Count | None = None,
    table: Table = TableOptions(),
) -> None:
    """Make spikes, frozen limbs, swapped limbs and sliding feet in true motion; score what is found and repaired.

    Args:
        clips: number of clips, spread evenly; all if omitted.
    """
    from bodysense_lab.completion.defects.repair_scores import repair_report, score_repair
    from bodysense_lab.data.clips import open_clips

    source = open_data(data, table)
    total = source.count()
    count = min(total, 4 if table.quick else clips or total)
    with progress_bar("scored", count) as advance:
        scores = score_repair(open_clips(source.path, source.split, at_most=count), advance=advance)
    report = repair_report(scores, source.name)
    finish(replace(report, numbers=report.numbers | {"clips": float(count)}), table)
