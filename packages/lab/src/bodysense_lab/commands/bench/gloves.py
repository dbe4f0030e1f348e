"""`bodysense bench gloves`: gloves on synthesised hands with hidden markers."""

from __future__ import annotations

from bodysense.ranges import Count
from bodysense_lab.commands.bench.timing import frame_stepper, percentiles, report, resident_memory
from bodysense_lab.core.options import Json


def gloves(frames: Count = 3000, json: Json = None) -> None:
    """Time the whole step of gloves frame by frame, with one hidden marker on each hand: one hand, then two.

    Another marker is hidden every half second. `all` is without hidden markers.

    Args:
        frames: number of frames of each, after 100 to warm up.
    """
    from bodysense.devices.gloves.hands import Hands, load_glove_models
    from bodysense_lab.synthesis.glove_stream import glove_stream

    numbers, models = {}, load_glove_models()
    for name, hands in (("one_hand", ("left",)), ("two_hands", ("left", "right"))):
        skeletons, hidden = glove_stream(hands, frames=600, hidden=1)
        _, whole = glove_stream(hands, frames=600, hidden=0)
        for label, observation in (("", hidden), ("_all", whole)):
            taken = percentiles(frame_stepper(Hands(skeletons, models), observation), frames)
            numbers |= {f"{name}{label}_{key}": value for key, value in taken.items()}
    report("gloves", numbers | {"rss_mb": resident_memory()}, json)
