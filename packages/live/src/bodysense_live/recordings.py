"""Recordings that clients ask for, in the one folder that the server allows."""

from __future__ import annotations

from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense_live.answer import Answer
from bodysense_live.messages import Notice
from bodysense_live.recorder import Recorder
from bodysense_live.seat import Seat


class Recordings:
    """All recordings of a process; `folder` None: recording is off."""

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds

    @property
    def are_allowed(self) -> bool:
        """Whether clients may ask for them."""
        return self._folder is not None

    def add(self, seat: Seat, answer: Answer) -> None:
        """Record an answer, where its session is recorded."""
        if seat.recorder is not None and not seat.recorder.add(answer):
            self.stop(seat)
            seat.tell(Notice("the recording ended: it was as long as it may be"))

    def switch(self, seat: Seat, on: bool) -> None:
        """Begin or end the recording of a session."""
        if self._folder is None:
            seat.tell(Notice("the server does not record; start it with --allow-record and a folder"))
            return
        if not on:
            self.stop(seat)
        elif seat.recorder is None:
            try:
                seat.recorder = Recorder(self._folder, seat.identity, seat.session.skeleton, self._seconds)
            except BodysenseError:
                seat.tell(Notice("the server's folder for recordings cannot be written to"))
                return
            seat.tell(Notice(f"recording to {seat.recorder.path.name}"))

    def stop(self, seat: Seat) -> None:
        """End a recording and report its result."""
        if seat.recorder is None:
            return
        recorder, seat.recorder = seat.recorder, None
        try:
            frames = recorder.close()
        except BodysenseError as error:
            seat.tell(Notice(str(error).replace(f"{recorder.path.parent}/", "")))
            return
        seat.tell(Notice(f"recorded {frames} frames to {recorder.path.name}" if frames else "nothing to record"))
