"""A table of joints by hand: {name in the file: ours}, as JSON; '' for those that are left out."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from pathlib import Path

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.rigs.figure import Figure

ARMS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "elbow", "wrist"))
LEGS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle"))
NEEDED = ("pelvis", "head", *ARMS, *LEGS)  # of a whole body


def table_of(path: Path) -> dict[str, str]:
    """The table of a file, {name in the file: ours}, without what is left out. Raises BodysenseError for another."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BodysenseError(f"--joints {path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise BodysenseError(f"--joints {path}: not JSON ({error}); draft it with bodysense data joints") from None
    if not isinstance(table, dict) or not all(isinstance(ours, str) for ours in table.values()):
        raise BodysenseError(f'--joints {path}: must be one object of names, {{"name in the file": "our name"}}')
    return {given: ours for given, ours in table.items() if ours}


def read_joint_map(path: Path, figure: Figure) -> dict[str, int]:
    """Points of a figure by our names, as a file says. Raises BodysenseError where it says it wrongly."""
    index = {name: point for point, name in enumerate(figure.points)}
    found: dict[str, int] = {}
    for given, ours in table_of(path).items():
        if given not in index:
            raise BodysenseError(f"--joints {path}: the file has no joint {given!r}{_near(given, figure.points)}")
        if ours not in default_skeleton().points:
            raise BodysenseError(
                f"--joints {path}: no joint of ours is {ours!r}{_near(ours, default_skeleton().points)}"
            )
        if ours in found:
            raise BodysenseError(f"--joints {path}: {ours!r} stands twice; each joint of ours is one of the file's")
        found[ours] = index[given]
    halves = [half for half in (ARMS, LEGS) if found.keys() & set(half)] or [ARMS, LEGS]
    if missing := [name for name in ("pelvis", *(name for half in halves for name in half)) if name not in found]:
        raise BodysenseError(
            f"--joints {path}: it names no {', '.join(missing[:4])}; a body needs a pelvis, and all {len(ARMS)} joints "
            f"of its arms, all {len(LEGS)} of its legs, or both"
        )
    return found


def write_joint_map(path: Path, figure: Figure, joints: Mapping[str, str]) -> None:
    """Write a draft of such a file."""
    with written_beside(path) as beside:
        beside.write_text(joint_map_text(figure, joints), encoding="utf-8")


def joint_map_text(figure: Figure, joints: Mapping[str, str]) -> str:
    """A draft: every point of a figure, with our name for it or ''."""
    ours = {given: name for name, given in joints.items()}
    table = {name: ours.get(name, "") for name in figure.points}
    return json.dumps(table, indent=1, ensure_ascii=False) + "\n"


def _near(name: str, names: tuple[str, ...]) -> str:
    """The nearest names known, for a message."""
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    return f"; near are {', '.join(near)}" if near else ""
