"""Options that several commands share."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bodysense.tracker import TrackerSettings


def tracker_settings(half_life: float | None) -> TrackerSettings:
    """The tracker's settings with another half-life, seconds; None keeps the tracker's own."""
    from bodysense.tracker import TrackerSettings

    return TrackerSettings() if half_life is None else TrackerSettings(half_life=half_life)
