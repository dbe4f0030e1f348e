"""Tallies of errors by key, from which tables of scores are made."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.table import interval_bounds


class Tallies(dict[tuple, Tally]):
    """Tallies of errors by key, such as method and measure; a missing key has an empty tally."""

    def __missing__(self, key: tuple) -> Tally:
        return Tally()

    def add(self, key: tuple, errors: np.ndarray, person: str = "") -> None:
        """Add errors (any shape) under a key, of a person if known."""
        self.setdefault(key, Tally()).add(errors, person)

    def merge(self, other: Mapping[tuple, Tally]) -> None:
        """Add the errors of another collection."""
        for key, tally in other.items():
            self.setdefault(key, Tally()).merge(tally)

    def mean(self, *key: object) -> float:
        """Return the mean under a key; NaN without errors."""
        return self[key].mpjpe

    def figures(self, name: str, *key: object) -> dict[str, float]:
        """Return the mean under a key as `name`, and its bounds."""
        return {name: self.mean(*key)} | interval_bounds({name: self[key].interval()})
