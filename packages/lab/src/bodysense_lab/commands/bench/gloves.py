"""`bodysense bench gloves`: gloves on synthesised hands, some of whose markers are hidden."""

from __future__ import annotations

from bodysense.ranges import Count
from bodysense_lab.commands.bench.timing import frame_stepper, percentiles, report, resident_memory
from bodysense_lab.options import Json


def gloves(frames: Count = 3000, json: Json = None) -> None:
    """Time gloves with one hidden marker a hand, a frame at a time, everything included: one hand, then two.

    Which marker is hidden changes every half second. `all` is with none hidden. The step that moves hands and fingers
    out of each other is timed in `contact` alone.

    Args:
        frames: Frames to time of each, after 100 to warm up.
    """
    from bodysense.devices.gloves.hands import Hands, HandsSettings, load_glove_models
    from bodysense_lab.synthesis.glove_stream import glove_stream

    numbers, models = {}, load_glove_models()
    for name, hands in (("one_hand", ("left",)), ("two_hands", ("left", "right"))):
        skeletons, hidden = glove_stream(hands, frames=600, hidden=1)
        _, whole = glove_stream(hands, frames=600, hidden=0)
        for label, observation, settings in (
            ("", hidden, HandsSettings(contact=None)),
            ("_all", whole, HandsSettings(contact=None)),
            ("_contact", hidden, HandsSettings()),
        ):
            taken = percentiles(frame_stepper(Hands(skeletons, models, settings), observation), frames)
            numbers |= {f"{name}{label}_{key}": value for key, value in taken.items()}
    report("gloves", numbers | {"rss_mb": resident_memory()}, json)
