"""`bodysense data render` draws videos of motion with their truth; `evaluate video-rendered` scores them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.errors import BodysenseError
from bodysense.files import make_folder
from bodysense_lab.core.options import Flat, Json, Output, TableOptions
from bodysense_lab.rendering.options import Rendering

if TYPE_CHECKING:
    import numpy as np

    from bodysense_lab.rendering.scene import Scene
    from bodysense_lab.rendering.take import RenderedTake


def render(run: Flat[Rendering]) -> None:
    """Draw videos of a skinned, dressed and lit body from motion with fingers, each with its truth.

    Three bodies alternate. Skin, clothes, light, room and camera are random. Existing videos are kept, so that a
    stopped run resumes.
    """
    import numpy as np
    from rich.console import Console
    from rich.progress import Progress

    from bodysense_lab.rendering.take import RATE, plan_gestures, render_take

    rng, out = np.random.default_rng(run.seed), run.out
    planned = plan_gestures(rng)[: run.videos] if run.motion is None else _planned(run, run.motion, rng)
    make_folder(out)
    with Progress() as progress:
        bar = progress.add_task("drawing", total=sum(len(take.time) for take, _ in planned))
        for take, scene in planned:
            progress.update(bar, description=take.name)
            if (out / f"{take.name}.mp4").is_file() and (out / f"{take.name}.npz").is_file():
                progress.update(bar, advance=len(take.time))
                continue
            render_take(take, scene, out, run.pixels, lambda: progress.update(bar, advance=1))
    length = sum(len(take.time) / RATE for take, _ in planned)
    is_short = run.motion is not None and len(planned) < run.videos
    remark = f" (of {run.videos}: the motion has no more clips with moving hands)" if is_short else ""
    Console().print(f"{out}: videos: {len(planned)}, {length:.0f} s{remark}", highlight=False)


def _planned(run: Rendering, motion: Path, rng: np.random.Generator) -> list[tuple[RenderedTake, Scene]]:
    """Return takes of recorded motion and their scenes."""
    from rich.progress import track

    from bodysense.cli.recordings import load_clip
    from bodysense_lab.data.clips import count_clips, open_clips
    from bodysense_lab.rendering.take import plan_takes

    if motion.is_file():
        clips = [load_clip(motion, run.reading)]
    else:
        clips = open_clips(motion, run.split, options=run.reading)
        clips = track(clips, "reading", count_clips(motion, run.split))
    shortest = min(2.0, run.seconds)
    fingered = [clip for clip in clips if clip.has_fingers and clip.seconds >= shortest]
    if not fingered:
        raise BodysenseError(f"{motion}: no clip of {shortest:g} s or more with fingers; a rendered set needs them")
    each = -(-run.videos // len(fingered))
    planned: list[tuple[RenderedTake, Scene]] = []
    for number in rng.permutation(len(fingered)):
        planned += plan_takes(fingered[number], min(each, run.videos - len(planned)), run.seconds, rng, len(planned))
        if len(planned) == run.videos:
            break
    if not planned:
        raise BodysenseError(f"{motion}: no clip with moving hands in view of a camera; give other motion")
    return planned


def video_rendered(
    videos: Annotated[Path, tyro.conf.Positional],
    model: Path | None = None,
    landmarkers: Path | None = None,
    out: Output = TableOptions.out,
    json: Json = None,
) -> None:
    """PAHMT, Table 3: arms and hands from the pixels of rendered videos, and inverse kinematics of landmarks.

    Args:
        videos: folder that `bodysense data render` wrote.
        model: network written by `bodysense train arms`; the packaged one if omitted.
        landmarkers: folder of MediaPipe's model files; if omitted, they are fetched once into the cache.
        out: folder for the table as CSV.
    """
    from bodysense.devices.video.arms import load_arms
    from bodysense.devices.video.landmarker_files import find_landmarkers
    from bodysense_lab.commands.reporting import check_outputs, finish, progress_bar
    from bodysense_lab.rendering.tables import score_videos, video_report
    from bodysense_lab.rendering.take import list_takes

    written = TableOptions(out=out, json=json)
    check_outputs(written)
    network, truths, files = load_arms(model), list_takes(videos), find_landmarkers(landmarkers)
    with progress_bar("watched", len(truths)) as advance:
        table = score_videos(truths, files, network, advance)
    finish(video_report(table, videos.name), written)
