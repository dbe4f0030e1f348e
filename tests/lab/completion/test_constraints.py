"""Limbs, the spine and feet, each by itself."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense_lab.completion.constraints import (
    ARMS,
    DRAG,
    ENDS,
    FADE,
    LIFT,
    LIMBS,
    MIDDLES,
    STARTS,
    STRAIGHT,
    FootState,
    Limbs,
    Spine,
    held_feet,
    triangle,
)
from bodysense_lab.completion.places import skeleton_tables
from bodysense_lab.completion.vectors import axes_of, carried, spread

SKELETON = default_skeleton()
NONE = torch.zeros(1, 1, 4, 3)  # nothing says about what limbs bend
TABLES = skeleton_tables()
REST = spread(torch.tensor(SKELETON.rest_offset.copy(), dtype=torch.float32)[None, None])


def random_body(seed: int, degrees: float) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Axes (1, 3, 22, 3), bones and points (1, 1, 65, 3) of a body whose joints are turned from the T-pose."""
    rng = np.random.default_rng(seed)
    q = np.concatenate([np.ones((1, 22, 1)), np.radians(degrees) / 2 * rng.standard_normal((1, 22, 3))], axis=-1)
    axes = axes_of(torch.tensor(q / np.linalg.norm(q, axis=-1, keepdims=True), dtype=torch.float32))
    return axes, *placed(axes)


def placed(axes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    bones = carried(axes.index_select(2, TABLES["flat_parents"]), REST)
    return bones, TABLES["from_head"] @ bones


def vectors(count: int, seed: int) -> torch.Tensor:
    return torch.tensor(np.random.default_rng(seed).standard_normal((1, 1, count, 3)), dtype=torch.float32)


def test_two_bones_reach_what_they_can() -> None:
    toward = vectors(300, 1) * 0.4
    a, b = 0.25 + 0.1 * torch.rand(1, 1, 300, 1), 0.25 + 0.1 * torch.rand(1, 1, 300, 1)
    to = triangle(toward, STRAIGHT * (a + b), a * a, (a * a - b * b) / 2)
    far = toward.norm(dim=-1, keepdim=True)
    inside = (far < STRAIGHT * (a + b)) & (far > (a - b).abs() + 1e-3)
    assert 100 < inside.sum() < 300
    assert torch.allclose(to.reached[inside.expand(-1, -1, -1, 3)], toward[inside.expand(-1, -1, -1, 3)], atol=1e-5)
    upper, lower = to.along**2 + to.aside**2, (to.reached.norm(dim=-1, keepdim=True) - to.along) ** 2 + to.aside**2
    assert torch.allclose(upper[inside].sqrt(), a[inside], atol=1e-4)
    assert torch.allclose(lower[inside].sqrt(), b[inside], atol=1e-4)


def test_two_bones_reach_for_a_place_that_is_their_start() -> None:
    to = triangle(
        torch.zeros(1, 1, 1, 3), torch.full((1, 1, 1, 1), 0.5), torch.full((1, 1, 1, 1), 0.09), torch.zeros(1)
    )
    assert all(torch.isfinite(part).all() for part in to)


def bend(seed: int, target: torch.Tensor | None = None, free: float = 1.0, kick: float = 0.0):
    axes, bones, points = random_body(seed, 15.0)
    start, end = points[:, :, STARTS], points[:, :, ENDS]
    target = end + kick * vectors(4, seed) if target is None else start + target
    limbs = Limbs()(
        axes, bones, start, NONE, target, bones[:, :, MIDDLES], NONE, torch.full((1, 1, 4, 1), free), torch.ones(1)
    )
    return axes, bones, start, target, limbs


@pytest.mark.parametrize("seed", range(5))
def test_limbs_come_to_their_ends_and_keep_their_bones(seed: int) -> None:
    _, _, start, target, limbs = bend(seed, kick=0.06)
    assert torch.allclose(limbs.before.norm(dim=-1), limbs.after.norm(dim=-1), atol=2e-4)
    root, upper, lower = limbs.after.split(len(LIMBS), dim=2)
    reached = start - limbs.before[:, :, :4] + root + upper + lower
    longest = upper.norm(dim=-1) + lower.norm(dim=-1)
    near = (target - start).norm(dim=-1) < STRAIGHT * longest
    assert torch.allclose(reached[near], target[near], atol=1e-4)
    assert torch.allclose(root[:, :, 2:], limbs.before[:, :, 2:4], atol=1e-6)  # the pelvis gives legs nothing


@pytest.mark.parametrize("way", [(0.2, 0.0, 0.9), (0.2, 0.9, 0.1)])
def test_a_collar_gives_an_arm_that_is_too_short(way: tuple[float, float, float]) -> None:
    """Forward and upward; sideways a collar has nothing to give."""
    toward = torch.tensor(way) / math.hypot(*way) * 0.54  # of an arm of 0.503 m
    out = torch.stack([toward, toward * torch.tensor([-1.0, 1, 1]), *torch.tensor([[0.0, -0.7, 0.1]] * 2)])
    *_, start, target, limbs = bend(0, target=out[None, None])
    root, upper, lower = limbs.after.split(len(LIMBS), dim=2)
    reached = start - limbs.before[:, :, :4] + root + upper + lower
    assert (reached - target)[:, :, :2].norm(dim=-1).max() < 0.4 * (0.54 - 0.503)
    assert (upper + lower)[:, :, :2].norm(dim=-1).max() < 0.504


def test_an_arm_hangs_from_a_measured_shoulder() -> None:
    axes, bones, points = random_body(6, 15.0)
    start, root = points[:, :, STARTS], bones[:, :, STARTS]
    raised = torch.tensor(Rotation.from_euler("y", 12, degrees=True).as_matrix(), dtype=torch.float32)
    turned = torch.cat([root[:, :, :ARMS] @ raised, root[:, :, ARMS:]], dim=2)
    target = start + torch.tensor([0.0, -0.3, 0.2])
    limbs = Limbs()(
        axes, bones, start, turned - root, target, bones[:, :, MIDDLES], NONE, torch.ones(1, 1, 4, 1), torch.ones(1)
    )
    given, upper, lower = limbs.after.split(len(LIMBS), dim=2)
    assert torch.allclose(given, turned, atol=1e-6)
    assert torch.allclose(start - root + given + upper + lower, target, atol=1e-4)


@pytest.mark.parametrize("way", [(0, -0.7, 0), (0, -0.3, 0.5), (0, 0.1, 0.6), (0, -0.4, -0.4), (0.3, -0.5, 0.3)])
def test_knees_bend_forward(way: tuple[float, float, float]) -> None:
    """A kick forward bends the knee upward, a heel behind the body bends it downward and forward."""
    axes, bones, points = random_body(3, 1.0)
    start = points[:, :, STARTS]
    target = start + torch.tensor(way)
    backward = torch.tensor([[0.0, -0.3, -0.3]])  # where a wrong prediction has the knee
    limbs = Limbs()(
        axes, bones, start, NONE, target, backward.expand(1, 1, 4, 3), NONE, torch.ones(1, 1, 4, 1), torch.ones(1)
    )
    upper, lower = limbs.after[0, 0, 6:8], limbs.after[0, 0, 10:12]
    # The knee's axis points to the wearer's left: the shank bends back about it.
    assert (torch.linalg.cross(upper, lower)[:, 0] > -1e-4).all()


def test_a_measured_knee_is_followed() -> None:
    axes, bones, points = random_body(4, 5.0)
    pole = torch.tensor([[[[0.0, -0.3, -0.2]]]]).expand(1, 1, 4, 3)
    target = points[:, :, STARTS] + torch.tensor([0.0, -0.6, 0.0])
    start = points[:, :, STARTS]
    limbs = Limbs()(axes, bones, start, NONE, target, pole, NONE, torch.zeros(1, 1, 4, 1), torch.ones(1))
    assert (limbs.after[0, 0, 6:8, 2] < -0.1).all()


def test_a_knee_bends_about_a_measured_foot() -> None:
    """Feet turned outward by 40° take knees with them that the network has ahead."""
    axes, bones, points = random_body(5, 1.0)
    start = points[:, :, STARTS]
    target = start + torch.tensor([0.0, -0.6, 0.0])
    ahead = torch.tensor([[[[0.0, -0.4, 0.2]]]]).expand(1, 1, 4, 3)
    out = math.radians(40)
    left = torch.tensor([[math.cos(out), 0, -math.sin(out)], [math.cos(out), 0, math.sin(out)]])
    hinge = torch.cat([torch.zeros(2, 3), left])[None, None]
    free, drawn = torch.ones(1, 1, 4, 1), torch.ones(1)
    told, untold = (Limbs()(axes, bones, start, NONE, target, ahead, one, free, drawn).after for one in (hinge, NONE))
    knees = [torch.atan2(after[0, 0, 6:8, 0].abs(), after[0, 0, 6:8, 2]) for after in (told, untold)]
    assert (knees[1] < math.radians(10)).all()
    assert (knees[0] > math.radians(20)).all() and (knees[0] < out).all()
    assert torch.allclose(told[:, :, :6], untold[:, :, :6])  # arms are as they were


@pytest.mark.parametrize("seed", range(4))
def test_the_spine_takes_the_pelvis_where_it_is_measured(seed: int) -> None:
    axes, bones, points = random_body(seed, 12.0)
    move = torch.tensor([[[[0.02, 0.03, -0.03]]]])
    turned = Spine()(axes, bones, move)
    _, after = placed(turned)
    assert torch.allclose(after[:, :, 0] - points[:, :, 0], move[:, :, 0], atol=2e-4)
    assert torch.allclose(after[:, :, [12, 15]], points[:, :, [12, 15]], atol=1e-6)  # neck and head stay
    others = [k for k, name in enumerate(BODY) if not name.startswith("spine")]
    assert torch.equal(turned[:, :, others], axes[:, :, others])
    assert torch.allclose(Spine()(axes, bones, torch.zeros_like(move)), axes, atol=3e-3)  # 0.3 mm, by `SOFT`


def feet(x: float, low: float = 0.02) -> torch.Tensor:
    """(1, 3, 2, 3) m from a base 1.6 m above the floor: ankles, balls, toe tips."""
    part = torch.tensor([[x, low + 0.06, 0.0], [x, low + 0.01, 0.14], [x, low, 0.2]])
    side = torch.tensor([0.1, 0, 0])
    return torch.stack([part + side, part - side], dim=1)[None] - torch.tensor([0, 1.6, 0])


def walk(steps: list[tuple[float, float, float]], hold: float = 1.0, dt: float = 0.01):
    """Moves (T, 2, 3) of the feet, for their x, contact and lowest height frame by frame."""
    zero = torch.zeros(1, 1, 2, 3)
    state, moves = FootState(torch.zeros(1, 2, 2, 1), zero, zero), []
    floor = torch.tensor([[[[0.0, -1.6, 0.0]]]])
    for x, contact, low in steps:
        probability = torch.full((1, 2, 2, 1), contact)
        move, state = held_feet(
            feet(x, low), probability, torch.full((1, 1, 1, 1), dt), floor, torch.full((1, 1, 1, 1), hold), state
        )
        moves.append(move[0, 0])
    return torch.stack(moves)


def test_feet_that_stand_stand_still() -> None:
    moves = walk([(0.001 * t, 0.9, 0.02) for t in range(50)])
    x = 0.001 * torch.arange(50)[:, None] + moves[:, :, 0]
    assert (x - x[0]).abs().max() < 1e-6
    assert moves[:, :, 1:].abs().max() < 1e-6
    # A foot that is dragged too far slides along.
    far = walk([(0.01 * t, 0.9, 0.02) for t in range(80)])
    assert far[:, :, 0].abs().max() <= DRAG + 1e-6


def test_a_foot_let_go_is_where_it_was_held_and_goes_on_smoothly() -> None:
    moves = walk([(0.001 * t, 0.9 if t < 50 else 0.1, 0.02) for t in range(150)])[:, 0, 0]
    assert abs(float(moves[50] - moves[49])) < 0.004
    assert torch.allclose(moves[51:] / moves[50:-1], torch.tensor(math.exp2(-0.01 / FADE)), atol=1e-3)


def test_contact_between_the_thresholds_holds_on_but_does_not_begin() -> None:
    assert walk([(0.001 * t, 0.4, 0.02) for t in range(20)]).abs().max() < 1e-6
    moves = walk([(0.001 * t, 0.9 if t < 5 else 0.4, 0.02) for t in range(20)])
    assert torch.allclose(moves[:, 0, 0], -0.001 * torch.arange(20), atol=1e-6)


def test_no_foot_is_under_the_floor() -> None:
    moves = walk([(0.0, 0.1, low) for low in (-0.3, -0.05, 0.0, 0.05, -2.0)])
    assert torch.allclose(moves[:, 0, 1], torch.tensor([0.3, 0.05, 0.0, 0.0, LIFT]), atol=1e-6)


def test_feet_are_free_where_that_is_wanted() -> None:
    assert walk([(0.001 * t, 0.9, -0.1) for t in range(20)], hold=0.0).abs().max() == 0
