"""Solver of a whole motion: the smoothest one that meets its contacts (Witkin and Kass, Spacetime Constraints, 1988).

Gauss-Newton over every frame's degrees of freedom. What joins the frames is only the penalty on accelerations, which
is diagonal in the degrees of freedom, so that the normal matrix is banded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded

from .figure import FigureState, Machine


@dataclass(frozen=True, eq=False)
class Spot:
    """A point fixed to a joint, or to the 'world'."""

    joint: str
    offset: np.ndarray | tuple[float, float, float]  # (3,) or (T, 3) m


@dataclass(frozen=True, eq=False)
class Touch:
    """Two points should be in one place."""

    a: Spot
    b: Spot
    weight: np.ndarray  # (T,) 1/m²
    axes: tuple[float, float, float] = (1, 1, 1)  # weights of the difference's components, world


@dataclass(frozen=True, eq=False)
class Aim:
    """Two directions should agree."""

    a: Spot
    b: Spot
    weight: np.ndarray  # (T,) 1


@dataclass(frozen=True, eq=False)
class Solid:
    """A capsule that probes stay out of."""

    joint: str
    start: np.ndarray  # (3,) m
    end: np.ndarray
    radius: float


@dataclass(frozen=True, eq=False)
class Probe:
    """A ball that stays out of some solids, and above the floor."""

    joint: str
    offset: np.ndarray  # (3,) m
    radius: float
    solids: tuple[Solid, ...]


@dataclass(frozen=True, eq=False)
class Problem:
    """The goals of a motion of T frames."""

    machine: Machine
    reference: np.ndarray  # (T, N) preferred value of every degree of freedom
    reference_weight: np.ndarray  # (T, N)
    acceleration_weight: np.ndarray  # (N,) on squared second differences
    terms: Sequence[Touch | Aim]
    probes: Sequence[Probe]
    apart_weight: float  # 1/m²: probes out of solids
    limit_weight: float  # 1/rad²
    soft: float = 0.002  # m, distance over which a solid's force increases


def at_frame(problem: Problem, frame: int) -> Problem:
    """Return one frame of a problem."""

    def spot(of: Spot) -> Spot:
        offset = np.asarray(of.offset)
        return Spot(of.joint, offset[frame] if offset.ndim == 2 else offset)

    cut = slice(frame, frame + 1)
    return replace(
        problem,
        reference=problem.reference[cut],
        reference_weight=problem.reference_weight[cut],
        terms=[replace(term, a=spot(term.a), b=spot(term.b), weight=term.weight[cut]) for term in problem.terms],
    )


def solve(problem: Problem, start: np.ndarray, iterations: int) -> np.ndarray:
    """The motion (T, N), from a first guess, by a fixed number of Levenberg-Marquardt steps."""
    value, damping = start.copy(), 1e-3
    normal, slope, cost = _linearised(problem, value)
    for _ in range(iterations):
        step = _banded_solve(problem, normal, slope, damping)
        trial = value - step
        found = _linearised(problem, trial)
        if found[2] < cost:
            value, damping = trial, max(1e-6, damping / 4)
            normal, slope, cost = found
        else:
            damping *= 8
    return value


def _linearised(problem: Problem, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Normal blocks (T, N, N), half gradient (T, N) and cost at a motion; accelerations only in the last two."""
    machine = problem.machine
    state = machine.place(value)
    frames, count = value.shape
    normal = np.zeros((frames, count, count))
    slope = np.zeros((frames, count))
    diagonal = np.arange(count)

    off = value - problem.reference
    normal[:, diagonal, diagonal] += problem.reference_weight
    slope += problem.reference_weight * off
    cost = float((problem.reference_weight * off**2).sum())

    low, high = machine.limits
    beyond = np.minimum(value - low, 0) + np.maximum(value - high, 0)
    normal[:, diagonal, diagonal] += problem.limit_weight * (beyond != 0)
    slope += problem.limit_weight * beyond
    cost += problem.limit_weight * float((beyond**2).sum())

    second = np.diff(value, 2, axis=0)
    cost += float((problem.acceleration_weight * second**2).sum())
    pull = problem.acceleration_weight * second
    slope[:-2] += pull
    slope[1:-1] -= 2 * pull
    slope[2:] += pull

    for term in problem.terms:
        active = np.flatnonzero(term.weight > 0)
        error, jacobian = _term(machine, state, term, active)
        weight = term.weight[active]
        weighted = weight[:, None, None] * jacobian
        normal[active] += jacobian.mT @ weighted
        slope[active] += (weighted.mT @ error[..., None])[..., 0]
        cost += float((weight * (error**2).sum(axis=1)).sum())

    for active, error, jacobian in _intrusions(problem, state):
        weighted = problem.apart_weight * jacobian
        normal[active] += jacobian[:, :, None] * weighted[:, None, :]
        slope[active] += weighted * error[:, None]
        cost += problem.apart_weight * float((error**2).sum())
    return normal, slope, cost


def _term(machine: Machine, state: FigureState, term: Touch | Aim, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (F, 3) and their derivatives (F, 3, N)."""
    a, b = machine.index(term.a.joint), machine.index(term.b.joint)
    offset = [np.broadcast_to(spot.offset, state.origin[0].shape)[frames, :, None] for spot in (term.a, term.b)]
    first, second = ((state.rotation[k][frames] @ o)[..., 0] for k, o in zip((a, b), offset, strict=True))
    if isinstance(term, Aim):
        slopes = [machine.direction_slope(state, k, v, frames) for k, v in ((a, first), (b, second))]
        return first - second, slopes[0] - slopes[1]
    first, second = first + state.origin[a][frames], second + state.origin[b][frames]
    slopes = [machine.point_slope(state, k, v, frames) for k, v in ((a, first), (b, second))]
    axes = np.asarray(term.axes, dtype=float)
    return (first - second) * axes, (slopes[0] - slopes[1]) * axes[:, None]


def _intrusions(problem: Problem, state: FigureState) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Frames (F,), depths (F,) and derivatives (F, N) of every probe that is in a solid or under the floor."""
    machine = problem.machine
    for probe in problem.probes:
        joint = machine.index(probe.joint)
        point = machine.point(state, joint, probe.offset)
        under = probe.radius - point[:, 1]
        frames = np.flatnonzero(under > 0)
        if frames.size:
            yield frames, under[frames], -machine.point_slope(state, joint, point[frames], frames)[:, 1]
        for solid in probe.solids:
            owner = machine.index(solid.joint)
            start, end = (machine.point(state, owner, p) for p in (solid.start, solid.end))
            bone = end - start
            along = ((point - start) * bone).sum(axis=1) / (bone**2).sum(axis=1)
            nearest = start + np.clip(along, 0, 1)[:, None] * bone
            away = point - nearest
            distance = np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-6)
            depth = probe.radius + solid.radius + problem.soft - distance
            frames = np.flatnonzero(depth > 0)
            if frames.size:
                normal = (away / distance[:, None])[frames, None, :]
                own = machine.point_slope(state, joint, point[frames], frames)
                other = machine.point_slope(state, owner, nearest[frames], frames)
                yield frames, depth[frames], -(normal @ (own - other))[:, 0]


def _banded_solve(problem: Problem, normal: np.ndarray, slope: np.ndarray, damping: float) -> np.ndarray:
    """The step (T, N) of the damped normal equations, by a banded Cholesky factorisation."""
    frames, count = slope.shape
    size = frames * count
    band = np.zeros((2 * count + 1, size))  # lower form: band[i - j, j] is the entry (i, j)
    by_frame = band.reshape(2 * count + 1, frames, count)
    for below in range(count):
        by_frame[below, :, : count - below] = np.diagonal(normal, -below, axis1=1, axis2=2)
    second = np.diff(np.eye(frames), 2, axis=0)
    square = second.T @ second
    for lag in (0, 1, 2):
        entries = np.diagonal(square, -lag)
        by_frame[lag * count, : frames - lag] += entries[:, None] * problem.acceleration_weight
    by_frame[0] *= 1 + damping
    return solveh_banded(band, slope.ravel(), lower=True, overwrite_ab=True).reshape(frames, count)
