"""`bodysense demo`: a motion completed from head and hands, and from the cameras of a headset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.cli.options import Output, Reading
from bodysense.cli.summary import write_summary
from bodysense.files import check_place, make_folder
from bodysense.io.reading_options import AS_FOUND

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.body.pose import Pose
    from bodysense.io.clip import Clip
    from bodysense.observing.observation import Observation

RATE = 30.0  # Hz of the completed motion
PICTURES = 15.0  # approximate Hz of the animation
LONGEST = 8.0  # s; longest animation, from the beginning of the motion
DEVICES = {"three_point": "head and hands", "headset_camera": "headset cameras"}


@dataclass(frozen=True)
class DemoRow:
    """Mean error of some joints that a device does not track."""

    device: str
    joints: str
    last_known: float  # cm, of the best of three baselines that hold the last known position
    completed: float  # cm


def demo(
    file: Annotated[Path | None, tyro.conf.Positional] = None,
    out: Output = Path("bodysense-demo"),
    json: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Complete a motion from head and hands, and from the cameras of a headset; write BVH files and pictures.

    Args:
        file: motion, .bvh or AMASS .npz; the packaged performance on an unseen body if omitted.
        out: folder for truth.bvh, hands.bvh, result.bvh, demo.webp and demo.png.
        json: file for the result as JSON: outputs, and the mean errors of hidden joints in cm.
        reading: facts that the file omits.
    """
    from rich.console import Console

    from bodysense.body.person import Person
    from bodysense.cli.recordings import load_clip
    from bodysense.demo import performance_of_unseen_body
    from bodysense.devices.simulated.device import simulate
    from bodysense.io.formats.bvh import write_bvh
    from bodysense.io.formats.recording import Recording
    from bodysense.io.resample import resample
    from bodysense.pictures.camera import Lens
    from bodysense.pictures.comparison import View, write_comparison, write_moments
    from bodysense.takes.track import track

    if json is not None:
        check_place(json)
    check_place(make_folder(out) / "demo.png")
    console = Console()
    clip = resample(load_clip(file, reading) if file is not None else performance_of_unseen_body(), RATE)
    skeleton, rows, poses = clip.pose.skeleton, list[DemoRow](), list["Pose"]()
    frames = picture_frames(clip)
    views = [View("the wearer", clip.pose[frames])]
    with console.status("completing the body …"):
        for device, name in DEVICES.items():
            seen = simulate(clip, device)
            pose = track(Recording(seen, skeleton), person=Person(skeleton)).clip.pose
            poses.append(pose)
            rows += demo_rows(clip, seen, pose, name)
            views.append(View(f"from {name}", pose[frames]))
    console.print(sentence(clip, rows), highlight=False, soft_wrap=True)
    console.print(demo_table(rows))
    with console.status("drawing …"):
        write_bvh(out / "truth.bvh", clip)
        for name, pose in zip(("hands", "result"), poses, strict=True):
            write_bvh(out / f"{name}.bvh", replace(clip, name=name, pose=pose))
        lens = Lens(width=220, height=290, aim=0.86, view_height=2.25)
        write_comparison(out / "demo.webp", views, clip.frame_rate / frames.step, lens)
        write_moments(out / "demo.png", views, clip.frame_rate / frames.step, lens=lens)
    written = [out / name for name in ("truth.bvh", "hands.bvh", "result.bvh", "demo.webp", "demo.png")]
    for path in written:
        console.print(f"wrote {path}", highlight=False)
    errors = [vars(row) for row in rows]
    write_summary(json, written, {"motion": clip.name, "seconds": clip.seconds, "errors_cm": errors})


def demo_rows(clip: Clip, seen: Observation, pose: Pose, device: str) -> list[DemoRow]:
    """Return mean world errors of the joints that a device does not track: of the whole body, and of the legs."""
    import numpy as np

    from bodysense.body.pose import forward_kinematics
    from bodysense.body.skeleton import BODY, LOWER_BODY
    from bodysense.observing.points import observed_points
    from bodysense.quality.metrics import joint_error
    from bodysense.takes.last_known import last_known

    skeleton = clip.pose.skeleton
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    hidden = ~observed_points(seen, skeleton)[2]
    kept, rows = last_known(seen, skeleton), []
    for joints, names in (("the whole body", BODY), ("the legs", LOWER_BODY)):
        points = skeleton.indices(names)
        counted = hidden[:, points]
        if not counted.any():
            continue

        def error(position: np.ndarray, points: np.ndarray = points, counted: np.ndarray = counted) -> float:
            return float(joint_error(position[:, points], truth[:, points])[counted].mean())

        best = min(error(position) for position in kept.values())
        rows.append(DemoRow(device, joints, best, error(np.asarray(forward_kinematics(pose)[0]))))
    return rows


def sentence(clip: Clip, rows: Sequence[DemoRow]) -> str:
    """Return the result as one sentence."""
    whole = [row for row in rows if row.joints == "the whole body"]
    errors = ", and ".join(f"{row.completed:.1f} cm from {row.device}" for row in whole)
    return f"In {clip.name} ({clip.seconds:.0f} s) joints that are not tracked are off by {errors}."


def demo_table(rows: Sequence[DemoRow]) -> Table:
    """Return the table of mean errors in cm, next to those of the best baseline."""
    from rich import box
    from rich.table import Table

    table = Table(caption="mean error of hidden joints, cm", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for column in ("completed from", "joints", "last known place", "bodysense"):
        table.add_column(column, justify="left" if column in ("completed from", "joints") else "right", no_wrap=True)
    for row in rows:
        table.add_row(row.device, row.joints, f"{row.last_known:.1f}", f"{row.completed:.1f}")
    return table


def picture_frames(clip: Clip) -> slice:
    """Return the frames of the animation: the first `LONGEST` seconds, about `PICTURES` a second."""
    step = max(1, round(clip.frame_rate / PICTURES))
    return slice(0, min(len(clip), round(LONGEST * clip.frame_rate)), step)
