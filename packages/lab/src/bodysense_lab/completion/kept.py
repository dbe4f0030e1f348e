"""Results by clip, kept in a folder: an evaluation that was interrupted goes on, and new clips are scored alone."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.clip import Clip
from bodysense_lab.completion.measures import Averages, Calibration
from bodysense_lab.completion.quantiles import Quantiles
from bodysense_lab.completion.scenes import Truth
from bodysense_lab.completion.sight_scores import JerkCurves, SightScores
from bodysense_lab.completion.tables import CompletionSettings, CompletionTable, WorstFrame

FORMAT = "bodysense-completion-clips-2"


@dataclass(frozen=True)
class KeptClips:
    """A folder with one file for each clip and truth: a table of that clip alone, without lattice and times."""

    folder: Path
    resumed: bool = False  # whether an earlier run began it, so that this run's time is not that of all clips

    @classmethod
    def open(cls, folder: Path, settings: CompletionSettings, network: str) -> KeptClips:
        """Make the folder, or go on with it.

        Raises BodysenseError if it holds results of other settings or of another network.
        """
        meant = {"format": FORMAT, "split": settings.split, "sets": list(settings.sets)}
        meant |= {"bodies": list(settings.bodies), "network": network, "takes": settings.takes}
        path = folder / "settings.json"
        resumed = path.is_file()
        if resumed:
            found = json.loads(path.read_text(encoding="utf-8"))
            for name, value in meant.items():
                if found.get(name) != value:
                    raise BodysenseError(
                        f"--keep {folder}: its clips were scored with {name} {found.get(name)!r}, not {value!r}; "
                        "give another folder, or delete this one"
                    )
        else:
            folder.mkdir(parents=True, exist_ok=True)
            with written_beside(path) as beside:
                beside.write_text(json.dumps(meant, indent=1), encoding="utf-8")
        return cls(folder, resumed)

    def find(self, clip: Clip, truth: Truth, settings: CompletionSettings) -> CompletionTable | None:
        """The table of a clip; None if it is not kept."""
        path = self._path(clip, truth)
        if not path.is_file():
            return None
        with np.load(path, allow_pickle=False) as stored:
            return _from_arrays(stored, settings)

    def keep(self, clip: Clip, truth: Truth, table: CompletionTable) -> None:
        """Write the table of a clip."""
        with written_beside(self._path(clip, truth)) as beside, beside.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **_arrays(table))

    def _path(self, clip: Clip, truth: Truth) -> Path:
        known = hashlib.sha256(f"{clip.person}/{clip.name}".encode()).hexdigest()[:16]
        return self.folder / f"{truth}-{known}.npz"


def _arrays(table: CompletionTable) -> dict[str, np.ndarray]:
    """A table of one clip as arrays: averages as one text, histograms and curves by name."""
    arrays: dict[str, np.ndarray] = {}
    rows: dict[str, Any] = {
        "cells": [[*key, _row(one)] for key, one in table.cells.items()],
        "truths": [[*key, _row(one)] for key, one in table.truths.items()],
        "baselines": [[*key, _row(one)] for key, one in table.baselines.items()],
        "people": [[*key, person, _row(one)] for key, people in table.people.items() for person, one in people.items()],
        "sights": [[*key, _row(one.averages)] for key, one in table.sights.items()],
        "worst": [asdict(one) for one in table.worst],
    }
    for key, one in table.calibrations.items():
        name = "/".join(("calibration", *key))
        arrays |= {f"{name}/pairs": one.pairs, f"{name}/sums": np.stack([one.expected, one.error])}
        arrays[f"{name}/within"] = np.array(one.within)
    for key, one in table.sights.items():
        for name, quantiles in one.quantiles.items():
            arrays["/".join(("quantiles", *key, name))] = quantiles.count
        for moment, curves in one.curves.items():
            arrays["/".join(("curves", *key, moment))] = np.stack([curves.output, curves.truth])
            arrays["/".join(("moments", *key, moment))] = np.array(curves.count)
    return arrays | {"rows": np.array(json.dumps(rows))}


def _from_arrays(stored: Mapping[str, np.ndarray], settings: CompletionSettings) -> CompletionTable:
    table, rows = CompletionTable(settings), json.loads(str(stored["rows"]))
    for sensors, body, group, row in rows["cells"]:
        table.cells[sensors, body, group] = _averages(row)
    for truth, group, row in rows["truths"]:
        table.truths[truth, group] = _averages(row)
    for method, truth, group, row in rows["baselines"]:
        table.baselines[method, truth, group] = _averages(row)
    for sensors, body, person, row in rows["people"]:
        table.people.setdefault((sensors, body), {})[person] = _averages(row)
    for sensors, body, group, row in rows["sights"]:
        table.sights[sensors, body, group] = SightScores(_averages(row))
    table.worst.extend(WorstFrame(**row) for row in rows["worst"])
    for name in stored:
        kind, *key = name.split("/")
        if kind == "calibration" and key[-1] == "pairs":
            sensors, body, region, _ = key
            expected, error = stored[name.replace("/pairs", "/sums")]
            within = float(stored[name.replace("/pairs", "/within")])
            table.calibrations[sensors, body, region] = Calibration(stored[name], expected, error, within)  # type: ignore[index]
        elif kind == "quantiles":
            sensors, body, group, which = key
            table.sights[sensors, body, group].quantiles[which] = Quantiles(stored[name])  # type: ignore[index]
        elif kind == "curves":
            sensors, body, group, moment = key
            count = int(stored[name.replace("curves", "moments", 1)])
            output, truth = stored[name]
            table.sights[sensors, body, group].curves[moment] = JerkCurves(output, truth, count)  # type: ignore[index]
    return table


def _row(averages: Averages) -> dict[str, tuple[float, float]]:
    return {name: (averages.total[name], weight) for name, weight in averages.weight.items()}


def _averages(row: Mapping[str, tuple[float, float]]) -> Averages:
    return Averages(
        {name: total for name, (total, _) in row.items()}, {name: weight for name, (_, weight) in row.items()}
    )
