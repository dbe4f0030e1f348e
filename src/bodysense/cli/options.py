"""Options that several commands share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import tyro

from bodysense.rigs.options import ReadingOptions

Reading = Annotated[ReadingOptions, tyro.conf.arg(name="")]  # of a motion file: --unit, --up, --floor …

if TYPE_CHECKING:
    from bodysense.lab.unoc.ik_tracker import IkTrackerSettings


def tracker_settings(half_life: float | None) -> IkTrackerSettings:
    """The tracker's settings with another half-life, seconds; None keeps the tracker's own."""
    from bodysense.lab.unoc.ik_tracker import IkTrackerSettings

    return IkTrackerSettings() if half_life is None else IkTrackerSettings(half_life=half_life)
