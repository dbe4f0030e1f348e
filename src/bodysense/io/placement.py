"""Height and floor of bodies in files that lack them: AMASS without its body model, and floors of any AMASS file.

A planted foot does not move, so while one is planted the pelvis moves against it as far as the legs are long: the
ratio of both paths is the body's size. The floor is where feet stand, not at the lowest sole: toes of a foot without a
toe joint go through the floor at the end of each step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.footing import side_clearance, sole_clearance
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.shape import stature
from bodysense.body.skeleton import Skeleton
from bodysense.io.clip import Clip
from bodysense.io.formats.amass import read_amass
from bodysense.io.formats.body_model import shape_in_file

_RATE = 30.0  # Hz; largest rate at which motions are analysed
_WINDOW = 4  # frames at that rate: 0.13 s, over which a path is measured
_PATH = 0.08  # m; least path of a foot relative to the pelvis in a window
_SLIP = 0.2  # largest share of that path by which the pelvis's differs
_SIZES = np.linspace(0.6, 1.5, 181)  # sizes of bodies in histograms, of the default one
_FEWEST = 30  # windows needed to infer a size
_LOW = 5  # percentile of the lowest sole's height that is the floor if no foot stands
_STILL = 0.5  # m/s: a foot that stands is slower, on bodies of another size, too
_FLAT = 0.03  # m: ankle and ball of a foot that stands are as far over their heights at rest, within this
_STANDING = 0.3  # s of standing that show a floor
_FLOOR_SHARE = 25  # percentile of standing feet's heights taken as the floor; climbers start on it
_STEP = 0.15  # m; a surface farther from 0 is a step, a chair or equipment
_FLOOR = 0.01  # m; a nearer floor is taken as 0


@dataclass(frozen=True, eq=False)
class Footing:
    """Evidence of motions for a body's size and floor."""

    sizes: np.ndarray  # counts (S,) of windows with a planted foot, by size
    pelvis: np.ndarray  # (N,) m, height of the pelvis
    sole: np.ndarray  # (N,) m, height of the lowest sole over its rest height, with the pelvis at 0
    stands: np.ndarray  # (N,) bool: the foot of that sole stands
    rate: float  # Hz of these frames
    stature: float  # m, of the body that was read


@dataclass(frozen=True)
class BodyPlacement:
    """Height and floor that motions of a person have."""

    height: float  # m, of the body
    size: float  # of the body, of the skeleton that was read
    source: Literal["model", "steps", "default"]  # of the size; 'default' if there are too few steps
    floor: float  # m, in the file; it is moved to 0

    @property
    def remark(self) -> str:
        """One line for users."""
        sources = {
            "model": f"bones by the body model, {self.height:.2f} m tall",
            "steps": f"{self.height:.2f} m tall by its steps (--smpl-model gives a body its own bones)",
            "default": f"too few steps for a height: {self.height:.2f} m (--height, or --smpl-model)",
        }
        floor = f"soles at {self.floor:.2f} m: moved to 0" if self.floor else "soles at 0"
        return f"{sources[self.source]}; {floor}"


def body_in_file(path: Path, smpl_model: Path | None, unit: float | None = None) -> Clip:
    """Read an AMASS file on its own body: bones by its `betas` if there is a model, else the default body.

    `unit` is metres of one unit of its path.
    """
    if smpl_model is None:
        return read_amass(path, unit=unit)
    shape = shape_in_file(path, smpl_model)
    return read_amass(path, shape.skeleton, shape.pelvis, unit)


def footing_of(clip: Clip) -> Footing:
    """Return the evidence of a motion on its own skeleton."""
    stride = max(1, round(clip.frame_rate / _RATE))
    pose = clip.pose[::stride]
    skeleton, root = pose.skeleton, pose.root_position
    point = np.asarray(forward_kinematics(Pose(skeleton, np.zeros_like(root), pose.rotation))[0])
    ball = point[:, skeleton.indices(["left_foot", "right_foot"])]
    step = (ball[_WINDOW:] - ball[:-_WINDOW]).reshape(-1, 3)
    way = np.repeat(root[_WINDOW:] - root[:-_WINDOW], 2, axis=0)
    path = np.linalg.norm(step, axis=-1)
    size = -(way * step).sum(axis=-1) / np.maximum(path, 1e-9) ** 2
    slip = np.linalg.norm(way + size[:, None] * step, axis=-1)
    planted = (path > _PATH) & (slip < _SLIP * path)
    return Footing(
        sizes=np.histogram(size[planted], _SIZES)[0],
        pelvis=root[:, 1].astype(np.float32),
        sole=np.asarray(sole_clearance(point, skeleton)).astype(np.float32),
        stands=_standing_frames(point + root[:, None], skeleton, clip.frame_rate / stride),
        rate=clip.frame_rate / stride,
        stature=float(stature(skeleton.rest_offset)),
    )


def placement_of(footing: Footing, has_bones: bool) -> BodyPlacement:
    """Return the height and floor that motions show; if the body has its own bones, only the floor is found."""
    size, source = 1.0, "default"
    count = footing.sizes.sum()
    if has_bones:
        source = "model"
    elif count >= _FEWEST:
        middle = int(np.searchsorted(np.cumsum(footing.sizes), count / 2))
        size, source = float(_SIZES[middle : middle + 2].mean()), "steps"
    height = footing.pelvis + size * footing.sole
    floor = _standing_height(height, footing)
    if floor is None:
        floor = float(np.percentile(height, _LOW))
    return BodyPlacement(size * footing.stature, size, source, 0.0 if abs(floor) < _FLOOR else floor)


def standing_floor(clip: Clip) -> float:
    """Return the height (m) of the floor on which feet stand in a motion on its own skeleton, whose floor is about 0.

    0 if no foot stands for long, and if feet stand farther than a step from 0.
    """
    footing = footing_of(clip)
    floor = _standing_height(footing.pelvis + footing.sole, footing)
    return floor if floor is not None and _FLOOR < abs(floor) < _STEP else 0.0


def _standing_height(height: np.ndarray, footing: Footing) -> float | None:
    """Return the height (m) at which feet stand, of heights (N,) of lowest soles; None if none stands for long."""
    if footing.stands.sum() < _STANDING * footing.rate:
        return None
    return float(np.percentile(height[footing.stands], _FLOOR_SHARE))


def _standing_frames(point: np.ndarray, skeleton: Skeleton, rate: float) -> np.ndarray:
    """(N,) bool: frames in which the lower foot is flat and slow, from points (N, P, 3) m at `rate` Hz."""
    rest = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[:, 1]
    height, stands = [], []
    for side in ("left", "right"):
        sole = list(skeleton.indices([f"{side}_ankle", f"{side}_foot"]))
        way = np.linalg.norm(np.diff(point[:, sole], axis=0, append=point[-1:, sole]), axis=-1)
        over = point[:, sole, 1] - rest[sole]
        stands.append((way < _STILL / rate).all(axis=1) & (abs(over[:, 0] - over[:, 1]) < _FLAT))
        height.append(side_clearance(point, skeleton, side))
    return np.where(np.asarray(height[0]) <= np.asarray(height[1]), *stands)


def apply_placement(clip: Clip, placement: BodyPlacement) -> Clip:
    """Return a motion with the height and the floor of a placement; its path keeps its length."""
    pose = clip.pose
    skeleton = pose.skeleton.with_offsets(pose.skeleton.rest_offset * placement.size)
    root = pose.root_position - np.array([0.0, placement.floor, 0.0])
    return replace(clip, pose=Pose(skeleton, root, pose.rotation))


def read_with_placement(
    path: Path, smpl_model: Path | None = None, known: BodyPlacement | None = None, unit: float | None = None
) -> tuple[Clip, BodyPlacement]:
    """Read an AMASS file with the height and floor of its person; without `known`, they come from this motion."""
    clip = body_in_file(path, smpl_model, unit)
    if known is None:
        known = placement_of(footing_of(clip), has_bones=smpl_model is not None)
    return apply_placement(clip, known), known
