"""Blocks that describe files of the repository: the referee's table of checks, and the cards of packaged networks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense_conform.table import Check, table
from bodysense_lab.completion.training.options import TABLE_SETS
from bodysense_lab.core.model_card import network_lines, parse_fields, read_network

from .tables import ROOT, Measured, put

WEIGHTS = "src/bodysense/weights"


def write_descriptions(measured: Mapping[str, Measured], root: Path = ROOT) -> None:
    """Replace the description of every file; validation figures of a card are those of `validation.json`."""
    for (page, name), text in DESCRIPTIONS.items():
        body = text(measured)
        if body is not None:
            path = root / page
            path.write_text(put(path.read_text(encoding="utf-8"), name, body), encoding="utf-8")


def network_card(name: str, kind: str, what: str, measured: Mapping[str, Measured]) -> str | None:
    """Return what a network's file says of itself, with its validation figures; None without them.

    `kind` is part of the figures' keys, and `what` says how they were computed.
    """
    if "validation" not in measured:
        return None
    validation = measured["validation"]
    keys = {sensors: f"{sensors}_own_{kind}{_position(sensors)}" for sensors in TABLE_SETS}
    figures = (
        f"{sensors.replace('_', ' ')} {validation.numbers[key]:.2f}"
        for sensors, key in keys.items()
        if key in validation.numbers
    )
    lines = [*_own_lines(name), f"- validation people, known bodies{what}, cm: {', '.join(figures)}"]
    return "\n".join(lines) + f"\n\n{validation.line}"


def backward_card(measured: Mapping[str, Measured]) -> str:
    """Return what the network for time that runs backward says of itself; it completes nothing alone."""
    return "\n".join(_own_lines("completion_backward"))


def checks(measured: Mapping[str, Measured]) -> str:
    """Return the referee's table, a section for each group."""
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


def _own_lines(name: str) -> list[str]:
    fields, _ = read_network(ROOT / WEIGHTS / f"{name}.safetensors")
    return network_lines(parse_fields(fields))


def _position(sensors: str) -> str:
    return "occluded_mpjpe_cm" if SENSOR_SETS[sensors].camera else "mpjpe_cm"


DESCRIPTIONS: dict[tuple[str, str], Callable[[Mapping[str, Measured]], str | None]] = {  # by page and marker
    (f"{WEIGHTS}/completion.md", "network"): partial(network_card, "completion", "", ""),
    (f"{WEIGHTS}/completion_backward.md", "network"): backward_card,
    (f"{WEIGHTS}/completion_joining.md", "network"): partial(
        network_card, "completion_joining", "take_", ", completed in both directions and joined"
    ),
    ("docs/conform.md", "checks"): checks,
}
