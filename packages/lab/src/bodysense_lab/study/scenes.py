"""Building of a study: scenes are cut from motion, completed by two methods, rendered, and written with a page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
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
from bodysense_lab.study.analysis import Condition, StudyKey, draw_key, write_key

_SHORTEST = 0.5  # s; shorter scenes cannot be judged


@dataclass(frozen=True, eq=False)
class SceneMotion:
    """One scene at 30 Hz under every condition."""

    name: str
    pose: dict[Condition, Pose]  # (T, …) each
    hidden: np.ndarray  # (T, 14) bool, tested joints that the headset did not see

    def error(self, condition: Condition) -> float:
        """Return the mean error of the hidden joints, cm; NaN if none was hidden."""
        tested = scored_points(self.pose["truth"].skeleton)
        ours, truth = (np.asarray(forward_kinematics(self.pose[name])[0])[:, tested] for name in (condition, "truth"))
        off = joint_error(ours, truth)[self.hidden]
        return float(off.mean()) if off.size else math.nan


def complete_clip(clip: Clip, model: Path | None = None) -> SceneMotion:
    """Return a canonical clip under every condition: the truth, and completions from a headset's view.

    'ours' uses the network, the packaged one by default, 'baseline' last known positions. Both have the same inverse
    kinematics and smoothing, as in the paper, so that bones keep their lengths.
    """
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
    pose: dict[Condition, Pose] = {"truth": clip.pose}
    estimators: dict[Condition, Estimator] = {
        "ours": Learned(load_model(model), skeleton),
        "baseline": Hold(skeleton, "heading"),
    }
    for name, estimator in estimators.items():
        tracker = IkTracker(estimator, IkTrackerSettings())
        pose[name] = tracker.step(observation, tracker.start())[0]
    return SceneMotion(clip.name, pose, ~observation.has_position[:, scored_points(skeleton)])


def cut_scenes(motion: SceneMotion, longest: float) -> list[SceneMotion]:
    """Cut a completed clip into scenes of equal length, at most `longest` seconds."""
    frames = len(motion.hidden)
    count = max(1, math.ceil(frames / (max(longest, _SHORTEST) * RATE)))
    if frames / count < _SHORTEST * RATE:
        raise BodysenseError(f"{motion.name}: {frames / RATE:.2f} s cannot be judged; give at least {_SHORTEST:g} s")
    parts = [slice(*edges) for edges in pairwise(np.linspace(0, frames, count + 1).astype(int))]
    return [
        SceneMotion(
            f"{motion.name}-{number}", {name: pose[part] for name, pose in motion.pose.items()}, motion.hidden[part]
        )
        for number, part in enumerate(parts, start=1)
    ]


def check_new(folder: Path) -> None:
    """Raise BodysenseError if a folder for a study exists and is not empty."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise BodysenseError(f"{folder} exists; name a new folder, so that no study loses its key")


def build_study(
    folder: Path,
    scenes: Sequence[SceneMotion],
    rng: np.random.Generator,
    jobs: int,
    advance: Callable[[int], None],
    lens: Lens = Lens(),
) -> StudyKey:
    """Write a study of scenes into a new folder: site/ for raters, and last key.json, and return its key.

    Animations are rendered in `jobs` processes, in the order of their opaque names, so that the age of a file reveals
    nothing; `advance` receives 1 for each. Raises BodysenseError if the folder is not empty.
    """
    check_new(folder)
    key = draw_key([scene.name for scene in scenes], rng)
    clips = folder / "site" / "clips"
    clips.mkdir(parents=True)
    content = json.dumps({"study": key.study, "scenes": [list(names) for names in key.scenes.values()]})
    page = files("bodysense_lab.study").joinpath("page.html").read_text(encoding="utf-8")
    (folder / "site" / "index.html").write_text(page.replace("STUDY", content.replace("<", "\\u003c")), "utf-8")
    work = []
    for scene, names in zip(scenes, key.scenes.values(), strict=True):
        camera = follow_body(scene.pose["truth"], RATE, lens)
        work += [(clips / f"{clip}.webp", scene.pose[condition], camera) for clip, condition in names.items()]
    for _ in parallel_map(_render, sorted(work, key=lambda one: one[0]), jobs):
        advance(1)
    write_key(folder / "key.json", key)
    return key


def _render(work: tuple[Path, Pose, FollowingCamera]) -> None:
    write_animation(*work, RATE)
