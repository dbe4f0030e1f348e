"""Stick figures as SVG, for reports."""

from __future__ import annotations

import numpy as np

from bodysense.conform.subject import Subject, is_finger

_HIGH = 2.05  # m that a picture shows, from a little under the floor
_WIDE = 1.5
_TURN = 0.5  # rad from the front, to the body's left


def stick_figure(subject: Subject, frame: int, marked: str = "", size: int = 132) -> str:
    """A frame as SVG; bones that end in a point that `marked` names are drawn in the accent colour."""
    place = subject.places[frame]
    body = [k for k, name in enumerate(subject.points) if np.isfinite(place[k]).all()]
    if not body:
        return f'<svg class="figure" viewBox="0 0 {_WIDE} {_HIGH}" height="{size}"></svg>'
    heading = _heading(subject, frame)
    middle = np.median(place[body], axis=0)
    turn = heading + _TURN
    drawn = {
        subject.points[k]: (
            _WIDE / 2 + (place[k, 0] - middle[0]) * np.cos(turn) - (place[k, 2] - middle[2]) * np.sin(turn),
            _HIGH - 0.12 - (place[k, 1] - (subject.ground if np.isfinite(subject.ground) else middle[1] - 0.9)),
        )
        for k in body
    }
    lines = []
    for parent, child in subject.bones:
        if parent in drawn and child in drawn:
            (x1, y1), (x2, y2) = drawn[parent], drawn[child]
            kind = "finger" if is_finger(child) else "bone"
            kind += " left" if child.startswith("left") else ""
            kind += " marked" if marked and (child in marked or parent in marked) else ""
            lines.append(f'<line class="{kind}" x1="{x1:.3f}" y1="{y1:.3f}" x2="{x2:.3f}" y2="{y2:.3f}"/>')
    if "head" in drawn:
        x, y = drawn.get("head_top", drawn["head"])
        x, y = (x + drawn["head"][0]) / 2, (y + drawn["head"][1]) / 2
        lines.append(f'<circle class="head" cx="{x:.3f}" cy="{y:.3f}" r="0.1"/>')
    floor = f'<line class="floor" x1="0.1" y1="{_HIGH - 0.12}" x2="{_WIDE - 0.1}" y2="{_HIGH - 0.12}"/>'
    return (
        f'<svg class="figure" viewBox="0 0 {_WIDE} {_HIGH}" height="{size}" role="img" '
        f'aria-label="frame {frame}">{floor}{"".join(lines)}</svg>'
    )


def strip(subject: Subject, count: int = 12) -> list[tuple[int, str]]:
    """Frames spread over the take, with their pictures."""
    frames = np.unique(np.linspace(0, len(subject) - 1, count).astype(int))
    return [(int(frame), stick_figure(subject, int(frame), size=120)) for frame in frames]


def _heading(subject: Subject, frame: int) -> float:
    """Heading of the hips, radians about +Y; 0 where they do not come."""
    if not subject.has("left_hip", "right_hip"):
        return 0.0
    across = subject.at("left_hip")[frame] - subject.at("right_hip")[frame]
    return float(np.arctan2(-across[2], across[0])) if np.isfinite(across).all() else 0.0
