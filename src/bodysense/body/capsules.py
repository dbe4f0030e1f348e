"""Primitives: capsules and boxes that approximate a body's surface, fitted to any skeleton of the default tree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_to_matrix

TRUNK = ("pelvis", "spine1", "spine2", "spine3")  # joints whose primitives are fitted between hips and shoulders


@dataclass(frozen=True, eq=False)
class Primitives:
    """C capsules, then B boxes, in metres, each rigid in the frame of its carrying joint (world axes at rest)."""

    skeleton: Skeleton
    names: tuple[str, ...]  # (C + B)
    joint: np.ndarray = field(repr=False)  # (C + B,) index of the carrying joint
    start: np.ndarray = field(repr=False)  # (C, 3) start of a capsule's axis
    end: np.ndarray = field(repr=False)  # (C, 3) end of a capsule's axis
    radius: np.ndarray = field(repr=False)  # (C,)
    center: np.ndarray = field(repr=False)  # (B, 3)
    half_size: np.ndarray = field(repr=False)  # (B, 3)
    nose: np.ndarray = field(repr=False)  # (3,) tip of the nose, in the head's frame

    @cached_property
    def attached(self) -> np.ndarray:
        """(C + B, P) bool: point p is the carrying joint of primitive n, or a child of that joint."""
        points = np.arange(len(self.skeleton.points))
        return (self.joint[:, None] == points) | (self.joint[:, None] == np.array(self.skeleton.parents))

    @cached_property
    def bounding_radius(self) -> np.ndarray:
        """(C + B,) m: radius of the bounding sphere about a primitive's middle."""
        capsule = np.linalg.norm(self.end - self.start, axis=-1) / 2 + self.radius
        return np.concatenate([capsule, np.linalg.norm(self.half_size, axis=-1)])


@dataclass(frozen=True, eq=False)
class PosedPrimitives:
    """Primitives of posed bodies, in metres; leading axes are those of the pose."""

    primitives: Primitives
    start: np.ndarray  # (..., C, 3)
    end: np.ndarray  # (..., C, 3)
    center: np.ndarray  # (..., B, 3)
    axes: np.ndarray  # (..., B, 3, 3) world ← box

    @cached_property
    def middle(self) -> np.ndarray:
        """(..., C + B, 3) m, the middle of every primitive."""
        return np.concatenate([(self.start + self.end) / 2, self.center], axis=-2)


@lru_cache(maxsize=64)
def fit_primitives(skeleton: Skeleton) -> Primitives:
    """Fit the default body's primitives and nose to another skeleton with the same points and parents.

    All sizes scale with the skeleton's height. Beyond that:

    - Positions along a limb's bone stretch with it: a capsule that ends in a joint of the default body does so here.
    - The trunk is fitted between hips and shoulders, and widened with them, because skeletons agree on these positions
    but not on the depth and height of the spine's joints.
    - The head keeps its height below the crown, because head joints may be anywhere between jaw and skull.

    Raises BodysenseError for a skeleton with other points or parents.
    """
    default = default_skeleton()
    _check_tree(skeleton, default)
    scale = skeleton.extent / default.extent
    trunk = _trunk_map(default, skeleton, scale)
    crown = default.index("head_top")
    rise = skeleton.rest_offset[crown, 1] - scale * default.rest_offset[crown, 1]

    def move(joint: str, point: list[float], radius: float = 0.0) -> np.ndarray:
        local, carrier = np.array(point), default.index(joint)
        if joint in TRUNK:
            return trunk(local + _rest_position(default)[carrier], radius) - _rest_position(skeleton)[carrier]
        if joint == "head":
            return scale * local + [0.0, rise, 0.0]
        child, bone = _bone_toward(local, carrier, default)
        share = np.clip(local @ bone / (bone @ bone), 0, 1)
        return scale * local + share * (skeleton.rest_offset[child] - scale * bone)

    def move_box(row: dict) -> tuple[np.ndarray, np.ndarray]:
        center, half_size = scale * np.array(row["center"]), scale * np.array(row["half_size"])
        child, bone = _bone_toward(center, default.index(row["joint"]), default)
        old, new = scale * bone, skeleton.rest_offset[child]
        along = np.arange(3) == np.argmax(np.abs(old))  # the axis of the box along the bone
        share = np.where(along, np.clip(center / np.where(along, old, 1), 0, 1), 1)
        stretch = np.where(along, np.abs(new / np.where(along, old, 1)), 1)
        return center + share * (new - old), half_size * stretch

    body = default_body()
    capsules = [row for row in body["primitives"] if row["kind"] == "capsule"]
    boxes = [row for row in body["primitives"] if row["kind"] == "box"]
    (nose,) = (row for row in body["landmarks"] if row["name"] == "nose")
    centers, half_sizes = zip(*(move_box(row) for row in boxes), strict=True)
    return Primitives(
        skeleton=skeleton,
        names=tuple(row["name"] for row in [*capsules, *boxes]),
        joint=default.indices([row["joint"] for row in [*capsules, *boxes]]),
        start=np.array([move(row["joint"], row["start"], row["radius"]) for row in capsules]),
        end=np.array([move(row["joint"], row["end"], row["radius"]) for row in capsules]),
        radius=np.array([scale * row["radius"] for row in capsules]),
        center=np.array(centers),
        half_size=np.array(half_sizes),
        nose=move(nose["parent"], nose["offset"]),
    )


def _rest_position(skeleton: Skeleton) -> np.ndarray:
    """Return positions (P, 3) m of the points in the rest pose, from the root."""
    return skeleton.path[:, 1:] @ skeleton.rest_offset[1:]


def _trunk_map(default: Skeleton, skeleton: Skeleton, scale: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """Return a function that maps rest positions (3,) from the default body's hips and shoulders to another skeleton's.

    Its second argument is the radius (m) of the sphere about the point. Relative to the width of hips and
    shoulders, the sphere reaches as far to the side as on the default body.
    """

    def middle_and_width(of: Skeleton) -> tuple[np.ndarray, np.ndarray]:
        place = _rest_position(of)
        left, right = (place[of.indices([f"{side}_hip", f"{side}_shoulder"])] for side in ("left", "right"))
        return (left + right) / 2, np.abs(left - right)[:, 0]

    (low, high), width = middle_and_width(default)
    (new_low, new_high), new_width = middle_and_width(skeleton)
    line = high - low

    def move(point: np.ndarray, radius: float) -> np.ndarray:
        share = (point - low) @ line / (line @ line)
        across = scale * (point - low - share * line)
        reach = (abs(point[0]) + radius) * np.interp(share, [0, 1], new_width / width)
        across[0] = np.sign(point[0]) * max(reach - scale * radius, 0.0)
        return new_low + share * (new_high - new_low) + across

    return move


def _bone_toward(point: np.ndarray, joint: int, skeleton: Skeleton) -> tuple[int, np.ndarray]:
    """Return the child of a joint that is closest in direction to `point` (3,), and its offset (3,) m."""
    children = np.flatnonzero(np.array(skeleton.parents) == joint)
    bones = skeleton.rest_offset[children]
    best = int(np.argmax(bones @ point / np.linalg.norm(bones, axis=1)))
    return int(children[best]), bones[best]


def _check_tree(skeleton: Skeleton, default: Skeleton) -> None:
    """Raise BodysenseError, naming the first difference, unless two skeletons have the same points and parents."""
    fix = "bring it into the default skeleton's form first"
    for name in default.points:
        if name not in skeleton.points:
            raise BodysenseError(f"the body's primitives need a point {name!r}, which this skeleton lacks; {fix}")
    for place, (name, expected) in enumerate(zip(skeleton.points, default.points, strict=False)):
        if name != expected:
            raise BodysenseError(
                f"the body's primitives expect {expected!r} as point {place}, but this skeleton has {name!r}; {fix}"
            )
    if len(skeleton.points) > len(default.points):
        unknown = skeleton.points[len(default.points)]
        raise BodysenseError(f"the body's primitives know no point {unknown!r}, which this skeleton has; {fix}")
    for name, parent, expected in zip(skeleton.points, skeleton.parents, default.parents, strict=True):
        if parent != expected:
            raise BodysenseError(
                f"in this skeleton the parent of {name!r} is {_name(skeleton, parent)}, but the body's primitives "
                f"expect {_name(default, expected)}; {fix}"
            )


def _name(skeleton: Skeleton, point: int) -> str:
    """Return the quoted name of a point, 'nothing' for index -1."""
    return repr(skeleton.points[point]) if point >= 0 else "nothing"


def pose_primitives(primitives: Primitives, position: np.ndarray, rotation: np.ndarray) -> PosedPrimitives:
    """Return the primitives of posed bodies.

    Args:
        primitives: fitted to the body's skeleton.
        position: (..., P, 3) m, positions of all points, from forward kinematics.
        rotation: (..., J, 4) wxyz, world ← joint.

    Returns:
        The primitives in the frame and with the leading axes of `position`.
    """
    turn = quaternion_to_matrix(rotation)
    capsules, boxes = np.split(primitives.joint, [len(primitives.radius)])

    def move(joint: np.ndarray, local: np.ndarray) -> np.ndarray:
        turned = np.einsum("...nij,nj->...ni", turn[..., joint, :, :], local.astype(turn.dtype))
        return position[..., joint, :] + turned

    return PosedPrimitives(
        primitives=primitives,
        start=move(capsules, primitives.start),
        end=move(capsules, primitives.end),
        center=move(boxes, primitives.center),
        axes=turn[..., boxes, :, :],
    )
