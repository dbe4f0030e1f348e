"""`bodysense data render`: videos of motion, with their truth; `bodysense evaluate video-rendered` scores them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.files import make_folder
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions

if TYPE_CHECKING:
    import numpy as np

    from bodysense.lab.rendering.scene import Scene
    from bodysense.lab.rendering.take import RenderedTake

Split = Literal["train", "val", "test", "all"]


def render(
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))],
    motion: Annotated[Path | None, tyro.conf.Positional] = None,
    videos: int = 24,
    seconds: float = 6.0,
    split: Split = "test",
    pixels: int = 480,
    seed: int = 1,
    reading: Reading = AS_FOUND,
) -> None:
    """Draw videos of a skinned, dressed and lit body from motion with fingers; each with its truth beside it.

    Three bodies take turns; skin, clothes, light, room and camera are drawn at random. A video that is already there
    is kept, so that a stop costs little.

    Args:
        out: The folder of the set: NAME.mp4 and NAME.npz.
        motion: A folder of motion files, a prepared store, or one file. If omitted, scripted gestures by each body:
            arms out to the sides, up, ahead, and punches.
        videos: number of videos, spread over the clips.
        seconds: greatest length of each video.
        split: people to draw.
        pixels: Height of the pictures; they are 4:3.
        seed: random seed.
        reading: What the motion files do not say of themselves.
    """
    import numpy as np
    from rich.console import Console
    from rich.progress import Progress

    from bodysense.lab.rendering.take import RATE, film, plan_gestures

    if videos < 1 or not seconds >= 1 or pixels < 64 or pixels % 2:
        raise BodysenseError(
            f"render: {videos} videos of {seconds:g} s, {pixels} pixels high; "
            "give at least 1 video, 1 s, and an even height from 64 on"
        )
    rng = np.random.default_rng(seed)
    if motion is None:
        planned = plan_gestures(rng)[:videos]
    else:
        planned = _planned(motion, videos, seconds, split, rng, reading)
    make_folder(out)
    with Progress() as progress:
        bar = progress.add_task("drawing", total=sum(len(take.time) for take, _ in planned))
        for take, scene in planned:
            progress.update(bar, description=take.name)
            if (out / f"{take.name}.mp4").is_file() and (out / f"{take.name}.npz").is_file():
                progress.update(bar, advance=len(take.time))
                continue
            film(take, scene, out, pixels, lambda: progress.update(bar, advance=1))
    length = sum(len(take.time) / RATE for take, _ in planned)
    is_short = motion is not None and len(planned) < videos
    said = f"; no more of {videos}: the motion has no more in which hands move" if is_short else ""
    Console().print(f"{out}: videos: {len(planned)}, {length:.0f} s{said}", highlight=False)


def _planned(
    motion: Path, videos: int, seconds: float, split: Split, rng: np.random.Generator, reading: ReadingOptions
) -> list[tuple[RenderedTake, Scene]]:
    """Takes of recorded motion."""
    from rich.progress import track

    from bodysense.cli.recordings import load_clip
    from bodysense.lab.clips import count_clips, open_clips
    from bodysense.lab.rendering.take import plan_takes

    if motion.is_file():
        clips = [load_clip(motion, reading)]
    else:
        clips = track(open_clips(motion, split, options=reading), "reading", count_clips(motion, split))
    fingered = [clip for clip in clips if clip.has_fingers and clip.seconds >= min(2.0, seconds)]
    if not fingered:
        raise BodysenseError(
            f"{motion}: no clip of {min(2.0, seconds):g} s or more with fingers; a rendered set needs them"
        )
    each = -(-videos // len(fingered))
    planned: list[tuple[RenderedTake, Scene]] = []
    for number in rng.permutation(len(fingered)):
        planned += plan_takes(fingered[number], min(each, videos - len(planned)), seconds, rng, len(planned))
        if len(planned) == videos:
            break
    if not planned:
        raise BodysenseError(f"{motion}: nothing in it that moves its hands before a camera; give livelier motion")
    return planned


def video_rendered(
    videos: Annotated[Path, tyro.conf.Positional],
    model: Path | None = None,
    landmarkers: Path | None = None,
    out: Path = Path("bodysense-tables"),
    json: Path | None = None,
) -> None:
    """PAHMT, Table 3: arms and hands from the pixels of rendered videos, beside inverse kinematics of landmarks.

    Args:
        videos: The folder that `bodysense data render` wrote.
        model: A network written by `bodysense train arms`; the packaged one if omitted.
        landmarkers: Folder of MediaPipe's model files; fetched once into the cache by default.
        out: Folder for the table as CSV and as a picture (PNG).
        json: Write the numbers here, as one flat object.
    """
    from rich.progress import Progress

    from bodysense.devices.video.arms import load_arms
    from bodysense.devices.video.landmarker_files import find_landmarkers
    from bodysense.lab.commands.reporting import Common, checked, finish
    from bodysense.lab.rendering.tables import score_videos, video_report
    from bodysense.lab.rendering.take import list_takes

    common = Common(out=out, json=json)
    checked(common)
    truths, files, network = list_takes(videos), find_landmarkers(landmarkers), load_arms(model)
    with Progress() as progress:
        bar = progress.add_task("watching", total=len(truths))
        table = score_videos(
            truths, files, network, lambda name: progress.update(bar, advance=1, description=f"watched {name}")
        )
    finish(video_report(table, videos.name), common)
