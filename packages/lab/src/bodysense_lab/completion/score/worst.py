"""Sheet of the worst frames of an evaluation: the truth next to the tracker's estimate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.observing.points import observed_points
from bodysense.pictures.camera import Lens
from bodysense.pictures.comparison import View, draw_views
from bodysense_lab.completion.score.scenes import TRUTH_OF, TrackedScene, person_of, scene_of
from bodysense_lab.completion.score.tables import CompletionSettings, WorstFrame
from bodysense_lab.completion.score.tracking import TrackPeople
from bodysense_lab.completion.training.options import Fault
from bodysense_lab.core.scoring import RATE

_LENS = Lens(width=260, height=330, aim=0.9, view_height=2.2)
_COLUMNS = 3  # pictures in a row


def worst_frames(found: Sequence[WorstFrame], count: int, fault: Fault) -> list[WorstFrame]:
    """Return the frames with the largest faults of a kind, the worst first, at most one of a clip."""
    by_clip: dict[str, WorstFrame] = {}
    for one in sorted(found, key=lambda one: one.size, reverse=True):
        if one.fault == fault:
            by_clip.setdefault(one.clip, one)
    return list(by_clip.values())[:count]


def draw_worst(
    path: Path,
    found: Sequence[WorstFrame],
    clips: Sequence[Clip],
    settings: CompletionSettings,
    track: TrackPeople,
    count: int,
    fault: Fault,
) -> None:
    """Write a PNG of the worst frames: the true body, with untracked points in red, next to the result.

    For a leap, the result of the previous frame is between the two. The clips are tracked again up to these frames.
    Raises BodysenseError if there are no such frames.
    """
    from PIL import Image

    named = {f"{clip.person}/{clip.name}": clip for clip in clips}
    pictures = []
    for one in worst_frames(found, count, fault):
        scene = scene_of(named[one.clip], TRUTH_OF[one.body], settings.split).beginning(one.frame + 1)
        pictures.append(_picture(one, scene, track))
    if not pictures:
        raise BodysenseError(f"--sheet {path}: no clip of the main categories was scored; give a larger --limit")
    blank = np.full_like(pictures[0], 255)
    pictures += [blank] * (-len(pictures) % min(_COLUMNS, len(pictures)))
    rows = [np.concatenate(pictures[k : k + _COLUMNS], axis=1) for k in range(0, len(pictures), _COLUMNS)]
    with written_beside(path) as beside:
        Image.fromarray(np.concatenate(rows)).save(beside)


def _picture(one: WorstFrame, scene: TrackedScene, track: TrackPeople) -> np.ndarray:
    """Draw the last frame of a scene, (H, W, 3) uint8."""
    seen = scene.observe(SENSOR_SETS[one.sensors])
    (tracked,) = track([person_of(one.body, scene.skeleton)], [seen])
    last = slice(one.frame, one.frame + 1)
    tracked_points = observed_points(seen, scene.skeleton)[2][last]
    views = [View(f"{one.clip.split('/')[-1]}, {one.frame / RATE:.1f} s", scene.pose[last], tracked_points)]
    titles = {one.frame: f"{one.sensors} {one.body}: {one.size:.0f} cm"}
    if one.fault == "leap":
        titles = {max(one.frame - 1, 0): "previous frame"} | titles
    for frame, title in titles.items():
        output = _posed(scene.skeleton, tracked.position[frame], tracked.rotation[frame : frame + 1])
        views.append(View(title, output))
    return next(iter(draw_views(views, RATE, [0], _LENS)))


def _posed(skeleton: Skeleton, position: np.ndarray, rotation: np.ndarray) -> Pose:
    """Return the pose (1,) with points (P, 3) m and local rotations (1, J, 4); bones have the points' distances."""
    turned = np.asarray(forward_kinematics(Pose(skeleton, position[None, 0], rotation))[1])[0]
    parents = np.array(skeleton.parents[1:])
    offset = skeleton.rest_offset.copy()
    offset[1:] = quaternion_rotate(quaternion_conjugate(turned[parents]), position[1:] - position[parents])
    return Pose(skeleton.with_offsets(offset), position[None, 0], rotation)
