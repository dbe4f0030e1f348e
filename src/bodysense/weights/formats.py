"""Kinds of network files: a training writes them, and the run time opens them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NetworkFormat:
    """The required kind of a network file."""

    name: str  # value of `format` in its card
    kind: str  # name of such networks in messages
    command: str  # command that writes such files
    fields: tuple[str, ...] = ()  # other required entries of its card
    packaged: str | None = None  # file in `bodysense/weights` that is opened by default


ARMS = NetworkFormat(
    name="bodysense arms 1",
    kind="network of arms",
    command="bodysense train arms",
    fields=("joints", "frames", "rate", "validation"),
    packaged="arms.onnx",
)
