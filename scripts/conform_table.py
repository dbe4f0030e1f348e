"""Write the referee's table of checks into docs/conform.md, between its markers: `python scripts/conform_table.py`."""

from __future__ import annotations

from pathlib import Path

from bodysense_conform.table import Check, table

PAGE = Path(__file__).parents[1] / "docs" / "conform.md"
_BEGIN, _END = "<!-- begin checks -->\n", "<!-- end checks -->\n"


def rows() -> str:
    """Return the table as Markdown, a section for each group."""
    found = []
    for group in table().groups:
        needs = f" (needs {', '.join(group.needs)})" if group.needs else ""
        found += [f"### {group.title}: `{group.id}`{needs}", "", "| id | quantity | statistic | window | least | most |"
                  " blame | why |", "|---|---|---|---|---|---|---|---|"]  # fmt: skip
        found += [_row(check) for check in table().checks if check.group == group.id]
        found.append("")
    return "\n".join(found)


def written(page: str) -> str:
    """Return a page with the table between its markers."""
    before, _, rest = page.partition(_BEGIN)
    return before + _BEGIN + rows() + _END + rest.partition(_END)[2]


def _row(check: Check) -> str:
    of = f"({', '.join(check.of)})" if check.of else ""
    limits = [f"{limit:g} {check.unit}".strip() if limit is not None else "" for limit in (check.least, check.most)]
    mark = " *" if check.gate else ""
    name = check.id.partition(".")[2]
    return (
        f"| {name}{mark} | {check.quantity}{of} | {check.statistic} | {check.window} | {limits[0]} | {limits[1]} | "
        f"{check.blame} | {check.why} |"
    )


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
