"""`bodysense papers`: systems of the papers on a recording."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.options import Reading
from bodysense.cli.recordings import open_recorded
from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.markers.options import NO_OPTIONS, MarkerOptions
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.ranges import Seed
from bodysense_lab.commands.paper_bodies import fingers, generate, sample
from bodysense_lab.core.options import Output, check_ending
from bodysense_lab.papers.paper_options import Method, PaperOptions, Variant

if TYPE_CHECKING:
    from bodysense.sources.open import Opened


def commands() -> SubcommandApp:
    """Return the group's commands."""
    group = SubcommandApp()
    for command in (track, calibrate_hands, generate, sample, fingers):
        group.command(command)
    return group


def track(
    source: Annotated[Path, tyro.conf.Positional],
    out: Output,
    method: Method,
    variant: Variant | None = None,
    networks: Path | None = None,
    device: DeviceName | None = None,
    noise: bool = False,
    seed: Seed = 1,
    calibration: Path | None = None,
    landmarkers: Path | None = None,
    gloves: Annotated[MarkerOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    reading: Reading = AS_FOUND,
) -> None:
    """Complete a recording, markers, a video or a motion by the system of a paper; write BVH, glTF or VRMA.

    Args:
        source: recording (.npz, .jsonl), gloves (.c3d, .csv, .trc, .tsv), video, or motion (.bvh, .npz, .glb …).
        out: completed motion: .bvh, .glb, .vrma or .mcap.
        method: 'unoc': body and fingers from a headset's cameras. 'hmd_vae': body from head and wrists. 'pahmt': arms
            and hands of a video. 'two_hands': hands from markers of gloves. 'completion': the tracker of
            `bodysense track`.
        variant: of 'hmd_vae' the model, 0 to 4; of 'pahmt' cnn, ahmt or pahmt; of 'two_hands' and 'unoc' paper or
            shipped.
        networks: network file that `bodysense train` wrote, for 'two_hands' a folder; the packaged one if omitted.
        device: simulated device that tracks a motion; the paper's own if omitted.
        noise: simulate errors of a real device.
        seed: random seed of the noise.
        calibration: flat-hand calibration, for 'two_hands', from `bodysense papers calibrate-hands`.
        landmarkers: folder of MediaPipe's landmarkers, for 'pahmt' on a video; downloaded if omitted.
        reading: properties that the file does not contain; --height is the wearer's.
    """
    from dataclasses import replace

    from bodysense.io.motion_files import check_ending as check_motion
    from bodysense.io.motion_files import write_motion
    from bodysense_lab.papers.paper_systems import SYSTEMS

    check_motion(out)
    if calibration is not None and method != "two_hands":
        raise BodysenseError(f"--calibration {calibration}: for --method two_hands, not for {method}; leave it out")
    if landmarkers is not None and method != "pahmt":
        raise BodysenseError(f"--landmarkers {landmarkers}: for --method pahmt, not for {method}; leave it out")
    opened, height = _opened(source, gloves, reading)
    options = PaperOptions(networks, variant, device, seed if noise else None, height, calibration, landmarkers)
    begun = time.perf_counter()
    clip = SYSTEMS[method](opened, options)
    rate = len(clip) / (time.perf_counter() - begun)
    write_motion(out, replace(clip, name=out.stem))
    print(f"wrote {out}: {len(clip)} frames by {method}, {rate:.0f} frames/s")


def calibrate_hands(
    source: Annotated[Path, tyro.conf.Positional],
    out: Output,
    variant: Variant | None = None,
    networks: Path | None = None,
    gloves: Annotated[MarkerOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    reading: Reading = AS_FOUND,
) -> None:
    """Write the flat-hand calibration of gloves (two hands, section 3.2.3), for `bodysense papers track`.

    Args:
        source: take of flat hands with all markers visible: .c3d, .csv, .trc, .tsv, .npz, .jsonl, or a motion.
        out: calibration, .npz.
        variant: form of the networks, paper or shipped.
        networks: folder that `bodysense train gloves` wrote; the packaged networks if omitted.
        reading: properties that the file does not contain.
    """
    from bodysense_lab.papers.two_hands.system import calibrate

    check_place(out)
    check_ending(out, ".npz", what="a calibration")
    opened, height = _opened(source, gloves, reading)
    hands = calibrate(opened, out, PaperOptions(networks, variant, height=height))
    print(f"wrote {out}: {' and '.join(hands)} hand")


def _opened(source: Path, gloves: MarkerOptions, reading: ReadingOptions) -> tuple[Opened, float | None]:
    """Return the opened source, and the wearer's given height if the source does not contain a body."""
    from bodysense.sources.open import RecordingSource, VideoSource

    opened = open_recorded(source, reading, gloves)
    return opened, reading.height if isinstance(opened, (RecordingSource, VideoSource)) else None
