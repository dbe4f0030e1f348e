"""Recording of a session to BVH files on the server's disk, under names that the server chooses.

The files are valid at every moment, so a server that is killed loses at most the poses of half a second.
"""

from __future__ import annotations

import os
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import count, pairwise
from pathlib import Path
from typing import IO

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.io.formats.bvh import BvhWriter, mend_bvh
from bodysense_live.security.safety import RecordingLimits
from bodysense_live.sessions.answer import Answer

RATE = 60.0  # Hz
LONGEST_GAP = 1.0  # s between two poses; after a longer one a new file begins
MOST_FILES = 100  # of one recording
MEND_AFTER = 10.0  # s since a file was written to, after which its writer is idle or was killed
_MEASURE_INTERVAL = 5.0  # s between two measurements of the folder
_SMALLEST = 4096  # bytes that a file takes at least on the disk
_MB = 1_000_000  # bytes


class Recorder:
    """One recording. Its methods block while the disk writes; each returns a notice for the wearer, or None.

    No error of the disk is raised: it ends the recording, and the file keeps the poses that were written before.
    The skeleton is that of the start. If inferred proportions change meanwhile, the root is moved so that the feet stay
    at their height.
    """

    def __init__(self, folder: Path, session: str, skeleton: Skeleton, limits: RecordingLimits) -> None:
        self._folder, self._skeleton, self._limits = folder, skeleton, limits
        self._stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{session[:8]}"
        self._file: IO[bytes] | None = None
        self._writer: BvhWriter | None = None
        self._paths: list[Path] = []  # files with poses, and the current one
        self._frames = self._size = 0  # of files that are finished; size in bytes
        self._start: float | None = None  # s, moment of the first pose
        self._last = 0.0  # s, moment of the last pose
        self._measured_at = -_MEASURE_INTERVAL  # s
        self.is_over = False

    def open(self) -> str:
        """Create the first file."""
        try:
            reason = self._folder_is_full() or self._next_file()
        except Exception as error:  # of the disk, or of ours: the session continues
            reason = _reason(error)
        if reason is not None:
            return self._end(reason)
        return f"recording to {self._paths[0].name}"

    def write(self, answers: Sequence[Answer]) -> str | None:
        """Write poses, which may reach a limit."""
        if self.is_over or not answers:
            return None
        try:
            for piece in _without_gaps(answers):
                if self._start is None:
                    self._start = piece[0].moment
                elif piece[0].moment - self._last > LONGEST_GAP:
                    reason = self._next_file()
                    if reason is not None:
                        return self._end(reason)
                self._append(piece)
            reason = self._limit_reached()
        except Exception as error:  # of the disk, or of ours: the session continues
            reason = _reason(error)
        return None if reason is None else self._end(reason)

    def close(self) -> str | None:
        """Finish the recording."""
        if self.is_over:
            return None
        self.is_over = True
        reason = self._finish_file()
        if reason is not None:
            return f"the recording ended: {reason}; {self._written()}"
        return self._written() if self._frames else "nothing to record"

    def _written(self) -> str:
        if not self._frames:
            return "nothing was recorded"
        others = f" and {len(self._paths) - 1} more files" if len(self._paths) > 1 else ""
        return f"recorded {self._frames} frames to {self._paths[0].name}{others}"

    def _end(self, reason: str) -> str:
        """End the recording before the wearer does."""
        self.is_over = True
        self._finish_file()
        return f"the recording ended: {reason}; {self._written()}"

    def _append(self, piece: Sequence[Answer]) -> None:
        assert self._writer is not None
        root = np.stack([answer.pose.root_position for answer in piece])
        # A body whose legs have another length than the recording's stands on the floor, too.
        root[:, 1] += _root_height(self._skeleton) - np.array([_root_height(one.pose.skeleton) for one in piece])
        pose = Pose(
            self._skeleton,
            root,
            np.stack([answer.pose.rotation for answer in piece]),
        )
        self._writer.append(np.array([answer.moment for answer in piece]), pose)
        self._last = piece[-1].moment

    def _next_file(self) -> str | None:
        """Finish the current file and begin the next one. Return why the recording must end, or None."""
        reason = self._finish_file()
        if reason is not None:
            return reason
        if len(self._paths) >= MOST_FILES:
            return f"the signal had {MOST_FILES} gaps of more than {LONGEST_GAP:g} s"
        path, self._file = _new_file(self._folder, self._stem)
        self._paths.append(path)
        self._writer = BvhWriter(self._file, self._skeleton, RATE)
        return None

    def _finish_file(self) -> str | None:
        """Close the current file, and remove it if it has no pose. Return why that failed, or None."""
        file, writer, reason = self._file, self._writer, None
        self._file = self._writer = None
        if file is None:
            return None
        try:
            if writer is not None:
                writer.finish()
        except Exception as error:  # of the disk, or of ours
            reason = _reason(error)
        try:
            file.close()
        except OSError as error:
            reason = reason or _reason(error)
        if writer is None or not writer.frames:
            with suppress(OSError):
                self._paths.pop().unlink()
        else:
            self._frames, self._size = self._frames + writer.frames, self._size + writer.size
        return reason

    def _limit_reached(self) -> str | None:
        """Return the limit that the recording has reached, or None."""
        limits, size = self._limits, self._size + (0 if self._writer is None else self._writer.size)
        if self._start is not None and self._last - self._start >= limits.seconds:
            return f"it reached the maximum length, {limits.seconds:g} s"
        if size >= limits.megabytes * _MB:
            return f"it reached the maximum size, {limits.megabytes:g} MB"
        return self._folder_is_full()

    def _folder_is_full(self) -> str | None:
        """Return that the folder has reached a limit, or None. The folder is measured at intervals."""
        now, limits = time.monotonic(), self._limits
        if now - self._measured_at < _MEASURE_INTERVAL:
            return None
        self._measured_at = now
        with os.scandir(self._folder) as entries:
            sizes = [max(entry.stat().st_size, _SMALLEST) for entry in entries if entry.name.endswith(".bvh")]
        if sum(sizes) >= limits.folder_megabytes * _MB:
            return f"the server's folder for recordings has its {limits.folder_megabytes:g} MB"
        if len(sizes) >= limits.folder_files:
            return f"the server's folder for recordings has its {limits.folder_files} files"
        return None


def mend_recordings(folder: Path) -> None:
    """Complete the files of recordings whose server was killed while it wrote to them."""
    with suppress(OSError):
        for path in sorted(folder.glob("*.bvh")):
            with suppress(OSError):  # of another user, or removed meanwhile
                if time.time() - path.stat().st_mtime > MEND_AFTER:  # noqa: TID251 (the clock of files)
                    mend_bvh(path)


def _new_file(folder: Path, stem: str) -> tuple[Path, IO[bytes]]:
    """Create a file with the first free name: STEM.bvh, STEM-2.bvh …"""
    for number in count(1):
        path = folder / f"{stem}{'' if number == 1 else f'-{number}'}.bvh"
        with suppress(FileExistsError):
            return path, open_file(path)
    raise AssertionError


def open_file(path: Path) -> IO[bytes]:
    """Create a file for writing. It is unbuffered: what was written survives the process."""
    return path.open("xb", buffering=0)


def _without_gaps(answers: Sequence[Answer]) -> Iterator[Sequence[Answer]]:
    """Yield the answers in pieces without a gap of more than `LONGEST_GAP`."""
    first = 0
    for k, (before, after) in enumerate(pairwise(answers), start=1):
        if after.moment - before.moment > LONGEST_GAP:
            yield answers[first:k]
            first = k
    yield answers[first:]


def _reason(error: Exception) -> str:
    """Return why a recording ended, without the names of folders. Errors that are not the disk's are printed."""
    if isinstance(error, OSError):
        return error.strerror or "the disk failed"
    traceback.print_exception(error)
    return "the server failed to write it"


def _root_height(skeleton: Skeleton) -> float:
    """Return the root's height in m above the lowest point of the T-pose."""
    return -float((skeleton.path @ skeleton.rest_offset)[:, 1].min())
