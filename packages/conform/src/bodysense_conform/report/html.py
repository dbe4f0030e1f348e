"""Verdict as one HTML page with pictures: no script, nothing from other servers."""

from __future__ import annotations

from html import escape
from importlib.resources import files

import numpy as np

from bodysense_conform.evaluate import Finding, Outcome, Verdict
from bodysense_conform.report.figure import stick_figure
from bodysense_conform.report.text import figure, sentence, shortened, versions
from bodysense_conform.table import Group

_TITLES = {
    "pass": ("Passed", "No check found a fault."),
    "fail": ("Failed", "The device is at fault in the checks below."),
    "retake": ("Take it again", "The performer did not do what the script asks; this does not judge the device."),
    "not enough": ("Not enough to judge", "A required check could not be answered."),
}
# Outcomes in the order of the page: mark, and words under their number.
_OUTCOMES: dict[Outcome, tuple[str, str]] = {
    "fail": ("✕", "failed"),
    "retake": ("↻", "to retake"),
    "pass": ("✓", "passed"),
    "measured": ("≈", "measured only"),
    "not enough": ("–", "not enough to judge"),
}
_PICTURES = 12  # of the take


def page(verdict: Verdict) -> str:
    """Return the page."""
    subject = verdict.subject
    title, text = _TITLES[verdict.judgement]
    style = files("bodysense_conform.report").joinpath("report.css").read_text(encoding="utf-8")
    rate = f"{1 / subject.interval:.3g} Hz" if subject.interval > 0 else "no rate"
    facts = (
        subject.format,
        f"{len(subject)} frames",
        f"{subject.seconds:.1f} s",
        rate,
        f"{len(subject.points)} points",
    )
    counts = "".join(
        f'<li class="{_kind(one) if verdict.of(one) else "none"}"><b>{len(verdict.of(one))}</b>{words}</li>'
        for one, (_, words) in _OUTCOMES.items()
    )
    frames = np.unique(np.linspace(0, len(subject) - 1, _PICTURES).astype(int)).tolist()
    pictures = "".join(
        f"<figure>{stick_figure(subject, k, size=120)}<figcaption>{_moment(verdict, k)}</figcaption></figure>"
        for k in frames
    )
    faults = "".join(_fault(verdict, one) for one in verdict.of("fail", "retake"))
    reasons = "".join(
        f"<tr><td class=id>{escape(reason)}</td><td class=why>{escape(', '.join(shortened(ids)))}</td></tr>"
        for reason, ids in verdict.unanswered.items()
    )
    unanswered = f"<table>{reasons}</table>" if reasons else "<p class=none>Every check was answered.</p>"
    rows = {"input SHA-256": subject.sha256 or "a stream", **versions(verdict.table)}
    footer = "".join(f"<dt>{escape(key)}</dt><dd>{escape(value)}</dd>" for key, value in rows.items())
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(subject.name)}: {title}</title><style>
{style}</style></head><body>
<header class="{_kind(verdict.judgement)}"><p class="what">bodysense conform</p><h1>{escape(subject.name)}</h1>
<p class="facts">{" · ".join(escape(fact) for fact in facts)}</p>
<p class="verdict"><strong>{title}</strong><span>{text}</span></p><ul class="counts">{counts}</ul></header>
<main><section class="strip" aria-label="the take">{pictures}</section>
{f'<section class="faults"><h2>Faults</h2>{faults}</section>' if faults else ""}
{"".join(_group(verdict, group) for group in verdict.table.groups)}
<section class="group"><h2>Not enough to judge</h2>{unanswered}</section>
</main><footer><dl>{footer}</dl></footer></body></html>
"""


def _fault(verdict: Verdict, finding: Finding) -> str:
    frame = finding.frame if finding.frame is not None else len(verdict.subject) // 2
    svg = stick_figure(verdict.subject, frame, finding.where, size=170)
    return (
        f'<article class="{finding.outcome}">{svg}<div><h3>{escape(finding.check.id)}</h3>'
        f'<p class="value">{escape(figure(finding))}<small>limit {escape(finding.check.limit)}</small></p>'
        f"<p>{escape(finding.check.why)}</p><p class=meta>{escape(finding.where or 'the whole body')}"
        f" · {_moment(verdict, frame)} · the {finding.check.blame}</p></div></article>"
    )


def _group(verdict: Verdict, group: Group) -> str:
    found = [one for one in verdict.findings if one.check.group == group.id and one.outcome != "not enough"]
    found.sort(key=lambda one: list(_OUTCOMES).index(one.outcome))
    rows = "".join(
        f'<tr class="{_kind(one.outcome)}" title="{escape(sentence(one))}">'
        f"<td class=mark>{_OUTCOMES[one.outcome][0]}</td>"
        f"<td class=id>{escape(one.check.id.partition('.')[2].replace('_', ' '))}</td>"
        f"<td class=value>{escape(figure(one))}</td><td class=limit>{escape(one.check.limit)}</td>"
        f"<td class=why>{escape(one.check.why)}</td></tr>"
        for one in found
    )
    return f'<section class="group"><h2>{escape(group.title)}</h2><table>{rows}</table></section>' if rows else ""


def _kind(outcome: str) -> str:
    return outcome.replace(" ", "-")


def _moment(verdict: Verdict, frame: int) -> str:
    return f"{verdict.subject.time[frame] - verdict.subject.time[0]:.1f} s"
