"""Writing a BVH file frame by frame, for motion that is too long to keep in memory."""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TextIO

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.rotation import quaternion_canonical, slerp
from bodysense.body.skeleton import Skeleton
from bodysense.files import written_beside
from bodysense.io.bvh import hierarchy_text, motion_text

_UNIT, _ORDER = 0.01, "ZXY"  # as `write_bvh` has them
_DIGITS = 12  # of the number of frames, which is written last
_SAME = 1e-4  # frames; Unix times are exact to 3e-7 s
_ROUNDED = 0.05  # frames by which the last one may come early: containers round times to a millisecond


class BvhStream(AbstractContextManager["BvhStream"]):
    """A BVH file that is written as motion comes, at a constant rate; it appears when the block ends well.

    Frames may come at any times: rotations between them are interpolated along the shorter arc, the root linearly.
    """

    def __init__(self, path: str | Path, skeleton: Skeleton, frame_rate: float) -> None:
        self._path, self._skeleton, self._rate = Path(path), skeleton, frame_rate
        self._stack = ExitStack()
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None
        self._begun = 0.0
        self.frames = 0

    def __enter__(self) -> BvhStream:
        with ExitStack() as stack:
            part = stack.enter_context(written_beside(self._path))
            self._file: TextIO = stack.enter_context(part.open("w", encoding="utf-8", newline="\n"))
            text, self._order = hierarchy_text(self._skeleton, _UNIT, _ORDER)
            self._file.write(f"{text}MOTION\nFrames: ")
            self._count = self._file.tell()
            self._file.write(f"{'':{_DIGITS}}\nFrame Time: {1 / self._rate:.10g}\n")
            self._stack = stack.pop_all()
        return self

    def append(self, time: np.ndarray, pose: Pose) -> None:
        """Add a motion (T, …) whose frames were taken at `time` (T,) s, which goes on increasing."""
        roots, rotations = np.asarray(pose.root_position), np.asarray(pose.rotation)[:, self._order]
        lines = []
        for moment, root, rotation in zip(time.tolist(), roots, rotations, strict=True):
            if self._last is None:
                self._begun, self._last = moment, (moment, root, rotation)
            before, root_before, rotation_before = self._last
            due = np.arange(self.frames, int(np.floor((moment - self._begun) * self._rate + _SAME)) + 1)
            share = ((self._begun + due / self._rate - before) / max(moment - before, 1e-9)).clip(0, 1)[:, None]
            shape = (len(due), *rotation.shape)
            turned = slerp(
                np.broadcast_to(rotation_before, shape),
                np.broadcast_to(rotation, shape),
                np.broadcast_to(share, shape[:2]),
            )
            place = (1 - share) * root_before + share * root
            if len(due):
                lines.append(motion_text(place, quaternion_canonical(turned), _UNIT, _ORDER))
            self.frames += len(due)
            self._last = (moment, root, rotation)
        self._file.write("".join(lines))

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            if self._last is not None and (self._last[0] - self._begun) * self._rate > self.frames - _ROUNDED:
                root, rotation = self._last[1:]
                self._file.write(motion_text(root[None], quaternion_canonical(rotation[None]), _UNIT, _ORDER))
                self.frames += 1
            self._file.seek(self._count)
            self._file.write(f"{self.frames:<{_DIGITS}}")
        self._stack.__exit__(*error)  # type: ignore[arg-type]
