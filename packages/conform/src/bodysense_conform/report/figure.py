"""Stick figures of a subject as SVG."""

from __future__ import annotations

import numpy as np

from bodysense_conform.subject import Subject, is_finger

_HIGH, _WIDE, _FLOOR = 2.05, 1.5, 0.12  # m of a picture, and of it below the floor
_TURN = 0.5  # rad from the front, to the body's left


def stick_figure(subject: Subject, frame: int, marked: str = "", size: int = 132) -> str:
    """Return a frame as SVG; bones of joints that `marked` names are drawn in the accent colour."""
    place = subject.places[frame]
    known = [k for k, name in enumerate(subject.points) if np.isfinite(place[k]).all()]
    if not known:
        return f'<svg class="figure" viewBox="0 0 {_WIDE} {_HIGH}" height="{size}"></svg>'
    turn = _TURN
    if subject.has("left_hip", "right_hip"):
        hips = subject.line("right_hip", "left_hip")[frame]
        turn += float(np.arctan2(-hips[2], hips[0])) if np.isfinite(hips).all() else 0.0  # their heading
    low = subject.ground if np.isfinite(subject.ground) else np.median(place[known, 1]) - 0.9
    across = place[:, 0] * np.cos(turn) - place[:, 2] * np.sin(turn)
    x = _WIDE / 2 + across - np.median(across[known])
    y = _HIGH - _FLOOR - (place[:, 1] - low)
    drawn = {subject.points[k]: (x[k], y[k]) for k in known}
    lines = [_line("floor", (0.1, _HIGH - _FLOOR), (_WIDE - 0.1, _HIGH - _FLOOR))]
    for parent, child in subject.bones:
        if parent in drawn and child in drawn:
            kind = "finger" if is_finger(child) else "bone"
            kind += " left" if child.startswith("left") else ""
            kind += " marked" if marked and (child in marked or parent in marked) else ""
            lines.append(_line(kind, drawn[parent], drawn[child]))
    if "head" in drawn:
        cx, cy = np.mean([drawn["head"], drawn.get("head_top", drawn["head"])], axis=0)
        lines.append(f'<circle class="head" cx="{cx:.3f}" cy="{cy:.3f}" r="0.1"/>')
    return (
        f'<svg class="figure" viewBox="0 0 {_WIDE} {_HIGH}" height="{size}" role="img" '
        f'aria-label="frame {frame}">{"".join(lines)}</svg>'
    )


def _line(kind: str, start: tuple[float, float], end: tuple[float, float]) -> str:
    return f'<line class="{kind}" x1="{start[0]:.3f}" y1="{start[1]:.3f}" x2="{end[0]:.3f}" y2="{end[1]:.3f}"/>'
