"""The three-point network: a whole body, in rotations, from a headset and two hands.

It starts at world poses of head and wrists, hands possibly missing, and ends at world rotations of the 22 joints of
`BODY`, placed by forward kinematics of the wearer's own bones so that the head is where it is measured. Everything
between is in the frame of the head's heading and at one stature: a body that is larger, elsewhere or turned about the
vertical gets the same answer, larger, elsewhere or turned. The floor is y = 0. Change of frame and of size, velocities
and the repetition of lost hands are inside, so that training, the exported file and every run time share them.

The network states every joint's rotation from the heading's frame, not from its parent's: a bone then depends on one
rotation and errors do not add up along the chains. The head's rotation is the measured one, and a wrist's where it is
measured.

At run time it is asked twice, once about what is seen in a mirror, and the answers are averaged: a body and its mirror
image get the same answer, mirrored, and errors that differ between the two cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.body_joints import body_skeleton
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.products import CONJUGATE, LEFT, MATRIX
from bodysense.body.rotation import matrix_to_sixd, normalize, quaternion_to_matrix
from bodysense.body.skeleton import BODY, Skeleton, default_skeleton
from bodysense.models.body_network import FIRST_INTERVAL, REFERENCE_HEIGHT
from bodysense.models.recurrent import Recurrent, branch
from bodysense.observation import Observation, observed_points
from bodysense.occlusion.three_point import POINTS

CONTACT = ("left_ankle", "right_ankle", "left_foot", "right_foot")  # whose contact with the floor is judged
NEVER = 10.0  # s: for how long a hand was not seen that never was
_HEAD, _WRISTS = BODY.index("head"), [BODY.index("left_wrist"), BODY.index("right_wrist")]
_SHORTEST, _LONGEST = 1 / 125, 0.1  # s: time steps outside are told to the network as these
_FASTEST, _SWIFTEST = 5.0, 15.0  # m/s and rad/s: what moves faster is told as this

# Products of two rotations' parts, ww, wx, wy, wz, xw …, as constant matrices: in the exported file each is one step.
_AXES = MATRIX[:, [0, 3, 6, 1, 4, 7]]  # of q with itself: the first two columns of its matrix (6-D)
_HEADING = np.zeros((16, 3))  # of q with itself: cosine and sine of its heading, both times the third
_HEADING[[0, 10, 2, 0, 10], [0, 0, 1, 2, 2]] = 1, -1, 2, 1, 1
_STEP = (LEFT.reshape(4, 4, 4) * CONJUGATE).transpose(0, 2, 1).reshape(16, 4)  # of a with b: a · b⁻¹
_CROSS = np.zeros((9, 3))  # of two vectors' parts, xx, xy …
_CROSS[[5, 7, 6, 2, 1, 3], [0, 0, 1, 1, 2, 2]] = 1, -1, 1, -1, 1, -1


@dataclass(frozen=True)
class ThreePointConfig:
    """How the network is built."""

    hidden: int = 384
    layers: int = 2  # recurrent layers
    branch: tuple[int, ...] = (384,)  # hidden layers that turn the joints
    judge_branch: tuple[int, ...] = (96,)  # hidden layers that judge contact with the floor and expected error
    dropout: float = 0.0  # in training, of the recurrent part: the same for all frames of a chunk, as motion is judged


class Tracked(NamedTuple):
    """What was tracked in T frames of B sequences: head, left wrist, right wrist."""

    position: Tensor  # (B, T, 3, 3) m, world; any finite value of hands that are not tracked
    rotation: Tensor  # (B, T, 3, 4) wxyz, world ← point; any unit quaternion of hands that are not tracked
    has_position: Tensor  # (B, T, 2) bool, of the hands
    has_rotation: Tensor  # (B, T, 2) bool, of the hands
    interval: Tensor  # (B, T) s, since the frame before
    rest_offset: Tensor  # (B, 22, 3) m, of the wearer's `BODY`
    height: Tensor  # (B,) m, of the wearer's rest pose


class State(NamedTuple):
    """What the network remembers between frames."""

    offset: Tensor  # (B, 2, 3) m at the reference height: last known hands from the head, in its heading's frame
    axes: Tensor  # (B, 2, 6) their last known rotation in that frame
    unseen: Tensor  # (B, 2) s, for how long the hands have not been seen
    position: Tensor  # (B, 3, 3) of the frame before, as in `Tracked`
    rotation: Tensor  # (B, 3, 4)
    fresh: Tensor  # (B, 3, 2) bool: whether these two were measured in the frame before
    memory: Tensor  # of the recurrent part


class Prepared(NamedTuple):
    """What the branches read of an input: features at the reference height, in the heading's frame."""

    features: Tensor  # (B, T, F)
    rest_offset: Tensor  # (B, 22, 3) m at the reference height


class Answer(NamedTuple):
    """The answer in the heading's frame at the reference height: what the losses compare."""

    rotation: Tensor  # (B, T, 22, 3, 3) heading ← joint
    position: Tensor  # (B, T, 22, 3) m, from the head
    error: Tensor  # (B, T, 22) m, expected position error
    contact_logit: Tensor  # (B, T, 4) of `CONTACT`


class Completed(NamedTuple):
    """The answer in the world."""

    root: Tensor  # (B, T, 3) m
    rotation: Tensor  # (B, T, 22, 4) wxyz, world ← joint
    position: Tensor  # (B, T, 22, 3) m
    error: Tensor  # (B, T, 22) m
    contact: Tensor  # (B, T, 4) probability


class ThreePointNetwork(nn.Module):
    """GRU, skip connection, two branches of fully connected layers: rotations, and judgement."""

    def __init__(self, config: ThreePointConfig) -> None:
        super().__init__()
        self.config = config
        reference = body_skeleton(default_skeleton().scaled(REFERENCE_HEIGHT))
        position, rotation = forward_kinematics(standing_pose(reference))
        position = position - position[_HEAD]
        constants = {
            "standing_axes": matrix_to_sixd(quaternion_to_matrix(rotation)),
            "standing_offset": position[_WRISTS],
            "typical_bone": reference.bone_length[1:],
            # From bones to places measured from the head: (22, 21).
            "path": (reference.path - reference.path[_HEAD])[:, 1:],
            **{"of_axes": _AXES, "of_heading": _HEADING, "of_step": _STEP, "of_cross": _CROSS, "of_matrix": MATRIX.T},
        }
        for name, values in constants.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32), persistent=False)
        turned = [joint for joint in range(len(BODY)) if joint != _HEAD]
        for name, swap in (("mirror_features", _mirrored_features()), ("mirror_turned", _mirrored_axes(turned))):
            self.register_buffer(name, torch.tensor(swap, dtype=torch.float32), persistent=False)
        partner = _partners(BODY) + [len(BODY) + place for place in _partners(CONTACT)]
        self.register_buffer("mirror_judged", torch.tensor(partner), persistent=False)
        for name, places in (("parents", reference.parents[1:]), ("turned", turned), ("diagonal", range(0, 16, 5))):
            self.register_buffer(name, torch.tensor(list(places)), persistent=False)
        self.features = sum(_WIDTHS.values())
        self.recurrent = Recurrent("gru", self.features, config.hidden, None, config.layers)
        both = config.hidden + self.features
        self.turn = branch(both, config.branch, 6 * len(turned))
        self.judge = branch(both, config.judge_branch, len(BODY) + len(CONTACT))

    standing_axes: Tensor
    standing_offset: Tensor
    typical_bone: Tensor
    path: Tensor
    of_axes: Tensor
    of_heading: Tensor
    of_step: Tensor
    of_cross: Tensor
    of_matrix: Tensor
    mirror_features: Tensor
    mirror_turned: Tensor
    mirror_judged: Tensor
    parents: Tensor
    turned: Tensor
    diagonal: Tensor

    def start(self, batch: int) -> State:
        """The state before the first frame of `batch` sequences: hands hang that were never seen."""
        like = self.path
        return State(
            offset=self.standing_offset.expand(batch, -1, -1).clone(),
            axes=self.standing_axes[_WRISTS].expand(batch, -1, -1).clone(),
            unseen=like.new_full((batch, 2), NEVER),
            position=like.new_zeros(batch, 3, 3),
            rotation=like.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(batch, 3, 4).clone(),
            fresh=torch.zeros(batch, 3, 2, dtype=torch.bool, device=like.device),
            memory=self.begin(batch),
        )

    def forward(self, tracked: Tracked, state: State) -> tuple[Completed, State]:
        """Complete T frames; one call with T frames equals T calls with one."""
        prepared, into, state = self.prepare(tracked, state)
        said, memory = self.ask_twice(prepared.features, state.memory)
        answer = self.answer(prepared, *said)
        size = (tracked.height / REFERENCE_HEIGHT)[:, None, None]
        position = answer.position @ (into.mT * size[..., None]) + tracked.position[..., :1, :]
        completed = Completed(
            root=position[..., 0, :],
            rotation=self.quaternions(into[..., None, :, :] @ answer.rotation),
            position=position,
            error=answer.error * size,
            contact=torch.sigmoid(answer.contact_logit),
        )
        return completed, state._replace(memory=memory)

    def begin(self, batch: int) -> Tensor:
        """The memory of `ask_twice` before the first frame."""
        return torch.cat([self.recurrent.start(batch)] * 2, dim=-1).to(self.path)

    def ask_twice(self, features: Tensor, memory: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """What the branches say of features (B, T, F), averaged with what they say in a mirror; the memory after."""
        both = torch.cat([features, features @ self.mirror_features])
        hidden, after = self.recurrent(both, torch.cat(memory.chunk(2, dim=-1)))
        said = self.say(both, hidden)
        (turned, in_mirror), (judged, judged_in_mirror) = (part.unflatten(0, (2, -1)) for part in said)
        turned = (turned + in_mirror @ self.mirror_turned) / 2
        judged = (judged + judged_in_mirror.index_select(-1, self.mirror_judged)) / 2
        return (turned, judged), torch.cat([*after.unflatten(0, (2, -1))], dim=-1)

    def say(self, features: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """What the two branches make (B, T, 126), (B, T, 26) of features and recurrent part (B, T, hidden)."""
        if self.training and self.config.dropout:
            kept = torch.rand_like(hidden[:, :1]) >= self.config.dropout
            hidden = hidden * kept / (1 - self.config.dropout)
        both = torch.cat([hidden, features], dim=-1)
        frames, both = both.shape[:-1], both.flatten(0, -2)  # as matrices, layers fuse in the exported file
        return self.turn(both).unflatten(0, frames), self.judge(both).unflatten(0, frames)

    def answer(self, prepared: Prepared, turned: Tensor, judged: Tensor) -> Answer:
        """A body of what the branches said."""
        said = self.standing_axes.index_select(0, self.turned) + turned.unflatten(-1, (-1, 6))
        parts = dict(zip(_WIDTHS, prepared.features.split(list(_WIDTHS.values()), dim=-1), strict=True))
        hands = torch.where(
            parts["has_rotation"][..., None] > 0.5, parts["hand_axes"].unflatten(-1, (2, 6)), said[..., -2:, :]
        )
        head = parts["head_axes"][..., None, :]
        axes = torch.cat([said[..., :_HEAD, :], head, said[..., _HEAD:-2, :], hands], dim=-2)
        rotation = self.upright(axes)
        bone = rotation.index_select(-3, self.parents) @ prepared.rest_offset[:, None, 1:, :, None]
        error = torch.exp(torch.clamp(judged[..., : len(BODY)] - 3, -7, 1))
        return Answer(rotation, self.path @ bone[..., 0], error, judged[..., len(BODY) :])

    def upright(self, axes: Tensor) -> Tensor:
        """Rotations (..., 3, 3) from two columns (..., 6) that need not be of length one, nor at right angles."""
        x = normalize(axes[..., :3])
        y = axes[..., 3:]
        y = normalize(y - (x * y).sum(dim=-1, keepdim=True) * x)
        return torch.stack([x, y, _outer(x, y) @ self.of_cross], dim=-1)

    def quaternions(self, matrix: Tensor) -> Tensor:
        """(..., 3, 3) → (..., 4), w ≥ 0: of four proportional ones the longest (Shepperd 1978)."""
        products = matrix.flatten(-2) @ self.of_matrix  # 4 q qᵀ, but for 1 on the diagonal
        largest = products.index_select(-1, self.diagonal).argmax(dim=-1, keepdim=True)[..., None]
        rows = (products + torch.eye(4).flatten().to(products)).unflatten(-1, (4, 4))
        chosen = normalize(torch.gather(rows, -2, largest.expand(*rows.shape[:-2], 1, 4))[..., 0, :])
        return torch.where(chosen[..., :1] < 0, -chosen, chosen)

    def facing(self, head_rotation: Tensor) -> Tensor:
        """The turn (..., 3, 3) of row vectors from the world into the heading's frame of rotations (..., 4)."""
        products = _outer(head_rotation, head_rotation) @ self.of_heading
        length = products[..., 2:]
        # Upside down (a half turn about a horizontal axis) there is no heading; that of the world serves.
        ahead = self.of_heading.new_tensor([1.0, 0.0])
        heading = torch.where(length < 1e-9, ahead, products[..., :2] / torch.clamp(length, min=1e-9))
        return turn_about_up(heading[..., 0], heading[..., 1])

    def prepare(self, tracked: Tracked, state: State) -> tuple[Prepared, Tensor, State]:
        """What the branches read, the turn (B, T, 3, 3) of row vectors from world into frame, and the next state."""
        into = self.facing(tracked.rotation[..., 0, :])
        size = (REFERENCE_HEIGHT / tracked.height)[:, None, None, None]
        scaled = into * size
        offset = (tracked.position[..., 1:, :] - tracked.position[..., :1, :]) @ scaled
        columns = _outer(tracked.rotation, tracked.rotation) @ self.of_axes
        axes = (columns.unflatten(-1, (2, 3)) @ into[..., None, :, :]).flatten(-2)
        held_offset = _held(offset, tracked.has_position, state.offset)
        held_axes = _held(axes[..., 1:, :], tracked.has_rotation, state.axes)
        unseen = _unseen(tracked.interval, tracked.has_position, state.unseen)

        head_known = torch.ones_like(tracked.has_position[..., :1, None].expand(-1, -1, -1, 2))
        known = torch.stack([tracked.has_position, tracked.has_rotation], dim=-1)
        known = torch.cat([head_known, known], dim=-2)  # (B, T, 3, 2)
        moving = (known & _before(known, state.fresh)).to(offset.dtype) / torch.clamp(
            tracked.interval[..., None, None], min=1e-3
        )
        velocity = (tracked.position - _before(tracked.position, state.position)) @ scaled * moving[..., :1]
        step = _outer(tracked.rotation, _before(tracked.rotation, state.rotation)) @ self.of_step
        turn = torch.where(step[..., :1] < 0, -2.0, 2.0) * step[..., 1:]  # a rotation vector, nearly
        spin = turn @ into * moving[..., 1:]

        rest_offset = tracked.rest_offset * size[..., 0]
        bone = (torch.linalg.vector_norm(rest_offset[:, 1:], dim=-1) - self.typical_bone) * 10
        interval = torch.clamp(tracked.interval[..., None], _SHORTEST, _LONGEST) * 30
        parts = {
            "head_axes": axes[..., 0, :],
            "hand_axes": held_axes.flatten(-2),
            "has_rotation": tracked.has_rotation.to(offset.dtype),
            "has_position": tracked.has_position.to(offset.dtype),
            "unseen": 1 - torch.exp(-unseen),
            "head_height": tracked.position[..., 0, 1:2] * size[..., 0] - 1.0,
            "hand_offset": held_offset.flatten(-2),
            "velocity": torch.clamp(velocity, -_FASTEST, _FASTEST).flatten(-2),
            "spin": torch.clamp(spin, -_SWIFTEST, _SWIFTEST).flatten(-2) / 5,
            "bone": bone[:, None].expand(-1, interval.shape[1], -1),
            "interval": interval,
        }
        after = State(
            offset=held_offset[:, -1],
            axes=held_axes[:, -1],
            unseen=unseen[:, -1],
            position=tracked.position[:, -1],
            rotation=tracked.rotation[:, -1],
            fresh=known[:, -1],
            memory=state.memory,
        )
        return Prepared(torch.cat([parts[name] for name in _WIDTHS], dim=-1), rest_offset), into, after


# Widths of the features, in their order.
_WIDTHS = {
    **{"head_axes": 6, "hand_axes": 12, "has_rotation": 2, "has_position": 2, "unseen": 2, "head_height": 1},
    **{"hand_offset": 6, "velocity": 9, "spin": 9, "bone": len(BODY) - 1, "interval": 1},
}


def turn_about_up(cosine: Tensor, sine: Tensor) -> Tensor:
    """The matrix (..., 3, 3) that turns row vectors from the world into a heading's frame, by the heading (...)."""
    zero, one = torch.zeros_like(cosine), torch.ones_like(cosine)
    return torch.stack([cosine, zero, sine, zero, one, zero, -sine, zero, cosine], dim=-1).unflatten(-1, (3, 3))


def tracked_of(observation: Observation, skeleton: Skeleton) -> Tracked:
    """What the network reads of T frames of one wearer; a batch of one. The head must be there in every frame."""
    places = skeleton.indices(POINTS)
    position, rotation, has_position, has_rotation = (
        values[:, places] for values in observed_points(observation, skeleton)
    )
    time = observation.time
    interval = np.diff(time, prepend=2 * time[0] - time[1] if len(time) > 1 else time[0] - FIRST_INTERVAL)
    upright = np.array([1.0, 0.0, 0.0, 0.0])

    def batch(values: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))[None]

    return Tracked(
        position=batch(np.where(has_position[..., None], position, 0.0)),
        rotation=batch(np.where(has_rotation[..., None], rotation, upright)),
        has_position=torch.from_numpy(has_position[None, :, 1:].copy()),
        has_rotation=torch.from_numpy(has_rotation[None, :, 1:].copy()),
        interval=batch(interval),
        rest_offset=batch(skeleton.rest_offset[skeleton.indices(BODY)]),
        height=torch.tensor([skeleton.height], dtype=torch.float32),
    )


def _before(values: Tensor, first: Tensor) -> Tensor:
    """What each frame of values (B, T, …) had before it, the first one `first` (B, …)."""
    return first[:, None] if values.shape[1] == 1 else torch.cat([first[:, None], values[:, :-1]], dim=1)


def _held(values: Tensor, known: Tensor, before: Tensor) -> Tensor:
    """Values (B, T, N, C); where they are not known (B, T, N) the last that were, at first `before` (B, N, C)."""
    if values.shape[1] == 1:  # spelled out, so that the exported file is small
        return torch.where(known[..., None], values, before[:, None])
    history = torch.cat([before[:, None], values], dim=1)
    return torch.take_along_dim(history, _last(known)[..., None].expand_as(values), dim=1)


def _unseen(interval: Tensor, known: Tensor, before: Tensor) -> Tensor:
    """For how long (B, T, N) s something was not known, after steps of (B, T) s; `before` (B, N) at first."""
    if known.shape[1] == 1:
        return torch.where(known, 0.0, before[:, None] + interval[..., None])
    clock = torch.cumsum(interval, dim=1)[..., None].expand_as(known)
    return clock - torch.take_along_dim(torch.cat([-before[:, None], clock], dim=1), _last(known), dim=1)


def _last(known: Tensor) -> Tensor:
    """(B, T, N) which was the last known frame, counted from 1; 0 where there was none."""
    frame = torch.arange(1, known.shape[1] + 1, device=known.device)[:, None]
    return torch.cummax(torch.where(known, frame, 0), dim=1).values


def _outer(a: Tensor, b: Tensor) -> Tensor:
    """Every product of a part of `a` with one of `b`: (..., n), (..., m) → (..., n · m)."""
    return (a[..., :, None] * b[..., None, :]).flatten(-2)


def _partners(names: Sequence[str]) -> list[int]:
    """Of every name the place of the other side's; of a name without a side its own."""
    other = {"left": "right", "right": "left"}
    swapped = [
        f"{other[side]}_{rest}" if side in other else name for name in names for side, _, rest in [name.partition("_")]
    ]
    return [list(names).index(name) for name in swapped]


def _mirrored_features() -> np.ndarray:
    """(F, F): features @ this are those of what is seen in a mirror at the plane x = 0 of the heading's frame."""
    mirror, hands = np.diag([-1.0, 1.0, 1.0]), np.eye(2)[::-1]
    head_and_hands = np.eye(3)[[0, 2, 1]]
    axes = np.kron(np.diag([-1.0, 1.0]), mirror)  # columns of a rotation's matrix: its own x axis is mirrored too
    blocks = {
        "head_axes": axes,
        "hand_axes": np.kron(hands, axes),
        **dict.fromkeys(("has_rotation", "has_position", "unseen"), hands),
        **dict.fromkeys(("head_height", "interval"), np.eye(1)),
        "hand_offset": np.kron(hands, mirror),
        "velocity": np.kron(head_and_hands, mirror),
        "spin": np.kron(head_and_hands, -mirror),
        "bone": np.eye(len(BODY))[_partners(BODY)][1:, 1:],
    }
    whole, place = np.zeros((sum(_WIDTHS.values()),) * 2), 0
    for name, width in _WIDTHS.items():
        whole[place : place + width, place : place + width] = blocks[name]
        place += width
    return whole


def _mirrored_axes(joints: Sequence[int]) -> np.ndarray:
    """(6 J, 6 J): the same for two columns of each of these joints' matrices."""
    partner = [list(joints).index(_partners(BODY)[joint]) for joint in joints]
    return np.kron(np.eye(len(joints))[partner], np.kron(np.diag([-1.0, 1.0]), np.diag([-1.0, 1.0, 1.0])))
