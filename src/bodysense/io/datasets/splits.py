"""Splits by person: a person of the training split is never in validation or test."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from typing import Literal

Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = ("train", "val", "test")


def split_of(person: str) -> Split:
    """Return the split of a person by name alone: about 80 % train, 10 % val, 10 % test, equal on every machine.

    Adding people never changes the split of others. With few people a split may be empty.
    """
    share = hash_share(person)
    return "train" if share < 0.8 else "val" if share < 0.9 else "test"


def hash_share(name: str) -> float:
    """Return a number from 0 to 1 that is random but equal for equal names, on every machine."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big") / 2**64


def empty_split(name: str, split: str, splits: Iterable[str]) -> str:
    """Return the message for motion `name` whose clips are of `splits` if the requested split is empty."""
    counts = Counter(splits)
    there = ", ".join(f"{counts[known]} of {known}" for known in SPLITS if counts[known])
    return (
        f"{name}: none of its {counts.total()} clips is of split {split!r} ({there or 'it has none'}); "
        "people are split by their names: give motion of more people, give their splits in splits.json, or choose "
        "another --split if the command has one"
    )
