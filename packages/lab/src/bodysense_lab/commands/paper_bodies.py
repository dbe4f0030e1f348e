"""Bodies and fingers drawn from papers' networks: `bodysense papers generate`, `sample` and `fingers`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.cli.options import Reading
from bodysense.cli.overwriting import check_apart
from bodysense.cli.recordings import open_motion, open_recorded, person_of
from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.ranges import Samples, Seed
from bodysense_lab.core.options import Output

if TYPE_CHECKING:
    from bodysense.io.formats.recording import Recording


def generate(
    out: Output, network: Path | None = None, count: Samples = 12, seed: Seed = 1, height: float | None = None
) -> None:
    """Sample bodies from HMD-VAE's prior, as a picture or as the frames of a BVH file.

    Args:
        out: NAME.png or NAME.bvh.
        network: network written by `bodysense train hmd-vae`, best a model 0; the packaged one if omitted.
        count: number of bodies.
        seed: random seed.
        height: height of the bodies in metres; the default skeleton's if omitted.
    """
    import numpy as np

    from bodysense.body.skeleton import default_skeleton
    from bodysense.io.clip import Clip
    from bodysense.io.formats.bvh import write_bvh
    from bodysense.pictures.sheet import draw_sheet
    from bodysense_lab.papers.hmd_vae.body_vae import load_body_vae, sample_prior

    check_place(out)
    if out.suffix.lower() not in (".bvh", ".png"):
        found = f"ends in {out.suffix!r}" if out.suffix else "has no ending"
        raise BodysenseError(f"{out}: the output {found}; valid are .png and .bvh")
    body = ReadingOptions(height=height)
    skeleton = default_skeleton() if body.height is None else default_skeleton().scaled(body.height)
    pose = sample_prior(skeleton, load_body_vae(network), count, np.random.default_rng(seed))
    if out.suffix.lower() == ".png":
        draw_sheet(out, pose)
    else:
        write_bvh(out, Clip(out.stem, pose, frame_rate=1.0))  # one frame per body, one second each
    print(f"wrote {out}: {count} bodies")


def sample(
    source: Annotated[Path, tyro.conf.Positional],
    out: Output,
    count: Samples = 4,
    device: DeviceName | None = None,
    network: Path | None = None,
    noise: bool = False,
    seed: Seed = 1,
    reading: Reading = AS_FOUND,
) -> None:
    """Write several plausible bodies for one recording of head and wrists by HMD-VAE: OUT_1.bvh, OUT_2.bvh …

    Args:
        source: recording (.npz, .jsonl) of head and wrists, or a motion with --device three_point.
        out: completed motions: .bvh, .glb, .vrma or .mcap.
        count: number of bodies.
        device: simulated device that tracks a motion.
        network: network written by `bodysense train hmd-vae`; the packaged one if omitted.
        noise: simulate errors of a real device.
        seed: random seed of bodies and noise.
        reading: properties that the file does not contain; --height is the wearer's.
    """
    from bodysense.io.formats.recording import Recording
    from bodysense.io.motion_files import check_ending
    from bodysense.sources.open import RecordingSource
    from bodysense.sources.signals import signal_from

    check_ending(out)
    check_apart(sample_paths(out, count), source)
    opened = open_recorded(source, reading)
    height = reading.height if isinstance(opened, RecordingSource) else None
    signal = signal_from(
        opened, device=device, person=person_of(None, height), height=height, noise=seed if noise else None
    )
    recording = Recording(signal.observation, signal.person.skeleton)
    for path in write_samples(recording, out, count, seed, network):
        print(f"wrote {path}")


def fingers(
    source: Annotated[Path, tyro.conf.Positional],
    out: Output,
    network: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Write a motion with fingers predicted from its body (UNOC, section 5.3); everything else is unchanged.

    Args:
        source: motion: .bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma.
        out: motion with fingers: .bvh, .glb, .vrma or .mcap.
        network: network written by `bodysense train fingers`; the packaged one if omitted.
        reading: properties that the file does not contain.
    """
    from dataclasses import replace

    from bodysense.io.motion_files import check_ending, write_motion
    from bodysense_lab.papers.unoc.fingers import synthesize
    from bodysense_lab.papers.unoc.point_model import load_point_model

    check_ending(out)
    clip = synthesize(open_motion(source, reading).clip, load_point_model("fingers", network))
    write_motion(out, replace(clip, name=out.stem))
    print(f"wrote {out}: {len(clip)} frames with synthesized fingers")


def sample_paths(out: Path, count: int) -> list[Path]:
    """Return the paths of the files that `write_samples` writes."""
    return [out.with_name(f"{out.stem}_{k}{out.suffix}") for k in range(1, count + 1)]


def write_samples(recording: Recording, out: Path, count: int, seed: int, network: Path | None = None) -> list[Path]:
    """Track one recording `count` times, each with a random draw of untracked joints: OUT_1.bvh, OUT_2.bvh, …

    Tracked heads and hands have their measured positions in all files. `network` is a file written by
    `bodysense train hmd-vae`; the packaged one if None. Raises BodysenseError if the recording has points other than
    head and wrists.
    """
    import numpy as np
    from rich.progress import track as progress

    from bodysense.devices.simulated.sensors import THREE_POINTS
    from bodysense.io.clip import Clip
    from bodysense.io.motion_files import write_motion
    from bodysense.io.resample import at_constant_rate
    from bodysense_lab.papers.hmd_vae.body_vae import BodyVaeEstimator, load_body_vae, sample_noise
    from bodysense_lab.papers.ik.target_ik import TargetIk

    observation = recording.observation
    other = [name for name in observation.points if name not in THREE_POINTS]
    if other:
        raise BodysenseError(
            f"papers sample draws from head and hands ({', '.join(THREE_POINTS)}), but {other[0]!r} is tracked too; "
            "give a recording of these, or --device three_point"
        )
    if "head" not in observation.points or not observation.has_position[:, observation.points.index("head")].any():
        raise BodysenseError("papers sample: 'head' is tracked in none of its frames; record it with a headset")
    model = load_body_vae(network)
    noises = sample_noise(model, count, np.random.default_rng(seed))
    paths, solver = sample_paths(out, count), TargetIk(recording.skeleton)
    interval = np.diff(observation.time)
    rate = 1 / float(np.median(interval)) if len(interval) else 30.0
    for path, noise in progress(list(zip(paths, noises, strict=True)), description="drawing bodies"):
        estimator = BodyVaeEstimator(recording.skeleton, model, noise)
        estimate, _ = estimator.step(observation, estimator.start())
        assert estimate.pose is not None
        pose = solver.bend(estimate, estimate.pose, observation)
        write_motion(path, at_constant_rate(Clip(path.stem, pose, rate), observation.time))
    return paths
