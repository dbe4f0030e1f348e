"""From trained weights to the packaged file: errors made true on validation people, then one .onnx with its card."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.completion.model import load_completion
from bodysense.data.clip import Clip
from bodysense.data.clips import open_clips
from bodysense.lab.completion.error_map import ErrorMap, unchanged_errors
from bodysense.lab.completion.export import write_completion
from bodysense.lab.completion.fingers import FingerNetwork
from bodysense.lab.completion.graph import CompletionStep
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.scenes import Scene, Truth, batches, scene_of
from bodysense.lab.completion.task import WORN
from bodysense.lab.completion.uncertainty import QUANTILE, fit_error_map, sample_errors

_LONGEST = 20.0  # s of each validation clip: enough to judge errors by


def publish(body: CompletionNetwork, fingers: FingerNetwork, data: Path, out: Path, card: dict[str, Any]) -> None:
    """Write the whole step with true errors; `card` says what it was trained on, and its licence."""
    beside = out.with_name(f"{out.stem}.uncalibrated.onnx")
    try:
        _write(body, fingers, unchanged_errors(), unchanged_errors(), beside, {})
        samples = sample_errors(_validation_scenes(data), load_completion(beside))
    finally:
        beside.unlink(missing_ok=True)
    mean, bound = fit_error_map(samples), fit_error_map(samples, QUANTILE)
    _write(body, fingers, mean, bound, out, card)


def _write(
    body: CompletionNetwork,
    fingers: FingerNetwork,
    mean: ErrorMap,
    bound: ErrorMap,
    out: Path,
    card: dict[str, Any],
) -> None:
    configured = {"network": asdict(body.config), "fingers": asdict(fingers.config)}
    write_completion(CompletionStep(body, fingers, mean, bound), out, {**configured, **card})


def _validation_scenes(data: Path) -> dict[Truth, list[list[Scene]]]:
    """Batches of scenes of what wearers do, on their own bodies and on strangers'."""
    clips = [_beginning(clip) for clip in open_clips(data, "val") if clip.category in WORN]
    truths: tuple[Truth, ...] = ("own", "stranger")
    return {truth: [[scene_of(clip, truth, "val") for clip in batch] for batch in batches(clips)] for truth in truths}


def _beginning(clip: Clip) -> Clip:
    return replace(clip, pose=clip.pose[: int(np.ceil(_LONGEST * clip.frame_rate))])
