"""Recording of a session to a BVH file on the server's disk, under a name that the server chooses."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.io.formats.bvh import BvhStream
from bodysense_live.sessions.answer import Answer

RATE = 60.0  # Hz
_BATCH = 64  # poses per write


class Recorder:
    """A recorder of poses. The file appears under `path` when the recorder is closed.

    The skeleton is that of the start. If inferred proportions change meanwhile, the root is moved so that the feet stay
    at their height. Raises BodysenseError if the file cannot be written.
    """

    def __init__(self, folder: Path, session: str, skeleton: Skeleton, max_seconds: float) -> None:
        self.path = folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{session[:8]}.bvh"
        self._stream = BvhStream(self.path, skeleton, RATE)
        self._stream.__enter__()
        self._skeleton, self._max_seconds = skeleton, max_seconds
        self._waiting: list[Answer] = []
        self._start: float | None = None

    def add(self, answer: Answer) -> bool:
        """Add a pose. Return False if the recording has reached its maximum length."""
        if self._start is None:
            self._start = answer.moment
        self._waiting.append(answer)
        if len(self._waiting) >= _BATCH:
            self._write()
        return answer.moment - self._start < self._max_seconds

    def close(self) -> int:
        """Finish the file. Return its number of frames; without any, no file appears."""
        self._write()
        if self._stream.frames:
            self._stream.__exit__(None, None, None)
        else:
            with suppress(ValueError):
                self._stream.__exit__(ValueError, ValueError("nothing was recorded"), None)
        return self._stream.frames

    def _root_position(self, pose: Pose) -> np.ndarray:
        """Return the root's position on the recording's skeleton, whose legs may have another length, (3,) m."""
        if pose.skeleton is self._skeleton:
            return pose.root_position
        return pose.root_position + np.array([0.0, _root_height(self._skeleton) - _root_height(pose.skeleton), 0.0])

    def _write(self) -> None:
        if not self._waiting:
            return
        pose = Pose(
            self._skeleton,
            np.stack([self._root_position(answer.pose) for answer in self._waiting]),
            np.stack([answer.pose.rotation for answer in self._waiting]),
        )
        self._stream.append(np.array([answer.moment for answer in self._waiting]), pose)
        self._waiting.clear()


def _root_height(skeleton: Skeleton) -> float:
    """Return the root's height in m above the lowest point of the T-pose."""
    return -float((skeleton.path @ skeleton.rest_offset)[:, 1].min())
