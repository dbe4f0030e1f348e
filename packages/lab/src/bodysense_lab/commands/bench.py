"""`bodysense bench`: how fast, on this machine.

Gloves to time with: synthesised hands of which markers are hidden.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from tyro.extras import SubcommandApp

from bodysense.body.person import Person
from bodysense.devices.simulated.device import SensorSetName
from bodysense.errors import BodysenseError
from bodysense.observation import Observation
from bodysense_lab.commands import arms, bench_live, bench_outputs, live_checks
from bodysense_lab.commands.timing import percentiles, report, resident_memory


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    group.command(step)
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


def step(
    sensors: SensorSetName = "three_point",
    frames: int = 3000,
    people: int = 16,
    model: Path | None = None,
    json: Path | None = None,
) -> None:
    """Time the tracker's whole step, a frame at a time: one wearer, and several in a batch.

    onnx_p50_ms and onnx_batch16_ms are the same step as the last ONNX graph; reference_ms are the step's matrix
    products of one wearer in NumPy, float32, of the body and its mirror image; mflop are their multiplications and
    additions a frame.

    Args:
        sensors: sensor set that is tracked.
        frames: frames to time of one wearer, after 100 to warm up; of the batch a quarter as many.
        people: wearers in the batch; its figure, ms a wearer, is called batch16_ms with 16.
        model: completion network of your own; the packaged one if omitted.
        json: write the numbers here, as one flat object.
    """
    from bodysense.completion.model import PACKAGED, load_completion
    from bodysense.demo import performance_of_stranger
    from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
    from bodysense.tracker import Tracker, step_together
    from bodysense_lab.completion.weights_file import read_safetensors

    if people < 1:
        raise BodysenseError(f"--people {people}: give at least 1")
    clip = performance_of_stranger()
    observation = observe(clip.pose, clip.time, SENSOR_SETS[sensors])
    network = None if model is None else load_completion(model)
    tracker = Tracker(Person(clip.pose.skeleton), network=network)
    one = percentiles(_streamed(tracker, observation), frames)
    single = [observation[place : place + 1] for place in range(len(observation))]
    states = [tracker.start() for _ in range(people)]

    def together(frame: int) -> None:
        nonlocal states
        place = frame % len(single)
        begun = [tracker.start() for _ in range(people)] if place == 0 else states
        done = step_together([(tracker, single[place], state) for state in begun])
        states = [state for _, state in done]

    batch = percentiles(together, max(1, frames // 4))
    numbers = {name: one[name] for name in ("p50_ms", "p99_ms")}
    numbers |= {f"batch{people}_ms": batch["p50_ms"] / people, f"batch{people}_p99_ms": batch["p99_ms"] / people}
    graph, graphs = (_graph(observation, tracker.people * count) for count in (1, people))
    numbers["onnx_p50_ms"] = percentiles(graph, max(1, frames // 4))["p50_ms"]
    numbers[f"onnx_batch{people}_ms"] = percentiles(graphs, max(1, frames // 16))["p50_ms"] / people
    with as_file(files("bodysense.weights") / PACKAGED) as packaged:
        path = packaged if model is None else model
        size, tables = path.stat().st_size, [t for t in read_safetensors(path)[0].values() if t.dtype == np.int8]
    wide = [np.ones(table.shape, np.float32) for table in tables]
    columns = [np.ones((table.shape[1], 2), np.float32) for table in tables]

    def products(_: int) -> None:
        for table, column in zip(wide, columns, strict=True):
            np.matmul(table, column)

    numbers["reference_ms"] = percentiles(products, max(1, frames // 4))["p50_ms"]
    numbers["mflop"] = sum(4e-6 * table.size for table in tables)
    report(f"step, {sensors}", numbers | {"rss_mb": resident_memory(), "file_mb": size / 1e6}, json)


def _graph(observation: Observation, people: Sequence[Person]) -> Callable[[int], None]:
    """Run the n-th frame of an observation, of several people alike, through the last ONNX graph."""
    from bodysense_lab.completion.onnx_graph import graph_inputs, open_graph

    network, names = open_graph(), ("position", "rotation", "has_position", "has_rotation", "accuracy")
    together = {name: np.repeat(getattr(observation, name)[None], len(people), axis=0) for name in names}
    frames = list(graph_inputs(replace(observation[:300], **{n: v[:, :300] for n, v in together.items()}), people))
    state = network.start(len(people))

    def one(frame: int) -> None:
        nonlocal state
        place = frame % len(frames)
        _, state = network.step(frames[place], network.start(len(people)) if place == 0 else state)

    return one


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
            taken = percentiles(_streamed(Hands(skeletons, models, settings), observation), frames)
            numbers |= {f"{name}{label}_{key}": value for key, value in taken.items()}
    report("gloves", numbers | {"rss_mb": resident_memory()}, json)


def _streamed(method: Any, observation: Observation) -> Callable[[int], None]:
    """Takes the n-th frame of an observation that begins again whenever it ends: by an estimator, a tracker, hands."""
    state = method.start()
    single = [observation[place : place + 1] for place in range(len(observation))]

    def one(frame: int) -> None:
        nonlocal state
        place = frame % len(single)
        state = method.step(single[place], method.start() if place == 0 else state)[-1]

    return one


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
    """Time reading a large BVH file, beside parsing the same floats with NumPy alone.

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

    Args:
        runs: Processes; the median is told.
        json: Write the numbers here, as one flat object.
    """
    import subprocess

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
    alone, seconds = (float(np.median([row[k] for row in rows])) for k in (0, 1))
    numbers = {"package_seconds": alone, "seconds": seconds, "torch_imported": max(row[2] for row in rows)}
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
