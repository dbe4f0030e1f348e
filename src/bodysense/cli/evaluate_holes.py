"""`bodysense evaluate holes`: limbs taken away from motion, and filled."""

from __future__ import annotations

from itertools import islice

from bodysense.cli.reporting import Common, Flat, checked, finish, progress_over


def holes(data: str, common: Flat = Common(), clips: int | None = None) -> None:
    """Score filled holes beside interpolation: an arm, a leg, a hand missing for 1 to 3 seconds.

    Args:
        data: folder of motion files or a prepared store; NAME=FOLDER names it.
        clips: so many clips, evenly spread; all if omitted.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.holes import report_of, score_holes

    checked(common)
    source = named_data(data, common.split)
    wanted = 6 if common.quick else clips
    stride = 1 if wanted is None else max(1, source.count() // wanted)
    with progress_over([source]) as advance:
        gaps = score_holes(islice(source.clips(), 0, None, stride), advance=advance)
    finish(report_of(gaps, source.name), common)
