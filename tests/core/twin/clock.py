"""The clock: intervals between frames, and where motion starts anew."""

from math import isnan

from bodysense.tracking.tracker import TrackerSettings


def interval_of(settings: TrackerSettings, time: float, before: float) -> tuple[float, bool]:
    """Return seconds since the frame `before` (NaN without one), and whether the motion restarts at `time`."""
    past = time - before
    if isnan(past) or past > settings.longest_gap:
        return settings.first_interval, True
    return min(past, settings.longest_interval), False
