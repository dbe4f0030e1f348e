"""`bodysense demo`, `track`, `simulate`: motion in, motion out."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bodysense.cli.markers import (
    NO_OPTIONS,
    MarkerOptions,
    check_gloves_of,
    gloved,
    has_gloves,
)
from bodysense.cli.options import tracker_settings
from bodysense.cli.recordings import Device, is_three_point, load_clip, metres, recording_of, simulated
from bodysense.cli.video import NO_VIDEO, VideoOptions, track_video
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.files import check_place

if TYPE_CHECKING:
    from bodysense.capture.recording import Recording
    from bodysense.estimators.estimate import Estimator

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]
MotionFile = Annotated[Path, tyro.conf.Positional]


def demo(
    file: Annotated[Path | None, tyro.conf.Positional] = None,
    out: Output = Path("bodysense-demo"),
    height: float | None = None,
) -> None:
    """Complete a motion from what a headset's cameras see of it; write BVH files and pictures.

    Args:
        file: A .bvh or AMASS .npz motion of your own; without one, the packaged performance.
        out: Folder for truth.bvh, result.bvh, demo.png and demo.gif.
        height: Metres; scales the body, for files that do not say how tall it is.
    """
    import numpy as np
    from rich.console import Console

    from bodysense.body.pose import forward_kinematics
    from bodysense.cli.show import headset_table, latency_line
    from bodysense.data.bvh import write_bvh
    from bodysense.estimators.ik_tracker import IkTrackerSettings
    from bodysense.evaluation.headset import HeadsetTable, score, track_clip
    from bodysense.export.picture import RESULT, Panel, draw_animation, draw_strip

    console = Console()
    clip = load_clip(file, height) if file is not None else packaged_performance()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BodysenseError(f"{out}: no folder can be made there ({error.strerror}); choose another --out") from None
    with console.status("completing the body …"):
        tracked = track_clip(clip, None, IkTrackerSettings())
    clip, moments = tracked.clip, tracked.clip.time
    table = HeadsetTable(score(tracked), 1, clip.seconds)
    title = f"{clip.name}: {clip.seconds:.0f} s"
    console.print(headset_table(table, title, ("body", "finger", "body_and_finger"), ("occluded", "all")))
    console.print(latency_line(tracked.latency), highlight=False)
    with console.status("drawing …"):
        truth = np.asarray(forward_kinematics(clip.pose)[0])
        panels = [
            Panel("truth", truth),
            Panel("what the headset sees (hidden: red)", truth, ~tracked.observation.has_position),
            Panel("bodysense", tracked.position["bodysense"], color=RESULT),
        ]
        write_bvh(out / "truth.bvh", clip)
        write_bvh(out / "result.bvh", replace(clip, name="result", pose=tracked.pose))
        draw_strip(out / "demo.png", clip.pose.skeleton, panels, moments)
        draw_animation(out / "demo.gif", clip.pose.skeleton, panels, moments)
    for name in ("truth.bvh", "result.bvh", "demo.png", "demo.gif"):
        console.print(f"wrote {out / name}", highlight=False)


def simulate(
    file: MotionFile,
    out: Output,
    device: Device = "headset-camera",
    height: float | None = None,
) -> None:
    """Record what a device would track of a motion.

    Args:
        file: A .bvh or AMASS .npz motion.
        out: The recording: .npz or .jsonl (docs/recording.md); of gloves also .csv or .c3d (docs/gloves.md).
        device: What watches the body.
        height: Metres; scales the body, for files that do not say how tall it is.
    """
    from rich.console import Console

    from bodysense.cli.markers import write_seen

    check_place(out)
    clip = load_clip(file, height)
    recording = simulated(clip, device)
    write_seen(out, recording, clip.frame_rate)
    seen = recording.observation.has_position.mean()
    Console().print(f"wrote {out}: {len(recording.observation)} frames, {seen:.0%} of points seen", highlight=False)


def track(
    file: MotionFile,
    out: Output,
    device: Device | None = None,
    model: Path | None = None,
    half_life: float | None = None,
    height: float | Literal["headset"] | None = None,
    fingers: Literal["tracked", "synthesize"] = "tracked",
    samples: int | None = None,
    seed: int = 1,
    gloves: Annotated[MarkerOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    video: Annotated[VideoOptions, tyro.conf.arg(name="")] = NO_VIDEO,
) -> None:
    """Complete a recording, a video, or a motion seen by a simulated device, and write it as BVH, glTF or VRMA.

    A recording of head and wrists alone is completed by the three-point network, the markers of gloves by theirs.

    Args:
        file: A recording (.npz, .jsonl), the markers of gloves (.csv, .c3d), a video (a file, a folder of images, or a
            webcam's index), or with --device a motion (.bvh, AMASS .npz).
        out: The completed motion: .bvh, .glb (glTF with an animated skeleton) or .vrma (an animation for VRM avatars).
        device: What watches the body, where the file is a motion.
        model: A network written by `bodysense train`; the packaged one by default.
        half_life: Seconds in which the smoother closes half of a jump; 0 does not smooth, its own choice by default.
            The three-point network's motion is not smoothed.
        height: Metres; scales the body, for files that do not say how tall it is. For a recording of head and wrists:
            the wearer's height, or 'headset' to take it from how high the headset is carried.
        fingers: 'synthesize' makes plausible fingers from the body's motion; of a motion without --device nothing else
            changes.
        samples: So many plausible bodies for the one signal of head and wrists, OUT_1.bvh, OUT_2.bvh …, by HMD-VAE.
        seed: Of the samples.
    """
    import numpy as np
    from rich.progress import track as progress

    from bodysense.body.pose import Pose
    from bodysense.capture.markers import is_marker_file
    from bodysense.capture.recording import is_recording
    from bodysense.capture.video import is_video
    from bodysense.data.clip import Clip
    from bodysense.data.resample import at_constant_rate
    from bodysense.estimators.finger_synthesis import synthesize
    from bodysense.estimators.ik_tracker import IkTracker
    from bodysense.estimators.point_model import load_point_model
    from bodysense.export.motion_files import check_ending, write_motion

    check_ending(out)
    if is_video(str(file)):
        if device is not None or half_life is not None or fingers == "synthesize" or samples is not None:
            raise BodysenseError(f"{file}: --device, --half-life, --fingers and --samples are not for videos")
        if height == "headset" or gloves != NO_OPTIONS:
            raise BodysenseError(f"{file}: give --height in metres for a video, and no options of markers")
        track_video(str(file), out, video, model, height)
        return
    if video != NO_VIDEO:
        raise BodysenseError(f"{file}: not a video; --overlay, --arms, --people and their like are for videos")
    if height == "headset" and (device is not None or not is_recording(file)):
        raise BodysenseError(f"{file}: --height headset is for recordings of head and wrists; give metres, or none")
    if samples is not None:
        _check_samples(samples, fingers == "synthesize", half_life is not None)
    is_motion = file.is_file() and not is_recording(file) and not is_marker_file(file)
    if device is None and fingers == "synthesize" and is_motion:
        clip = synthesize(load_clip(file, metres(height)), load_point_model("fingers", model))
        write_motion(out, replace(clip, name=out.stem))
        print(f"wrote {out}: {len(clip)} frames with synthesized fingers")
        return
    recording = recording_of(file, device, height, gloves)
    if has_gloves(recording.observation):
        check_gloves_of(recording, file, fingers == "synthesize", samples, model)
    if samples is not None:
        from bodysense.cli.samples import write_samples

        for path in write_samples(recording, out, samples, seed, model):
            print(f"wrote {path}")
        return
    tracker = IkTracker(_estimator(recording, model, half_life), tracker_settings(half_life))
    state, poses, begun = tracker.start(), [], time.perf_counter()
    for frame in progress(range(len(recording.observation)), description=f"tracking {file.name}"):
        pose, _, state = tracker.step(recording.observation[frame : frame + 1], state)
        poses.append(pose)
    pose = Pose(
        recording.skeleton,
        np.concatenate([pose.root_position for pose in poses]),
        np.concatenate([pose.rotation for pose in poses]),
    )
    rate = len(poses) / (time.perf_counter() - begun)
    moments = recording.observation.time
    frame_rate = 1 / float(np.median(np.diff(moments))) if len(moments) > 1 else 30.0
    clip = at_constant_rate(Clip(out.stem, pose, frame_rate), moments)
    write_motion(out, synthesize(clip) if fingers == "synthesize" else clip)
    print(f"wrote {out}: {len(poses)} frames at {rate:.0f} frames/s")


def _check_samples(samples: int, fingers: bool, smoothed: bool) -> None:
    """Refuse what samples do not go with."""
    other = "--fingers synthesize" if fingers else "--half-life" if smoothed else None
    if other is not None:
        raise BodysenseError(f"--samples {samples} draws bodies as they are; leave {other} out")


def _estimator(recording: Recording, model: Path | None, half_life: float | None) -> Estimator:
    """What completes a recording: of head and wrists alone the three-point network, otherwise the body network.

    Hands with gloves are completed by theirs.
    """
    from bodysense.estimators.learned import Learned, load_model
    from bodysense.estimators.three_point import ThreePoint
    from bodysense.estimators.three_point_answers import load_three_point

    if has_gloves(recording.observation):
        return gloved(recording, lambda rest: _estimator(rest, model, half_life), half_life)
    if not is_three_point(recording):
        return Learned(load_model(model), recording.skeleton)
    if half_life is not None:
        raise BodysenseError(
            f"--half-life {half_life:g}: head and wrists are completed without smoothing, so that head and hands are "
            "where they are measured; leave it out"
        )
    return ThreePoint(recording.skeleton, load_three_point(model))
