"""`bodysense bench`: how fast, on this machine.

Gloves to time with: synthesised hands of which markers are hidden.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError
from bodysense_lab.commands import arms, bench_live, bench_outputs, bench_step, live_checks
from bodysense_lab.commands.timing import percentiles, report, resident_memory, streamed


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    group.command(name="step")(bench_step.bench_step)
    group.command(gloves)
    group.command(ik)
    group.command(occlusion)
    group.command(bvh)
    group.command(name="import")(import_time)
    group.command(training)
    group.command(name="arms")(arms.bench_arms)
    group.command(name="live")(bench_live.bench_live)
    group.command(name="live-outputs")(bench_outputs.live_outputs)
    group.command(live_checks.live_fuzz)
    group.command(live_checks.packet_fuzz)
    group.command(live_checks.packet_decoders)
    group.command(live_checks.live_soak)
    return group


def gloves(frames: int = 3000, json: Path | None = None) -> None:
    """Time gloves with one hidden marker a hand, a frame at a time, everything included: one hand, then two.

    Which marker is hidden changes every half second. `all` is with none hidden. The step that moves hands and fingers
    out of each other is timed in `contact` alone.

    Args:
        frames: Frames to time of each, after 100 to warm up.
        json: Write the numbers here, as one flat object.
    """
    from bodysense.devices.gloves.hands import Hands, HandsSettings, load_glove_models
    from bodysense_lab.synthesis.glove_stream import glove_stream

    numbers, models = {}, load_glove_models()
    for name, hands in (("one_hand", ("left",)), ("two_hands", ("left", "right"))):
        skeletons, hidden = glove_stream(hands, frames=600, hidden=1)
        _, whole = glove_stream(hands, frames=600, hidden=0)
        for label, observation, settings in (
            ("", hidden, HandsSettings(contact=None)),
            ("_all", whole, HandsSettings(contact=None)),
            ("_contact", hidden, HandsSettings()),
        ):
            taken = percentiles(streamed(Hands(skeletons, models, settings), observation), frames)
            numbers |= {f"{name}{label}_{key}": value for key, value in taken.items()}
    report("gloves", numbers | {"rss_mb": resident_memory()}, json)


def ik(frames: int = 3000, noise: float = 0.0, json: Path | None = None) -> None:
    """Time inverse kinematics of the whole body, a frame at a time, from the frame before.

    Args:
        frames: Frames to time, after 100 to warm up.
        noise: Metres; standard deviation added to every target.
        json: Write the numbers here, as one flat object.
    """
    from bodysense.body.ik import InverseKinematics
    from bodysense.body.pose import forward_kinematics
    from bodysense.demo import packaged_performance

    clip = packaged_performance()
    target = np.asarray(forward_kinematics(clip.pose)[0])
    target = target + np.random.default_rng(0).normal(scale=noise, size=target.shape) if noise else target
    solver, state = InverseKinematics(clip.pose.skeleton), None

    def one(frame: int) -> None:
        nonlocal state
        place = frame % len(clip)
        _, state = solver.solve(target[place], state=None if place == 0 else state)

    report("ik", percentiles(one, frames), json)


def occlusion(frames: int = 30_000, json: Path | None = None) -> None:
    """Time the simulation of what a headset's cameras see: the median of five passes after one to warm up.

    Args:
        frames: Frames to see.
        json: Write the numbers here, as one flat object.
    """
    from bodysense.demo import packaged_performance
    from bodysense.devices.simulated.headset_camera import see

    clip = packaged_performance()
    many = clip.pose[np.arange(frames) % len(clip)]
    passes = []
    for _ in range(6):
        begun = time.perf_counter()
        see(many)
        passes.append(frames / (time.perf_counter() - begun))
    report("occlusion", {"frames_per_second": float(np.median(passes[1:]))}, json)


def bvh(megabytes: int = 60, json: Path | None = None) -> None:
    """Time reading a large BVH file, compared with parsing its floats by NumPy alone.

    Args:
        megabytes: Size of the file, written to a temporary folder.
        json: Write the numbers here, as one flat object.
    """
    from dataclasses import replace
    from tempfile import TemporaryDirectory

    from bodysense.demo import packaged_performance
    from bodysense.io.bvh import read_bvh, write_bvh

    clip = packaged_performance()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "large.bvh"
        write_bvh(path, clip)
        copies = max(1, round(megabytes * 1e6 / path.stat().st_size))
        write_bvh(path, replace(clip, pose=clip.pose[np.tile(np.arange(len(clip)), copies)]))
        size = path.stat().st_size / 1e6
        begun = time.perf_counter()
        read_bvh(path)
        read = time.perf_counter() - begun
        text = path.read_bytes()
        numbers = text[text.index(b"Frame Time") :].split(b"\n", 1)[1]
        begun = time.perf_counter()
        np.fromstring(numbers.decode("ascii"), sep=" ")
        bare = time.perf_counter() - begun
    report("bvh", {"mb_per_second": size / read, "bare_parse_mb_per_second": size / bare, "ratio": read / bare}, json)


def import_time(runs: int = 9, json: Path | None = None) -> None:
    """Time `import bodysense`, alone and with the tracker, in fresh processes; PyTorch must not be among it.

    numpy_seconds is `import numpy` alone, which is part of what the tracker takes.

    Args:
        runs: Number of processes; the median is printed.
        json: Write the numbers here, as one flat object.
    """
    import subprocess

    numpy = "import time; begun = time.perf_counter(); import numpy; print(time.perf_counter() - begun)"
    code = (
        "import time; begun = time.perf_counter(); import bodysense; alone = time.perf_counter() - begun; "
        "bodysense.Tracker; import sys; print(alone, time.perf_counter() - begun, int('torch' in sys.modules))"
    )
    rows = [
        [
            float(word)
            for word in subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout.split()
        ]
        for _ in range(runs)
    ]
    bare = [float(subprocess.run([sys.executable, "-c", numpy], capture_output=True, check=True).stdout) for _ in rows]
    alone, seconds = (float(np.median([row[k] for row in rows])) for k in (0, 1))
    numbers = {
        "package_seconds": alone,
        "seconds": seconds,
        "numpy_seconds": float(np.median(bare)),
        "torch_imported": max(row[2] for row in rows),
    }
    report("import", numbers, json)


def training(steps: int = 6, threads: int = 1, json: Path | None = None) -> None:
    """Time steps of `train completion`, and UNOC's training on windows and on whole sequences with carried state.

    A window teaches one frame, its last; a sequence teaches every frame that it plays.

    Args:
        steps: Optimiser steps of each, after one to warm up.
        threads: PyTorch threads.
        json: Write the numbers here, as one flat object.
    """
    from bodysense.demo import packaged_performance
    from bodysense_lab.completion.pace import training_pace
    from bodysense_lab.unoc.train import throughput

    if steps < 1:
        raise BodysenseError(f"--steps {steps}: give at least 1")
    clip = packaged_performance()
    report("training", training_pace(clip, steps, threads) | throughput(clip, steps, threads), json)
