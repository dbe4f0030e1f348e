"""The referee's table of checks in docs/conform.md."""

from __future__ import annotations

from bodysense_conform.table import Check, table

from .blocks import Block


def rows() -> str:
    """Return the table as Markdown, a section for each group."""
    found = []
    for group in table().groups:
        needs = f" (needs {', '.join(group.needs)})" if group.needs else ""
        head = "| id | quantity | of | statistic | window | least | most | blame | why |"
        found += [f"### {group.title}: `{group.id}`{needs}", "", head, "|---|---|---|---|---|---|---|---|---|"]
        found += [_row(check) for check in table().checks if check.group == group.id]
        found.append("")
    return "\n".join(found[:-1])


def _row(check: Check) -> str:
    quantity = check.quantity.replace("|", "\\|")  # a bar would end the cell
    of = check.of if isinstance(check.of, str) else "; ".join(check.of)
    limits = [f"{limit:g} {check.unit}".strip() if limit is not None else "" for limit in (check.least, check.most)]
    mark = " *" if check.gate else ""
    name = check.id.partition(".")[2]
    return (
        f"| {name}{mark} | `{quantity}` | {of} | {check.statistic} | {check.window} | {limits[0]} | {limits[1]} | "
        f"{check.blame} | {check.why} |"
    )


BLOCKS = (Block("docs/conform.md", "checks", rows),)
