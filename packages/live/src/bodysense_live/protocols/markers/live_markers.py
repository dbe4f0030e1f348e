"""The person in a marker stream: a layout that is learned when markers appear, and frames converted by it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from bodysense.body.hands.hand import Side, glove_hands, hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.io.markers.body_layout import MarkerLayout
from bodysense.io.markers.raw_markers import MarkerFormat, points_alone, world_of
from bodysense.io.markers.stream import StreamLayout
from bodysense.observing.checks import FARTHEST
from bodysense.observing.observation import Observation
from bodysense.observing.points import joined_points
from bodysense_live.protocols.markers.stream_frame import StreamFrame, raw_of

SPANS = (0.5, 2.0, 8.0)  # s of frames from which the layout is learned: soon, and then better
_AGAIN = 2.0  # s between looks for markers that were never seen when the layout was learned
_SHARE = 0.5  # of these frames in which such a marker must be seen
_CLOCK_SET = 1.0  # s; a larger step, forward or back, means that the server's clock was set


class LiveMarkers:
    """The conversion of one stream.

    Args:
        form: facts that the server omits.
        unlabelled: gloves to find among points without a name.
    """

    def __init__(self, form: MarkerFormat, unlabelled: Sequence[Side] = ()) -> None:
        self._form, self._unlabelled = form, tuple(unlabelled)
        self.layout: StreamLayout | None = None
        self._names: tuple[str, ...] = ()
        self._columns = np.zeros(0, dtype=int)
        self._frames: deque[StreamFrame] = deque()
        self._learned = 0  # number of spans from which the layout was learned
        self._tried = 0.0  # s of frames of the last attempt, if it failed
        self._seen = np.zeros(0, dtype=bool)  # (M,) markers that were seen when the layout was learned
        self._labeller = _Labeller(self._unlabelled) if unlabelled else None

    def add(self, frame: StreamFrame) -> str | None:
        """Take a frame to learn from. Return a line about other markers than before, or None."""
        text = None
        if frame.names != self._names:
            text = _changes(self._names, frame.names) if self._names else None
            self._names = frame.names
            self._frames.clear()
            self._learned, self._tried = 0, 0.0
            if self.layout is not None:
                self._columns = self.layout.columns_in(frame.names)
        if self._frames and not 0 < frame.time - self._frames[-1].time < _CLOCK_SET:
            if 0 >= frame.time - self._frames[-1].time > -_CLOCK_SET:
                return text  # out of order
            self._frames.clear()
        self._frames.append(frame)
        longest = SPANS[-1] if self._learned < len(SPANS) else _AGAIN
        while frame.time - self._frames[0].time > longest:
            self._frames.popleft()
        return text

    @property
    def is_due(self) -> bool:
        """Whether the layout is to be learned from the frames so far."""
        if not self._names or len(self._frames) < 2:
            return False
        span = self._frames[-1].time - self._frames[0].time
        if self._learned < len(SPANS):
            needed = max(SPANS[self._learned], min(2 * self._tried, SPANS[-1]))
            return span >= 0.99 * needed and span > 1.1 * self._tried
        if span < 0.99 * _AGAIN:
            return False
        share = np.mean([np.isfinite(frame.position[:, 0]) for frame in self._frames], axis=0)
        is_new = bool((~self._seen & (share >= _SHARE)).any())
        if not is_new:
            self._frames.clear()
        return is_new

    def window(self) -> list[StreamFrame]:
        """Return the frames to learn from."""
        return list(self._frames)

    def adopt(self, layout: StreamLayout) -> list[str]:
        """Use a layout. Return lines that describe it, if they differ from those of the one before."""
        before, self.layout = self.layout, layout
        self._learned, self._tried = min(self._learned + 1, len(SPANS)), 0.0
        self._columns = layout.columns_in(self._names)
        self._seen = np.any([np.isfinite(frame.position[:, 0]) for frame in self._frames], axis=0)
        if before is not None and before.names == layout.names and set(_joints(before)) == set(_joints(layout)):
            return []
        gloves = " and ".join(glove_hands(layout.gloves))
        lines = [*layout.remarks, *(f"warning: {text}" for text in layout.warnings)]
        return [*lines, f"{gloves} glove: {len(layout.gloves)} markers"] if gloves else lines

    def fail(self) -> None:
        """Wait for twice as many frames, after no layout was found."""
        self._tried = self._frames[-1].time - self._frames[0].time if self._frames else 0.0
        if self._tried >= 0.9 * SPANS[-1]:
            self._frames.clear()
            self._tried = 0.0

    def drop_gloves(self) -> None:
        """Use the body alone from now on."""
        self._labeller = None
        if self.layout is not None:
            self.layout = StreamLayout(self.layout.names, self.layout.world, self.layout.body)

    def observe(self, frame: StreamFrame) -> Observation | None:
        """Return the person's points in a frame, or None before the layout is known."""
        time, found = np.array([frame.time]), list[Observation]()
        if self.layout is not None:
            rotation = None if frame.rotation is None else frame.rotation[None]
            with np.errstate(invalid="ignore"):
                found.append(self.layout.observe(self._columns, frame.position[None], rotation, time))
        if self._labeller is not None:
            world = self.layout.world if self.layout is not None else world_of(raw_of([frame]), self._form)
            found.append(self._labeller.label(world.to_ours(frame.unnamed), frame.time))
        if not found:
            return None
        observation = found[0]
        for one in found[1:]:
            observation = joined_points(observation, one)
        far = ~(np.abs(np.nan_to_num(observation.position)).max(axis=-1) < FARTHEST)
        observation.has_position[far] = False
        return observation


class _Labeller:
    """Gloves among points without a name."""

    def __init__(self, sides: tuple[Side, ...]) -> None:
        from bodysense.devices.gloves.labels.labelling import Labeller

        self._labeller = Labeller({side: hand_skeleton(default_skeleton(), side) for side in sides})
        self._state = self._labeller.start()
        self._time = -np.inf  # s, of the last frame

    def label(self, points: np.ndarray, time: float) -> Observation:
        """Return the markers of gloves among points (N, 3) m."""
        if not 0 < time - self._time < _CLOCK_SET:
            self._state = self._labeller.start()
        self._time = time
        names = tuple(map(str, range(len(points))))
        known = points[np.isfinite(points).all(axis=1)]
        observed = points_alone(names[: len(known)], known[None], np.array([time]))
        labelled, self._state = self._labeller.step(observed, self._state)
        return labelled


def _joints(layout: StreamLayout) -> tuple[str, ...]:
    body: MarkerLayout | None = layout.body
    return (*(() if body is None else body.accuracy), *layout.gloves)


def _changes(before: tuple[str, ...], after: tuple[str, ...]) -> str:
    """Describe in one line which markers came and went."""
    came, went = [name for name in after if name not in before], [name for name in before if name not in after]
    parts = [
        f"{len(names)} {what} ({', '.join(names[:4])}{' …' if len(names) > 4 else ''})"
        for names, what in ((came, "new"), (went, "gone"))
        if names
    ]
    return f"other markers: {' and '.join(parts) or 'another order'}"
