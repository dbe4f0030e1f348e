"""Recordings that clients request, in the folder that the server allows."""

from __future__ import annotations

from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense_live.server.messages import Notice
from bodysense_live.server.session_slot import SessionSlot
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.recorder import Recorder


class Recordings:
    """All recordings of a process. `folder` None: recordings are not allowed. `seconds`: maximum length."""

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds

    @property
    def are_allowed(self) -> bool:
        """Whether clients may request recordings."""
        return self._folder is not None

    def add(self, slot: SessionSlot, answer: Answer) -> None:
        """Add an answer to the recording of its session, if there is one."""
        if slot.recorder is not None and not slot.recorder.add(answer):
            self.stop(slot)
            slot.send(Notice("the recording ended: it reached the maximum length"))

    def switch(self, slot: SessionSlot, on: bool) -> None:
        """Start or stop the recording of a session."""
        if self._folder is None:
            slot.send(Notice("the server does not record; start it with --allow-record and a folder"))
            return
        if not on:
            self.stop(slot)
        elif slot.recorder is None:
            try:
                slot.recorder = Recorder(self._folder, slot.session_id, slot.session.skeleton, self._seconds)
            except BodysenseError:
                slot.send(Notice("the server's folder for recordings cannot be written to"))
                return
            slot.send(Notice(f"recording to {slot.recorder.path.name}"))

    def stop(self, slot: SessionSlot) -> None:
        """Stop a recording, if there is one, and report the result."""
        if slot.recorder is None:
            return
        recorder, slot.recorder = slot.recorder, None
        try:
            frames = recorder.close()
        except BodysenseError as error:
            slot.send(Notice(str(error).replace(f"{recorder.path.parent}/", "")))
            return
        slot.send(Notice(f"recorded {frames} frames to {recorder.path.name}" if frames else "nothing to record"))
