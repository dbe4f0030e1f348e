"""Table of checks: `checks.toml`, read and validated."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, Literal

Blame = Literal["device", "performer"]


@dataclass(frozen=True)
class Group:
    """Checks that are skipped together when one of their gates, or of the groups that they need, fails."""

    id: str
    title: str
    needs: tuple[str, ...] = ()  # groups before this one


@dataclass(frozen=True)
class Check:
    """A statistic of a quantity in a window, with its limits; without limits it is only measured."""

    id: str  # group.name
    quantity: str  # expression, see bodysense_conform.expressions
    statistic: str  # see evaluate.reduced
    why: str  # one sentence for users of the tracker
    of: tuple[str, ...] | str = ("",)  # columns: joints, or bones as 'parent, child'; or an expression that lists them
    lacking: str = ""  # reason if the points, rotations or facts in the expression never come
    window: str = "take"  # or a step of the script; 'held STEP' is its last 60 %
    enough: int = 1  # frames with a value that a judgement needs
    least: float | None = None
    most: float | None = None
    unit: str = ""
    blame: Blame = "device"
    gate: bool = False  # if it fails, its group and those that need it are skipped
    required: bool = False  # if it has no answer, the subject cannot be judged

    @property
    def group(self) -> str:
        """The first part of the id."""
        return self.id.partition(".")[0]

    @property
    def limit(self) -> str:
        """The limits in words."""
        if self.least is not None and self.most is not None:
            return self.with_unit(f"{self.least:g} … {self.most:g}")
        if self.most is not None:
            return self.with_unit(f"≤ {self.most:g}")
        return "–" if self.least is None else self.with_unit(f"≥ {self.least:g}")

    def with_unit(self, figure: str) -> str:
        """Return a figure with the unit of the check."""
        return figure + (self.unit if self.unit.startswith(("°", "%")) else f" {self.unit}" if self.unit else "")


@dataclass(frozen=True)
class CheckTable:
    """All groups and checks, in the order of evaluation."""

    groups: tuple[Group, ...]
    checks: tuple[Check, ...]
    sha256: str  # reports with the same hash used the same checks

    def before(self, group: str) -> set[str]:
        """Return a group and all groups that it needs, directly or not."""
        needs = next(one.needs for one in self.groups if one.id == group)
        return {group}.union(*(self.before(one) for one in needs))


@lru_cache(maxsize=1)
def table() -> CheckTable:
    """Return the packaged table."""
    data = files("bodysense_conform").joinpath("checks.toml").read_bytes()
    document = tomllib.loads(data.decode("utf-8"))
    groups = tuple(Group(**_tuples(row)) for row in document["group"])
    checks = tuple(Check(**_tuples(row)) for row in document["check"])
    return CheckTable(groups, checks, hashlib.sha256(data).hexdigest())


def _tuples(row: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
