"""`bodysense study`: user studies of which completed motion looks more natural."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.files import check_place, make_folder
from bodysense.io.reading_options import AS_FOUND
from bodysense.ranges import Count, Processes, Seed
from bodysense_lab.commands.reporting import check_places, progress_bar
from bodysense_lab.core.options import Json, Output, Seconds

KeyFile = Annotated[Path, tyro.conf.Positional]


def commands() -> SubcommandApp:
    """Return the group's commands."""
    group = SubcommandApp()
    for command in (build, analyze, simulate):
        group.command(command)
    return group


def build(
    out: Annotated[Path, tyro.conf.Positional],
    clips: tuple[Path, ...] = (),
    seconds: Seconds = 6.0,
    scenes: Count = 8,
    model: Path | None = None,
    seed: Seed = 0,
    jobs: Processes | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Make a study: the page for raters, and the key to its animations (docs/study.md).

    Args:
        out: new folder; serve site/, and keep key.json secret.
        clips: motion files (.bvh, AMASS .npz); the packaged performance if omitted.
        seconds: maximum length of a scene; longer clips are cut into scenes of equal length.
        scenes: maximum number of scenes, drawn at random; each rater sees three pairs of each.
        model: network written by `bodysense train`; the packaged one if omitted.
        seed: random seed of names and scenes.
        jobs: processes; all processors if omitted.
        reading: properties that the motion files do not contain.
    """
    import numpy as np

    from bodysense.cli.recordings import load_clip
    from bodysense.demo import packaged_performance
    from bodysense_lab.study.scenes import build_study, check_new, complete_clip, cut_scenes

    check_place(out / "key.json" if out.is_dir() else out)
    check_new(out)
    loaded = [replace(load_clip(file, reading), name=file.stem) for file in clips] or [packaged_performance()]
    if len({clip.name for clip in loaded}) < len(loaded):
        raise BodysenseError("--clips: two have the same name; rename one, so that results can name their scenes")
    found = [scene for clip in loaded for scene in cut_scenes(complete_clip(clip, model), seconds)]
    rng = np.random.default_rng(seed)
    chosen = [found[index] for index in sorted(rng.permutation(len(found))[:scenes])]
    with progress_bar("rendered", 3 * len(chosen)) as advance:
        build_study(out, chosen, rng, jobs or os.cpu_count() or 1, advance)
    for scene in chosen:
        print(
            f"{scene.name}: {scene.hidden.mean():.0%} of joints hidden, {scene.error('ours'):.1f} cm off, last known "
            f"{scene.error('baseline'):.1f} cm"
        )
    print(f"wrote {out / 'site'}: {3 * len(chosen)} pairs a rater; serve this folder")
    print(f"wrote {out / 'key.json'}: the condition of each animation; do not serve it")


def analyze(key: KeyFile, answers: Annotated[tuple[Path, ...], tyro.conf.Positional] = (), json: Json = None) -> None:
    """Compute mean preferences of raters with standard error and t-test, per scene and over all (UNOC, Fig. 6).

    Args:
        key: the study's key.json.
        answers: files that raters saved.
    """
    from bodysense.cli.show import write_numbers
    from bodysense_lab.study.analysis import COMPARISONS, preferences, read_all_votes, read_key, study_numbers

    check_places(json)
    study = read_key(key)
    found = preferences(study, read_all_votes(answers, study))
    print(f"{found['(all)'][0].n} raters; +1: all prefer the first; −1: the second. Mean ± standard error, t-test")
    for scene, rows in found.items():
        for (first, second), one in zip(COMPARISONS, rows, strict=True):
            tested = f" ± {one.standard_error:.2f}  t {one.t:.2f}  p {one.p:.3f}" if one.n > 1 else ""
            print(f"{scene}: {first} over {second} {one.mean:+.2f}{tested}")
    write_numbers(json, study_numbers(found))


def simulate(
    key: KeyFile,
    out: Output,
    truth: float = 0.0,
    ours: float = 0.0,
    baseline: float = 0.0,
    raters: Count = 39,
    ties: float = 0.2,
    seed: Seed = 0,
) -> None:
    """Write answers of simulated raters, to test a study or to find the number of raters that it needs.

    Args:
        key: the study's key.json.
        out: folder for answers-simulated-001.json …
        truth: quality of the truth; the mean vote on a pair is the difference of its qualities.
        ours: quality of the completion.
        baseline: quality of last known positions.
        raters: number of raters.
        ties: share of 'no difference' between conditions of equal quality.
        seed: random seed of the votes.
    """
    import numpy as np

    from bodysense_lab.study.analysis import Condition, read_key, write_simulated_answers

    study = read_key(key)
    make_folder(out)
    quality: dict[Condition, float] = {"truth": truth, "ours": ours, "baseline": baseline}
    write_simulated_answers(out, study, raters, quality, np.random.default_rng(seed), ties)
    print(f"wrote {raters} files to {out}")
