"""Skeleton: names, parents and rest offsets of joints and of the end sites that hang on them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import isfinite

import numpy as np

from bodysense.errors import BodysenseError

FINGERS = ("index", "middle", "pinky", "ring", "thumb")  # in the order of SMPL-H
# The 22 joints of SMPL without its hands, in its order, which all three-point methods use for evaluation.
# fmt: off
BODY = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)
# fmt: on
ARM = ("collar", "shoulder", "elbow", "wrist")  # the joints that turn collar, upper arm, forearm and hand
LEG = ("hip", "knee", "ankle", "foot", "toe")  # the last is an end site
# The lower body among them as in AGRoL (Du et al. 2023); hands are the wrists.
LOWER_BODY = tuple(name for name in BODY if name.split("_")[-1] in ("pelvis", "hip", "knee", "ankle", "foot"))
# Points with an inertial sensor whose acceleration the tracker uses, and the end of the bone that carries the sensor.
# None: the sensor is at the joint itself.
INERTIAL_BONES: dict[str, str | None] = {
    "pelvis": None,
    "spine3": None,
    **{
        f"{side}_{joint}": f"{side}_{end}"
        for joint, end in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "foot"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
        )
        for side in ("left", "right")
    },
}
INERTIAL_POINTS = tuple(INERTIAL_BONES)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of joints, with end sites (fingertips, toe tips, head top) at its leaves.

    A *point* is a joint or an end site. Points are the joints in order, then the end sites. Parents come before their
    children. In the rest pose every rotation is the identity: the body stands in a T-pose and faces +Z, with its left
    hand toward +X (world: +Y up, metres).
    """

    joints: tuple[str, ...]
    end_sites: tuple[str, ...]
    parents: tuple[int, ...]  # one per point: index of the joint it hangs on; -1 for the root
    rest_offset: np.ndarray = field(repr=False)  # (P, 3) m, from the parent joint, in the rest pose

    def __repr__(self) -> str:
        return f"Skeleton({len(self.joints)} joints, {len(self.end_sites)} end sites, {self.height:.2f} m)"

    def __post_init__(self) -> None:
        offset = np.array(self.rest_offset, dtype=np.float64, order="C")  # as the compiled core reads it
        offset.setflags(write=False)
        object.__setattr__(self, "rest_offset", offset)
        names = self.points
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise BodysenseError(f"skeleton: the name {twice[0]!r} appears twice; names must differ, rename one")
        if len(self.parents) != len(names) or offset.shape != (len(names), 3):
            raise BodysenseError(
                f"skeleton: {len(names)} points need {len(names)} parents and offsets ({len(names)}, 3), "
                f"but got {len(self.parents)} and {offset.shape}"
            )
        if not self.joints or self.parents[0] != -1:
            raise BodysenseError("skeleton: the first joint must be the root, with parent -1")
        for index, parent in enumerate(self.parents[1:], start=1):
            if not 0 <= parent < min(index, len(self.joints)):
                raise BodysenseError(
                    f"skeleton: the parent of {names[index]!r} is {parent}; it must be a joint that comes before it"
                )
        if not np.isfinite(offset).all():
            bad = names[int(np.argmin(np.isfinite(offset).all(axis=1)))]
            raise BodysenseError(f"skeleton: the offset of {bad!r} is not finite; give three numbers in metres")

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of all points: joints, then end sites."""
        return self.joints + self.end_sites

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: index for index, name in enumerate(self.points)}

    def index(self, name: str) -> int:
        """Return the index of a point. Raises BodysenseError, with the nearest names, for an unknown name."""
        if name not in self._index:
            import difflib

            near = ", ".join(difflib.get_close_matches(name, self.points, n=3, cutoff=0.3)) or ", ".join(self.points)
            raise BodysenseError(f"unknown joint {name!r}; this skeleton has {near}")
        return self._index[name]

    def indices(self, names: Sequence[str]) -> np.ndarray:
        """Return the indices (N,) of several points."""
        return np.array([self.index(name) for name in names], dtype=np.int64)

    @cached_property
    def levels(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Joints by depth below the root: (their indices, the index of each one's parent in the level above)."""
        depth = [0] * len(self.joints)
        for joint in range(1, len(self.joints)):
            depth[joint] = depth[self.parents[joint]] + 1
        levels: list[tuple[np.ndarray, np.ndarray]] = []
        above: list[int] = []
        for d in range(max(depth) + 1):
            here = [joint for joint, value in enumerate(depth) if value == d]
            places = [above.index(self.parents[joint]) for joint in here] if d else [0]
            levels.append((np.array(here), np.array(places)))
            above = here
        return tuple(levels)

    @cached_property
    def path(self) -> np.ndarray:
        """(P, P) 0/1: path[i, k] is 1 if point k is on the path from the root (excluded) to point i (included).

        With bone vectors in the world, positions are `root + path @ bones`.
        """
        count = len(self.points)
        path = np.zeros((count, count))
        for point in range(1, count):
            path[point] = path[self.parents[point]]
            path[point, point] = 1
        return path

    @cached_property
    def wrist_of(self) -> np.ndarray:
        """(P,) index of the wrist of each finger's point; -1 for every other point."""
        wrists = np.full(len(self.points), -1)
        for point, name in enumerate(self.points):
            side, _, part = name.partition("_")
            if part.startswith(FINGERS):
                wrists[point] = self.index(f"{side}_wrist")
        return wrists

    @cached_property
    def mirror(self) -> np.ndarray:
        """(P,) index of each point's partner on the other side; points of the middle are their own partners."""
        swap = {"left": "right", "right": "left"}
        partners = []
        for name in self.points:
            side, _, rest = name.partition("_")
            partners.append(self._index.get(f"{swap[side]}_{rest}" if side in swap else name, self._index[name]))
        return np.array(partners)

    @cached_property
    def height(self) -> float:
        """Stature, metres: height of the rest pose's highest point over the soles, which are on y = 0.

        Skeletons whose rest pose goes below y = 0 are measured from their lowest point.
        """
        high = (self.path @ self.rest_offset)[:, 1] + self.rest_offset[0, 1]
        return float(high.max() - min(high.min(), 0.0))

    @cached_property
    def extent(self) -> float:
        """Distance from the lowest to the highest point of the rest pose, metres, by which bodies are scaled.

        Soles are below the lowest point.
        """
        high = (self.path @ self.rest_offset)[:, 1]
        return float(high.max() - high.min())

    @cached_property
    def bone_length(self) -> np.ndarray:
        """(P,) distance of every point from its parent, metres; 0 for the root."""
        length = np.linalg.norm(self.rest_offset, axis=1)
        length[0] = 0.0
        return length

    def with_offsets(self, rest_offset: np.ndarray) -> Skeleton:
        """Return the skeleton with other rest offsets (P, 3), metres."""
        offset = np.array(rest_offset, dtype=np.float64, order="C")
        if offset.shape != self.rest_offset.shape or not (
            isfinite(np.vdot(offset, offset)) or np.isfinite(offset).all()  # the first is faster
        ):
            return replace(self, rest_offset=offset)  # raises the error
        offset.setflags(write=False)
        other = object.__new__(Skeleton)
        other.__dict__.update(self.__dict__)  # values derived from the tree alone are shared
        other.__dict__.pop("height", None)
        other.__dict__.pop("extent", None)
        other.__dict__.pop("bone_length", None)
        other.__dict__["rest_offset"] = offset
        return other

    def scaled(self, height: float) -> Skeleton:
        """Scale the proportions to another stature, metres."""
        if not 0.3 <= height <= 3.0:
            raise BodysenseError(f"height {height:g} m is not a person's; give metres between 0.3 and 3.0")
        return self.with_offsets(self.rest_offset * (height / self.height))


def default_body() -> dict:
    """Read the packaged description of an average adult: joints, end sites, landmarks, primitives (docs/credits.md)."""
    from importlib.resources import files

    return json.loads(files("bodysense.body").joinpath("default_body.json").read_text(encoding="utf-8"))


@lru_cache(maxsize=1)
def default_skeleton() -> Skeleton:
    """Return the 52 joints of SMPL-H and 13 end sites, with the offsets of an average adult."""
    return skeleton_from_table(default_body()["joints"], default_body()["end_sites"])


def chain_to_root(parents: Sequence[int], point: int) -> list[int]:
    """Return a point of a tree and its ancestors up to the root, whose parent is negative."""
    chain = [point]
    while parents[chain[-1]] >= 0:
        chain.append(parents[chain[-1]])
    return chain


def skeleton_from_table(joints: Sequence[dict], end_sites: Sequence[dict]) -> Skeleton:
    """Build a skeleton from rows with `name`, `parent` (a name, or null for the root) and `offset` (metres)."""
    index = {row["name"]: place for place, row in enumerate(joints)}
    rows = [*joints, *end_sites]
    for row in rows:
        if row["parent"] is not None and row["parent"] not in index:
            raise BodysenseError(f"skeleton: {row['name']!r} hangs on {row['parent']!r}, which is not among its joints")
    return Skeleton(
        joints=tuple(row["name"] for row in joints),
        end_sites=tuple(row["name"] for row in end_sites),
        parents=tuple(-1 if row["parent"] is None else index[row["parent"]] for row in rows),
        rest_offset=np.array([row["offset"] for row in rows], dtype=np.float64),
    )
