"""The networks of UNOC's Tables 2 to 4: the paper's own, its rivals and its ablations, each as a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from bodysense_lab.papers.unoc.network.network import PAPER, BodyNetworkConfig


@dataclass(frozen=True)
class Variant:
    """One network of a table."""

    title: str
    config: BodyNetworkConfig = PAPER
    loss: Mapping[str, float] = field(default_factory=dict)  # weights that differ from the paper's, by name


VARIANTS: dict[str, Variant] = {
    "gru": Variant("GRU"),
    "rnn": Variant("RNN", replace(PAPER, cell="rnn")),
    "lstm": Variant("LSTM", replace(PAPER, cell="lstm")),
    "tcn": Variant("TCN", replace(PAPER, cell="tcn")),
    "head_local": Variant("head-local fingers", replace(PAPER, finger_origin="head")),
    "no_skip": Variant("without skip connections", replace(PAPER, skip=False)),
    "window_9": Variant("9 frames", replace(PAPER, window=9)),
    "window_81": Variant("81 frames", replace(PAPER, window=81)),
    "hidden_1024": Variant("hidden 1024", replace(PAPER, hidden=1024)),
    "no_occlusion": Variant("w/o occlusion prediction", replace(PAPER, judges=())),
    "no_parent": Variant("w/o parent local", loss={"parent": 0.0}),
    "no_bone": Variant("w/o bone length", loss={"body_bone": 0.0, "finger_bone": 0.0}),
    "no_parent_no_bone": Variant(
        "w/o parent local and bone length", loss={"parent": 0.0, "body_bone": 0.0, "finger_bone": 0.0}
    ),
    "mask_given": Variant("mask given", replace(PAPER, inputs="positions_and_mask", judges=())),
}


TABLES: dict[str, tuple[str, ...]] = {
    "2": ("gru", "rnn", "lstm", "tcn"),
    "3": ("gru", "head_local", "no_skip", "window_9", "window_81", "hidden_1024"),
    "4": ("gru", "no_occlusion", "no_parent", "no_bone", "no_parent_no_bone"),
    "smoothness": ("gru", "mask_given"),
}
