"""`bodysense data render` draws videos of motion with their truth; `evaluate video-rendered` scores them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.errors import BodysenseError
from bodysense.files import make_folder
from bodysense.ranges import Count
from bodysense_lab.core.options import Flat, Json, Output, TableOptions, check_ending
from bodysense_lab.rendering.options import Rendering

if TYPE_CHECKING:
    import numpy as np

    from bodysense_lab.rendering.figures import FilmedTake
    from bodysense_lab.rendering.scene import Scene
    from bodysense_lab.rendering.take import RenderedTake

Videos = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(help="folder that `bodysense data render` wrote")]
Model = Annotated[
    Path | None, tyro.conf.arg(help="network written by `bodysense train arms`; the packaged one if omitted")
]
Landmarkers = Annotated[
    Path | None,
    tyro.conf.arg(help="folder of MediaPipe's model files; if omitted, they are fetched once into the cache"),
]


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
    videos: Videos,
    model: Model = None,
    landmarkers: Landmarkers = None,
    out: Output = TableOptions.out,
    json: Json = None,
) -> None:
    """PAHMT, Table 3: arms and hands from the pixels of rendered videos, and inverse kinematics of landmarks.

    Args:
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


def pahmt_figure3(
    videos: Videos,
    hands: Path,
    out: Output,
    model: Model = None,
    landmarkers: Landmarkers = None,
    moments: Count = 1,
) -> None:
    """PAHMT, Fig. 3: draw arms and hands by one network next to hands alone with arms by inverse kinematics.

    The people in the films are synthesised. Arms are compared with straight wrists as well.

    Args:
        hands: .pt of a network that `bodysense train arms --input hands` wrote.
        out: picture, .png or .webp.
        moments: number of rows of each video.
    """
    from bodysense.pictures.comparison import write_picture
    from bodysense_lab.rendering.figures import draw_figure_3

    films = _films(videos, out, model, landmarkers, hands)
    write_picture(out, draw_figure_3(films, moments))
    print(f"wrote {out}")


def pahmt_figure4(
    videos: Videos, out: Output, model: Model = None, landmarkers: Landmarkers = None, moments: Count = 1
) -> None:
    """PAHMT, Fig. 4: draw films next to MediaPipe's landmarks with inverse kinematics, the network and the truth.

    The people in the films are synthesised; their motion may be recorded (`bodysense data render DIR`).

    Args:
        out: picture, .png or .webp.
        moments: number of rows of each video.
    """
    from bodysense.pictures.comparison import write_picture
    from bodysense_lab.rendering.figures import draw_figure_4

    films = _films(videos, out, model, landmarkers)
    write_picture(out, draw_figure_4(films, moments))
    print(f"wrote {out}")


def _films(
    videos: Path, out: Path, model: Path | None, landmarkers: Path | None, hands: Path | None = None
) -> list[FilmedTake]:
    """Return the completed videos of a figure, and print their errors by method."""
    from bodysense.devices.video.arms import load_arms
    from bodysense.devices.video.landmarker_files import find_landmarkers
    from bodysense.files import check_place
    from bodysense_lab.commands.reporting import progress_bar
    from bodysense_lab.papers.pahmt.network import read_arms
    from bodysense_lab.rendering.figures import read_films
    from bodysense_lab.rendering.take import list_takes

    check_place(out)
    check_ending(out, ".png", ".webp", what="a picture")
    alone = None if hands is None else read_arms(hands)[0]
    network, count, files = load_arms(model), len(list_takes(videos)), find_landmarkers(landmarkers)
    with progress_bar("watched", count) as advance:
        films = read_films(videos, files, network, alone, advance)
    for film in films:
        for method in film.rotation:
            found = film.errors(method)
            print(f"{film.take.name}, {method}: arms {found['arms_deg']:.1f}°, fingers {found['hands_cm']:.1f} cm")
    return films
