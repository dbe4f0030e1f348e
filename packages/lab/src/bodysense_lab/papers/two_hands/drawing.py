"""Batches and losses of the networks of a glove: hidden markers from the others, angles from all (section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.hands.glove import ALIGNMENT, MARKERS, default_glove
from bodysense.body.hands.hand import FINGERS, hand_skeleton, rotations_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.registration import register, to_hand
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate, shortest_arc
from bodysense_lab.papers.two_hands.frames import RATE, GloveFrames
from bodysense_lab.papers.two_hands.given_shapes import draw_shapes
from bodysense_lab.papers.two_hands.network import JointNetwork, MarkerNetwork
from bodysense_lab.papers.two_hands.task import GloveTask
from bodysense_lab.papers.two_hands.trials import FINGER_POINTS, hide_some

_ROUND = 1e-3  # m: below, distances count squared
_BASES = tuple(f"{finger}1" for finger in FINGERS)
_ALL_ALIKE = (0.25, 0.25, 0.25, 0.25)


class Registered(NamedTuple):
    """Markers on the template, by those that are known."""

    seen: Tensor  # (..., 27) hidden ones 0
    all: Tensor  # (..., 27)
    hidden: Tensor  # (..., 9) bool
    hand: Tensor  # (..., 87)


@dataclass(frozen=True, eq=False)
class MarkerTask(GloveTask):
    """Hidden markers from the others."""

    def loss(self, batch: np.random.Generator, memory: None) -> tuple[dict[str, Tensor], None]:
        """Compute the loss of hidden markers, at two times of an occlusion."""
        schedule, network = self.schedule, self.network
        drawn = draw_markers(self.frames, schedule.batch, schedule.hidden_share, schedule.noise, batch)
        if schedule.squared:
            missed = network(drawn.seen, drawn.hand) - drawn.all
            return {"loss": (missed * 100).square().mean()}, None
        before, after = self._errors(network, drawn)
        position = (_rounded(before) + _rounded(after)).mean() / 2
        change = _rounded(after - before).mean()
        return {"loss": 100 * (position + schedule.change * change), "position": position, "change": change}, None

    @torch.no_grad()
    def validate(self, network: MarkerNetwork) -> dict[str, float]:
        """Mean change of the error since the occlusion, one to four markers hidden as often, cm."""
        batch = draw_markers(self.validation, 4096, _ALL_ALIKE, 0.0, np.random.default_rng(0))
        before, after = self._errors(network, batch)
        return {"error_cm": 100 * float((after - before).norm(dim=-1).mean())}

    @staticmethod
    def _errors(network: MarkerNetwork, batch: Registered) -> tuple[Tensor, Tensor]:
        """Return the errors of hidden markers (n, 3) m at both times."""
        missed = (network(batch.seen, batch.hand) - batch.all).unflatten(-1, (-1, 3))
        return missed[0][batch.hidden[0]], missed[1][batch.hidden[1]]


@dataclass(frozen=True, eq=False)
class JointTask(GloveTask):
    """A hand's angles from all its markers."""

    def loss(self, batch: np.random.Generator, memory: None) -> tuple[dict[str, Tensor], None]:
        """Compute the loss of finger joints after the finger rotation, plus small terms before it and of angles."""
        schedule, frames = self.schedule, self.frames
        rows = batch.integers(len(frames), size=schedule.batch)
        noise = batch.normal(0.0, schedule.noise, (len(rows), len(MARKERS), 3))
        before, after, true, angles = self._answer(self.network, frames, rows, noise, batch)
        turned = (angles - torch.from_numpy(frames.angles[rows])).square().mean()
        if schedule.squared:
            return {"loss": turned}, None
        position, raw = (_rounded(points - true).mean() for points in (after, fingers_of(before)))
        return {"loss": 100 * (position + 0.3 * raw) + 0.3 * turned, "position": position, "turned": turned}, None

    @torch.no_grad()
    def validate(self, network: JointNetwork) -> dict[str, float]:
        """Mean distance of the joints of fingers after the finger rotation, cm."""
        rows = np.linspace(0, len(self.validation) - 1, 8192).astype(int)
        _, after, true, _ = self._answer(network, self.validation, rows, 0.0, np.random.default_rng(0))
        return {"error_cm": 100 * float((after - true).norm(dim=-1).mean())}

    @staticmethod
    def _answer(
        network: JointNetwork,
        frames: GloveFrames,
        rows: np.ndarray,
        noise: np.ndarray | float,
        rng: np.random.Generator,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """All points before the finger rotation, those of fingers after it, where these are in truth, and angles."""
        shapes = draw_shapes(frames, frames.motion[rows], rng)
        markers = (frames.markers[rows] + noise) * shapes.scale
        own, points = in_hand(markers, frames.points[rows] * shapes.scale, shapes.template)
        angles = network(_flat(own), torch.from_numpy(shapes.shape))
        before = finger_points(angles, torch.from_numpy(shapes.rest.astype(np.float32)), _tensor(shapes.axes))
        return before, turned_to(before, _tensor(own)), fingers_of(_tensor(points)), angles


def draw_markers(
    frames: GloveFrames, count: int, share: tuple[float, ...], noise: float, rng: np.random.Generator
) -> Registered:
    """Frames and others of the same motions up to 2 s later or earlier, the same markers hidden: (2, count, …)."""
    rows = rng.integers(len(frames), size=count)
    gap = np.exp(rng.uniform(np.log(0.1), np.log(2.0), count)) * RATE
    away = rows + np.maximum(1, np.round(gap)).astype(int) * rng.choice([-1, 1], count)
    first = np.searchsorted(frames.motion, np.arange(len(frames.rest)))
    last = np.append(first[1:], len(frames)) - 1
    motion = frames.motion[rows]
    later = np.clip(away, first[motion], last[motion])
    both, hidden = np.stack([rows, later]), hide(count, share, rng)
    markers = frames.markers[both] + rng.normal(0.0, noise, (2, count, len(MARKERS), 3))
    shapes = draw_shapes(frames, frames.motion[rows], rng)
    flat, shape = (np.stack([part, part]) for part in (shapes.template, shapes.shape))
    return registered(markers * shapes.scale, np.stack([hidden, hidden]), shape, flat)


def hide(count: int, share: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """(count, 9) bool: one marker is hidden as often as the first of `share` says, two as the second …"""
    number = 1 + rng.choice(len(share), size=count, p=share)
    return hide_some(count, number[:, None], rng)


def registered(markers: np.ndarray, hidden: np.ndarray, hand: np.ndarray, template: np.ndarray) -> Registered:
    """Markers (..., 9, 3) m on `template` (..., 9, 3) by those that are not `hidden` (..., 9), as at run time.

    `hand` (..., 87) m.
    """
    aligned = _on_template(markers, markers, hidden, template)
    return Registered(
        seen=_flat(np.where(hidden[..., None], 0.0, aligned)),
        all=_flat(aligned),
        hidden=torch.from_numpy(hidden),
        hand=torch.from_numpy(np.asarray(hand, dtype=np.float32)),
    )


def in_hand(markers: np.ndarray, points: np.ndarray, template: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Markers (n, 9, 3) and points (n, 21, 3) m as a hand is placed by the markers on its back."""
    elsewhere = np.ones(markers.shape[:-1], dtype=bool)
    elsewhere[:, list(ALIGNMENT)] = False
    own, of = (_on_template(one, markers, elsewhere, template) for one in (markers, points))
    return own, of


def finger_points(angles: Tensor, rest: Tensor, axes: Tensor) -> Tensor:
    """Points (n, 21, 3) m of hands with angles (n, 26) about `axes` (n, 15, 4) and resting offsets (n, 21, 3).

    From the wrist in its axes.
    """
    turns = quaternion_multiply(quaternion_multiply(axes, rotations_of(angles)), quaternion_conjugate(axes))
    upright = torch.zeros_like(turns[:, :1])
    upright[..., 0] = 1.0
    pose = Pose(_hand(), torch.zeros_like(rest[:, 0]), torch.cat([upright, turns], dim=1))
    return forward_kinematics(pose, rest)[0]


def fingers_of(points: Tensor) -> Tensor:
    """Joints 2 and 3 and tips of fingers (n, 5, 3, 3) among all points (n, 21, 3)."""
    return points[:, _places(FINGER_POINTS)].unflatten(1, (-1, 3))


def turned_to(points: Tensor, markers: Tensor) -> Tensor:
    """Joints 2 and 3 and tips (n, 5, 3, 3) after the finger rotation (two-hands, section 2.2).

    Fingers turn about their bases to point at the markers of their tips. `points` (n, 21, 3) and `markers` (n, 9, 3) m,
    from the wrist in its axes.
    """
    base, rest = points[:, _places(_BASES)][:, :, None], fingers_of(points)
    goal = markers[:, [default_glove().markers.index(f"{finger}_tip") for finger in FINGERS], None]
    arc = shortest_arc(rest[:, :, -1:] - base, goal - base)
    return base + quaternion_rotate(arc.expand(-1, -1, 3, -1), rest - base)


def _on_template(points: np.ndarray, markers: np.ndarray, hidden: np.ndarray, template: np.ndarray) -> np.ndarray:
    """Points (..., n, 3) turned and moved as brings the markers that are not hidden onto the template."""
    base, seen, known = (part.reshape(-1, *part.shape[markers.ndim - 2 :]) for part in (template, markers, ~hidden))
    rotation, translation = register(base, seen, known)
    aligned = to_hand(points.reshape(-1, *points.shape[-2:]), rotation, translation)
    return aligned.reshape(points.shape)


@lru_cache(maxsize=1)
def _hand() -> Skeleton:
    return hand_skeleton(default_skeleton(), "left")


@lru_cache(maxsize=16)
def _places(names: tuple[str, ...]) -> list[int]:
    return _hand().indices(names).tolist()


def _tensor(values: np.ndarray) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))


def _flat(points: np.ndarray) -> Tensor:
    return torch.from_numpy(points.reshape(*points.shape[:-2], -1).astype(np.float32))


def _rounded(vector: Tensor) -> Tensor:
    """Its length, squared near zero (m)."""
    return torch.sqrt(vector.square().sum(dim=-1) + _ROUND**2) - _ROUND
