"""The file of whoever the server's own inputs track: written when they are calibrated, read by the next start."""

from __future__ import annotations

from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.serve.messages import Said
from bodysense.serve.seat import Seat


class WearerFile:
    """A person's file; `path` None: none is kept."""

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def keep(self, seat: Seat) -> None:
        """Write the wearer of a session, where they were calibrated since the last call."""
        wearer, seat.session.calibrated = seat.session.calibrated, None
        if wearer is None or self._path is None:
            return
        try:
            wearer.save(self._path)
        except (OSError, BodysenseError) as error:
            seat.tell(Said(f"your file cannot be written: {error}"))
