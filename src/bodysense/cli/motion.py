"""`bodysense simulate`, `track` and `convert`: simulate tracking, complete it, convert motions."""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from bodysense.cli.options import ONE_FILE, Many, MoreFiles, Output, Reading, check_rate
from bodysense.cli.recordings import load_clip, open_motion, open_recorded, person_of
from bodysense.cli.summary import do_many, frame_counts, print_take, remaining_gaps, take_values, write_summary
from bodysense.cli.video import NO_VIDEO, VideoOptions, track_video
from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.markers.options import NO_OPTIONS, MarkerOptions
from bodysense.io.reading_options import AS_FOUND, ReadingOptions, given_options
from bodysense.ranges import Seed

if TYPE_CHECKING:
    from bodysense.sources.open import Opened
    from bodysense.takes.take import FilledFile, Take

MotionFile = Annotated[Path, tyro.conf.Positional]


def simulate(
    file: MotionFile,
    out: Output,
    device: DeviceName = "headset_camera",
    rate: float | None = None,
    noise: bool = False,
    seed: Seed = 1,
    marker_set: str | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Record what a device would track of a motion.

    Args:
        file: motion: .bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma.
        out: recording, .npz or .jsonl (docs/recording.md); of gloves also .csv or .c3d (docs/gloves.md).
        device: simulated device that tracks the body.
        rate: frames a second, for files without a frame rate.
        noise: tracking errors like those of real devices.
        seed: random seed of the noise.
        marker_set: gloves: marker set, a file or the name of a packaged set (docs/gloves.md).
        reading: facts that the file omits.
    """
    from rich.console import Console

    from bodysense.body.hands.glove_set import read_set
    from bodysense.devices.simulated.device import InertialGloves, MarkerGloves
    from bodysense.devices.simulated.device import simulate as simulated
    from bodysense.io.formats.recording import Recording, write_recording
    from bodysense.io.markers.files import WRITTEN, write_markers
    from bodysense.io.markers.options import is_marker_file

    check_place(out)
    check_rate("--rate", rate)
    if marker_set is not None and device not in ("gloves", "gloves_imu"):
        raise BodysenseError(f"--marker-set {marker_set}: for --device gloves, not for {device}; leave it out")
    if device == "gloves_imu" and is_marker_file(out):
        raise BodysenseError(
            f"{out}: marker files have no sensors; give a recording, a name that ends in .npz or .jsonl"
        )
    endings = (".npz", ".jsonl", *(WRITTEN if device == "gloves" else ()))
    if out.suffix not in endings:
        raise BodysenseError(
            f"{out}: signals of {device} are written as {', '.join(endings)}; give a name that ends so"
        )
    watching = device
    if marker_set is not None:
        gloves = MarkerGloves if device == "gloves" else InertialGloves
        watching = gloves(read_set(marker_set))
    clip = load_clip(file, reading, rate)
    observation = simulated(clip, watching, seed if noise else None)
    if is_marker_file(out):
        write_markers(out, observation, clip.frame_rate)
    else:
        write_recording(out, Recording(observation, clip.pose.skeleton))
    tracked = (observation.has_position | observation.has_rotation).mean()
    Console().print(f"wrote {out}: {len(observation)} frames, {tracked:.0%} of points tracked", highlight=False)


def track(
    file: MotionFile,
    out: Output,
    more: MoreFiles = (),
    device: DeviceName | None = None,
    missing: str | None = None,
    rig: str | None = None,
    person: Path | None = None,
    save_person: Path | None = None,
    hold_feet: bool = True,
    causal: bool = False,
    noise: bool = False,
    model: Path | None = None,
    seed: Seed = 1,
    json: Path | None = None,
    markers: Annotated[MarkerOptions, tyro.conf.OmitArgPrefixes] = NO_OPTIONS,
    video: Annotated[VideoOptions, tyro.conf.OmitArgPrefixes] = NO_VIDEO,
    reading: Reading = AS_FOUND,
    many: Many = ONE_FILE,
) -> int:
    """Complete a recording, a video, a motion with holes, or one seen by a simulated device; write BVH, glTF or VRMA.

    Several files or a folder are completed with the same options into the folder -o; a later run does only what
    is left.

    Args:
        file: recording (.npz, .jsonl), markers of a body or of gloves (.c3d, .csv, .trc, .tsv), video (a file, a folder
            of images, or a webcam's index), or a motion (.bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma) with
            holes, or with --device any motion. Also a folder of them.
        more: further files or folders.
        out: completed motion: .bvh, .fbx, .glb (glTF with an animated skeleton), .vrma (an animation for VRM
            avatars) or .mcap (a take for robots' tools). For a marker file also a name with its ending (.trc, .c3d,
            .tsv, .csv): the same file with the gaps of its markers filled. Of several files: a folder.
        device: simulated device that tracks a motion. If omitted, the holes of the motion are filled, and its known
            frames are unchanged.
        missing: missing joints of a motion, by its names or ours: left_forearm,left_hand. LeftForeArm+ includes all
            its descendants; left_forearm,left_hand:100-240 are both missing in these frames (from 0, both included). If
            omitted: values that are not numbers, and limbs with constant values while the body moves.
        rig: target rig: 'bodysense' and 'smplh' are our 52 joints; 'mixamo', 'unreal', 'metahuman', 'rigify', 'vrm',
            'vrchat', 'lafan1', 'soma' and 'mhr' the same joints under these names; 'source' is the rig of FILE, with
            its holes filled, and NAME.bvh or NAME.fbx that of another file, to whose body the motion is fitted. If
            omitted: 'source' for a .bvh or .fbx with holes that is written as the same, else 'bodysense'.
        person: wearer's file, written by --save-person.
        save_person: JSON file for the wearer, as inferred at the end.
        hold_feet: hold standing feet, and keep feet above the floor.
        causal: complete each frame only from the frames before it, like live tracking; else with past and future.
        noise: tracking errors of the simulated device, like those of real devices.
        model: completion network; the packaged one if omitted. With a video: the network for its arms.
        seed: random seed of the noise.
        json: file for the result as JSON: outputs, frames, height, filled frames of each joint or marker, warnings.
        reading: facts that the file omits. For a recording: --floor, and --height of the wearer, from which other
            proportions are inferred (if omitted, the body is that of the recording, or inferred).
        many: several files or a folder.
    """
    from bodysense.devices.video.pictures import has_images
    from bodysense.io.markers.options import is_marker_file
    from bodysense.sources.kinds import TRACKED_ENDINGS

    values = {
        **{"device": device, "missing": missing, "rig": rig, "person": person, "hold_feet": hold_feet},
        **{"causal": causal, "noise": noise, "model": model, "seed": seed},
    }
    work = partial(_track_file, **values, markers=markers, video=video, reading=reading)
    if more or (file.is_dir() and not has_images(file)):
        for option, path in (("--save-person", save_person), ("--overlay", video.overlay)):
            if path is not None:
                raise BodysenseError(f"{option} {path}: for one file, not for several; leave it out")
        return do_many(work, [file, *more], TRACKED_ENDINGS, out, many, json)
    if options := given_options(many):
        raise BodysenseError(f"{file}: one file; {options}: for several files or a folder, leave it out")
    _check_outputs(file, out, None if is_marker_file(out) else rig, save_person, json)
    write_summary(json, *_outputs(work(file, out, save_person=save_person)))
    return 0


def _outputs(values: dict[str, Any]) -> tuple[list[Path], dict[str, Any]]:
    """Return the outputs of a command, and its other values."""
    return values["outputs"], {name: value for name, value in values.items() if name != "outputs"}


def _track_file(
    file: Path,
    out: Path,
    *,
    device: DeviceName | None,
    missing: str | None,
    rig: str | None,
    person: Path | None,
    hold_feet: bool,
    causal: bool,
    noise: bool,
    model: Path | None,
    seed: int,
    markers: MarkerOptions,
    video: VideoOptions,
    reading: ReadingOptions,
    save_person: Path | None = None,
) -> dict[str, Any]:
    """Complete one file, and return its outputs and values about them."""
    from rich.progress import Progress

    from bodysense.io.markers.options import is_marker_file
    from bodysense.sources.open import MarkerSource, MotionSource, VideoSource
    from bodysense.takes.take import check_marker_output
    from bodysense.tracking.model import load_completion
    from bodysense.tracking.tracker import TrackerSettings

    markers_out = is_marker_file(out)
    opened = open_recorded(file, reading, markers)
    if isinstance(opened, VideoSource) and person is not None and str(person).isdecimal() and not person.exists():
        raise BodysenseError(f"{file}: --person {person}: no such wearer's file; --follow {person} follows that person")
    wearer, seeded = person_of(person, reading.height), seed if noise else None
    if isinstance(opened, VideoSource):
        if device is not None or missing is not None or noise or save_person is not None:
            raise BodysenseError(f"{file}: --device, --missing, --noise and --save-person are not for videos")
        settings = TrackerSettings(hold_feet=hold_feet)
        track_video(opened.name, out, video, model, wearer, rig, settings, causal)
        return {"outputs": [out] if video.overlay is None else [out, video.overlay]}
    if options := given_options(video):
        raise BodysenseError(f"{file}: not a video; {options}: for videos, leave it out")
    if markers_out:
        check_marker_output(out, opened if isinstance(opened, MarkerSource) else None, rig)
    has_holes = isinstance(opened, MotionSource) and device is None
    if isinstance(opened, MotionSource) and (device is not None or opened.joint_file is None):
        for line in opened.remarks:
            print(line)
    # A body with gloves already has the given height, and a motion was scaled to it.
    is_sized = isinstance(opened, MarkerSource) and opened.recording.known
    height = None if has_holes or is_sized else reading.height
    floor = 0.0 if isinstance(opened, MotionSource) else reading.floor or 0.0  # motions were moved to floor 0
    network = None if model is None else load_completion(model)
    settings = TrackerSettings(floor=floor, hold_feet=hold_feet)
    begun = time.perf_counter()
    with Progress(transient=True) as progress:
        bar = progress.add_task(f"tracking {file.name}", total=None)

        def advance(done: int, frames: int) -> None:
            progress.update(bar, completed=done, total=frames)

        given: dict[str, Any] = {
            **{"device": device, "missing": () if missing is None else missing, "person": wearer, "height": height},
            **{"noise": seeded, "settings": settings, "network": network, "causal": causal, "advance": advance},
        }
        take = _completed(opened, out, rig, given)
    rate = len(take.time) / (time.perf_counter() - begun)
    if take.partial is not None and take.partial.line:
        print(take.partial.line)
    take.save(out, rig)
    print(f"wrote {out}: {len(take.time)} frames at {rate:.0f} frames/s")
    warnings = (*take.remarks, *(remaining_gaps(take) if markers_out else ()))
    print_take(take, warnings, markers_out)
    if save_person is not None:
        take.person.save(save_person)
        print(f"wrote {save_person}")
    outputs = [out] if save_person is None else [out, save_person]
    return {"outputs": outputs, **take_values(take, rate, warnings, markers_out)}


def _completed(opened: Opened, out: Path, rig: str | None, options: dict[str, Any]) -> Take | FilledFile:
    """Complete an opened file by options of `track`; one that is written on its own rig in less memory."""
    from bodysense.io.target_rigs.named import SOURCE
    from bodysense.sources.open import MotionSource
    from bodysense.takes.track import Completion, fill_file, track

    if isinstance(opened, MotionSource) and opened.joint_file is not None and rig in (None, SOURCE):
        is_own = out.suffix.lower() == opened.joint_file.suffix.lower()
        if is_own and all(options[name] is None for name in ("device", "person", "height", "noise")):
            completion = Completion(*(options[name] for name in ("settings", "network", "causal", "advance")))
            return fill_file(opened, options["missing"], rig, completion)
    return track(opened, **options)


def convert(
    file: MotionFile,
    out: Output,
    more: MoreFiles = (),
    rig: str = "bodysense",
    rate: float | None = None,
    file_rate: float | None = None,
    json: Path | None = None,
    reading: Reading = AS_FOUND,
    many: Many = ONE_FILE,
) -> int:
    """Write a whole motion as another kind of file, on another rig, or at another rate.

    Several files or a folder are written with the same options into the folder -o; a later run does only what
    is left.

    Args:
        file: motion: .bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma. Also a folder of them.
        more: further files or folders.
        out: .bvh, .fbx, .glb (glTF with an animated skeleton), .vrma (an animation for VRM avatars) or .mcap (a
            take that robots' tools read). Of several files: a folder.
        rig: joints to write on: 'bodysense' and 'smplh' are our 52 joints; 'mixamo', 'unreal', 'metahuman', 'rigify',
            'vrm', 'vrchat', 'lafan1', 'soma' and 'mhr' the same under these names; 'source' is the rig of a .bvh or
            .fbx FILE, NAME.bvh or NAME.fbx that of another file, to whose body the motion is fitted.
        rate: frames a second of the output; those of the file if omitted.
        file_rate: frames a second of a file that does not say it.
        json: file for the result as JSON: outputs, frames, frame rate, rig, warnings.
        reading: facts that the file omits.
        many: several files or a folder.
    """
    check_rate("--rate", rate)
    check_rate("--file-rate", file_rate)
    work = partial(_convert_file, rig=rig, rate=rate, file_rate=file_rate, reading=reading)
    if more or file.is_dir():
        from bodysense.sources.kinds import MOTION_ENDINGS

        return do_many(work, [file, *more], MOTION_ENDINGS, out, many, json)
    if options := given_options(many):
        raise BodysenseError(f"{file}: one file; {options}: for several files or a folder, leave it out")
    if json is not None:
        check_place(json)
    write_summary(json, *_outputs(work(file, out)))
    return 0


def _convert_file(
    file: Path, out: Path, *, rig: str, rate: float | None, file_rate: float | None, reading: ReadingOptions
) -> dict[str, Any]:
    """Convert one file, and return its outputs and values about them."""
    from bodysense.io.motion_files import check_ending
    from bodysense.io.target_rigs.named import check_rig, is_rig_file
    from bodysense.sources.conversion import convert as converted

    check_rig(check_ending(out), rig, file if is_rig_file(file) else None)
    opened = open_motion(file, reading, file_rate, "--file-rate", watches_limbs=True)
    clip = converted(opened, out, rig=rig, rate=rate)
    print(f"wrote {out}: {len(clip)} frames at {clip.frame_rate:g} Hz on {rig}")
    joints, held = opened.held_still
    warnings = list(opened.warnings)
    if held.any():
        lost = f"frames, of {len(held)}: {frame_counts(joints, held, 'joints')}"
        lost = f"limbs are held still while the body moves, as lost ones are ({lost})"
        lost = f"{lost}; complete them: bodysense track {file.name} -o {out.name}"
        warnings.append(lost)
        print(f"WARNING: {lost}", file=sys.stderr)
    values = {"frames": len(clip), "frame_rate": round(clip.frame_rate, 6), "rig": rig, "warnings": warnings}
    return {"outputs": [out], **values}


def _check_outputs(file: Path, out: Path, rig: str | None, *more: Path | None) -> None:
    """Raise BodysenseError, before any work, for outputs that cannot be written."""
    from bodysense.io.markers.options import is_marker_file
    from bodysense.io.motion_files import check_ending
    from bodysense.io.target_rigs.named import check_rig, is_rig_file

    if is_marker_file(out) and is_marker_file(file):
        check_place(out)
    else:
        check_ending(out)
    if rig is not None:
        try:
            check_rig(out, rig, file if is_rig_file(file) else None)
        except BodysenseError as error:
            raise BodysenseError(f"{file}: {error}") from None
    for path in more:
        if path is not None:
            check_place(path)
