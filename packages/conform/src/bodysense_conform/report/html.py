"""A verdict as one HTML page with pictures: no script, nothing from elsewhere.

Stick figures as SVG, for reports.
"""

from __future__ import annotations

from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from bodysense.files import written_beside
from bodysense_conform.check import Finding, Outcome
from bodysense_conform.report.text import figure, sentence, versions
from bodysense_conform.subject import Subject, is_finger
from bodysense_conform.verdict import GROUPS, Verdict

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


_TITLES = {
    "data": "Data",
    "anatomy": "Anatomy",
    "motion": "Motion",
    "poses": "Scripted poses",
    "hands": "Hands and gestures",
}
_SAID = {
    "pass": ("Passed", "No check found a fault."),
    "fail": ("Failed", "The device is at fault in what stands below."),
    "retake": ("Take it again", "The performer did not do what the script says; the device is not judged by that."),
    "not enough": ("Not enough to judge", "A required check could not be answered."),
}
_ORDER: tuple[Outcome, ...] = ("fail", "retake", "pass", "measured", "not enough")
_MARKS = {"pass": "✓", "fail": "✕", "retake": "↻", "measured": "≈", "not enough": "–"}


def write_html(path: Path, verdict: Verdict) -> None:
    """Write a page; the file appears whole or not at all."""
    with written_beside(path) as beside:
        beside.write_text(page(verdict), encoding="utf-8")


def page(verdict: Verdict) -> str:
    """The page."""
    subject = verdict.subject
    title, text = _SAID[verdict.judgement]
    style = files("bodysense_conform.report").joinpath("report.css").read_text(encoding="utf-8")
    kind = verdict.judgement.replace(" ", "-")
    rate = f"{1 / subject.interval:.3g} Hz" if subject.interval > 0 else "no rate"
    facts = [
        subject.format,
        f"{len(subject)} frames",
        f"{subject.seconds:.1f} s",
        rate,
        f"{len(subject.points)} points",
    ]
    counts = "".join(
        f'<li class="{_kind(verdict, o)}"><b>{len(verdict.of(o))}</b>{escape(_plural(o))}</li>' for o in _ORDER
    )
    pictures = "".join(
        f"<figure>{svg}<figcaption>{_moment(verdict, k)}</figcaption></figure>" for k, svg in strip(subject)
    )
    faults = verdict.of("fail", "retake")
    shown = "".join(_fault(verdict, one) for one in faults)
    groups = "".join(_group(verdict, group) for group in GROUPS)
    rows = {"input SHA-256": subject.sha256 or "a stream", **{f"{k}": v for k, v in versions().items()}}
    footer = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows.items())
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(subject.name)}: {title}</title><style>
{style}</style></head><body>
<header class="{kind}"><p class="what">bodysense conform</p><h1>{escape(subject.name)}</h1>
<p class="facts">{" · ".join(escape(fact) for fact in facts)}</p>
<p class="verdict"><strong>{title}</strong><span>{text}</span></p><ul class="counts">{counts}</ul></header>
<main><section class="strip" aria-label="the take">{pictures}</section>
{f'<section class="faults"><h2>What is wrong</h2>{shown}</section>' if faults else ""}
{groups}</main><footer><dl>{footer}</dl></footer></body></html>
"""


def _fault(verdict: Verdict, finding: Finding) -> str:
    frame = finding.frame if finding.frame is not None else len(verdict.subject) // 2
    svg = stick_figure(verdict.subject, min(frame, len(verdict.subject) - 1), finding.where, size=170)
    blamed = "the device" if finding.outcome == "fail" else "the performer"
    return (
        f'<article class="{finding.outcome}">{svg}<div><h3>{escape(finding.check.id)}</h3>'
        f'<p class="value">{escape(figure(finding))}<small>limit {escape(finding.check.limit)}</small></p>'
        f"<p>{escape(finding.check.why)}</p><p class=meta>{escape(finding.where or 'the whole body')}"
        f" · {_moment(verdict, frame)} · {blamed}</p></div></article>"
    )


def _group(verdict: Verdict, group: str) -> str:
    found = [one for one in verdict.findings if one.check.group == group]
    found.sort(key=lambda one: _ORDER.index(one.outcome))
    answered = [one for one in found if one.outcome != "not enough"]
    silent = [one for one in found if one.outcome == "not enough"]
    rows = "".join(_line(one) for one in answered)
    rest = "".join(_line(one) for one in silent)
    hidden = f"<details><summary>{len(silent)} not answered</summary><table>{rest}</table></details>" if silent else ""
    table = f"<table>{rows}</table>" if answered else "<p class=none>Nothing here could be answered.</p>"
    return f'<section class="group"><h2>{_TITLES[group]}</h2>{table}{hidden}</section>'


def _line(finding: Finding) -> str:
    kind, check = finding.outcome.replace(" ", "-"), finding.check
    said = finding.reason if finding.outcome == "not enough" else check.why
    return (
        f'<tr class="{kind}" title="{escape(sentence(finding))}"><td class=mark>{_MARKS[finding.outcome]}</td>'
        f"<td class=id>{escape(check.id.partition('.')[2].replace('_', ' '))}</td>"
        f"<td class=value>{escape(figure(finding))}</td>"
        f"<td class=limit>{escape(check.limit)}</td><td class=why>{escape(said)}</td></tr>"
    )


def _kind(verdict: Verdict, outcome: Outcome) -> str:
    return outcome.replace(" ", "-") if verdict.of(outcome) else "none"


def _plural(outcome: Outcome) -> str:
    return {"pass": "passed", "fail": "failed", "retake": "to retake", "measured": "measured only"}.get(
        outcome, "not answered"
    )


def _moment(verdict: Verdict, frame: int) -> str:
    time = verdict.subject.time
    return f"{time[min(frame, len(time) - 1)] - time[0]:.1f} s"
