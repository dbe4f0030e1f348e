"""`bodysense demo`: a motion, seen through a headset's cameras and completed."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.io.rigs.options import AS_FOUND

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.io.clip import Clip
    from bodysense.scoring import Tallies

PICTURES = 10.0  # Hz of the animation, about
LONGEST = 10.0  # s of it, from the middle of the motion


def demo(
    file: Annotated[Path | None, tyro.conf.Positional] = None,
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))] = Path("bodysense-demo"),
    reading: Reading = AS_FOUND,
) -> None:
    """Complete a motion from what a headset's cameras see of it; write BVH files and pictures.

    Args:
        file: motion of your own, .bvh or AMASS .npz; without one, the packaged performance, by a stranger: a body that
            no network was trained on.
        out: folder for truth.bvh, result.bvh, demo.webp and demo.png.
        reading: what the file does not say of itself.
    """
    import numpy as np
    from rich.console import Console

    from bodysense.body.person import Person
    from bodysense.body.pose import forward_kinematics
    from bodysense.cli.recordings import load_clip
    from bodysense.cli.show import processor
    from bodysense.demo import performance_of_stranger
    from bodysense.devices.simulated.device import simulate
    from bodysense.io.bvh import write_bvh
    from bodysense.io.recording import Recording
    from bodysense.io.resample import resample
    from bodysense.pictures.comparison import View, write_comparison, write_moments
    from bodysense.scoring import RATE, TrackedClip, last_known, score
    from bodysense.take import track

    console = Console()
    clip = resample(load_clip(file, reading) if file is not None else performance_of_stranger(), RATE)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BodysenseError(f"{out}: no folder can be made there ({error.strerror}); choose another --out") from None
    skeleton = clip.pose.skeleton
    with console.status("completing the body …"):
        seen = simulate(clip, "headset_camera")
        begun = time.perf_counter()
        take = track(Recording(seen, skeleton), person=Person(skeleton))
        taken = time.perf_counter() - begun
    pose = take.clip.pose
    positions = {"bodysense": np.asarray(forward_kinematics(pose)[0])} | last_known(seen, skeleton)
    tallies = score(TrackedClip(clip, seen, pose, positions))
    hidden = 1 - seen.has_position.mean()
    console.print(demo_table(tallies, f"{clip.name}: {clip.seconds:.0f} s, {hidden:.0%} of points hidden"))
    console.print(f"{len(clip) / taken:.0f} frames/s, one thread, {processor()}", highlight=False)
    with console.status("drawing …"):
        write_bvh(out / "truth.bvh", clip)
        write_bvh(out / "result.bvh", replace(take.clip, name="result"))
        frames = shown_frames(clip)
        views = [
            View("the wearer; red: unseen by the headset", clip.pose[frames], seen.has_position[frames]),
            View("bodysense, from what the headset sees", pose[frames]),
        ]
        write_comparison(out / "demo.webp", views, clip.frame_rate / frames.step)
        write_moments(out / "demo.png", views, clip.frame_rate / frames.step)
    for name in ("truth.bvh", "result.bvh", "demo.webp", "demo.png"):
        console.print(f"wrote {out / name}", highlight=False)


def demo_table(tallies: Tallies, title: str) -> Table:
    """RMSJPE / MPJPE in cm of the best last known and of the tracker, and the ratio."""
    from rich import box
    from rich.table import Table

    from bodysense.cli.show import PARTS, SHARES
    from bodysense.scoring import KNOWN

    caption = "RMSJPE / MPJPE, cm. Last known: the best of three ways to keep it."
    shown = Table(title=title, caption=caption, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for column in ("part", "joints", "last known", "bodysense", "ratio"):
        shown.add_column(column, justify="left" if column in ("part", "joints") else "right", no_wrap=True)
    groups = {group for group, *_ in tallies}
    for group, part, share in (
        (group, part, share)
        for group in groups
        for part in ("body", "finger", "body_and_finger")
        for share in ("occluded", "all")
    ):
        ours = tallies.get((group, part, share, "bodysense"))
        if ours is None or not ours.count:
            continue
        known = [tallies[group, part, share, frame] for frame in KNOWN]
        best = [min(getattr(one, measure) for one in known) for measure in ("rmsjpe", "mpjpe")]
        cells = [best, (ours.rmsjpe, ours.mpjpe)]
        ratio = " / ".join(f"{mine / theirs:.2f}" for mine, theirs in zip(cells[1], best, strict=True))
        shown.add_row(PARTS[part], SHARES[share], *(f"{a:.1f} / {b:.1f}" for a, b in cells), ratio)
    return shown


def shown_frames(clip: Clip) -> slice:
    """The frames of the animation: `LONGEST` seconds of the middle, about `PICTURES` a second."""
    step = max(1, round(clip.frame_rate / PICTURES))
    count = min(len(clip), round(LONGEST * clip.frame_rate))
    start = (len(clip) - count) // 2
    return slice(start, start + count, step)
