"""Subject: the unchanged output of a tracker, which the checks judge."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from bodysense.body.skeleton import FINGERS, default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense_conform.series import Absent, change, norm

SHORTEST_INTERVAL = 0.004  # s; speeds over shorter intervals measure the clock, not the body
USUAL_HEIGHT = 1.406  # m, ankle to head along the bones of the default skeleton, whose soles are as thick as its own
SIDES = ("left", "right")
UP = np.array([0.0, 1.0, 0.0])
_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")


@dataclass(frozen=True)
class Step:
    """One step of a script: from `start` to `end` the performer does what `label` names."""

    label: str
    start: float  # s, of the subject's clock
    end: float  # s


@dataclass(frozen=True, eq=False)
class Transport:
    """Facts about messages from a container or a stream; None if unknown."""

    messages: int | None = None  # received
    malformed: int = 0  # received and unreadable
    lost: int = 0  # absent from the sequence numbers
    log_time: np.ndarray | None = None  # (T,) s, when each was written
    available: np.ndarray | None = None  # (T,) s, when each became available, on the clock of the samples
    device_time: np.ndarray | None = None  # (T,) s, of the device's own clock
    all_tracked: np.ndarray | None = None  # (T,) bool, the device's own summary of its joints
    all_valid: np.ndarray | None = None  # (T,) bool, whether all joints of that summary are valid, hands included


@dataclass(frozen=True, eq=False)
class Subject:
    """T frames of P points with the names of the default skeleton; world: +Y up, metres; identity in the T-pose.

    Nothing is repaired: values may be NaN, quaternions of any length, times in any order.
    """

    name: str
    format: str  # "BVH", "MCAP" …
    points: tuple[str, ...]  # in the order of the default skeleton
    time: np.ndarray  # (T,) s
    position: np.ndarray  # (T, P, 3) m
    rotation: np.ndarray  # (T, P, 4) wxyz, world ← joint
    rotated: np.ndarray  # (P,) bool: the format gives this point a rotation
    valid: np.ndarray  # (T, P) bool: the device claims to have this point
    measured: np.ndarray | None = None  # (T, P) bool: measured, not completed; None if the device does not say
    floor: float | None = None  # m; None: unknown, estimated from the feet
    steps: tuple[Step, ...] = ()
    transport: Transport = field(default_factory=Transport)
    reference: Subject | None = None  # the same performance from a source with a trusted clock
    sha256: str = ""

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.points)}

    @cached_property
    def _present(self) -> frozenset[str]:
        return frozenset(np.array(self.points)[self.known.any(axis=0)].tolist())

    def has(self, *names: str) -> bool:
        """Whether all these points are known in at least one frame each."""
        return self._present.issuperset(names)

    def has_rotation(self, *names: str) -> bool:
        """Whether all these points are known and have rotations."""
        return self.has(*names) and bool(self.rotated[self.columns(names)].all())

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Return the columns of some points."""
        return np.array([self._index[name] for name in names], dtype=np.int64)

    def column(self, name: str) -> int:
        """Return the column of a known point. Raises Absent if it never comes."""
        if not self.has(name):
            raise Absent(f"no {name}")
        return self._index[name]

    def at(self, name: str) -> np.ndarray:
        """Return places (T, 3) of a point in metres, NaN in frames without it. Raises Absent if it never comes."""
        return self.places[:, self.column(name)]

    def line(self, start: str, end: str) -> np.ndarray:
        """Return vectors (T, 3) from one point to another in metres."""
        return self.at(end) - self.at(start)

    def length(self, start: str, end: str) -> np.ndarray:
        """Return distances (T,) between two points in metres."""
        return norm(self.line(start, end))

    def along(self, chain: Sequence[str]) -> float:
        """Return the length of a chain of points in metres: of each bone the median over time."""
        return sum(float(np.nanmedian(self.length(a, b))) for a, b in pairwise(chain))

    def turn(self, name: str) -> np.ndarray:
        """Return unit quaternions (T, 4) world ← joint, NaN if unknown. Raises Absent if it has no rotation."""
        if not self.rotated[self.column(name)]:
            raise Absent(f"no rotation of {name}")
        return self.turns[:, self._index[name]]

    def local(self, parent: str, child: str) -> np.ndarray:
        """Return quaternions (T, 4) parent ← child."""
        return quaternion_multiply(quaternion_conjugate(self.turn(parent)), self.turn(child))

    def axis(self, name: str, axis: str) -> np.ndarray:
        """Return the axis 'x' (left), 'y' (up) or 'z' (ahead) of a joint in the world, (T, 3)."""
        return quaternion_rotate(self.turn(name), np.eye(3)["xyz".index(axis)])

    def carried(self, joint: str, vector: np.ndarray) -> np.ndarray:
        """Return vectors (T, 3) in the frame of a joint."""
        return quaternion_rotate(quaternion_conjugate(self.turn(joint)), vector)

    @cached_property
    def known(self) -> np.ndarray:
        """(T, P) bool: the device claims to have the point, and its position is finite."""
        return self.valid & np.isfinite(self.position).all(axis=-1)

    @cached_property
    def places(self) -> np.ndarray:
        """(T, P, 3) m, NaN if unknown."""
        return np.where(self.known[..., None], self.position, np.nan)

    @cached_property
    def turns(self) -> np.ndarray:
        """(T, P, 4) of unit length, NaN if unknown."""
        length = np.linalg.norm(self.rotation, axis=-1, keepdims=True)
        good = self.valid[..., None] & np.isfinite(length) & (length > 1e-6)
        return np.where(good, self.rotation / np.where(good, length, 1), np.nan)

    @cached_property
    def interval(self) -> float:
        """Median time between frames in seconds; NaN if there are fewer than two frames."""
        steps = np.diff(self.time)
        steps = steps[np.isfinite(steps)]
        return float(np.median(steps)) if len(steps) else float("nan")

    @cached_property
    def seconds(self) -> float:
        """Time from the first frame to the last."""
        return float(self.time[-1] - self.time[0]) if len(self) else 0.0

    def frames(self, seconds: float) -> int:
        """Return the number of frames in a time, at least 1."""
        return max(round(seconds / self.interval), 1) if self.interval > 0 else 1

    @cached_property
    def velocity(self) -> np.ndarray:
        """(T, P, 3) m/s from the frame before; NaN in the first frame and over intervals that are too short."""
        step = change(self.time)
        return change(self.places) / np.where(step >= SHORTEST_INTERVAL, step, np.nan)[:, None, None]

    def speed(self, names: Sequence[str]) -> np.ndarray:
        """Return speeds (T, K) of some points in m/s."""
        return norm(self.velocity[:, self.columns(names)])

    @cached_property
    def body(self) -> tuple[str, ...]:
        """Known points without fingers."""
        return tuple(name for name in self.points if not is_finger(name) and self.has(name))

    @cached_property
    def trunk_and_limbs(self) -> tuple[str, ...]:
        """Known points of the body without feet and toes, which flip in takes from markers."""
        return tuple(name for name in self.body if not name.endswith(("_foot", "_toe")))

    def parent(self, name: str) -> str:
        """Return the nearest ancestor of a point that is known too. Raises Absent if no ancestor is known."""
        found = nearest_ancestor(name, self._present)
        if found is None:
            raise Absent(f"no bone to {name}")
        return found

    @cached_property
    def bones(self) -> tuple[tuple[str, str], ...]:
        """Parent and child of every bone: a point and its nearest ancestor that is known too."""
        pairs = ((nearest_ancestor(name, self._present), name) for name in self.points if self.has(name))
        return tuple((parent, name) for parent, name in pairs if parent is not None)

    @cached_property
    def height(self) -> float:
        """Length of the bones from ankle to head in metres, medians over time; NaN if the chain is broken."""
        legs = [[f"{side}_{part}" for part in ("hip", "knee", "ankle")] for side in SIDES]
        legs = [leg for leg in legs if self.has(*leg)]
        if not legs or not self.has("head", "pelvis"):
            return float("nan")
        return self.along([*filter(self.has, _TRUNK)]) + float(np.mean([self.along(leg) for leg in legs]))

    @cached_property
    def feet(self) -> tuple[str, ...]:
        """Known points of the feet."""
        return tuple(name for name in self.points if name.endswith(("_ankle", "_foot", "_toe")) and self.has(name))

    @cached_property
    def soles(self) -> dict[str, np.ndarray]:
        """Height (T,) of the sole of either side in metres, from the lowest point of each foot; NaN if unknown."""
        ours = default_skeleton()
        rest = (ours.path @ ours.rest_offset)[:, 1] + ours.rest_offset[0, 1]
        size = self.height / USUAL_HEIGHT if np.isfinite(self.height) else 1.0
        soles = {}
        for side in SIDES:
            foot = [name for name in self.feet if name.startswith(side)]
            thick = size * rest[ours.indices(foot)]  # m, from the sole to the point in the rest pose
            soles[side] = np.fmin.reduce(self.places[:, self.columns(foot), 1] - thick, axis=1, initial=np.nan)
        return soles

    @cached_property
    def lower_sole(self) -> np.ndarray:
        """Height (T,) of the lower sole in metres, NaN if unknown."""
        return np.fmin(*self.soles.values())

    @cached_property
    def ground(self) -> float:
        """Height of the floor in metres: the known one, or the usual height of the lower sole."""
        if self.floor is not None:
            return self.floor
        lower = self.lower_sole
        return float(np.nanpercentile(lower, 10)) if np.isfinite(lower).any() else float("nan")

    def during(self, step: Step, share: float = 1.0) -> np.ndarray:
        """Return which frames (T,) are in the last `share` of a step."""
        start = step.end - share * (step.end - step.start)
        return (self.time >= start) & (self.time <= step.end)

    def labelled(self, *labels: str) -> list[Step]:
        """Return the steps with one of these labels, in order."""
        return [step for step in self.steps if step.label in labels]

    def within(self, *labels: str) -> np.ndarray:
        """Return which frames (T,) are in a step with one of these labels."""
        return sum((self.during(step) for step in self.labelled(*labels)), np.zeros(len(self), dtype=bool))


def is_finger(name: str) -> bool:
    """Return whether a point is a joint or tip of a finger."""
    return name.partition("_")[2].startswith(FINGERS)


def nearest_ancestor(name: str, names: Collection[str]) -> str | None:
    """Return the nearest ancestor of a point in the default skeleton that is among some names, or None."""
    ours = default_skeleton()
    above = ours.parents[ours.index(name)]
    while above >= 0 and ours.points[above] not in names:
        above = ours.parents[above]
    return ours.points[above] if above >= 0 else None


def ordered(names: Collection[str]) -> tuple[str, ...]:
    """Return the names that the default skeleton has, in its order."""
    return tuple(name for name in default_skeleton().points if name in names)


def points_subject(
    name: str,
    form: str,
    names: Sequence[str],
    time: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    rotated: np.ndarray,
    valid: np.ndarray | None = None,
) -> Subject:
    """Return a subject from points by `names`: duplicates and unknown names are dropped.

    Arrays are those of a subject; all points are valid if `valid` is omitted.
    """
    points = ordered(names)
    keep = [names.index(point) for point in points]
    valid = np.ones(position.shape[:-1], dtype=bool) if valid is None else valid
    time, position = np.asarray(time, dtype=float), np.asarray(position, dtype=float)
    return Subject(name, form, points, time, position[:, keep], rotation[:, keep], rotated[keep], valid[:, keep])
