"""What a completed body must keep to: measured points, bones, the senses of joints, the floor, held feet.

Everything is in the world, from a place near the head. Vectors are (B, 1, N, 3) and rotations axes (B, 3, N, 3), as in
`vectors`. A rotation changed here never moves another joint's rotation, only places.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.points import JOINTS
from bodysense_lab.completion.state import POINT_COUNT
from bodysense_lab.completion.vectors import ASIDE, TINY, across, cross, dot, length, reflected, turned_onto, unit

_SKELETON = default_skeleton()
_AT = _SKELETON.index
STRAIGHT = 0.9995  # of a limb's length: it is never quite straight
# Of a limb's length, for arms and legs: share of the natural side in where the middle joint points; it decides where a
# limb is nearly straight. On validation people elbows and knees are the nearer to the truth for it.
BENT_ARM, BENT_LEG = 0.08, 0.1
# m: a root is steep at zero, where rounding to single precision would move the middle of a straight spine by 0.1 mm.
SOFT = 1e-3
COLLAR_GIVES = 0.8  # of a collar's length: what it gives an arm that is too short
LIMBS = [tuple(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")) for side in ("left", "right")]
LIMBS += [tuple(f"{side}_{part}" for part in ("hip", "knee", "ankle")) for side in ("left", "right")]
STARTS, MIDDLES, ENDS = ([_AT(name) for name in names] for names in zip(*LIMBS, strict=True))
ARMS = 2  # of the limbs, the first two are arms
FEET = [_AT(f"{side}_{part}") for side in ("left", "right") for part in ("ankle", "foot", "toe")]
_SPINE = ("spine1", "spine2", "spine3")
_ELBOWS_FORWARD, _KNEES_BACK = 1.0, -1.0  # where middle joints do not go: along z of the upper bone


class Triangle(NamedTuple):
    """Where the middle of two bones is that reach a place: `along` the way there, and `aside` from it."""

    direction: Tensor  # (B, 1, N, 3) unit, from the start to that place
    along: Tensor  # (B, 1, N, 1) m
    aside: Tensor  # (B, 1, N, 1) m
    reached: Tensor  # (B, 1, N, 3) m: where the end comes to, from the start


def triangle(toward: Tensor, longest: Tensor, square: Tensor, excess: Tensor) -> Triangle:
    """Two bones from a start `toward` (B, 1, N, 3) a place; out of reach, they point at it.

    Args:
        toward: (B, 1, N, 3) m, from the start.
        longest: (B, 1, N, 1) m, how far they reach.
        square: (B, 1, N, 1) m², of the upper bone's length.
        excess: (B, 1, N, 1) m², half of what that exceeds the square of the lower bone's by.
    """
    far = length(toward).clamp(min=TINY)
    direction = toward / far
    reach = torch.minimum(far, longest)
    along = 0.5 * reach + excess / reach
    left = torch.relu(square - along * along)
    return Triangle(direction, along, left / torch.sqrt(left + SOFT * SOFT), direction * reach)


class Spine(nn.Module):
    """Bend the spine so that the pelvis, which keeps its rotation, moves by as much as it is asked to."""

    bones: Tensor
    lengths: Tensor
    squares: Tensor
    joints: Tensor
    kept: Tensor

    def __init__(self) -> None:
        super().__init__()
        spine1, spine2, spine3 = (_AT(name) for name in _SPINE)
        bones = torch.zeros(4, POINT_COUNT)  # upper, lower, both, upper
        bones[0, [_AT("neck"), spine3]] = bones[3, [_AT("neck"), spine3]] = -1
        bones[1, spine2] = -1
        bones[2] = bones[0] + bones[1]
        joints = [spine3, spine1, spine2]
        for name, values in (
            ("bones", bones),
            ("lengths", torch.tensor([[1.0, 1, 0, 0]])),
            ("squares", torch.tensor([[1.0, 0, 0, 0], [0.5, -0.5, 0, 0]])),
            ("joints", torch.tensor(joints)),
            ("kept", torch.tensor(replacing(JOINTS, joints))),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(self, axes: Tensor, bones: Tensor, move: Tensor) -> Tensor:
        """Axes (B, 3, 22, 3) with the spine bent, for bones (B, 1, 65, 3) and a move (B, 1, 1, 3), m."""
        before = self.bones @ bones
        upper, lower, both, again = before.split(1, dim=2)
        size = length(before)
        square, excess = (self.squares @ (size * size)).split(1, dim=2)
        old = axes.index_select(2, self.joints)
        # Between neck and the lowest joint of the spine: two bones, the upper one of which is stiff.
        to = triangle(both + move, self.lengths @ size, square, excess)
        side = across(upper @ ASIDE, to.direction)  # a spine that is straight bends to some side
        middle = to.direction * to.along + unit(side) * to.aside
        turned = turned_onto(
            old, torch.cat([upper, lower, again], dim=2), torch.cat([middle, to.reached - middle, middle], dim=2)
        )
        return torch.cat([axes, turned], dim=2).index_select(2, self.kept)


class BentLimbs(NamedTuple):
    """What turns arms and legs: bones of collars (and hips, which stay), then upper bones, then lower bones."""

    before: Tensor  # (B, 1, 12, 3) m
    after: Tensor  # (B, 1, 12, 3) m


HINGE = 2.0  # how much more a measured foot or pelvis says of where a knee goes than the network does


class Limbs(nn.Module):
    """Bend arms and legs so that their ends come to where they should be; a collar gives an arm that is too short."""

    chains: Tensor
    lengths: Tensor
    squares: Tensor
    unnatural: Tensor
    one_sided: Tensor
    bent: Tensor
    most_given: Tensor

    def __init__(self) -> None:
        super().__init__()
        count = len(LIMBS)
        four, none = torch.eye(count), torch.zeros(count, count)
        unnatural = torch.zeros(count, JOINTS)
        for k, start in enumerate(STARTS):
            unnatural[k, start] = _ELBOWS_FORWARD if k < ARMS else _KNEES_BACK
        arms = torch.tensor([[1.0], [1], [0], [0]])
        for name, values in (
            ("chains", torch.tensor([*STARTS, *MIDDLES, *ENDS])),
            ("lengths", torch.cat([torch.cat([four, none, none], 1), STRAIGHT * torch.cat([none, four, four], 1)])),
            ("squares", torch.cat([torch.cat([none, four, none], 1), torch.cat([none, four, -four], 1) / 2])),
            ("unnatural", unnatural),
            ("one_sided", 1 - arms.expand(-1, 3)),
            ("bent", BENT_ARM * arms + BENT_LEG * (1 - arms)),
            ("most_given", COLLAR_GIVES * arms),
        ):
            self.register_buffer(name, values.contiguous(), persistent=False)

    def forward(
        self,
        axes: Tensor,
        bones: Tensor,
        start: Tensor,
        shifted: Tensor,
        target: Tensor,
        pole: Tensor,
        hinge: Tensor,
        free: Tensor,
        drawn: Tensor,
    ) -> BentLimbs:
        """How to turn the limbs.

        Args:
            axes: (B, 3, 22, 3).
            bones: (B, 1, 65, 3) m.
            start: (B, 1, 4, 3) m.
            shifted: (B, 1, 4, 3) m, by how much measured shoulders are off it.
            target: (B, 1, 4, 3) m; out of reach, the limb points at it.
            pole: (B, 1, 4, 3) m, where the middle joint would be, from the start.
            hinge: (B, 1, 4, 3) about what limbs bend as measured rotations tell, toward the left; 0 where none does.
            free: (B, 1, 4, 1) 1 where the middle joint is not measured: it then goes to its natural side.
            drawn: (B, 1, 1, 1) how much it is drawn there, 0 to 1.
        """
        before = bones.index_select(2, self.chains)
        size = length(before)
        base, longest = (self.lengths @ size).split(len(LIMBS), dim=2)
        square, excess = (self.squares @ (size * size)).split(len(LIMBS), dim=2)
        root = before[:, :, : len(LIMBS)]
        measured = unit(root + shifted) * base
        wanted = target - (start - root)
        toward = wanted - measured
        far = length(toward).clamp(min=TINY)
        lacking = torch.minimum(torch.relu(far - longest), self.most_given * base)
        reached = unit(measured + toward / far * lacking) * base
        given = reached - root
        to = triangle(wanted - reached, longest, square, excess)
        # The side to which the middle joint does not go turns with the limb, so that a leg kicked forward bends upward.
        halfway = unit(unit(before[:, :, len(LIMBS) : 2 * len(LIMBS)]) @ ASIDE + to.direction)
        unnatural = reflected(self.unnatural @ axes[:, 2:], halfway)
        side = pole - given
        wrong = torch.relu(dot(side, unnatural)) * self.one_sided
        side = side - unnatural * ((wrong + self.bent * longest * drawn) * free)
        aside = unit(across(side, to.direction)) + cross(to.direction, hinge) * (HINGE * free)
        middle = to.direction * to.along + unit(aside) * to.aside
        return BentLimbs(before, torch.cat([reached, middle, to.reached - middle], dim=2))


class FootState(NamedTuple):
    """What holds each foot, left and right."""

    held: Tensor  # (B, 2, 2, 1) 1 where the feet are held by their ankles, and by their balls
    anchor: Tensor  # (B, 1, 2, 3) m, where that stands
    shift: Tensor  # (B, 1, 2, 3) m, by how much the feet are moved along the floor


HOLD, RELEASE = 0.5, 0.3  # probability of contact from which a foot is held, and below which it is let go
FADE = 0.1  # s in which half of what a released foot was held back by fades
DRAG = 0.06  # m: a foot that its leg drags farther slides along
LIFT = 0.5  # m: no foot is lifted farther to be on the floor
_KEEP = 10.0  # by how much a part that holds already goes before the other one, more than any probability
_BALL_FIRST = torch.tensor([0.0, 1e-5]).reshape(2, 1, 1)
_ALONG, _UP = torch.tensor([1.0, 0, 1]), torch.tensor([0.0, 1, 0])


def held_feet(
    foot: Tensor, contact: Tensor, interval: Tensor, floor: Tensor, hold: Tensor, state: FootState
) -> tuple[Tensor, FootState]:
    """By how much (B, 1, 2, 3) m to move the feet so that they stand still and not under the floor.

    Args:
        foot: (B, 3, 2, 3) m: ankles, balls and toe tips.
        contact: (B, 2, 2, 1) probability that ankles and balls stand.
        interval: (B, 1, 1, 1) s.
        floor: (B, 1, 1, 3) m, straight down to it.
        hold: (B, 1, 1, 1) 1 where feet are to be held and kept above the floor, 0 where not.
        state: of the frame before.
    """
    kept = state.held * (contact >= RELEASE).to(contact)
    score = contact + kept * _KEEP + _BALL_FIRST
    held = (score >= score.amax(dim=1, keepdim=True).clamp(min=HOLD)).to(contact) * hold
    standing = (held * foot[:, :2]).sum(dim=1, keepdim=True)
    stays = kept.sum(dim=1, keepdim=True) > 0.5
    faded = state.shift * torch.exp(interval * (-math.log(2) / FADE))
    shift = torch.where(stays, state.anchor - standing, faded) * (hold * _ALONG)
    shift = shift / length(shift).clamp(min=DRAG) * DRAG
    lift = torch.clamp(floor - foot.amin(dim=1, keepdim=True), min=0.0, max=LIFT) * (hold * _UP)
    return shift + lift, FootState(held, standing + shift, shift)


def replacing(count: int, places: list[int]) -> list[int]:
    """(count,) indices into [all, some new ones] that take the new ones at `places`."""
    chosen = list(range(count))
    for k, place in enumerate(places):
        chosen[place] = count + k
    return chosen
