"""From trained weights to the packaged file: expected errors made true, then one .onnx with its card."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.completion.model import load_completion
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.lab.clips import open_clips
from bodysense.lab.completion.error_map import ErrorMap, unchanged_errors
from bodysense.lab.completion.export import write_completion
from bodysense.lab.completion.fingers import FingerNetwork
from bodysense.lab.completion.graph import CompletionStep
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.scenes import TrackedScene, Truth, batches, scene_of
from bodysense.lab.completion.task import WORN
from bodysense.lab.completion.uncertainty import QUANTILE, fit_error_map, sample_errors

_LONGEST, _CLIPS = 9.0, 2  # s of a clip, and clips of a person who was learned from, that errors are judged by


def publish(body: CompletionNetwork, fingers: FingerNetwork, data: Path, out: Path, card: dict[str, Any]) -> None:
    """Write the whole step with true errors; `card` says what it was trained on, and its licence."""
    beside = out.with_name(f"{out.stem}.uncalibrated.onnx")
    try:
        _write(body, fingers, unchanged_errors(), unchanged_errors(), beside, {})
        samples = sample_errors(_judged_scenes(data), load_completion(beside))
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


def _judged_scenes(data: Path) -> dict[Truth, list[list[TrackedScene]]]:
    """Batches of scenes of what wearers do, on their own bodies and on strangers'.

    Of people that were watched all clips, and of people that were learned from a few each: the former are few, and how
    far errors spread shows in many people only.
    """
    truths: tuple[Truth, ...] = ("own", "stranger")
    splits: tuple[Split, ...] = ("train", "val")
    scenes: dict[Truth, list[list[TrackedScene]]] = {truth: [] for truth in truths}
    for split in splits:
        clips = [_piece(clip) for clip in open_clips(data, split) if clip.category in WORN]
        if split == "train":
            clips = _few_of_each_person(clips)
        for batch in batches(clips):
            for truth in truths:
                scenes[truth].append([scene_of(clip, truth, split) for clip in batch])
    return scenes


def _piece(clip: Clip) -> Clip:
    """The middle of a clip."""
    frames = int(np.ceil(_LONGEST * clip.frame_rate))
    first = max(0, (len(clip) - frames) // 2)
    return replace(clip, pose=clip.pose[first : first + frames])


def _few_of_each_person(clips: list[Clip]) -> list[Clip]:
    by_person: dict[str, list[Clip]] = {}
    for clip in clips:
        by_person.setdefault(clip.person, []).append(clip)
    return [clip for own in by_person.values() for clip in own[:: max(1, len(own) // _CLIPS)][:_CLIPS]]
