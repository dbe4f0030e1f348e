"""Recordings that clients ask for, in the one folder that the server allows."""

from __future__ import annotations

from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense_live.answer import Answer
from bodysense_live.messages import Notice
from bodysense_live.recorder import Recorder
from bodysense_live.session_slot import SessionSlot


class Recordings:
    """All recordings of a process; `folder` None: recording is off."""

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds

    @property
    def are_allowed(self) -> bool:
        """Whether clients may ask for them."""
        return self._folder is not None

    def add(self, slot: SessionSlot, answer: Answer) -> None:
        """Record an answer, where its session is recorded."""
        if slot.recorder is not None and not slot.recorder.add(answer):
            self.stop(slot)
            slot.send(Notice("the recording ended: it was as long as it may be"))

    def switch(self, slot: SessionSlot, on: bool) -> None:
        """Begin or end the recording of a session."""
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
        """End a recording and report its result."""
        if slot.recorder is None:
            return
        recorder, slot.recorder = slot.recorder, None
        try:
            frames = recorder.close()
        except BodysenseError as error:
            slot.send(Notice(str(error).replace(f"{recorder.path.parent}/", "")))
            return
        slot.send(Notice(f"recorded {frames} frames to {recorder.path.name}" if frames else "nothing to record"))
