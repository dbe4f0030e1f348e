"""Training of the joining network in PyTorch: network, losses, validation, calibration of expected errors, file.

The network and its features are defined in `bodysense.takes.joining_network`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.nn.functional import silu

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.files import written_beside
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.datasets.splits import Split
from bodysense.takes.joining_network import DILATIONS, FORMAT, JOINTS, OUTPUTS
from bodysense_lab.completion.data.joining_takes import JoinedTake, cached_takes, draw_takes
from bodysense_lab.completion.data.points import partners
from bodysense_lab.completion.networks.publish import QUANTILE
from bodysense_lab.completion.networks.weights_file import safetensors_bytes
from bodysense_lab.completion.score.measures import JUMP
from bodysense_lab.completion.training.losses import SLACK, length
from bodysense_lab.completion.training.options import JoiningTraining
from bodysense_lab.core.fit import Task, cut_frames, fit, set_seed_and_threads
from bodysense_lab.core.options import Schedule
from bodysense_lab.core.progress import log_progress
from bodysense_lab.core.scoring import RATE
from bodysense_lab.data.clips import read_clips

_PARENTS, _HEAD = default_skeleton().parents[:JOINTS], BODY.index("head")
_ARRAYS = (
    *("features", "past", "future", "share", "world", "turned", "head", "truth", "true_head"),
    *("hidden", "expected"),
)
_VALIDATION_FRAMES, _VALIDATION_SEED = 40_000, 7


@dataclass(frozen=True)
class JoiningConfig:
    """Size of the network."""

    inputs: int
    width: int = 192
    dilations: tuple[int, ...] = DILATIONS
    dropout: float = 0.1


@dataclass(frozen=True)
class JoiningLosses:
    """Weights of the terms of the loss, each a mean over frames and joints of `BODY`."""

    position: float = 1.0  # per metre, of positions relative to the head
    rotation: float = 0.15  # per radian, of local rotations
    velocity: float = 0.045  # per m/s, difference of velocities in the world
    haste: float = 3.0  # per m/s that a joint is faster than the true one, beyond `SLACK`
    certainty: float = 0.02  # error / expected + log(expected), of points that are not tracked


@dataclass(frozen=True)
class JoiningTaskConfig:
    """Settings of batches and losses."""

    network: JoiningConfig
    takes: int = 24  # takes in a batch
    frames: int = 160  # frames of each take
    losses: JoiningLosses = field(default_factory=JoiningLosses)


class JoiningModule(nn.Module):
    """The joining network in PyTorch."""

    def __init__(self, config: JoiningConfig) -> None:
        super().__init__()
        self.config, width = config, config.width
        self.inward = nn.Linear(config.inputs, width)
        self.convolutions = nn.ModuleList(
            [nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation) for dilation in config.dilations]
        )
        self.mixing = nn.ModuleList([nn.Linear(width, width) for _ in config.dilations])
        self.dropout = nn.Dropout(config.dropout)
        self.outward = nn.Linear(width, OUTPUTS)
        self.error_offset: Tensor
        self.bound_offset: Tensor
        nn.init.zeros_(self.outward.weight)  # begin with the plain mean of both estimates
        nn.init.zeros_(self.outward.bias)
        for name in ("error_offset", "bound_offset"):  # logarithms of factors that `calibrate_errors` sets
            self.register_buffer(name, torch.zeros(JOINTS))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return turns (B, T, 22, 3) rad, log odds and log factors of errors (B, T, 22) for features (B, T, F)."""
        hidden = self.inward(features)
        for convolution, mix in zip(self.convolutions, self.mixing, strict=True):
            hidden = hidden + mix(self.dropout(silu(convolution(hidden.transpose(1, 2)).transpose(1, 2))))
        found = self.outward(silu(hidden))
        turn, odds, log_scale = found.split((3 * JOINTS, JOINTS, JOINTS), dim=-1)
        return turn.unflatten(-1, (JOINTS, 3)), odds, log_scale


def joined_rotation(batch: dict[str, Tensor], turn: Tensor, odds: Tensor) -> Tensor:
    """Return joined local rotations (B, T, 22, 4), in which tracked rotations are not yet restored."""
    share = batch["share"].clamp(1e-3, 1 - 1e-3)[..., None]
    share = torch.sigmoid(torch.logit(share) + odds)[..., None]
    past, future = batch["past"], batch["future"]
    sign = torch.where((past * future).sum(dim=-1, keepdim=True) < 0, -1.0, 1.0)
    mean = nn.functional.normalize((1 - share) * past + share * sign * future, dim=-1)
    return quaternion_multiply(mean, quaternion_exp(turn))


def head_relative_kinematics(
    rotation: Tensor, rest_offset: Tensor, world: Tensor | None = None, turned: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Return positions (..., 22, 3) m relative to the head, and local rotations (..., 22, 4).

    Args:
        rotation: (..., 22, 4) wxyz, local rotations.
        rest_offset: (..., 22, 3) m.
        world: (..., 22, 4) wxyz, world rotations of joints with a true `turned`.
        turned: (..., 22) bool: joints whose world rotation is given.
    """
    places, turns, local = list[Tensor](), list[Tensor](), list[Tensor]()
    for joint, parent in enumerate(_PARENTS):
        own = rotation[..., joint, :]
        whole = own if parent < 0 else quaternion_multiply(turns[parent], own)
        if world is not None and turned is not None:
            whole = torch.where(turned[..., joint, None], world[..., joint, :], whole)
        turns.append(whole)
        local.append(whole if parent < 0 else quaternion_multiply(quaternion_conjugate(turns[parent]), whole))
        bone = rest_offset[..., joint, :]
        zero = torch.zeros_like(whole[..., :3])
        places.append(zero if parent < 0 else places[parent] + quaternion_rotate(turns[parent], bone))
    position = torch.stack(places, dim=-2)
    return position - position[..., _HEAD : _HEAD + 1, :], torch.stack(local, dim=-2)


@dataclass(eq=False)
class JoiningTask(Task):
    """Training task of the joining network."""

    network: JoiningModule
    configuration: JoiningTaskConfig
    schedule: Schedule
    training_takes: Sequence[JoinedTake]
    validation_takes: Sequence[JoinedTake]
    source: Any = None

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[dict[str, Tensor]]:
        """Yield batches of random parts of takes; longer takes are drawn more often."""
        size = self.configuration.frames
        weight = np.array([min(len(take), 3 * size) for take in self.training_takes], dtype=float)
        weight /= weight.sum()
        while True:
            pieces = []
            for place in rng.choice(len(self.training_takes), self.configuration.takes, p=weight):
                take = self.training_takes[place]
                pieces.append((take, int(rng.integers(0, max(1, len(take) - size + 1)))))
            yield _batch(pieces, size)

    def loss(self, batch: dict[str, Tensor], memory: Any) -> tuple[dict[str, Tensor], Any]:
        """Return the weighted terms and their sum, 'loss'. There is no memory."""
        del memory
        error = _errors(self.network, batch)
        weights = asdict(self.configuration.losses)
        terms = {name: weight * error[name] for name, weight in weights.items()}
        return {"loss": torch.stack(list(terms.values())).sum(), **terms}, None

    @torch.no_grad()
    def validate(self, network: JoiningModule) -> dict[str, float]:
        """Return the score, errors in cm and degrees, and jumps per minute, of validation takes."""
        sums, frames = dict[str, float](), 0
        for take in self.validation_takes:
            error = _errors(network, _batch([(take, 0)], len(take)))
            frames += len(take)
            for name, value in error.items():
                sums[name] = sums.get(name, 0.0) + float(value) * len(take)
        mean = {name: value / frames for name, value in sums.items()}
        weights = asdict(self.configuration.losses) | {"certainty": 0.0}  # the score has errors, not expected errors
        score = sum(weight * mean[name] for name, weight in weights.items())
        return {
            "score": 100 * score,
            "error_cm": 100 * mean["position"],
            "rotation_deg": float(np.degrees(mean["rotation"])),
            "jumps_per_minute": mean["jumps"] * RATE * 60,
        }


def _batch(pieces: list[tuple[JoinedTake, int]], frames: int) -> dict[str, Tensor]:
    batch = cut_frames(pieces, frames, _ARRAYS)
    batch = {name: values.float() if values.dtype == torch.float16 else values for name, values in batch.items()}
    offset = np.stack([take.rest_offset for take, _ in pieces])
    return batch | {"rest_offset": torch.from_numpy(offset)[:, None]}


@dataclass(frozen=True, eq=False)
class _JoinedBodies:
    """Joined bodies of a batch; positions are relative to the head."""

    position: Tensor  # (B, T, 22, 3) m
    local: Tensor  # (B, T, 22, 4)
    truth: Tensor  # (B, T, 22, 3) m
    expected: Tensor  # (B, T, 22) logarithm of expected errors, m


def _joined_bodies(network: JoiningModule, batch: dict[str, Tensor]) -> _JoinedBodies:
    turn, odds, log_scale = network(batch["features"])
    rotation = joined_rotation(batch, turn, odds)
    position, local = head_relative_kinematics(rotation, batch["rest_offset"], batch["world"], batch["turned"])
    with torch.no_grad():
        truth, _ = head_relative_kinematics(batch["truth"], batch["rest_offset"])
    return _JoinedBodies(position, local, truth, batch["expected"] + log_scale)


def _errors(network: JoiningModule, batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the terms of the loss without weights, and the share of frames in which a joint jumps."""
    bodies = _joined_bodies(network, batch)
    valid, hidden = batch["valid"].float(), batch["hidden"].float() * batch["valid"][..., None]
    count, moving = valid.sum(), valid[:, 1:]
    step, true_step = (
        (place + head[..., None, :]).diff(dim=1)
        for place, head in ((bodies.position, batch["head"]), (bodies.truth, batch["true_head"]))
    )
    faster, error = length(step) - length(true_step), length(bodies.position - bodies.truth)
    surprise = error.detach() * torch.exp(-bodies.expected) + bodies.expected
    return {
        "position": (error.mean(dim=-1) * valid).sum() / count,
        "rotation": (geodesic_angle(bodies.local, batch["truth"]).mean(dim=-1) * valid).sum() / count,
        "velocity": RATE * (length(step - true_step).mean(dim=-1) * moving).sum() / count,
        "haste": RATE * ((faster - SLACK / RATE).clamp_min(0).sum(dim=-1) * moving).sum() / count / JOINTS,
        "certainty": (surprise * hidden).sum() / hidden.sum().clamp_min(1.0),
        "jumps": ((faster.max(dim=-1).values > JUMP / 100) * moving).sum() / count,
    }


@torch.no_grad()
def calibrate_errors(network: JoiningModule, takes: Sequence[JoinedTake]) -> None:
    """Set the network's offsets so that expected errors equal mean errors on takes, and bounds cover 90 %.

    Left and right joints have the same offsets.
    """
    parts = [(_joined_bodies(network, _batch([(take, 0)], len(take))), take) for take in takes]
    error = torch.cat([length(bodies.position - bodies.truth)[0] for bodies, _ in parts]).numpy()
    logarithm = torch.cat([bodies.expected[0] for bodies, _ in parts]).numpy()
    hidden = np.concatenate([take.hidden for _, take in parts])
    spread = np.concatenate([take.spread for _, take in parts]).astype(float)
    for joint, other in enumerate(partners(BODY)):
        both = [joint, other]
        where = hidden[:, both]
        if not where.any():
            continue
        true, guess = error[:, both][where], np.exp(logarithm[:, both][where])
        scale = true.mean() / guess.mean()
        bound = np.quantile(true / (scale * guess * np.exp(spread[:, both][where])), QUANTILE)
        network.error_offset[joint], network.bound_offset[joint] = float(np.log(scale)), float(np.log(bound))


def train_joining(options: JoiningTraining, fabric: Fabric) -> JoiningModule:
    """Train or resume, and return the network with the best weights on validation takes."""
    set_seed_and_threads(options.schedule.seed, options.threads)
    with fabric.rank_zero_first():  # other processes find the takes in the folder of the run
        training_takes = _takes(options, "train", options.frames, options.schedule.seed)
        validation_takes = _takes(options, "val", min(options.frames, _VALIDATION_FRAMES), _VALIDATION_SEED)
    config = JoiningTaskConfig(JoiningConfig(training_takes[0].features.shape[1]))
    network = JoiningModule(config.network)
    source = options.trial_settings | {"frames": options.frames}
    fit(
        JoiningTask(network, config, options.schedule, training_takes, validation_takes, source),
        options.checkpoint,
        fabric=fabric,
    )
    network = network.cpu()
    calibrate_errors(network, validation_takes)
    return network


def _takes(options: JoiningTraining, split: Split, frames: int, seed: int) -> list[JoinedTake]:
    def draw() -> Iterator[JoinedTake]:
        clips = list(read_clips(options.data, split, options.limit))
        with log_progress(f"completing takes of the {split} split, frames", frames) as advance:
            for take in draw_takes(clips, split, np.random.default_rng(seed)):
                advance(len(take))
                yield take

    source = f"{FORMAT}, {options.data.resolve()}, limit {options.limit}, seed {seed}"
    return cached_takes(options.folder / split, draw, frames, source)


def write_joining(network: JoiningModule, path: Path, card: dict[str, Any]) -> None:
    """Write the network's file in half precision. `card` has further fields of the metadata."""
    weights = sum(values.numel() for values in network.parameters())
    card = {"network": asdict(network.config), "weights": weights, "rate": RATE} | card
    tensors = {name: values.detach().numpy().astype(np.float16) for name, values in network.state_dict().items()}
    with written_beside(path) as beside:
        texts = {name: json.dumps(value) for name, value in card.items()}
        beside.write_bytes(safetensors_bytes(tensors, {"format": FORMAT, **texts}))
