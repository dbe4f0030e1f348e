"""Building of a study: scenes are cut from motion, completed by two methods, rendered, and written as web pages."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.parallel import parallel_map
from bodysense.pictures.animation import write_animation
from bodysense.pictures.camera import FollowingCamera, Lens, follow_body
from bodysense.quality.metrics import joint_error
from bodysense.takes.last_known import Hold
from bodysense_lab.core.scoring import RATE, scored_points
from bodysense_lab.papers.unoc.ik_tracker import Estimator, IkTracker, IkTrackerSettings
from bodysense_lab.papers.unoc.learned import Learned, load_model
from bodysense_lab.study.study import CONDITIONS, Condition, StudyKey, draw_key, write_key

FILES = ("index.html", "style.css", "study.js")


def write_study_page(folder: Path, study: str, rings: Sequence[Sequence[str]]) -> Path:
    """Write the pages of a study into an existing, empty folder, and return the folder for its animations.

    `rings` has the names of each scene's animations, in the order of its ring (lab/study/study.py). The caller writes
    their files, `<name>.webp`, into the returned folder. The page contains only the names.
    """
    study_json = json.dumps({"study": study, "scenes": [list(ring) for ring in rings]}).replace("<", "\\u003c")
    source = files("bodysense_lab.study").joinpath("assets")
    for name in FILES:
        text = source.joinpath(name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace(">STUDY<", f">{study_json}<"), encoding="utf-8")
    clips = folder / "clips"
    clips.mkdir()
    return clips


_SHORTEST = 0.5  # s; shorter scenes cannot be judged


@dataclass(frozen=True)
class StudySettings:
    """Scenes of a study, and completion of their bodies; both conditions use the same tracker."""

    longest: float = 6.0  # s; longer clips are cut into scenes of equal length
    scenes: int = 8  # maximum number, drawn at random (the paper: eight)
    model: Path | None = None  # network; the packaged one if None
    last_known: Literal["world", "head", "heading"] = "heading"  # axes in which the baseline keeps hidden points
    tracker: IkTrackerSettings = IkTrackerSettings()
    lens: Lens = Lens()

    def __post_init__(self) -> None:
        if not _SHORTEST <= self.longest < math.inf:
            raise BodysenseError(f"scenes of {self.longest:g} s cannot be judged; give at least {_SHORTEST:g}")
        if self.scenes < 1:
            raise BodysenseError(f"a study of {self.scenes} scenes is empty; give at least 1")


@dataclass(frozen=True, eq=False)
class SceneMotion:
    """One scene at 30 Hz under every condition."""

    name: str
    pose: dict[Condition, Pose]  # (T, …) each
    hidden: np.ndarray  # (T, 14) bool, tested joints that the headset did not see
    error: dict[Condition, float]  # cm, mean over hidden joints; NaN if none was hidden

    @property
    def seconds(self) -> float:
        """Length of the scene."""
        return len(self.hidden) / RATE


def complete_clip(clip: Clip, settings: StudySettings) -> SceneMotion:
    """Return a canonical clip under every condition: the truth, and completions from a headset's view.

    'ours' uses the network, 'baseline' last known positions. Both have the same inverse kinematics and smoothing, as in
    the paper, so that bones keep their lengths.
    """
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)

    def completed(estimator: Estimator) -> Pose:
        tracker = IkTracker(estimator, settings.tracker)
        return tracker.step(observation, tracker.start())[0]

    pose: dict[Condition, Pose] = {
        "truth": clip.pose,
        "ours": completed(Learned(load_model(settings.model), skeleton)),
        "baseline": completed(Hold(skeleton, settings.last_known)),
    }
    return _scene_motion(clip.name, pose, ~observation.has_position[:, scored_points(skeleton)])


def cut_scenes(motion: SceneMotion, longest: float) -> list[SceneMotion]:
    """Cut a completed clip into scenes of equal length, at most `longest` seconds."""
    frames = len(motion.hidden)
    count = max(1, math.ceil(frames / (longest * RATE)))
    if frames / count < _SHORTEST * RATE:
        raise BodysenseError(f"{motion.name}: {motion.seconds:.2f} s cannot be judged; give at least {_SHORTEST:g} s")
    if count == 1:
        return [motion]
    edges = np.linspace(0, frames, count + 1).astype(int)
    return [
        _scene_motion(
            f"{motion.name}-{number}",
            {condition: pose[start:end] for condition, pose in motion.pose.items()},
            motion.hidden[start:end],
        )
        for number, (start, end) in enumerate(pairwise(edges), start=1)
    ]


def build_study(
    folder: Path,
    clips: Sequence[Clip],
    settings: StudySettings,
    generator: np.random.Generator,
    jobs: int,
    advance: Callable[[int, int], None],
) -> tuple[StudyKey, list[SceneMotion]]:
    """Make a study of canonical clips in a new folder: key.json, and site/ with all files for raters.

    Animations are rendered in `jobs` processes; `advance` receives the numbers of finished and of all animations.
    Returns the key, and the scenes in its order. Raises BodysenseError if the folder is not empty, or if two clips have
    the same name.
    """
    names = [clip.name for clip in clips]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BodysenseError(f"two clips are called {twice!r}; rename one, so that results can name their scenes")
    with _new_folder(folder) as beside:
        found = [scene for clip in clips for scene in cut_scenes(complete_clip(clip, settings), settings.longest)]
        drawn = generator.permutation(len(found))[: settings.scenes]
        scenes = [found[index] for index in sorted(drawn)]
        key = draw_key([scene.name for scene in scenes], generator)
        site = beside / "site"
        site.mkdir()
        place = write_study_page(site, key.study, [scene.ring for scene in key.scenes])
        work = _renderings(key, scenes, settings.lens, place)
        advance(0, len(work))
        for done, _ in enumerate(parallel_map(_render, work, jobs), start=1):
            advance(done, len(work))
        write_key(beside / "key.json", key)
    return key, scenes


def _render(work: tuple[Path, Pose, FollowingCamera]) -> None:
    write_animation(*work, RATE)


def _renderings(
    key: StudyKey, scenes: Sequence[SceneMotion], lens: Lens, place: Path
) -> list[tuple[Path, Pose, FollowingCamera]]:
    """Return the animations to draw, sorted by opaque name, so that the age of a file reveals nothing."""
    work = []
    for scene, motion in zip(key.scenes, scenes, strict=True):
        camera = follow_body(motion.pose["truth"], RATE, lens)
        work += [
            (place / f"{clip}.webp", motion.pose[condition], camera) for clip, condition in scene.condition.items()
        ]
    return sorted(work, key=lambda one: one[0])


def _scene_motion(name: str, pose: dict[Condition, Pose], hidden: np.ndarray) -> SceneMotion:
    """Return a scene with its errors."""
    tested = scored_points(pose["truth"].skeleton)
    position = {c: np.asarray(forward_kinematics(pose[c])[0])[:, tested] for c in CONDITIONS}
    error: dict[Condition, float] = {}
    for condition in CONDITIONS:
        missed = joint_error(position[condition], position["truth"])[hidden]
        error[condition] = float(missed.mean()) if missed.size else math.nan
    return SceneMotion(name, pose, hidden, error)


@contextmanager
def _new_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder to fill; it is renamed to `folder` if the block succeeds, and removed otherwise."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise BodysenseError(f"{folder} exists; name a new folder, so that no study loses its key")
    folder = folder.resolve()
    beside = folder.with_name(f".{folder.name}.part")
    try:
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir(parents=True)
        yield beside
        if folder.exists():
            folder.rmdir()
        beside.rename(folder)
    except OSError as error:
        raise BodysenseError(f"{folder} cannot be made ({error.strerror}); choose another place") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
