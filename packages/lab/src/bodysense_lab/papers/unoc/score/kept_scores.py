"""Scores of UNOC's networks in files, so that no table counts them twice."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bodysense.files import write_json
from bodysense.takes.last_known import KNOWN
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet

FORMAT = 2  # of the files; another number makes them be counted again


@dataclass(frozen=True)
class Scores:
    """Errors (cm) of one method by group of categories, part of the body, and share of the joints."""

    tallies: Tallies = field(repr=False)
    census: Census

    def get(self, part: str, share: str, group: str = "main") -> Tally:
        """One cell; empty where nothing was counted."""
        return self.tallies[group, part, share]


def scores_path(folder: Path, method: str, data: DataSet) -> Path:
    """Return the file of a method's scores, next to the network."""
    return folder / f"{method}.{data.label}.scores.json"


def identity_of(data: DataSet, stride: int, file: Path | None, settings: str = "") -> dict[str, Any]:
    """Return the settings that scores depend on; `file` is the network's."""
    stat = file.stat() if file is not None else None
    return {
        "format": FORMAT,
        "data": str(data.path.resolve()),
        "split": data.split,
        "quick": data.quick,
        "stride": stride,
        "file": [stat.st_size, stat.st_mtime_ns] if stat is not None else None,
        "settings": settings,
    }


def write_scores(path: Path, scores: Scores, identity: Mapping[str, Any]) -> None:
    """Write scores with what they depend on."""
    tallies = {
        "/".join(key): {
            "all": [tally.count, tally.total, tally.squared],
            "people": {person: [one.count, one.total, one.squared] for person, one in tally.people.items()},
        }
        for key, tally in scores.tallies.items()
    }
    census = asdict(scores.census) | {"people": sorted(scores.census.people)}
    write_json(path, {"identity": identity, "census": census, "tallies": tallies})


def read_scores(path: Path, identity: Mapping[str, Any]) -> Scores | None:
    """Return the scores of a file, or None without a file of this identity."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return None
        tallies = Tallies()
        for key, sums in kept["tallies"].items():
            group, part, share = key.split("/")
            people = {person: Tally(*of_person) for person, of_person in sums["people"].items()}
            tallies[group, part, share] = Tally(*sums["all"], people=people)
        return Scores(tallies, Census(**kept["census"] | {"people": frozenset(kept["census"]["people"])}))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def better_last_known(scores: Mapping[str, Scores]) -> str:
    """The frame of `KNOWN` whose baseline, 'last_known_…', has the smaller error of hidden body joints (RMSJPE)."""

    def error(frame: str) -> float:
        one = scores[f"last_known_{frame}"]
        groups = [group for group, part, _ in one.tallies if part == "body"]
        return one.get("body", "occluded", "main" if "main" in groups else groups[0]).rmsjpe

    return min(KNOWN, key=error)
