"""Markers of a live stream: a layout is learned from some frames, and converts every frame on its own.

The layout is that of a take (`recording.recording_of`), so frames that are converted live equal those of a file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bodysense.io.markers.body_layout import MarkerLayout
from bodysense.io.markers.marker_sets import recognised
from bodysense.io.markers.raw_markers import FileWorld, MarkerFormat, RawMarkers, glove_labels, points_alone
from bodysense.io.markers.recording import recording_of
from bodysense.io.rigs.names import joints_of
from bodysense.observing.observation import Observation
from bodysense.observing.points import joined_points


@dataclass(frozen=True, eq=False)
class StreamLayout:
    """How the points of a person follow from a stream's markers. It has no state."""

    names: tuple[str, ...]  # of the markers that it was learned from
    world: FileWorld  # between the stream and our world
    body: MarkerLayout | None = None
    gloves: Mapping[str, int] = field(default_factory=dict)  # our names of the markers of gloves → index in `names`
    remarks: tuple[str, ...] = ()  # what was recognised, and what was left out
    warnings: tuple[str, ...] = ()  # dropped labels, and limbs that are guessed

    def columns_in(self, names: Sequence[str]) -> np.ndarray:
        """Return the index of each marker of the layout among the markers of a frame, (M,); -1 for missing ones."""
        place = {name: k for k, name in enumerate(names)}
        return np.array([place.get(name, -1) for name in self.names], dtype=int)

    def observe(
        self, columns: np.ndarray, position: np.ndarray, rotation: np.ndarray | None, time: np.ndarray
    ) -> Observation:
        """Return the joints and markers of gloves in frames.

        Args:
            columns: of the layout's markers in the frames (`columns_in`).
            position: (T, N, 3) of all markers of the frames, in the stream's unit and axes; NaN where hidden.
            rotation: (T, N, 4) wxyz of rigid bodies and bones, or None.
            time: (T,) s.
        """
        position = _chosen(position, columns)
        gloves = points_alone(tuple(self.gloves), self.world.to_ours(position[:, list(self.gloves.values())]), time)
        if self.body is None:
            return gloves
        body = self.body.observe(position, None if rotation is None else _chosen(rotation, columns), time)
        return joined_points(body, gloves) if self.gloves else body


def learn_layout(raw: RawMarkers, form: MarkerFormat, place: str) -> StreamLayout:
    """Learn the layout of a stream from some of its frames; `place` names the stream in messages.

    Rigid bodies that are named as joints count without a marker set, too. Raises BodysenseError, naming the fix, if
    there is neither a body nor a glove.
    """
    if form.names is None and not glove_labels(raw, form) and recognised(raw.names) is None:
        turned = [] if raw.rotation is None else np.flatnonzero(np.isfinite(raw.rotation).any(axis=(0, 2)))
        named = joints_of([raw.names[k] for k in turned])  # of rigid bodies
        form = replace(form, names=named) if named else form
    found = recording_of(raw, form, place)
    own = found.raw  # of one subject
    gloves = {ours: own.names.index(name) for name, ours in glove_labels(own, form).items()}
    return StreamLayout(own.names, found.world, found.layout, gloves, found.remarks, found.warnings)


def _chosen(values: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return columns of values (T, N, C) as (T, M, C); NaN for columns of -1."""
    chosen = np.full((len(values), len(columns), values.shape[-1]), np.nan)
    here = columns >= 0
    chosen[:, here] = values[:, columns[here]]
    return chosen
