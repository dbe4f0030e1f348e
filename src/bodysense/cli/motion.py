"""`bodysense track`, `simulate`: signals in, motion out, and the other way round."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bodysense.cli.markers import NO_OPTIONS, MarkerOptions
from bodysense.cli.overwriting import check_apart
from bodysense.cli.recordings import load_clip, person_of, source_of
from bodysense.cli.video import NO_VIDEO, VideoOptions, track_video
from bodysense.devices.simulated import DeviceName
from bodysense.errors import BodysenseError
from bodysense.files import check_place

if TYPE_CHECKING:
    from bodysense.body.person import Person

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]
MotionFile = Annotated[Path, tyro.conf.Positional]


def simulate(
    file: MotionFile,
    out: Output,
    device: DeviceName = "headset_camera",
    height: float | None = None,
    rate: float | None = None,
    noise: bool = False,
    seed: int = 1,
) -> None:
    """Record what a device would track of a motion.

    Args:
        file: motion: .bvh, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma.
        out: recording, .npz or .jsonl (docs/recording.md); of gloves also .csv or .c3d (docs/gloves.md).
        device: what watches the body.
        height: metres to which the body is scaled, for files that do not say how tall it is.
        rate: frames a second, for files that do not say it.
        noise: errors as real devices have them.
        seed: random seed of the noise.
    """
    from rich.console import Console

    from bodysense.capture.recording import Recording
    from bodysense.cli.markers import write_seen
    from bodysense.devices.simulated import simulate as simulated

    check_place(out)
    clip = load_clip(file, height, rate)
    observation = simulated(clip, device, seed if noise else None)
    write_seen(out, Recording(observation, clip.pose.skeleton), clip.frame_rate)
    tracked = (observation.has_position | observation.has_rotation).mean()
    Console().print(f"wrote {out}: {len(observation)} frames, {tracked:.0%} of points tracked", highlight=False)


def track(  # noqa: PLR0915
    file: MotionFile,
    out: Output,
    device: DeviceName | None = None,
    height: float | None = None,
    person: Path | None = None,
    save_person: Path | None = None,
    floor: float = 0.0,
    hold_feet: bool = True,
    noise: bool = False,
    model: Path | None = None,
    fingers: Literal["tracked", "synthesize"] = "tracked",
    samples: int | None = None,
    seed: int = 1,
    gloves: Annotated[MarkerOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    video: Annotated[VideoOptions, tyro.conf.arg(name="")] = NO_VIDEO,
) -> None:
    """Complete a recording, a video, or a motion seen by a simulated device; write it as BVH, glTF or VRMA.

    Args:
        file: recording (.npz, .jsonl), markers of a body or of gloves (.c3d, .csv, .trc, .tsv), video (a file, a folder
            of images, or a webcam's index), or with --device a motion (.bvh, AMASS or SMPL
            .npz, .npy, .glb, .gltf, .vrma).
        out: completed motion: .bvh, .glb (glTF with an animated skeleton) or .vrma (an animation for VRM avatars).
        device: what watches the body, where the file is a motion.
        height: wearer's height in metres; other proportions are inferred. If omitted, the body is the recording's, and
            inferred where that has none.
        person: wearer's file, written by --save-person.
        save_person: JSON file for the wearer, as believed at the end.
        floor: height of the floor in metres.
        hold_feet: hold feet that stand, and keep them over the floor.
        noise: errors of a simulated device as real ones have them.
        model: completion network of your own; the packaged one if omitted. With --samples, a video, or fingers of a
            motion: the network of that.
        fingers: 'synthesize' makes plausible fingers from the body's motion; of a motion without --device nothing else
            changes.
        samples: so many plausible bodies for one signal of head and wrists, OUT_1.bvh, OUT_2.bvh …, by HMD-VAE.
        seed: random seed of samples and noise.
    """
    from rich.progress import Progress

    from bodysense.capture.recording import Recording, is_recording
    from bodysense.capture.video import is_video
    from bodysense.completion.model import load_completion
    from bodysense.estimators.finger_synthesis import synthesize
    from bodysense.export.motion_files import check_ending, write_motion
    from bodysense.io.markers.files import is_marker_file
    from bodysense.reading import check_kind
    from bodysense.take import signal_of
    from bodysense.take import track as complete
    from bodysense.tracker import TrackerSettings

    check_ending(out)
    check_kind(file)
    if save_person is not None:
        check_place(save_person)
    if is_video(str(file)):
        if device is not None or fingers == "synthesize" or samples is not None or gloves != NO_OPTIONS:
            raise BodysenseError(f"{file}: --device, --fingers, --samples and options of markers are not for videos")
        track_video(str(file), out, video, model, height)
        return
    if video != NO_VIDEO:
        raise BodysenseError(f"{file}: not a video; --overlay, --people and their like are for videos")
    if samples is not None and fingers == "synthesize":
        raise BodysenseError(f"--samples {samples} draws bodies as they are; leave --fingers synthesize out")
    wearer, seeded = person_of(person, height), seed if noise else None
    is_motion = file.is_file() and not is_recording(file) and not is_marker_file(file)
    if device is None and fingers == "synthesize" and is_motion:
        _write_with_fingers(file, out, height, gloves.rate, model)
        return
    if device is None and is_motion:
        raise BodysenseError(
            f"{file}: not a recording; if it is a motion, say what watches it: --device headset_camera, or --fingers "
            "synthesize to give it fingers"
        )
    source = source_of(file, gloves, height, floor or None, fingers=fingers == "synthesize")
    # Gloves were put on a body of this height already.
    told = None if isinstance(source, Recording) and source.told else height
    if samples is not None:
        from bodysense.cli.samples import sample_paths, write_samples

        check_apart(sample_paths(out, samples), file)
        signal = signal_of(source, device=device, person=wearer, height=told, noise=seeded)
        recording = Recording(signal.observation, signal.person.skeleton)
        for path in write_samples(recording, out, samples, seed, model):
            print(f"wrote {path}")
        return
    network = None if model is None else load_completion(model)
    settings = TrackerSettings(floor=floor, hold_feet=hold_feet)
    begun = time.perf_counter()
    with Progress(transient=True) as progress:
        bar = progress.add_task(f"tracking {file.name}", total=None)
        take = complete(
            source,
            device=device,
            person=wearer,
            height=told,
            noise=seeded,
            settings=settings,
            network=network,
            advance=lambda done, frames: progress.update(bar, completed=done, total=frames),
        )
    rate = len(take.time) / (time.perf_counter() - begun)
    clip = replace(take.clip, name=out.stem)
    write_motion(out, synthesize(clip) if fingers == "synthesize" else clip)
    print(f"wrote {out}: {len(take.time)} frames at {rate:.0f} frames/s")
    if take.person.bone_deviation.any():
        print(inferred_line(take.person))
    if save_person is not None:
        take.person.save(save_person)
        print(f"wrote {save_person}")


def _write_with_fingers(file: Path, out: Path, height: float | None, rate: float | None, model: Path | None) -> None:
    """A motion with plausible fingers, and otherwise as it is."""
    from bodysense.estimators.finger_synthesis import synthesize
    from bodysense.estimators.point_model import load_point_model
    from bodysense.export.motion_files import write_motion

    clip = synthesize(load_clip(file, height, rate), load_point_model("fingers", model))
    write_motion(out, replace(clip, name=out.stem))
    print(f"wrote {out}: {len(clip)} frames with synthesized fingers")


def inferred_line(person: Person) -> str:
    """What was inferred of a wearer."""
    from bodysense.body.shape import stature

    if person.height is None:
        return f"height {float(stature(person.skeleton.rest_offset)):.2f} m inferred"
    return f"height {person.height.value:.2f} m told, other proportions inferred"
