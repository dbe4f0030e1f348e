"""Kinds of network files of the papers' own methods."""

from __future__ import annotations

from typing import Literal

from bodysense.weights.formats import NetworkFormat

PointNetworkTask = Literal["fingers", "upper-body"]
BODY = NetworkFormat(
    name="bodysense body 1",
    kind="body network",
    command="bodysense train body-gru",
    fields=("points", "rate", "fastest_rate", "state"),
)
BODY_VAE = NetworkFormat(
    name="bodysense body vae 1",
    kind="body VAE",
    command="bodysense train hmd-vae",
    fields=("reads", "frames", "latent", "rate", "expected_error"),
    packaged="body_vae.onnx",
)
_PACKAGED: dict[PointNetworkTask, str | None] = {"fingers": "fingers.onnx", "upper-body": None}
POINTS = {
    task: NetworkFormat(
        name="bodysense points 1",
        kind="network of points",
        command=f"bodysense train {task}",
        fields=("task", "reads", "places", "rate", "state"),
        packaged=name,
    )
    for task, name in _PACKAGED.items()
}
