"""Recordings that clients request, in the folder that the server allows.

One thread writes all recordings of a process, so that a slow, full or broken disk delays no wearer.
"""

from __future__ import annotations

import asyncio
import queue
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from bodysense_live.security.safety import RecordingLimits
from bodysense_live.server.messages import Notice
from bodysense_live.server.session_slot import SessionSlot
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.recorder import MEND_AFTER, Recorder, mend_recordings

_BATCH = 64  # poses that are written at once
_BATCH_SECONDS = 0.5  # s; older poses are written even if they are few
_MOST_PENDING = 8  # batches of a recording that wait for the disk; more end the recording
_MOST_JOBS = 256  # of all recordings that wait for the disk; more allow no new recording
_TO_FINISH = 2.0  # s for which a server that stops waits for the disk

Job = Callable[[], str | None]  # returns a notice for the wearer, or None


@dataclass(eq=False)
class RunningRecording:
    """A recording as the event loop knows it; only the writer's thread uses `recorder`."""

    recorder: Recorder
    batch: list[Answer] = field(default_factory=list)
    pending: int = 0  # batches that wait for the disk


class Recordings:
    """All recordings of a process. Use it within the event loop only.

    `folder` None: recordings are not allowed.
    """

    def __init__(self, folder: Path | None, limits: RecordingLimits) -> None:
        self._folder, self._limits = folder, limits
        self._jobs: queue.SimpleQueue[tuple[Job, Callable[[str | None], None]] | None] = queue.SimpleQueue()
        self._waiting = 0  # jobs
        self._recordings: dict[SessionSlot, RunningRecording] = {}
        self._thread: threading.Thread | None = None

    @property
    def are_allowed(self) -> bool:
        """Whether clients may request recordings."""
        return self._folder is not None

    def start(self) -> None:
        """Mend what a killed server left in the folder, after a while. Call it in a running event loop."""
        self._loop = asyncio.get_running_loop()
        if self._folder is not None:
            mend = partial(self._queue_job, partial(mend_recordings, self._folder), lambda text: None)
            self._mending = self._loop.call_later(MEND_AFTER, mend)

    def add(self, slot: SessionSlot, answer: Answer) -> None:
        """Add an answer to the recording of its session, if there is one."""
        recording = self._recordings.get(slot)
        if recording is None:
            return
        recording.batch.append(answer)
        if len(recording.batch) < _BATCH and answer.received - recording.batch[0].received < _BATCH_SECONDS:
            return
        if recording.pending < _MOST_PENDING:
            self._write(slot, recording)
        else:
            slot.send(Notice("the recording ended: the server's disk is too slow"))
            recording.batch.clear()
            self.stop(slot)

    def switch(self, slot: SessionSlot, on: bool) -> None:
        """Start or stop the recording of a session."""
        if self._folder is None:
            slot.send(Notice("the server does not record; start it with --allow-record and a folder"))
        elif not on:
            self.stop(slot)
        elif slot in self._recordings:
            return
        elif self._waiting >= _MOST_JOBS:
            slot.send(Notice("the server's disk is too slow to record; try again later"))
        else:
            recorder = Recorder(self._folder, slot.session_id, slot.session.skeleton, self._limits)
            recording = self._recordings[slot] = RunningRecording(recorder)
            self._do(slot, recording, recorder.open)

    def stop(self, slot: SessionSlot) -> None:
        """Stop a recording, if there is one. Its clients get the result."""
        recording = self._recordings.pop(slot, None)
        if recording is not None:
            self._write(slot, recording)
            self._do(slot, recording, recording.recorder.close)

    async def finish(self) -> None:
        """Wait, for a limited time, until all stopped recordings are written."""
        if self._folder is not None:
            self._mending.cancel()
        if self._thread is None:
            return
        written = asyncio.Event()
        self._queue_job(lambda: None, lambda text: written.set())
        self._jobs.put(None)
        with suppress(TimeoutError):
            async with asyncio.timeout(_TO_FINISH):
                await written.wait()

    def _write(self, slot: SessionSlot, recording: RunningRecording) -> None:
        batch, recording.batch = recording.batch, []
        self._do(slot, recording, partial(recording.recorder.write, batch))

    def _do(self, slot: SessionSlot, recording: RunningRecording, job: Job) -> None:
        """Queue a job of a recording; send its notice, and forget the recording if it is over."""
        recording.pending += 1

        def done(text: str | None) -> None:
            recording.pending -= 1
            if text is not None:
                slot.send(Notice(text))
            if recording.recorder.is_over and self._recordings.get(slot) is recording:
                del self._recordings[slot]

        self._queue_job(job, done)

    def _queue_job(self, job: Job, done: Callable[[str | None], None]) -> None:
        """Run a job in the thread, then `done` in the event loop with its result."""
        self._waiting += 1
        self._jobs.put((job, done))
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="recordings", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while (item := self._jobs.get()) is not None:
            job, done = item
            try:
                text = job()
            except Exception:  # of ours; the thread must not end
                traceback.print_exc()
                text = None
            with suppress(RuntimeError):  # the event loop is closed
                self._loop.call_soon_threadsafe(self._finish_job, done, text)

    def _finish_job(self, done: Callable[[str | None], None], text: str | None) -> None:
        self._waiting -= 1
        done(text)
