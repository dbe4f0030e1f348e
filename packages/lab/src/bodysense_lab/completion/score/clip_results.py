"""Results of single clips in a folder, so that an evaluation can resume, and only new clips are scored."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import write_json, written_beside
from bodysense.io.clip import Clip
from bodysense_lab.completion.score.scenes import Truth
from bodysense_lab.completion.score.scores import Calibration, RunningScores
from bodysense_lab.completion.score.sight.sight_scores import CellScores
from bodysense_lab.completion.score.tables import CompletionSettings, CompletionTable, WorstFrame

FORMAT = "bodysense-completion-clips-2"
_MEANS = ("cells", "truths", "baselines", "people")  # fields of a table with means


@dataclass(frozen=True)
class ClipResults:
    """Folder with a file for each clip and body: the table of that clip alone, without times."""

    folder: Path
    resumed: bool = False  # an earlier run wrote results, so this run does not time all clips

    @classmethod
    def open(cls, folder: Path, settings: CompletionSettings, network: str) -> ClipResults:
        """Make the folder, or open an existing one.

        Raises BodysenseError if it has results of other settings or of another network.
        """
        wanted = {"format": FORMAT, "split": settings.split, "sets": list(settings.sets)}
        wanted |= {"bodies": list(settings.bodies), "network": network, "takes": settings.takes}
        path = folder / "settings.json"
        resumed = path.is_file()
        if resumed:
            found = json.loads(path.read_text(encoding="utf-8"))
            for name, value in wanted.items():
                if found.get(name) != value:
                    raise BodysenseError(
                        f"--keep {folder}: its clips were scored with {name} {found.get(name)!r}, not {value!r}; "
                        "give another folder, or delete this one"
                    )
        else:
            folder.mkdir(parents=True, exist_ok=True)
            write_json(path, wanted)
        return cls(folder, resumed)

    def load(self, clip: Clip, truth: Truth, settings: CompletionSettings) -> CompletionTable | None:
        """Read the table of a clip, or return None if it has no file."""
        path = self._path(clip, truth)
        if not path.is_file():
            return None
        with np.load(path, allow_pickle=False) as stored:
            return _from_arrays(stored, settings)

    def save(self, clip: Clip, truth: Truth, table: CompletionTable) -> None:
        """Write the table of a clip."""
        with written_beside(self._path(clip, truth)) as beside, beside.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **_arrays(table))

    def _path(self, clip: Clip, truth: Truth) -> Path:
        known = hashlib.sha256(f"{clip.person}/{clip.name}".encode()).hexdigest()[:16]
        return self.folder / f"{truth}-{known}.npz"


def _arrays(table: CompletionTable) -> dict[str, np.ndarray]:
    """Return a table of one clip as arrays: means as JSON in `rows`, histograms and curves as KIND/KEY/NAME."""
    rows: dict[str, Any] = {"worst": [asdict(one) for one in table.worst]}
    for field in _MEANS:
        rows[field] = [
            [*key, {name: (one.total[name], weight) for name, weight in one.weight.items()}]
            for key, one in getattr(table, field).items()
        ]
    rows["sights"] = [[*key, {}] for key in table.cells]  # earlier versions stored these means apart
    arrays = {
        "/".join((kind, *key, name)): values
        for field in ("calibrations", "cells")
        for key, one in getattr(table, field).items()
        for (kind, name), values in one.sums.items()
    }
    return arrays | {"rows": np.array(json.dumps(rows))}


def _from_arrays(stored: Mapping[str, np.ndarray], settings: CompletionSettings) -> CompletionTable:
    table, rows = CompletionTable(settings), json.loads(str(stored["rows"]))
    table.worst.extend(WorstFrame(**row) for row in rows["worst"])
    for field in (*_MEANS, "sights"):
        found: Any = getattr(table, "cells" if field == "sights" else field)
        for *key, row in rows[field]:
            one = found.setdefault(tuple(key), CellScores() if found is table.cells else RunningScores())
            for name, (total, weight) in row.items():
                one.total[name], one.weight[name] = total, weight
    for path in stored:
        kind, *key = path.split("/")
        if kind != "rows":
            name = key.pop()
            found = getattr(table, "calibrations" if kind == "calibration" else "cells")
            found.setdefault(tuple(key), Calibration()).sums[kind, name] = stored[path]
    return table
