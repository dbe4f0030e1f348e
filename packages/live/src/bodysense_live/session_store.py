"""Sessions for other server processes to resume: one small JSON file for each, in a folder that they share.

The estimator's memory is not kept, so the motion begins anew; who the wearer is, how trackers are worn, where the
middle is and what was set stay.
"""

from __future__ import annotations

import hmac
import json
import re
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bodysense.body.person import Person
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense_live.message_text import changed
from bodysense_live.messages import Resume, Settings
from bodysense_live.webxr import Placement

_IDENTITY = re.compile(r"[0-9a-f]{16}")
_LARGEST = 1 << 20  # bytes


@dataclass(frozen=True, eq=False)
class Kept:
    """A session as another process takes it on."""

    token: str
    watch_token: str
    name: str
    settings: Settings
    person: Person
    placement: Placement
    worn: dict[str, str]  # undecided trackers → joints


class SessionStore:
    """Sessions in a folder, for `seconds` after they were last put there."""

    def __init__(self, folder: Path, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds

    def put(self, identity: str, kept: Kept) -> None:
        """Keep a session; a full disk costs its resumption in another process and nothing else."""
        person = self._folder / f"{identity}.person.json"
        row = {
            "token": kept.token,
            "watch_token": kept.watch_token,
            "name": kept.name,
            "settings": asdict(kept.settings),
            "placement": {"heading": kept.placement.heading, "offset": list(kept.placement.offset)},
            "worn": kept.worn,
        }
        try:
            kept.person.save(person)
            with written_beside(self._folder / f"{identity}.json") as beside:
                beside.write_text(json.dumps(row), encoding="utf-8")
        except (OSError, BodysenseError):
            return

    def touch(self, identity: str) -> None:
        """Say that a session still goes on."""
        try:
            (self._folder / f"{identity}.json").touch()
        except OSError:
            return

    def drop(self, identity: str) -> None:
        """Forget a session."""
        for ending in (".json", ".person.json"):
            (self._folder / f"{identity}{ending}").unlink(missing_ok=True)

    def take(self, resume: Resume) -> Kept | None:
        """Return the session that a client had; None if it is unknown or over, or the token is wrong."""
        if not _IDENTITY.fullmatch(resume.session):
            return None
        path = self._folder / f"{resume.session}.json"
        try:
            if time.time() - path.stat().st_mtime > self._seconds or path.stat().st_size > _LARGEST:
                return None
            row: Any = json.loads(path.read_text(encoding="utf-8"))
            if not hmac.compare_digest(row["token"].encode(), resume.token.encode()):
                return None
            person = Person.load(self._folder / f"{resume.session}.person.json")
            x, y, z = row["placement"]["offset"]
            return Kept(
                row["token"],
                row["watch_token"],
                row["name"],
                changed(Settings(), row["settings"]),
                person,
                Placement(row["placement"]["heading"], (x, y, z)),
                row["worn"],
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, BodysenseError):
            return None

    def sweep(self) -> None:
        """Delete sessions that can no longer be resumed."""
        for path in self._folder.glob("*.json"):
            try:
                if time.time() - path.stat().st_mtime > 2 * self._seconds:
                    path.unlink(missing_ok=True)
            except OSError:
                continue
