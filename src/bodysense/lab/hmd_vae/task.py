"""Training of HMD-VAE: batches of windows from flat arrays, the loop, its checkpoint (papers.md, part 2)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from bodysense.body.skeleton import BODY
from bodysense.lab.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense.lab.hmd_vae.frames import BodyFrames
from bodysense.lab.hmd_vae.network import BodyVae
from bodysense.lab.hmd_vae.windows import Joints, VaeBatch, make_batch, mirrored
from bodysense.lab.unoc.training import Progress
from bodysense.lab.windows import Windows

_VALIDATED = 2048  # windows that are enough to see how a run goes


@dataclass(frozen=True)
class VaeSchedule:
    """How long and on what. The paper does not print its own."""

    steps: int = 6000
    batch: int = 256  # windows
    learning_rate: float = 3e-3  # the highest of one cycle
    weight_decay: float = 0.01
    average_decay: float = 0.995  # the kept weights are a moving average; 0 keeps the last ones
    mirrored: bool = True  # half of the windows in the mirror, which the paper does not do
    check_every: int = 500  # steps between checkpoints
    seed: int = 1


def batches(
    network: BodyVae, schedule: VaeSchedule, frames: BodyFrames, windows: Windows, done: int, rank: int = 0
) -> Iterator[VaeBatch]:
    """The run's batches from step `done` on; a resumed run draws anew from there, and every process for itself."""
    rng = np.random.default_rng([schedule.seed, done, rank])
    while True:
        order = rng.permutation(len(windows))
        for first in range(0, max(1, len(order) - schedule.batch + 1), schedule.batch):
            which = order[first : first + schedule.batch]
            batch = make_batch(network.config, frames, windows, which)
            turned = torch.from_numpy(rng.random(len(which)) < 0.5)
            yield mirrored(network.config, batch, turned) if schedule.mirrored else batch


def train_vae(
    network: BodyVae,
    schedule: VaeSchedule,
    frames: BodyFrames,
    windows: Windows,
    validation: tuple[BodyFrames, Windows],
    checkpoint: Path,
    report: Callable[[Progress], None],
    fabric: Fabric,
    source: Mapping[str, Any] | None = None,
) -> BodyVae:
    """Train and return the network with averaged weights, evaluating.

    Continues from `checkpoint` where that file exists; raises BodysenseError when it belongs to another configuration
    or `source` (`identity`).
    """
    optimizer = torch.optim.AdamW(
        [parameter for parameter in network.parameters() if parameter.requires_grad],
        lr=schedule.learning_rate,
        weight_decay=schedule.weight_decay,
    )
    average = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(schedule.average_decay))
    kept = average.module
    assert isinstance(kept, BodyVae)
    noise = torch.Generator().manual_seed(schedule.seed)
    learner, optimizer = fabric.setup(network, optimizer)
    learner.mark_forward_method("negative_elbo")
    average.to(fabric.device)
    run = identity(network.config, schedule, source)
    done, _ = load_checkpoint(checkpoint, run, network, optimizer, average)
    begun, recent = time.monotonic(), []
    steps = range(done + 1, schedule.steps + 1)
    made = batches(network, schedule, frames, windows, done, fabric.global_rank)
    for step, batch in zip(steps, made, strict=False):
        for group in optimizer.param_groups:
            group["lr"] = one_cycle(schedule, step)
        seen, truth, offset = fabric.to_device((batch.seen, batch.truth, batch.rest_offset))
        terms: dict[str, Tensor] = learner.negative_elbo(seen, truth, offset, noise)
        optimizer.zero_grad()
        fabric.backward(terms["loss"])
        torch.nn.utils.clip_grad_norm_(network.parameters(), 50.0)
        optimizer.step()
        average.update_parameters(network)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.check_every == 0 or step == schedule.steps:
            mean = {name: float(np.mean([row[name] for row in recent])) for name in recent[0]}
            recent = []
            scores = {"position_cm": 100 * float(joint_errors(kept, *validation).mean())}
            if fabric.is_global_zero:
                save_checkpoint(checkpoint, run, step, network, optimizer, average)
                report(Progress(step, schedule.steps, time.monotonic() - begun, mean, scores))
    network.load_state_dict(kept.state_dict())
    return network.eval()


def one_cycle(schedule: VaeSchedule, step: int) -> float:
    """Up in the first tenth, then a cosine down to a thousandth (Smith & Topin 2019)."""
    along = step / schedule.steps
    if along < 0.1:
        return schedule.learning_rate * along / 0.1
    return schedule.learning_rate * (0.001 + 0.999 * 0.5 * (1 + math.cos(math.pi * (along - 0.1) / 0.9)))


@torch.no_grad()
def joint_errors(network: BodyVae, frames: BodyFrames, windows: Windows) -> Tensor:
    """Mean error (22,), m, of positions from the head in the last frame of some windows, at the posterior's mean."""
    training = network.training
    network.eval()
    which = np.linspace(0, len(windows) - 1, min(_VALIDATED, len(windows))).astype(np.int64)
    batch = make_batch(network.config, frames, windows, which)
    seen, truth = (Joints(*(values.to(network.stature.device) for values in one)) for one in (batch.seen, batch.truth))
    offset = batch.rest_offset.to(network.stature.device)
    body = network.decode(network.posterior(seen, offset)[0], offset)
    head = BODY.index("head")
    missed = (body.position - body.position[:, head, None]) - (truth.position - truth.position[:, head, None])
    network.train(training)
    return missed.norm(dim=-1).mean(dim=0).cpu()
