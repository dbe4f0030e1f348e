"""Timelines (PNG): when which joint of a take has a defect."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bodysense.files import written_beside
from bodysense.quality.defects import KINDS, Defect

_COLORS = dict(zip(KINDS, ("#c0392b", "#e67e22", "#2980b9", "#8e44ad", "#d4ac0d", "#16a085", "#7f6a4f"), strict=True))
_LABEL, _WIDTH, _ROW, _MARGIN = 130, 900, 18, 26  # pixels
_LEAST = 3  # pixels of the shortest defect
_GRID, _TEXT = "#dddddd", "#333333"
_TICKS = 6


def draw_timeline(path: str | Path, defects: Sequence[Defect], frames: int) -> None:
    """Write a PNG with a row for each joint that has defects, and a bar for each of these along the frames."""
    from PIL import Image, ImageDraw

    joints = list(dict.fromkeys(defect.joint for defect in sorted(defects, key=lambda one: one.joint))) or [
        "no defects"
    ]
    height = 2 * _MARGIN + _ROW * len(joints)
    picture = Image.new("RGB", (_LABEL + _WIDTH + _MARGIN, height), "white")
    pen, scale = ImageDraw.Draw(picture), _WIDTH / max(frames, 1)
    for tick in range(_TICKS + 1):
        x = _LABEL + _WIDTH * tick / _TICKS
        pen.line([(x, _MARGIN), (x, height - _MARGIN)], fill=_GRID)
        pen.text((x, height - _MARGIN + 6), str(round(frames * tick / _TICKS)), fill=_TEXT, anchor="ma")
    for row, joint in enumerate(joints):
        top = _MARGIN + _ROW * row
        pen.text((_LABEL - 8, top + _ROW / 2), joint, fill=_TEXT, anchor="rm")
        for defect in (one for one in defects if one.joint == joint):
            left = _LABEL + scale * defect.first
            right = max(_LABEL + scale * (defect.last + 1), left + _LEAST)
            pen.rectangle([(left, top + 3), (right, top + _ROW - 4)], fill=_COLORS[defect.kind])
    x = float(_LABEL)
    found = {defect.kind for defect in defects}
    for kind in KINDS:
        if kind not in found:
            continue
        pen.rectangle([(x, 8), (x + 10, 18)], fill=_COLORS[kind])
        pen.text((x + 15, 13), kind, fill=_TEXT, anchor="lm")
        x += 80
    with written_beside(path) as beside:
        picture.save(beside, format="PNG")
