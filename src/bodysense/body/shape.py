"""The shape space: the distribution of adult skeletons, and the likeliest skeleton given a few lengths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError

SHORTEST, TALLEST = 1.45, 2.05  # m; statures of sampled bodies
FARTHEST = 2.5  # standard deviations; largest coefficient of a sampled body
SPLITS = ("train", "validation", "test")
Split = Literal["train", "validation", "test"]
_BLOCK = 256  # bodies drawn at once, so that the first bodies of a split do not depend on the count


@dataclass(frozen=True)
class Measured:
    """A measured length: its value and its standard deviation, both in metres."""

    value: float
    deviation: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and self.value > 0):
            raise BodysenseError(
                f"a length of {self.value:g} m: a measured length must be positive and finite; give metres"
            )
        if not (np.isfinite(self.deviation) and self.deviation > 0):
            raise BodysenseError(
                f"a standard deviation of {self.deviation:g} m: it must be positive and finite; give 0.001 for a "
                "length that is known exactly"
            )


@dataclass(frozen=True, eq=False)
class ShapeEstimate:
    """A normal distribution over shapes."""

    space: ShapeSpace = field(repr=False)
    coefficients: np.ndarray  # (K,) its mean, in standard deviations of the population
    covariance: np.ndarray = field(repr=False)  # (K, K)

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation (K,) of every coefficient; 1 without measurements."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def skeleton(self) -> Skeleton:
        """The likeliest skeleton."""
        return self.space.skeleton_of(self.coefficients)

    @property
    def bone_deviation(self) -> np.ndarray:
        """Standard deviation (P,), metres, of every point's distance from its parent; 0 for the root."""
        offset = self.space.offsets(self.coefficients)
        length = np.maximum(np.linalg.norm(offset, axis=-1), 1e-9)
        slope = np.einsum("kpc,pc->pk", self.space.components, offset / length[:, None])
        deviation = np.sqrt(np.einsum("pk,kl,pl->p", slope, self.covariance, slope))
        deviation[0] = 0.0
        return deviation


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """Rest offsets of adults as a mean and principal components: offsets = mean + coefficients · components.

    Coefficients are standard normal over the population. Points are those of the default skeleton, in its order.
    Every rest pose is a T-pose that faces +Z, symmetric, with the soles on y = 0 and the pelvis over the origin
    (world: +Y up, metres). Source: figures of the body model anny (docs/credits.md, "Assets").
    """

    mean: np.ndarray = field(repr=False)  # (P, 3) m, from the parent; the root's from the floor below the pelvis
    components: np.ndarray = field(repr=False)  # (K, P, 3) m, each one standard deviation long, largest first
    share: np.ndarray  # (K,) share of the variance that each component explains

    def __post_init__(self) -> None:
        for name in ("mean", "components", "share"):
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @property
    def size(self) -> int:
        """Number of coefficients of a shape."""
        return len(self.components)

    @cached_property
    def _flat(self) -> np.ndarray:
        return self.components.reshape(self.size, -1)

    def offsets(self, coefficients: np.ndarray) -> np.ndarray:
        """Return rest offsets (..., P, 3), metres, of shapes (..., K)."""
        coefficients = np.asarray(coefficients, dtype=np.float64)
        if coefficients.ndim == 0 or coefficients.shape[-1] != self.size:
            raise BodysenseError(
                f"a shape of {coefficients.shape} coefficients: the last axis must hold {self.size}; "
                f"give zeros({self.size}) for the mean adult"
            )
        return self.mean + (coefficients @ self._flat).reshape(*coefficients.shape[:-1], *self.mean.shape)

    def skeleton_of(self, coefficients: np.ndarray) -> Skeleton:
        """Return the skeleton of a shape (K,)."""
        return default_skeleton().with_offsets(self.offsets(coefficients))

    def stature(self, coefficients: np.ndarray) -> np.ndarray:
        """Return the height (...), metres, of the crown above the floor in the rest pose, of shapes (..., K)."""
        return stature(self.offsets(coefficients))

    def likeliest(
        self,
        lengths: Mapping[tuple[str, str], Measured] | None = None,
        height: Measured | None = None,
        *,
        is_stated: bool = False,
    ) -> ShapeEstimate:
        """Return the likeliest shape given measured lengths, with its remaining uncertainty.

        The result is the maximum a posteriori under the standard normal prior, by Gauss-Newton, with Laplace's
        approximation of the covariance. Without measurements it is the mean adult with the covariance of the
        population.

        Args:
            lengths: distances between two points in the rest pose, by the points' names, such as
                ("left_hip", "left_ankle").
            height: stature, from the floor to the crown, without shoes.
            is_stated: whether the wearer gave the height, which then replaces the distribution of the population's
                statures: without lengths, the likeliest shape has that height.

        Raises BodysenseError for an unknown point, and for a point's distance from itself.
        """
        rows, value, deviation = _measurement_rows(lengths or {}, height)
        start = np.einsum("mp,pc->mc", rows, self.mean)  # (M, 3) vectors of the mean adult
        slope = np.einsum("mp,kpc->mkc", rows, self.components)  # (M, K, 3) and how they change with the shape
        if height is not None:  # only its vertical part counts
            start[-1, [0, 2]] = 0.0
            slope[-1, :, [0, 2]] = 0.0
            if is_stated:
                value[-1] += (value[-1] - start[-1, 1]) * deviation[-1] ** 2 / (slope[-1, :, 1] ** 2).sum()
        coefficients = np.zeros(self.size)
        precision = np.eye(self.size)
        for _ in range(20):
            vector = start + np.einsum("mkc,k->mc", slope, coefficients)
            length = np.maximum(np.linalg.norm(vector, axis=1), 1e-9)
            jacobian = np.einsum("mkc,mc->mk", slope, vector / length[:, None]) / deviation[:, None]
            precision = np.eye(self.size) + jacobian.T @ jacobian
            gradient = coefficients + jacobian.T @ ((length - value) / deviation)
            step = np.linalg.solve(precision, gradient)
            coefficients = coefficients - step
            if np.abs(step).max() < 1e-9:
                break
        return ShapeEstimate(self, coefficients, np.linalg.inv(precision))


def _measurement_rows(
    lengths: Mapping[tuple[str, str], Measured], height: Measured | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows (M, P) that sum offsets to measured vectors, with values (M,) and deviations (M,); height is last."""
    skeleton = default_skeleton()
    rows = []
    for start, end in lengths:
        if start == end:
            raise BodysenseError(f"the distance of {start!r} from itself is no length; name two different points")
        rows.append(skeleton.path[skeleton.index(end)] - skeleton.path[skeleton.index(start)])
    measured = list(lengths.values())
    if height is not None:
        rows.append(_crown_path())
        measured.append(height)
    value = np.array([length.value for length in measured])
    deviation = np.array([length.deviation for length in measured])
    return np.array(rows).reshape(len(rows), len(skeleton.points)), value, deviation


@lru_cache(maxsize=1)
def _crown_path() -> np.ndarray:
    """Return the row (P,) that sums offsets from the floor to the crown."""
    skeleton = default_skeleton()
    up = skeleton.path[skeleton.index("head_top")].copy()
    up[0] = 1.0
    return up


def stature(offsets: np.ndarray) -> np.ndarray:
    """Return the height (...), metres, of the crown, for rest offsets (..., 65, 3) with the soles on y = 0."""
    return np.asarray(offsets)[..., 1] @ _crown_path()


def stature_of_head(head: float, deviation: float) -> Measured:
    """Return the stature of a person with the head joint at height `head` m, by the proportions of the mean adult."""
    mean = shape_space().mean
    joint = (default_skeleton().path @ mean)[default_skeleton().index("head"), 1] + mean[0, 1]
    ratio = float(stature(mean)) / joint
    return Measured(head * ratio, deviation * ratio)


@lru_cache(maxsize=1)
def shape_space() -> ShapeSpace:
    """Return the packaged shape space of adults."""
    from importlib.resources import files

    with (files("bodysense.body") / "shape_space.npz").open("rb") as file, np.load(file, allow_pickle=False) as stored:
        return ShapeSpace(stored["mean"], stored["components"], stored["share"])


def sample_bodies(split: Split, count: int, seed: int = 0) -> np.ndarray:
    """Draw people from the shape space; return rest offsets (count, 65, 3), metres, float64.

    No coefficient is beyond 2.5 standard deviations, and statures are 1.45 to 2.05 m. Bodies of different splits come
    from independent random streams. The first bodies do not change with `count`.

    Args:
        split: "train", "validation" or "test".
        count: number of people.
        seed: random seed, the same for all splits.
    """
    if split not in SPLITS:
        raise BodysenseError(f"split {split!r} of bodies is unknown; give {', '.join(map(repr, SPLITS))}")
    if count < 0:
        raise BodysenseError(f"{count} bodies cannot be drawn; give a count of 0 or more")
    space = shape_space()
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SPLITS.index(split),)))
    blocks = [np.zeros((0, *space.mean.shape))]
    found = 0
    while found < count:
        coefficients = rng.standard_normal((_BLOCK, space.size))
        offsets = space.offsets(coefficients[(np.abs(coefficients) <= FARTHEST).all(axis=1)])
        tall = stature(offsets)
        blocks.append(offsets[(tall >= SHORTEST) & (tall <= TALLEST)])
        found += len(blocks[-1])
    return np.concatenate(blocks)[:count]
