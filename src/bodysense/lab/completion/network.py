"""The completion network: any points of a body, on any proportions, → rotations, contacts and expected errors.

It reads whichever of 27 points are tracked (the 22 joints of `BODY`, head top and toe tips, and the middle of each
hand's knuckles), each with a position, a rotation, both or neither, and the wearer's bones as far as they are known.
It works in the frame under the head (x, z from the head, the floor at y = 0, turned by the head's heading) and at one
stature: a body that is elsewhere, turned or larger gets the same answer. It states every joint's rotation from that
frame, not from its parent's, so that a bone depends on one rotation and errors do not add up along a chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import BODY, default_skeleton

SITES = ("head_top", "left_toe", "right_toe")
BODY_POINTS = (*BODY, *SITES)  # what has a rest offset here
KNUCKLES = ("left_knuckles", "right_knuckles")  # the mean of the four fingers' first joints
INPUT_POINTS = (*BODY_POINTS, *KNUCKLES)
SPINNING = ("head", "left_wrist", "right_wrist")  # whose angular velocity is read
CONTACT = ("left_ankle", "right_ankle", "left_foot", "right_foot")
JOINTS, PLACED, READ = len(BODY), len(BODY_POINTS), len(INPUT_POINTS)
HEAD = BODY.index("head")
SPIN_PLACES = [BODY.index(name) for name in SPINNING]
HEAD_HEIGHT = 1.5  # m: where the head joint of the reference stature rests above the soles
SMALLEST_ERROR = 0.002  # m: no expected error is smaller
_FASTEST, _SWIFTEST = 5.0, 15.0  # m/s, and change of axes per second: larger values are clipped
_USUAL_INTERVAL = 1 / 30  # s
_BONE_SCALE, _CERTAINTY_SCALE = 20.0, 20.0  # 1/m: a deviation of 5 cm is 1


@dataclass(frozen=True)
class CompletionConfig:
    """How the network is built."""

    hidden: int = 512
    layers: int = 2  # recurrent layers
    branch: int = 512  # units of the layer that turns the joints
    judge_branch: int = 128  # units of the layer that judges contact and expected error


class Signal(NamedTuple):
    """What was tracked in T frames of B sequences, and what is known of the wearers. Absent values are finite."""

    position: Tensor  # (B, T, 27, 3) m, world
    rotation: Tensor  # (B, T, 22, 3, 3) world ← joint
    has_position: Tensor  # (B, T, 27) bool
    has_rotation: Tensor  # (B, T, 22) bool
    accuracy: Tensor  # (B, T, 27) m
    interval: Tensor  # (B, T) s
    turn: Tensor  # (B, T, 3, 3) row vectors of the world @ turn are those of the frame under the head
    origin: Tensor  # (B, T, 3) m, of that frame
    before: Before
    rest_offset: Tensor  # (B, 25, 3) m, as far as known
    certainty: Tensor  # (B, 25) m, standard deviation of each of those lengths; 0 where told
    size: Tensor  # (B,) the wearer's stature beside the reference's


class Before(NamedTuple):
    """What was tracked a frame earlier."""

    position: Tensor  # (B, T, 27, 3) m, world
    has_position: Tensor  # (B, T, 27) bool
    rotation: Tensor  # (B, T, 3, 3, 3) of `SPINNING`
    has_rotation: Tensor  # (B, T, 3) bool


class Prediction(NamedTuple):
    """What the network says, in the frame under the head, at the reference stature."""

    axes: Tensor  # (B, T, 22, 3, 2) first two columns of frame ← joint, not yet orthonormal
    head: Tensor  # (B, T, 3) m, where the head is if it is not tracked
    contact_logit: Tensor  # (B, T, 4) of `CONTACT`
    error: Tensor  # (B, T, 25) m, expected position error


# Per frame: what is read, and how many numbers it has.
WIDTHS = {
    "position": 3 * READ,
    "has_position": READ,
    "velocity": 3 * READ,
    "accuracy": READ,
    "axes": 6 * JOINTS,
    "has_rotation": JOINTS,
    "spin": 6 * len(SPINNING),
    "bones": 3 * PLACED,
    "certainty": PLACED,
    "interval": 1,
}


class CompletionNetwork(nn.Module):
    """Two recurrent layers, a skip connection, and two branches: one turns the joints, one judges."""

    def __init__(self, config: CompletionConfig) -> None:
        super().__init__()
        self.config = config
        self.features = sum(WIDTHS.values())
        self.recurrent = nn.GRU(self.features, config.hidden, config.layers, batch_first=True)
        both = config.hidden + self.features
        self.turn_branch = nn.Sequential(
            nn.Linear(both, config.branch), nn.ReLU(), nn.Linear(config.branch, 6 * JOINTS + 3)
        )
        self.judge_branch = nn.Sequential(
            nn.Linear(both, config.judge_branch), nn.ReLU(), nn.Linear(config.judge_branch, len(CONTACT) + PLACED)
        )
        reference = reference_offsets()
        standing = forward_kinematics(standing_pose(default_skeleton()))[1][:JOINTS]
        constants = {
            "usual_bones": reference,
            "standing_axes": quaternion_to_matrix(standing)[..., :2],
            "from_head": path_from_head(),
            "mirror_sign": mirror_signs(),
        }
        for name, values in constants.items():
            self.register_buffer(name, torch.tensor(np.asarray(values), dtype=torch.float32), persistent=False)
        for name, places in (
            ("bone_parents", bone_parents()),
            ("mirror_place", mirror_places()),
            ("mirror_joints", partners(BODY)),
            ("mirror_judged", [*partners(CONTACT), *(len(CONTACT) + k for k in partners(BODY_POINTS))]),
        ):
            self.register_buffer(name, torch.tensor(list(places)), persistent=False)

    usual_bones: Tensor
    standing_axes: Tensor
    from_head: Tensor
    mirror_sign: Tensor
    bone_parents: Tensor
    mirror_place: Tensor
    mirror_joints: Tensor
    mirror_judged: Tensor

    def read(self, signal: Signal) -> Tensor:
        """Features (B, T, F) of a signal."""
        size = signal.size[:, None, None]
        turn, interval = signal.turn, signal.interval[..., None, None]
        seen = signal.has_position[..., None]
        position = (signal.position - signal.origin[..., None, :]) @ turn / size[..., None]
        moved = (signal.position - signal.before.position) @ turn / (size[..., None] * interval)
        both = (signal.has_position & signal.before.has_position)[..., None]
        known = signal.has_rotation[..., None, None]
        into = turn.mT[..., None, :, :]
        axes = into @ signal.rotation[..., :2]
        spun = axes[..., SPIN_PLACES, :, :] - into @ signal.before.rotation[..., :2]
        spins = (signal.has_rotation[..., SPIN_PLACES] & signal.before.has_rotation)[..., None, None]
        frames = signal.interval.shape
        bones = (signal.rest_offset / size - self.usual_bones) * _BONE_SCALE
        bones = torch.cat([torch.zeros_like(bones[:, :1]), bones[:, 1:]], dim=1)  # the pelvis hangs on nothing
        parts = {
            "position": torch.where(seen, position, 0.0).flatten(-2),
            "has_position": signal.has_position.to(position),
            "velocity": torch.where(both, moved.clamp(-_FASTEST, _FASTEST), 0.0).flatten(-2),
            "accuracy": torch.where(signal.has_position, torch.log10(signal.accuracy) + 3, 0.0),
            "axes": torch.where(known, axes, 0.0).flatten(-3),
            "has_rotation": signal.has_rotation.to(position),
            "spin": torch.where(spins, (spun / interval[..., None]).clamp(-_SWIFTEST, _SWIFTEST), 0.0).flatten(-3),
            "bones": bones.flatten(-2)[:, None].expand(*frames, -1),
            "certainty": (signal.certainty * _CERTAINTY_SCALE)[:, None].expand(*frames, -1),
            "interval": signal.interval[..., None] / _USUAL_INTERVAL,
        }
        return torch.cat([parts[name] for name in WIDTHS], dim=-1)

    def mirrored(self, features: Tensor) -> Tensor:
        """The features of what is seen in a mirror at the plane x = 0 of the frame under the head."""
        return features.index_select(-1, self.mirror_place) * self.mirror_sign

    def begin(self, batch: int) -> Tensor:
        """The memory (layers, batch, hidden) before the first frame."""
        return self.usual_bones.new_zeros(self.config.layers, batch, self.config.hidden)

    def predict(self, features: Tensor, memory: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Raw outputs of both branches for features (B, T, F), and the memory after them."""
        hidden, memory = run_gru(self.recurrent, features, memory)
        both = torch.cat([hidden, features.to(hidden)], dim=-1)
        return (self.turn_branch(both), self.judge_branch(both)), memory

    def prediction(self, turned: Tensor, judged: Tensor) -> Prediction:
        """What the raw outputs mean."""
        axes = turned[..., : 6 * JOINTS].unflatten(-1, (JOINTS, 3, 2)) + self.standing_axes
        contact, error = judged[..., : len(CONTACT)], judged[..., len(CONTACT) :]
        raised = turned[..., 6 * JOINTS :] + turned.new_tensor([0.0, HEAD_HEIGHT, 0.0])
        return Prediction(axes, raised, contact, nn.functional.softplus(error - 3) + SMALLEST_ERROR)

    def places(self, rotation: Tensor, rest_offset: Tensor) -> Tensor:
        """Positions (B, T, 25, 3) from the head of joints turned (B, T, 22, 3, 3), with offsets (B, 25, 3)."""
        bones = rotation[..., self.bone_parents, :, :] @ rest_offset[:, None, 1:, :, None]
        return self.from_head @ bones[..., 0]


def run_gru(gru: nn.GRU, features: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
    """(B, T, F) and memory (layers, B, H) → (B, T, H) and the memory after.

    A single frame is spelled out: in an exported file that is faster, and all that a file needs.
    """
    if features.shape[1] > 1:
        return gru(features, memory)
    above, after = features[:, 0], []
    for layer, (of_input, of_state, input_bias, state_bias) in enumerate(gru.all_weights):
        before = memory[layer]
        given = nn.functional.linear(above, of_input, input_bias)
        kept = nn.functional.linear(before, of_state, state_bias)
        size = before.shape[-1]
        reset, update = torch.sigmoid(given[:, : 2 * size] + kept[:, : 2 * size]).chunk(2, dim=-1)
        candidate = torch.tanh(given[:, 2 * size :] + reset * kept[:, 2 * size :])
        above = candidate + update * (before - candidate)
        after.append(above)
    return above[:, None], torch.stack(after)


def orthonormal(axes: Tensor) -> Tensor:
    """(..., 3, 2) → (..., 3, 3): rotations by Gram-Schmidt (Zhou et al. 2019)."""
    x = nn.functional.normalize(axes[..., 0], dim=-1, eps=1e-6)
    y = axes[..., 1] - x * (x * axes[..., 1]).sum(dim=-1, keepdim=True)
    y = nn.functional.normalize(y, dim=-1, eps=1e-6)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def heading(rotation: Tensor) -> Tensor:
    """(..., 3, 3) → (..., 3, 3): the turn about the vertical of world ← joint, as `Signal.turn`.

    It is the twist about +Y, which stays steady when the head looks up or down.
    """
    cosine = rotation[..., 0, 0] + rotation[..., 2, 2]
    sine = rotation[..., 0, 2] - rotation[..., 2, 0]
    return turn_about_up(cosine, sine)


def turn_about_up(cosine: Tensor, sine: Tensor) -> Tensor:
    """Turns (..., 3, 3) about +Y, for column vectors of the frame or row vectors of the world; not yet unit input."""
    length = torch.sqrt(cosine * cosine + sine * sine).clamp(min=1e-6)
    c, s = cosine / length, sine / length
    zero, one = torch.zeros_like(c), torch.ones_like(c)
    rows = [[c, zero, s], [zero, one, zero], [-s, zero, c]]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def body_places() -> list[int]:
    """Indices of `BODY_POINTS` in the 65 points of a skeleton."""
    return [int(place) for place in default_skeleton().indices(BODY_POINTS)]


def bone_parents() -> list[int]:
    """(24,) for each of `BODY_POINTS` but the pelvis the joint that carries it."""
    skeleton = default_skeleton()
    return [skeleton.parents[place] for place in body_places()[1:]]


def path_from_head() -> np.ndarray:
    """(25, 24): bones in the world → positions of `BODY_POINTS` from the head."""
    skeleton = default_skeleton()
    path = skeleton.path[np.ix_(body_places(), body_places()[1:])]
    return path - path[HEAD]


def reference_offsets() -> np.ndarray:
    """(25, 3) m: rest offsets of the default body at the reference stature."""
    offset = default_skeleton().rest_offset[body_places()]
    return offset / float(stature(offset[None])[0])


def stature(rest_offset: np.ndarray) -> np.ndarray:
    """(B, 25, 3) m → (B,): how high the head rests above the soles, beside the reference's."""
    height = (path_from_head() @ rest_offset[..., 1:, :])[..., 1]
    return -height.min(axis=-1) / HEAD_HEIGHT


def partners(names: tuple[str, ...]) -> list[int]:
    """The place of each name's partner on the other side; a name of the middle is its own."""
    swap = {"left": "right", "right": "left"}
    places = []
    for name in names:
        side, _, rest = name.partition("_")
        places.append(names.index(f"{swap[side]}_{rest}" if side in swap else name))
    return places


def _mirror_parts() -> dict[str, tuple[list[int], list[float]]]:
    """For each kind of feature where its mirror image comes from, and with which sign."""

    def vectors(of: list[int]) -> tuple[list[int], list[float]]:
        return [3 * k + axis for k in of for axis in range(3)], [-1.0, 1.0, 1.0] * len(of)

    def axes(of: list[int]) -> tuple[list[int], list[float]]:
        # Rows x, y, z of two columns: a mirrored rotation changes the sign of its x row and of its x column.
        return [6 * k + part for k in of for part in range(6)], [1.0, -1.0, -1.0, 1.0, -1.0, 1.0] * len(of)

    def plain(of: list[int]) -> tuple[list[int], list[float]]:
        return of, [1.0] * len(of)

    points, joints, placed = partners(INPUT_POINTS), partners(BODY), partners(BODY_POINTS)
    return {
        "position": vectors(points),
        "has_position": plain(points),
        "velocity": vectors(points),
        "accuracy": plain(points),
        "axes": axes(joints),
        "has_rotation": plain(joints),
        "spin": axes(partners(SPINNING)),
        "bones": vectors(placed),
        "certainty": plain(placed),
        "interval": plain([0]),
    }


def mirror_places() -> list[int]:
    """(F,) where each feature's mirror image is read."""
    places, first = [], 0
    for name, width in WIDTHS.items():
        places += [first + place for place in _mirror_parts()[name][0]]
        first += width
    return places


def mirror_signs() -> list[float]:
    """(F,) by what it is multiplied."""
    return [sign for name in WIDTHS for sign in _mirror_parts()[name][1]]
