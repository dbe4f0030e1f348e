"""Fixtures shared by all tests."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import entry_points, version
from inspect import unwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings
from tyro._parsers import ParserSpecification
from tyro.extras import SubcommandApp
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.cli import main, packages
from bodysense.devices.simulated.glove import observe
from bodysense.devices.simulated.noise import hide
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.tracking.model import CompletionModel, packaged_model

sys.path.insert(0, str(Path(__file__).parent))  # helpers that tests of several rooms share
Command = Callable[..., str]
Refused = Callable[..., str]
MakeClip = Callable[..., Clip]
ExportedOnce = Callable[[str, Callable[[Path], None]], Path]

TESTS = Path(__file__).parent

# How long an example takes says how busy a machine is, not what is wrong.
settings.register_profile("bodysense", max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("bodysense")


def pytest_configure() -> None:
    """Give each process of the tests one thread: pytest-xdist starts a process per core with this environment."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")


# Files with tests of a minute: they begin first, so that no process waits for another at the end.
LONG = ("tests/extras/test_install.py", "tests/lab/commands/test_resuming.py", "tests/cli/test_trials.py")
# Folders whose tests run in one process: they take free ports and multicast, share one slow export, or drive browsers.
TOGETHER = ("tests/live/", "tests/lab/hmd_vae/", "tests/web/")
# Files whose fixtures or tests take a minute, of which each is for one process, too.
WHOLE = ("tests/extras/test_blender_headless.py", "tests/core/test_builds.py", "tests/lab/commands/test_arms.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put long files first, then long folders and files of one process, so that all processes end together."""
    items.sort(key=lambda item: 2 - item.nodeid.startswith((*TOGETHER, *WHOLE)) - 2 * item.nodeid.startswith(LONG))


class ByFile(LoadScopeScheduling):
    """Keeps the tests of a file in one process, which makes its fixtures once; long files are shared out."""

    def _split_scope(self, nodeid: str) -> str:
        path = nodeid.partition("::")[0]
        folder = next(filter(path.startswith, TOGETHER), None)
        return folder or (nodeid if path in LONG else path)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> ByFile:
    """Return the scheduler of processes; groups by marks (`--dist loadgroup`) are lost with pytest 9.2."""
    return ByFile(config, log)


@pytest.fixture(scope="session", autouse=True)
def packages_looked_up_once() -> Iterator[None]:
    """Look up the installed packages once: each run of a command would search all of the environment again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packages, "entry_points", cache(entry_points))
        yield


@pytest.fixture(scope="session", autouse=True)
def options_inspected_once() -> Iterator[None]:
    """Build the parser of each command once: each run would inspect the types and texts of all options again."""
    unions, parsers = dict[Any, Any](), dict[Any, Any]()
    build, make = SubcommandApp._build_union, ParserSpecification.from_callable_or_type

    def commands(application: SubcommandApp) -> tuple[Any, ...]:
        rows = application._subcommands.items()
        return tuple(
            (name, commands(one.target) if isinstance(one.target, SubcommandApp) else unwrap(one.target), one.help)
            for name, one in rows
        )

    def union(application: SubcommandApp, **given: Any) -> Any:
        key = (commands(application), *given.items())
        if key not in unions:
            unions[key] = build(application, **given)
        return unions[key]

    def parser(union: Any, **given: Any) -> ParserSpecification:
        key = (union, given["description"])
        if key not in parsers:
            parsers[key] = make(union, **given)
        return parsers[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SubcommandApp, "_build_union", union)
        root = SimpleNamespace(ParserSpecification=SimpleNamespace(from_callable_or_type=parser))
        patch.setattr("tyro._cli._parsers", root)
        yield


@pytest.fixture(scope="session")
def motion_data() -> Path:
    """Return a folder of real motion, laid out as in docs/data.md; skip the test if it is missing."""
    given = os.environ.get("BODYSENSE_DATA")
    candidates = [Path(given)] if given else [Path(__file__).parents[2] / "shared" / "data"]
    for folder in candidates:
        if (folder / "splits.json").is_file():
            return folder
    pytest.skip("no motion data: set BODYSENSE_DATA to a folder of it (docs/data.md)")


@pytest.fixture(scope="session")
def waving_clip() -> Clip:
    """Three seconds at 30 Hz of a standing person, who looks around, sways and waves; hands enter and leave view."""
    skeleton = default_skeleton()
    standing, time = standing_pose(skeleton), np.arange(90) / 30
    rotation = np.tile(standing.rotation, (len(time), 1, 1))
    swings = {
        "pelvis": (0.2, 0.0, 1.0, 0.0, 0.3),  # amplitude, axis, Hz
        "head": (0.5, 0.3, 1.0, 0.0, 0.4),
        "left_shoulder": (1.0, 0.0, 0.3, 1.0, 0.7),
        "left_elbow": (0.9, 0.0, -1.0, 0.0, 0.9),
        "right_shoulder": (0.9, 0.0, -1.0, -0.6, 0.5),
        "right_elbow": (1.2, 0.0, 1.0, 0.0, 1.1),
        "left_index2": (0.5, 0.0, 0.0, -1.0, 1.3),
        "right_thumb2": (0.4, 0.0, -1.0, 0.0, 0.8),
        "left_knee": (0.3, 1.0, 0.0, 0.0, 0.6),
    }
    for joint, (amplitude, *axis, rate) in swings.items():
        angle = amplitude * np.sin(2 * np.pi * rate * time)
        turn = quaternion_exp(angle[:, None] * np.array(axis))
        place = skeleton.index(joint)
        rotation[:, place] = quaternion_multiply(rotation[:, place], turn)
    root = standing.root_position + 0.05 * np.stack([np.sin(time), 0.2 * np.sin(3 * time), np.cos(time)], axis=-1)
    return Clip("waving", Pose(skeleton, root, rotation), 30.0)


@pytest.fixture(scope="session")
def hand() -> Skeleton:
    """The left hand of the default body."""
    return hand_skeleton(default_skeleton(), "left")


@pytest.fixture(scope="session")
def gloves(waving_clip: Clip) -> Observation:
    """Both gloves of a waving person, with every marker seen."""
    return observe(waving_clip.pose, waving_clip.time)


@pytest.fixture(scope="session")
def hidden_gloves(gloves: Observation) -> Observation:
    """Hide a fifth of the markers at random, and all of one frame."""
    hidden = np.random.default_rng(0).random(gloves.has_position.shape) < 0.2
    hidden[7] = True
    return hide(gloves, hidden)


@cache
def sources_of_exports() -> str:
    """Return a digest of the code and packages that an exported network depends on."""
    digest = hashlib.sha256("".join(f"{name} {version(name)}" for name in ("torch", "onnx", "onnxscript")).encode())
    root = TESTS.parent
    folders = [root / "packages/lab/src/bodysense_lab" / name for name in ("core", "papers")]
    folders += [root / "src/bodysense" / name for name in ("body", "geometry")]
    for path in (Path(__file__), *(path for folder in folders for path in sorted(folder.rglob("*.py")))):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@pytest.fixture(scope="session")
def exported_once(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ExportedOnce:
    """Write a network's files into a folder that all processes and later runs share, if none has: exports take long.

    `exported_once("a.onnx", write)` calls `write(path)` unless the file is there, and returns the path. Files of other
    sources are written again.
    """
    own, stored = tmp_path_factory.getbasetemp(), getattr(request.config, "cache", None)
    if stored is not None:  # none with `-p no:cacheprovider`
        folder = stored.mkdir("networks") / sources_of_exports()
    else:
        folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "networks"

    def written(name: str, write: Callable[[Path], None]) -> Path:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{path}.lock"):
            if not path.is_file():
                write(path)
        return path

    return written


@pytest.fixture(scope="session")
def small_network(exported_once: ExportedOnce) -> Path:
    """A small untrained network, exported."""
    import torch

    from bodysense_lab.papers.unoc.network.export import write_onnx
    from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyNetworkConfig

    torch.manual_seed(0)
    network = BodyNetwork(BodyNetworkConfig(hidden=16, branch=(16,)), default_skeleton())
    return exported_once("small.onnx", lambda path: write_onnx(network, path, {"licence": "Apache-2.0"}))


@pytest.fixture
def quick_completion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Train the completion network on four sequences at once instead of 96, judge errors by a second of each scene,
    and round no weights: all of it takes long.

    tests/lab/completion/networks/test_rounding.py rounds them.
    """
    from bodysense_lab.completion.networks import error_samples, publish
    from bodysense_lab.completion.training import task

    monkeypatch.setattr(task, "CompletionTaskConfig", partial(task.CompletionTaskConfig, streams=4))
    monkeypatch.setattr(publish, "_STREAMS", 4)
    monkeypatch.setattr(error_samples, "_LONGEST", 1.0)  # s of a clip
    monkeypatch.setattr(error_samples, "_SECONDS", 1.0)  # s of a scripted scene
    monkeypatch.setattr(publish, "round_weights", lambda network, moments: None)


@pytest.fixture
def in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the laboratory's other processes as threads: each process would import PyTorch."""
    monkeypatch.setattr("bodysense.parallel.ProcessPoolExecutor", lambda *given, **options: ThreadPoolExecutor(1))


@pytest.fixture
def short_training(quick_completion: None, in_threads: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Train without what takes long: other processes, exports, many sequences.

    A word is written in place of each .onnx file.
    """

    def export(*given: Any, **options: Any) -> None:
        next(one for one in given if isinstance(one, Path)).write_bytes(b"trained")

    for module in ("unoc.network.export", "hmd_vae.export", "pahmt.export", "two_hands.train"):
        monkeypatch.setattr(f"bodysense_lab.papers.{module}.export", export)


@pytest.fixture(scope="session")
def landmarkers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of MediaPipe's models: the cache's, or built once of an older wheel; skips where it cannot be had."""
    import runpy

    pytest.importorskip("mediapipe")
    from bodysense.devices.video.landmarker_files import HAND_LANDMARKER, POSE_LANDMARKER, landmarker_folder

    cache = getattr(request.config, "cache", None)  # none with `-p no:cacheprovider`
    built = tmp_path_factory.mktemp("landmarkers") if cache is None else cache.mkdir("landmarkers")
    with FileLock(built.with_suffix(".lock")):  # another process of the tests may build them
        for folder in (landmarker_folder(), built):
            if all((folder / name).is_file() for name in (HAND_LANDMARKER, POSE_LANDMARKER)):
                return folder
        script = runpy.run_path(str(TESTS.parent / "scripts" / "build_landmarkers.py"))
        try:
            script["build"](script["download"](tmp_path_factory.mktemp("wheel")), built)
        except subprocess.CalledProcessError:
            pytest.skip("no landmarkers: the wheel of mediapipe 0.10.21 cannot be downloaded")
        return built


@pytest.fixture(scope="session")
def filmed() -> tuple[np.ndarray, Clip]:
    """Eight pictures (8, 320, 320, 3) at 15 Hz of the packaged performance, drawn, and its motion; both hands show."""
    from bodysense.demo import packaged_performance
    from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
    from bodysense.pictures.animation import draw_pose
    from bodysense.pictures.camera import Lens, follow_body

    clip = packaged_performance()
    pose = clip.pose[308:332:3]  # the performer stands, and was turned by 2.28 rad: turn it to the camera
    turn = quaternion_exp(np.array([0.0, -2.28, 0.0]))
    rotation = np.array(pose.rotation)
    rotation[:, 0] = quaternion_multiply(np.broadcast_to(turn, rotation[:, 0].shape), rotation[:, 0])
    root = quaternion_rotate(np.broadcast_to(turn, rotation[:, 0].shape), pose.root_position)
    clip = replace(clip, pose=replace(pose, rotation=rotation, root_position=np.asarray(root)), frame_rate=15.0)
    lens = Lens(width=320, height=320, distance=3.0, eye=1.35, aim=1.15, view_height=1.5, azimuth=0.15)
    return np.stack(list(draw_pose(clip.pose, follow_body(clip.pose, 15.0, lens)))), clip


@pytest.fixture(scope="session")
def completion() -> CompletionModel:
    """The completion network that comes with the package."""
    return packaged_model()


@pytest.fixture(scope="session")
def short_clip(waving_clip: Clip) -> Clip:
    """Two thirds of a second."""
    return replace(waving_clip, name="short", pose=waving_clip.pose[:20])


@pytest.fixture
def motion(tmp_path: Path, short_clip: Clip) -> Path:
    """The short clip as BVH."""
    write_bvh(tmp_path / "motion.bvh", short_clip)
    return tmp_path / "motion.bvh"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run a command that must succeed, and return its output."""
    monkeypatch.setenv("COLUMNS", "250")  # no line is broken

    def call(*arguments: object) -> str:
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert (status, captured.err) == (0, "")
        return captured.out

    return call


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """Run a command that must fail: status 2 and one line on stderr, without `bodysense: `, which is returned."""

    def call(*arguments: object) -> str:
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert status == 2
        assert captured.err.startswith("bodysense: ") and captured.err.endswith("\n")
        assert captured.err.count("\n") == 1, captured.err
        return captured.err.removeprefix("bodysense: ").removesuffix("\n")

    return call


@pytest.fixture
def two_people(tmp_path: Path, short_clip: Clip) -> Path:
    """Two people, one of them at 60 Hz."""
    for person, clip in (("anna", short_clip), ("ben", resample(short_clip, 60.0))):
        (tmp_path / "motion" / person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / person / "a.bvh", clip)
    write_bvh(tmp_path / "motion" / "ben" / "b.bvh", short_clip)
    return tmp_path / "motion"


@pytest.fixture
def make_clip() -> MakeClip:
    def make(frames: int = 12, seed: int = 0, spread: float = 0.5, rate: float = 30.0) -> Clip:
        rng = np.random.default_rng(seed)
        skeleton = default_skeleton()
        knots = rng.normal(scale=spread, size=(4, len(skeleton.joints), 3))
        place = np.linspace(0, 2.999, frames)
        before, t = place.astype(int), (place % 1)[:, None, None]
        rotation = quaternion_exp((1 - t) * knots[before] + t * knots[before + 1])
        root = np.array([0.3, 0.95, -0.2]) + np.cumsum(rng.normal(scale=0.01, size=(frames, 3)), axis=0)
        return Clip(f"random_{seed}", Pose(skeleton, root, quaternion_canonical(rotation)), rate)

    return make
