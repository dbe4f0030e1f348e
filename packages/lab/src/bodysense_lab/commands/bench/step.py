"""`bodysense bench step`: the whole step, and its matrix products only."""

from __future__ import annotations

import runpy
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from importlib.resources import as_file, files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.person import Person
from bodysense.devices.simulated.device import SensorSetName
from bodysense.errors import BodysenseError
from bodysense.observing.observation import Observation
from bodysense.observing.observation import observe as make_frame
from bodysense.ranges import Count
from bodysense_lab.commands.bench.timing import frame_stepper, percentiles, report, resident_memory
from bodysense_lab.core.options import Json

if TYPE_CHECKING:
    from bodysense.tracking.tracker import Tracker

_ROOT = Path(__file__).parents[6]  # of the repository
_ROUNDS = 1000  # of the products
_RATE = 72.0  # Hz, of a headset
_PACED_FRAMES = 300
_OTHER_WORK = 2**25  # bytes that a frame's other work reads and writes


def bench_step(
    device: SensorSetName = "three_point",
    frames: Count = 3000,
    people: Count = 16,
    model: Path | None = None,
    json: Json = None,
) -> None:
    """Time the tracker's whole step frame by frame, for one wearer and for several in a batch.

    observe_ms is the time of `bodysense.observe` for head and wrists. live_ms is the time of a whole frame of the
    documented live loop: `observe`, `Tracker.step` in reused memory for a person of unknown body, and the pose. hot_ms
    is the median time of a step after the other, and p50_ms and p99_ms are of these. paced_ms is the median time of
    steps at 72 Hz, which find their weights evicted from the processor's caches. floor_ms is the time of one wearer's
    matrix products in C, for the body and its mirror image. reference_ms is the time of these products in NumPy,
    float32. mflop is their number of multiplications and additions for a frame.

    Args:
        device: tracked sensor set.
        frames: number of frames for one wearer, after 100 to warm up; the batch has a quarter of them.
        people: wearers in the batch; its figure in ms for each wearer is batch16_ms for 16.
        model: completion network of your own; the packaged one if omitted.
    """
    from bodysense.demo import performance_of_unseen_body
    from bodysense.devices.simulated.sensing import observe
    from bodysense.devices.simulated.sensors import SENSOR_SETS
    from bodysense.tracking.model import PACKAGED, load_completion
    from bodysense.tracking.tracker import Tracker

    clip = performance_of_unseen_body()
    observation = observe(clip.pose, clip.time, SENSOR_SETS[device])
    tracker = Tracker(Person(clip.pose.skeleton), network=None if model is None else load_completion(model))
    one = percentiles(frame_stepper(tracker, observation), frames)
    paced = _paced(frame_stepper(tracker, observation), min(frames, _PACED_FRAMES))
    batch = percentiles(_together(tracker, observation, people), max(1, frames // 4))
    live = percentiles(_live(observation), frames)["p50_ms"]
    numbers = {
        "live_ms": live,
        "observe_ms": percentiles(_observe, frames)["p50_ms"],
        "hot_ms": one["p50_ms"],
        "paced_ms": paced,
    }
    numbers |= {name: one[name] for name in ("p50_ms", "p99_ms")}
    numbers |= {f"batch{people}_ms": batch["p50_ms"] / people, f"batch{people}_p99_ms": batch["p99_ms"] / people}
    memory = resident_memory()  # of the step alone
    with ExitStack() as stack:
        packaged = files("bodysense.weights") / PACKAGED
        weights = stack.enter_context(as_file(packaged)) if model is None else model
        numbers |= {"floor_ms": _floor(weights)} | _reference(weights, max(1, frames // 4))
        size = weights.stat().st_size
    report(f"step, {device}", numbers | {"rss_mb": memory, "file_mb": size / 1e6}, json)


def _observe(frame: int) -> None:
    """Make an observation of head and wrists of numbers, as a live loop does."""
    head, turn = [0.1, 1.6 + 0.001 * (frame % 50), 0.2], [1.0, 0.0, 0.0, 0.0]
    make_frame(
        frame / _RATE, {"head": (head, turn), "left_wrist": ([0.4, 1.0, 0.3], None), "right_wrist": (None, turn)}
    )


def _live(observation: Observation) -> Callable[[int], None]:
    """Return a function that makes and completes the n-th frame of an observation, as a live loop does."""
    from bodysense.tracking.tracker import Tracker

    tracker = Tracker()
    last, state = None, tracker.start()
    tracked = ((observation.position, observation.has_position), (observation.rotation, observation.has_rotation))
    frames: list[dict[str, Any]] = [
        {
            name: tuple(values[t, k].tolist() if has[t, k] else None for values, has in tracked)
            for k, name in enumerate(observation.points)
        }
        for t in range(len(observation))
    ]
    interval = float(np.diff(observation.time).mean())

    def one(frame: int) -> None:
        nonlocal last, state
        seen = make_frame(frame * interval, frames[frame % len(frames)])
        estimate, state = last = tracker.step(seen, state, out=last)
        _ = estimate.pose.root_position[0], estimate.pose.rotation[0]

    return one


def _paced(one: Callable[[int], None], frames: int) -> float:
    """Return the median time in ms of frames at the rate of a headset. Other work of its time fills the caches."""
    other = np.zeros(_OTHER_WORK // 8)
    one(0)
    durations = list[float]()
    due = time.perf_counter()
    for frame in range(1, frames + 1):
        other += 1
        due += 1 / _RATE
        time.sleep(max(0.0, due - time.perf_counter()))
        start = time.perf_counter()
        one(frame)
        durations.append(time.perf_counter() - start)
    return 1000 * float(np.median(durations))


def _together(tracker: Tracker, observation: Observation, people: int) -> Callable[[int], None]:
    """Return a function that completes the n-th frame of several equal people in one batch."""
    from bodysense.tracking.tracker import step_together

    single = [observation[place : place + 1] for place in range(len(observation))]
    states = [tracker.start() for _ in range(people)]

    def one(frame: int) -> None:
        nonlocal states
        place = frame % len(single)
        begun = [tracker.start() for _ in range(people)] if place == 0 else states
        states = [state for _, state in step_together([(tracker, single[place], state) for state in begun])]

    return one


def _floor(weights: Path) -> float:
    """Return the median time in ms of the matrix products of one wearer in C; compiles core/bench/products.c."""
    source = _ROOT / "core" / "bench" / "products.c"
    if not source.is_file():
        raise BodysenseError(
            f"bench step compiles {source}, which does not exist; in a clone of the repository: "
            "pip install -c constraints.txt -e packages/lab"
        )
    with TemporaryDirectory(prefix="bodysense-") as folder:
        program = runpy.run_path(str(_ROOT / "scripts" / "build_core.py"))["build_program"](source, Path(folder) / "a")
        command = [str(program), str(weights), str(_ROUNDS), "1"]
        return float(subprocess.run(command, capture_output=True, check=True).stdout)


def _reference(weights: Path, frames: int) -> dict[str, float]:
    """Return the median time in ms of the products in NumPy, and their millions of multiplications and additions."""
    from bodysense_lab.completion.networks.weights_file import read_safetensors

    tables = [table for table in read_safetensors(weights)[0].values() if table.dtype == np.int8]
    wide = [np.ones(table.shape, np.float32) for table in tables]
    columns = [np.ones((table.shape[1], 2), np.float32) for table in tables]

    def products(_: int) -> None:
        for table, column in zip(wide, columns, strict=True):
            np.matmul(table, column)

    return {
        "reference_ms": percentiles(products, frames)["p50_ms"],
        "mflop": sum(4e-6 * table.size for table in tables),
    }
