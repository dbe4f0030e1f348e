"""The table of `bodysense evaluate completion`: sensor sets by bodies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeVar

import numpy as np

from bodysense.devices.simulated.sensors import TABLE_SETS
from bodysense.io.datasets.splits import Split
from bodysense.lab.bootstrap import Interval, interval
from bodysense.lab.completion.calibration import REGIONS, Calibration
from bodysense.lab.completion.lattice import EdgeScore
from bodysense.lab.completion.measures import Averages
from bodysense.lab.completion.options import BODIES, Body
from bodysense.lab.completion.scenes import TRUTH_OF, Truth
from bodysense.lab.scoring import GROUPS, KNOWN

Key = TypeVar("Key")


@dataclass(frozen=True)
class CompletionSettings:
    """What is scored."""

    split: Split | Literal["all"] = "test"
    sets: tuple[str, ...] = TABLE_SETS
    bodies: tuple[Body, ...] = BODIES
    edges: int = 200  # of the lattice; 0 leaves it out


@dataclass(frozen=True)
class CompletionTable:
    """Averages of every cell by category group, calibrations of the main group, and what stands beside them."""

    settings: CompletionSettings
    cells: dict[tuple[str, Body, str], Averages] = field(default_factory=dict, repr=False)
    calibrations: dict[tuple[str, Body, str], Calibration] = field(default_factory=dict, repr=False)  # by region
    truths: dict[tuple[Truth, str], Averages] = field(default_factory=dict, repr=False)
    baselines: dict[tuple[str, Truth, str], Averages] = field(default_factory=dict, repr=False)
    people: dict[tuple[str, Body], dict[str, Averages]] = field(default_factory=dict, repr=False)  # of the main group
    times: dict[tuple[str, Body], np.ndarray] = field(default_factory=dict, repr=False)  # (N,) s a step
    lattice: list[EdgeScore] = field(default_factory=list, repr=False)

    def merge(self, other: CompletionTable) -> None:
        """Count what another table of the same settings has counted."""
        _merge(self.cells, other.cells)
        _merge(self.truths, other.truths)
        _merge(self.baselines, other.baselines)
        for key, one in other.calibrations.items():
            self.calibrations.setdefault(key, Calibration()).merge(one)
        for key, people in other.people.items():
            _merge(self.people.setdefault(key, {}), people)

    def get(self, sensors: str, body: Body, name: str, group: str = "main") -> float:
        """One figure of one cell; NaN where nothing was counted."""
        return self.cells.get((sensors, body, group), Averages()).get(name)

    def calibration(self, sensors: str, body: Body | None = None, region: str | None = None) -> Calibration:
        """The calibration of a set, over all bodies and regions that are not named."""
        whole = Calibration()
        for (of_sensors, of_body, of_region), one in self.calibrations.items():
            if of_sensors == sensors and body in (None, of_body) and region in (None, of_region):
                whole.merge(one)
        return whole

    def interval(self, sensors: str, body: Body, minus: Body | None = None) -> Interval:
        """The headline of a cell, or what it has more than another body's, and between what it lies: main group."""
        of, other = (self._by_person(sensors, one) for one in (body, minus))
        return interval(of, None if minus is None else other)

    def _by_person(self, sensors: str, body: Body | None) -> dict[str, tuple[float, float]]:
        name = headline(sensors)
        people = {} if body is None else self.people.get((sensors, body), {})
        return {person: (one.get(name), one.weight[name]) for person, one in people.items() if name in one.weight}

    def last_known(self, truth: Truth, group: str = "main") -> Averages:
        """The best of the last-known baselines, by the root of its mean square."""
        known = [self.baselines.get((frame, truth, group), Averages()) for frame in KNOWN]
        return min(known, key=lambda one: one.get("occluded_square"))

    def ratio(self, body: Body, group: str = "main") -> float:
        """RMSJPE of hidden joints by that of the best last-known baseline."""
        cell = self.cells.get(("headset_camera", body, group), Averages())
        return cell.root("occluded_square") / self.last_known(TRUTH_OF[body], group).root("occluded_square")

    def numbers(self) -> dict[str, float]:
        """One flat object; keys without a group at their end are over the main categories."""
        result: dict[str, float] = {}
        for (sensors, body, group), cell in self.cells.items():
            suffix = "" if group == "main" else f"_{group}"
            key = f"{sensors}_{body}"
            result |= {f"{key}_{name}{suffix}": cell.get(name) for name in cell.weight if name != "occluded_square"}
            if sensors == "headset_camera":
                result[f"{key}_occluded_rmsjpe_cm{suffix}"] = cell.root("occluded_square")
                result[f"{key}_ratio{suffix}"] = self.ratio(body, group)
        for (truth, group), averages in self.truths.items():
            suffix = "" if group == "main" else f"_{group}"
            result |= {f"truth_{truth}_{name}{suffix}": averages.get(name) for name in averages.weight}
        for (method, truth, group), averages in self.baselines.items():
            key = f"{'last_known_' if method in KNOWN else ''}{method}_{truth}"
            suffix = "" if group == "main" else f"_{group}"
            result[f"{key}_occluded_mpjpe_cm{suffix}"] = averages.get("occluded_mpjpe_cm")
            result[f"{key}_occluded_rmsjpe_cm{suffix}"] = averages.root("occluded_square")
        for sensors, body in self.people:
            one = self.interval(sensors, body)
            result |= {f"{sensors}_{body}_low_cm": one.low, f"{sensors}_{body}_high_cm": one.high}
            if body != "own" and (sensors, "own") in self.people:
                beside = self.interval(sensors, body, "own")
                parts = zip(("", "_low", "_high"), (beside.value, beside.low, beside.high), strict=True)
                result |= {f"{sensors}_{body}_minus_own{part}_cm": value for part, value in parts}
        for (sensors, body), times in self.times.items():
            for percent in (50, 99):
                result[f"{sensors}_{body}_p{percent}_ms"] = 1000 * float(np.percentile(times, percent))
        result |= self._confidence_numbers()
        if self.lattice:
            result |= {
                "lattice_violations": sum(score.violates for score in self.lattice),
                "lattice_edges": len(self.lattice),
            }
        return result

    def _confidence_numbers(self) -> dict[str, float]:
        result: dict[str, float] = {}
        for sensors in self.settings.sets:
            parts = {"": self.calibration(sensors)}
            parts |= {f"_{region}": self.calibration(sensors, region=region) for region in REGIONS}
            parts |= {f"_{body}": self.calibration(sensors, body) for body in self.settings.bodies}
            for part, one in parts.items():
                result[f"{sensors}{part}_ece"] = one.ece
                result[f"{sensors}{part}_cover90"] = one.coverage
                result[f"{sensors}{part}_spearman"] = one.rank_correlation
        return result


def _merge(ours: dict[Key, Averages], theirs: dict[Key, Averages]) -> None:
    for key, averages in theirs.items():
        ours.setdefault(key, Averages()).merge(averages)


def headline(sensors: str) -> str:
    """The measure by which a set is told first."""
    return "occluded_mpjpe_cm" if sensors == "headset_camera" else "mpjpe_cm"


def groups_of(table: CompletionTable) -> tuple[str, ...]:
    """The category groups of which there was motion."""
    return tuple(group for group in GROUPS if any(key[-1] == group for key in table.cells))
