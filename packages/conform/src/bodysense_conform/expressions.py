"""Expressions of the table of checks, evaluated for a subject and a column."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import partial
from inspect import isfunction, signature
from typing import Any

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.geometry import series as over_time
from bodysense_conform import series
from bodysense_conform.quantities import axes, floor, hands, joints, motion, poses, shape, stream, tracking
from bodysense_conform.series import Absent, NotEnough
from bodysense_conform.subject import Subject
from bodysense_conform.table import Check

# Functions and constants (upper case) of these modules; those whose first argument is the subject get it.
_MODULES = (over_time, series, stream, axes, shape, joints, motion, floor, tracking, poses, hands)
_WORDS = {
    word: value
    for module in _MODULES
    for word, value in vars(module).items()
    if not word.startswith("_") and (word.isupper() or (isfunction(value) and value.__module__ == module.__name__))
}


def columns(check: Check, subject: Subject) -> Mapping[str, np.ndarray | float]:
    """Return the quantity of a check by column: joint, bone or side; '' is the whole body.

    Columns of missing points are left out. Raises NotEnough if no column remains.
    """
    names: Iterable[str | tuple[str, str]] = check.of if isinstance(check.of, tuple) else _value(check.of, subject)
    found: dict[str, Any] = {}
    for name in (one if isinstance(one, str) else ", ".join(one) for one in names):
        with suppress(Absent):
            found[name] = _value(check.quantity, subject, name)
    if not found and check.lacking:
        raise NotEnough(check.lacking)
    whole = found.get("")
    if isinstance(whole, np.ndarray) and whole.ndim == 2:
        return dict(zip(subject.points, whole.T, strict=True))
    return whole if isinstance(whole, Mapping) else found


def _value(expression: str, subject: Subject, column: str = "") -> Any:
    """Return the value of an expression of the table, which is code of this package, not input."""
    return eval(expression, {"__builtins__": {}}, _Namespace(subject, column))


class _Namespace(dict[str, Any]):
    """Names for one column: for the column 'left_knee', `it` is this name, `side` is 'left', and `hip` is 'left_hip'.

    The column of a bone, 'left_hip, left_knee', has `other`, too. All other names are looked up when they are needed.
    """

    def __init__(self, subject: Subject, column: str) -> None:
        it, _, other = column.partition(", ")
        super().__init__(it=it, other=other, side=it.partition("_")[0])
        self._subject = subject

    def __missing__(self, word: str) -> Any:
        """Look up a point, a property of the subject or its transport, a word of the modules, or one of NumPy."""
        for point in (f"{self['side']}_{word}", word):
            if point in default_skeleton().points:
                return point
        for facts in (self._subject, self._subject.transport):
            if hasattr(facts, word):
                value = getattr(facts, word)
                if value is None or (isinstance(value, float) and np.isnan(value)):
                    raise Absent(f"no {word}")
                return value
        value = _WORDS[word] if word in _WORDS else getattr(np, word)
        of_subject = isfunction(value) and "subject" in signature(value).parameters
        return partial(value, self._subject) if of_subject else value
