"""What a completion step reads, remembers and gives, for B people."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from bodysense.body.skeleton import default_skeleton
from bodysense.observation import STRAPPED
from bodysense_lab.completion.features import MOVING
from bodysense_lab.completion.fingers import FingerConfig
from bodysense_lab.completion.network import CompletionConfig
from bodysense_lab.completion.points import JOINTS

_SKELETON = default_skeleton()
POINT_COUNT, JOINT_COUNT = len(_SKELETON.points), len(_SKELETON.joints)


class Inputs(NamedTuple):
    """What a step reads. Values that are not tracked are finite."""

    position: Tensor  # (B, 65, 3) m, world
    rotation: Tensor  # (B, 52, 4) wxyz, world ← joint
    has_position: Tensor  # (B, 65) bool
    has_rotation: Tensor  # (B, 52) bool
    accuracy: Tensor  # (B, 65) m, above 0
    interval: Tensor  # (B,) s since the frame before, above 0
    rest_offset: Tensor  # (B, 65, 3) m
    certainty: Tensor  # (B, 65) m, standard deviation of each bone's length
    floor: Tensor  # (B,) m
    hold: Tensor  # (B,) 1: feet are held and kept above the floor; 0: not
    acceleration: Tensor  # (B, 12, 3) m/s², world, without gravity, of `observation.STRAPPED`
    has_acceleration: Tensor  # (B, 12) bool


class Outputs(NamedTuple):
    """What a step gives."""

    root_position: Tensor  # (B, 3) m
    local_rotation: Tensor  # (B, 52, 4) wxyz, parent ← joint; the root's is world ← root
    points: Tensor  # (B, 65, 3) m, world
    confidence: Tensor  # (B, 65) m, expected error
    bound: Tensor  # (B, 65) m, within which the error is in nine of ten cases
    contact: Tensor  # (B, 4) probability


class State(NamedTuple):
    """What a step remembers, in three tensors: a graph with few inputs is quicker to call."""

    memory: Tensor  # (B, M) `Memory`
    rows: Tensor  # (B, 1, 162, 3) `Rows`
    numbers: Tensor  # (B, 261) `Numbers`


class Memory(NamedTuple):
    """What advances with the networks: not at every frame of a fast device."""

    body: Tensor  # (B, 2 · layers · hidden), of the body and of its mirror image
    fingers: Tensor  # (B, 2 · hidden), of both hands
    rows: Tensor  # (B, 99): 33 places m, world, of the 27 points; x axes, y axes of what spins
    seen: Tensor  # (B, 33) whether these were tracked


class Rows(NamedTuple):
    """Vectors of the frame before."""

    points: Tensor  # (B, 1, 65, 3) m, world, as shown
    axes: Tensor  # (B, 1, 44, 3) x axes, then y axes of the body's joints, world, as shown
    blend: Tensor  # (B, 1, 45, 3) what was shown when sensors last came or went, beside the prediction; of wrists alone
    ends: Tensor  # (B, 1, 4, 3) m, the same of wrists and ankles
    anchor: Tensor  # (B, 1, 2, 3) m, world, where the held parts of the feet stand
    shift: Tensor  # (B, 1, 2, 3) m, by how much the feet are moved along the floor


class Numbers(NamedTuple):
    """Numbers of the frame before."""

    tracked: Tensor  # (B, 117) masks of positions and rotations
    held: Tensor  # (B, 4) 1 where a foot is held, left and right, by its ankle; and by its ball
    heading: Tensor  # (B, 2) cosine and sine
    age: Tensor  # (B, 3) s since sensors last came or went; since the rotations of the left and right wrist did
    elapsed: Tensor  # (B, 1) s since the memory last advanced
    begun: Tensor  # (B, 1) 0 before the first frame


def untracked(batch: int) -> Inputs:
    """Inputs of `batch` people of whom nothing is tracked, on the default body."""
    return Inputs(
        position=torch.zeros(batch, POINT_COUNT, 3),
        rotation=torch.tensor([1.0, 0, 0, 0]).expand(batch, JOINT_COUNT, 4).clone(),
        has_position=torch.zeros(batch, POINT_COUNT, dtype=torch.bool),
        has_rotation=torch.zeros(batch, JOINT_COUNT, dtype=torch.bool),
        accuracy=torch.full((batch, POINT_COUNT), 0.001),
        interval=torch.full((batch,), 1 / 30),
        rest_offset=torch.tensor(_SKELETON.rest_offset.copy(), dtype=torch.float32).expand(batch, -1, -1).clone(),
        certainty=torch.zeros(batch, POINT_COUNT),
        floor=torch.zeros(batch),
        hold=torch.ones(batch),
        acceleration=torch.zeros(batch, len(STRAPPED), 3),
        has_acceleration=torch.zeros(batch, len(STRAPPED), dtype=torch.bool),
    )


_ROWS = (POINT_COUNT, 2 * JOINTS, 2 * JOINTS + 1, 4, 2, 2)
_NUMBERS = (POINT_COUNT + JOINT_COUNT, 4, 2, 3, 1, 1)
_LONG_AGO = 1e3  # s


def _memory_sizes(body: CompletionConfig, fingers: FingerConfig) -> tuple[int, ...]:
    return 2 * body.layers * body.hidden, 2 * fingers.hidden, 3 * MOVING, MOVING


def first_state(body: CompletionConfig, fingers: FingerConfig, batch: int) -> State:
    """The state before the first frame of `batch` people."""
    numbers = torch.zeros(batch, sum(_NUMBERS))
    numbers[:, sum(_NUMBERS[:2])] = 1.0  # the cosine of the heading
    numbers[:, sum(_NUMBERS[:3]) : sum(_NUMBERS[:4])] = _LONG_AGO
    return State(torch.zeros(batch, sum(_memory_sizes(body, fingers))), torch.zeros(batch, 1, sum(_ROWS), 3), numbers)


def unpacked(state: State, body: CompletionConfig, fingers: FingerConfig) -> tuple[Memory, Rows, Numbers]:
    """The parts of a state."""
    return (
        Memory(*state.memory.split(_memory_sizes(body, fingers), dim=1)),
        Rows(*state.rows.split(_ROWS, dim=2)),
        Numbers(*state.numbers.split(_NUMBERS, dim=1)),
    )
