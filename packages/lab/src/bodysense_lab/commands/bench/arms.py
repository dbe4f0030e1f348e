"""`bodysense bench arms`: the network of arms and hands (PAHMT)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.ranges import Count
from bodysense_lab.commands.bench.timing import percentiles, report
from bodysense_lab.core.options import Json


def arms(frames: Count = 2000, model: Path | None = None, json: Json = None) -> None:
    """Time the network of arms and hands on a window of 32 frames, and the estimator frame by frame.

    Args:
        frames: number of windows and of frames, after 100 to warm up.
        model: network written by `bodysense train arms`; the packaged one if omitted.
    """
    from bodysense.demo import packaged_performance
    from bodysense.devices.video.arms import Arms, ArmSettings, load_arms
    from bodysense_lab.papers.pahmt.system import seen_from_front

    clip, network = packaged_performance(), load_arms(model)
    keypoints = seen_from_front(clip)
    count = int(network.card["frames"])
    window = {name: np.nan_to_num(value[:count]) for name, value in vars(keypoints).items() if name != "time"}
    window = {name: value if value.dtype == bool else value.astype(np.float32) for name, value in window.items()}

    def whole(_: int) -> None:
        network.rotations(window)

    numbers = percentiles(whole, frames)
    for name, settings in (("frame", ArmSettings()), ("live_frame", ArmSettings(look_ahead=0.0))):
        estimator = Arms(clip.pose.skeleton, network, settings)
        state = estimator.start()

        def one(frame: int, estimator: Arms = estimator) -> None:
            nonlocal state
            place = frame % len(clip)
            state = estimator.step(keypoints[place : place + 1], estimator.start() if place == 0 else state)[1]

        numbers |= {f"{name}_{key}": value for key, value in percentiles(one, frames).items()}
    report("arms", numbers, json)
