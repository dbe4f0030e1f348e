"""A verdict as JUnit XML, which continuous integration shows: a suite a group, a case a check."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from bodysense.conform.check import Finding
from bodysense.conform.report.text import figure, sentence
from bodysense.conform.verdict import GROUPS, Verdict
from bodysense.files import written_beside

_FORBIDDEN = re.compile(r"[^\t\n\r -퟿-�𐀀-􏿿]")  # characters that no XML may hold


def write_junit(path: Path, verdict: Verdict) -> None:
    """Write a verdict; the file appears whole or not at all."""
    root = ElementTree.Element("testsuites", name=_clean(verdict.subject.name))
    for group in GROUPS:
        found = [one for one in verdict.findings if one.check.group == group]
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=group,
            tests=str(len(found)),
            failures=str(sum(one.outcome in ("fail", "retake") for one in found)),
            skipped=str(sum(one.outcome == "not enough" for one in found)),
            errors="0",
        )
        for one in found:
            _case(suite, one)
    ElementTree.indent(root)
    with written_beside(path) as beside:
        ElementTree.ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)


def _case(suite: ElementTree.Element, finding: Finding) -> None:
    check = finding.check
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"conform.{check.group}", name=check.id.partition(".")[2]
    )
    if finding.outcome in ("fail", "retake"):
        blamed = "device" if finding.outcome == "fail" else "performer"
        ElementTree.SubElement(case, "failure", type=blamed, message=_clean(sentence(finding)))
    elif finding.outcome == "not enough":
        ElementTree.SubElement(case, "skipped", message=_clean(finding.reason))
    else:
        ElementTree.SubElement(case, "system-out").text = _clean(f"{figure(finding)} (limit {check.limit})")


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("�", text)
