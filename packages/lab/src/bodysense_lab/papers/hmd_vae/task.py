"""Training of HMD-VAE: batches of windows from flat arrays, the loop, its checkpoint (reproduce.md, part 2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bodysense.body.skeleton import BODY
from bodysense_lab.core.fit import Task
from bodysense_lab.data.windows import Windows
from bodysense_lab.papers.hmd_vae.body_windows import Joints, VaeBatch, make_batch, mirrored
from bodysense_lab.papers.hmd_vae.frames import BodyFrames
from bodysense_lab.papers.hmd_vae.network import BodyVae
from bodysense_lab.papers.hmd_vae.options import VaeSchedule

_VALIDATED = 2048  # windows that are enough to see how a run goes


@dataclass(frozen=True, eq=False)
class VaeTask(Task):
    """Training of HMD-VAE on windows of motion, each seen once an epoch."""

    network: BodyVae
    schedule: VaeSchedule
    frames: BodyFrames
    windows: Windows
    validation: tuple[BodyFrames, Windows]
    source: Mapping[str, Any] | None = None
    keeps_best = False
    clip = 50.0

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[VaeBatch]:
        """Windows without end, in another order every epoch."""
        while True:
            order = rng.permutation(len(self.windows))
            for first in range(0, max(1, len(order) - self.schedule.batch + 1), self.schedule.batch):
                which = order[first : first + self.schedule.batch]
                batch = make_batch(self.network.config, self.frames, self.windows, which)
                turned = torch.from_numpy(rng.random(len(which)) < 0.5)
                yield mirrored(self.network.config, batch, turned) if self.schedule.mirrored else batch

    def loss(self, batch: VaeBatch, memory: None) -> tuple[dict[str, Tensor], None]:
        """The negative evidence lower bound."""
        return self.network.negative_elbo(batch.seen, batch.truth, batch.rest_offset, None), None

    def validate(self, network: BodyVae) -> dict[str, float]:
        """Mean error of positions from the head, cm."""
        return {"position_cm": 100 * float(joint_errors(network, *self.validation).mean())}


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
