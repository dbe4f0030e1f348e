"""Sheet of strips of scripted scenes: the truth over the tracker's result, at moments of each scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose
from bodysense.files import written_beside
from bodysense.observing.points import observed_points
from bodysense.pictures.camera import Lens
from bodysense.pictures.comparison import View, draw_views
from bodysense_lab.completion.score.scripted.scene_scoring import SETS, SceneJob, observe_scene
from bodysense_lab.completion.score.tracking import PeopleTracker
from bodysense_lab.core.scoring import RATE

_LENS = Lens(width=110, height=160, view_height=2.2)
_MOMENTS = 12  # pictures of a strip
_INK = (34, 48, 60)


def draw_strips(path: Path, jobs: Sequence[SceneJob], name: str, track: PeopleTracker) -> None:
    """Write a PNG with a strip of each scene, tracked by the set `name`; untracked points of the truth are red."""
    from PIL import Image

    strips = [_strip(job, name, track) for job in jobs]
    with written_beside(path) as beside:
        Image.fromarray(np.concatenate(strips)).save(beside)


def _strip(job: SceneJob, name: str, track: PeopleTracker) -> np.ndarray:
    """Draw moments of a scene, (2 H, W, 3) uint8: the truth over the result."""
    from PIL import Image, ImageDraw

    _, scene, lost = job.draw()
    seen, _ = observe_scene(scene, SETS[name], lost)
    (tracked,) = track([Person(scene.skeleton) if SETS[name].known else Person()], [seen])
    known = observed_points(seen, scene.skeleton)[2]
    result = Pose(scene.skeleton, tracked.position[:, 0], tracked.rotation)
    pictures = []
    for frame in np.linspace(0, len(scene) - 1, _MOMENTS).round().astype(int):
        now = slice(frame, frame + 1)
        views = [View("", scene.pose[now], known[now]), View("", result[now])]
        drawn = next(iter(draw_views(views, RATE, [0], _LENS)))[-_LENS.height :]
        pictures.append(np.concatenate(np.split(drawn, 2, axis=1)))
    strip = Image.fromarray(np.concatenate(pictures, axis=1))
    ImageDraw.Draw(strip).text((4, 2), f"{job.kind.replace('_', ' ')}, {SETS[name].title}", fill=_INK)
    return np.asarray(strip)
